//! Settings of a tempered run.

use crate::error::{Error, Result};
use crate::limits::{Memory, in_range};
use crate::output::MIN_ESS;
use serde::{Deserialize, Serialize};

/// Maximum number of SMC particles of an SMC sampler: each has a random stream of its own.
const MAX_PARTICLES: usize = 1 << 19;

/// Minimum number of MCMC steps at each temperature, if their number is not given.
const MIN_MCMC_STEPS: usize = 8;

/// Scans of the longest part of an extension over those of the last round.
const PART: usize = 4;

/// Temperatures that an SMC sampler passes from the prior to the posterior, for the estimate of memory. A posterior of 13 parameters needs
/// about 30.
const LEVELS: f64 = 64.0;

/// Copies of the coordinates of a draw when the result is put together.
const COPIES: f64 = 6.0;

/// Other numbers of a draw: ln L, weight, derived quantities, labels.
const NUMBERS_PER_DRAW: f64 = 16.0;

/// States of the pools of one temperature.
const POOL: f64 = 2_048.0;

/// Maximum number of examples that a surrogate is fitted to: more do not make it better (docs/decisions.md, section 3).
pub(super) const EXAMPLES_KEPT: usize = 150_000;

/// Draws that a mixture is fitted to, copies of them while it is, and its components.
const TRAINING: f64 = 15_000.0;
const COPIES_OF_TRAINING: f64 = 4.0;
const COMPONENTS: f64 = 64.0;

/// Settings of a tempered run; the defaults suit smooth posteriors of up to a few dozen parameters.
///
/// The cost in gradients is about `2^rounds first_scans x chain_sets x temperatures x hmc_transitions x leapfrogs`, where leapfrogs
/// is 2-10 for a temperature whose metric fits and at most `max_leapfrogs`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// Number of independent chain sets, at least 2: their scatter gives the errors.
    pub chain_sets: usize,
    /// Rounds, each twice as long as the one before; all but the last adapt.
    pub rounds: usize,
    /// Maximum number of extensions of the last round: 0 for a round of fixed length. The first is as long as the round
    /// itself, the second and third are twice, the fourth and fifth four times as long, and so on. The run ends after
    /// two extensions in succession at whose ends all draws that count pass the checks ([module](super)). From the prior
    /// all scans of the last round count. From a mixture the round itself does not, and mixture, temperatures and
    /// metrics are fitted anew to all draws before each extension. A run that ended too soon is continued from its
    /// checkpoint if more are allowed.
    pub extensions: usize,
    /// Effective sample size, the smallest of bulk and tails, that the checks want of all draws, and half of it of the newest extension;
    /// R-hat may be 1.01, and more where it is below 400.
    pub target_ess: f64,
    /// Scans of the first round.
    pub first_scans: usize,
    /// Temperatures of the first rounds.
    pub temperatures: usize,
    /// Minimum number of temperatures later on, which keeps neighbouring temperatures close enough for one-sided
    /// estimates of the evidence to serve as a check. If equal to `temperatures` and `max_temperatures`, the number is
    /// fixed.
    pub min_temperatures: usize,
    /// Maximum number of temperatures later on.
    pub max_temperatures: usize,
    /// Mean acceptance of HMC transitions to which step sizes are adapted.
    pub target_acceptance: f64,
    /// Maximum number of leapfrog steps of one HMC transition; 1 is MALA.
    pub max_leapfrogs: usize,
    /// Mean length of a trajectory in metric units.
    pub trajectory: f64,
    /// HMC transitions per scan and temperature; 0: none, if there are slice updates.
    pub hmc_transitions: usize,
    /// SMC particles per chain set, moved from the prior to the posterior to find the first states, temperatures and
    /// metrics; 0: draws of the prior everywhere. For posteriors of many modes.
    pub smc_particles: usize,
    /// Independent SMC samplers, at most one per chain set; chain set `k` starts from number `k` modulo their number.
    /// One SMC sampler of many particles weighs its modes against each other; many samplers of few particles only show
    /// how uncertain each is. Errors are by the scatter of SMC samplers.
    pub smc_samplers: usize,
    /// MCMC steps of each SMC particle per temperature; 0: as many as parameters, at least 8. The first is a slice update; the others are moves
    /// along the surrogate, if there is one, or slice updates. With too few the particles are not in equilibrium, and ln Z is too small.
    pub mcmc_steps: usize,
    /// Slice updates per scan and temperature, before the HMC transitions: for likelihoods too rough for long
    /// trajectories. Each costs several values and no gradient.
    pub slice_updates: usize,
    /// Whether a surrogate of ln L is fitted, to the values of the SMC samplers and of the chains, before each step in temperature of the SMC
    /// samplers, before the first round, after each, and eight times in an extension. In every scan each chain but the hottest then makes moves along it that ln L accepts
    /// ([module](super)), in place of `hmc_transitions`. For likelihoods that cost much, are rough, or have no gradient.
    pub surrogate: bool,
    /// Number of rounds at the end whose reference is a mixture fitted to earlier draws, most of them of the round
    /// before, plus a little of the prior: a shorter annealing path. 0: the reference is always the prior. With as many
    /// as `rounds`, the first reference is fitted to the SMC particles, or is the prior without them.
    pub mixture_rounds: usize,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            chain_sets: 4,
            rounds: 10,
            extensions: 0,
            target_ess: MIN_ESS,
            first_scans: 4,
            temperatures: 20,
            min_temperatures: 8,
            max_temperatures: 64,
            target_acceptance: 0.8,
            max_leapfrogs: 256,
            trajectory: std::f64::consts::FRAC_PI_2,
            hmc_transitions: 1,
            smc_particles: 0,
            smc_samplers: 4,
            mcmc_steps: 0,
            slice_updates: 0,
            surrogate: false,
            mixture_rounds: 0,
        }
    }
}

impl Settings {
    /// Maximum number of extensions of the last round: they are then 12,285 times as long as the round.
    pub const MAX_EXTENSIONS: usize = 24;

    /// Scans of the last round (0) or of one of its extensions (from 1 on).
    #[must_use]
    pub(super) fn scans_of_extension(&self, extension: usize) -> usize {
        self.scans(self.rounds - 1) << (extension / 2)
    }

    /// Scans of the parts of the last round (0) or of one of its extensions. A part has references, temperatures and metrics of its own on a
    /// path from a mixture; those of a long extension would else be old at its end.
    pub(super) fn parts_of_extension(&self, extension: usize) -> impl Iterator<Item = usize> {
        let all = self.scans_of_extension(extension);
        let most = if self.mixture_rounds > 0 {
            PART * self.scans(self.rounds - 1)
        } else {
            all
        };
        (0..all).step_by(most).map(move |done| most.min(all - done))
    }

    /// Scans of the last round with so many extensions.
    #[must_use]
    pub(super) fn scans_with(&self, extensions: usize) -> usize {
        (0..=extensions)
            .map(|extension| self.scans_of_extension(extension))
            .sum()
    }

    /// Scans of a round, the first of which is 0.
    #[must_use]
    pub fn scans(&self, round: usize) -> usize {
        self.first_scans << round
    }

    /// Whether the reference of a round, the first of which is 0, is to be a mixture.
    #[must_use]
    pub(super) fn mixes(&self, round: usize) -> bool {
        (round > 0 || self.smc_particles > 0) && round + self.mixture_rounds >= self.rounds
    }

    /// Number of independent clusters of chain sets.
    #[must_use]
    pub fn clusters(&self) -> usize {
        if self.smc_particles > 0 {
            self.smc_samplers.min(self.chain_sets)
        } else {
            self.chain_sets
        }
    }

    /// SMC particles of each SMC sampler: rounded up, so that no chain set has fewer than its own.
    #[must_use]
    pub fn particles_per_sampler(&self) -> usize {
        (self.smc_particles * self.chain_sets).div_ceil(self.clusters())
    }

    /// MCMC steps per temperature, for a target of `dim` parameters.
    #[must_use]
    pub(super) fn mcmc_steps(&self, dim: usize) -> usize {
        if self.mcmc_steps > 0 {
            self.mcmc_steps
        } else {
            dim.max(MIN_MCMC_STEPS)
        }
    }

    /// Checks every number by itself: the ranges of docs/limits.md.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] names the first one that is out of its range.
    pub fn check_ranges(&self) -> Result<()> {
        in_range("chain_sets", self.chain_sets, 2..=1024)?;
        in_range("rounds", self.rounds, 2..=24)?;
        in_range("extensions", self.extensions, 0..=Self::MAX_EXTENSIONS)?;
        in_range("target_ess", self.target_ess, 50.0..=1e7)?;
        in_range("first_scans", self.first_scans, 2..=4096)?;
        in_range("temperatures", self.temperatures, 3..=1024)?;
        in_range("min_temperatures", self.min_temperatures, 3..=1024)?;
        in_range("max_temperatures", self.max_temperatures, 3..=1024)?;
        in_range("target_acceptance", self.target_acceptance, 0.2..=0.99)?;
        in_range("max_leapfrogs", self.max_leapfrogs, 1..=100_000)?;
        in_range("trajectory", self.trajectory, 1e-3..=1e3)?;
        in_range("hmc_transitions", self.hmc_transitions, 0..=1000)?;
        in_range("smc_particles", self.smc_particles, 0..=65_536)?;
        in_range("smc_samplers", self.smc_samplers, 2..=1024)?;
        in_range("mcmc_steps", self.mcmc_steps, 0..=1000)?;
        in_range("slice_updates", self.slice_updates, 0..=1000)?;
        in_range("mixture_rounds", self.mixture_rounds, 0..=24)?;
        Ok(())
    }

    /// Checks whether a run of `dim` parameters can work with these numbers.
    ///
    /// # Errors
    /// As of [`check_ranges`](Self::check_ranges); [`Error::Setting`] for numbers that do not go together;
    /// [`Error::TooMuchMemory`] by the estimate of [`memory`](Self::memory).
    pub fn check(&self, dim: usize) -> Result<()> {
        self.check_ranges()?;
        if !(self.min_temperatures..=self.max_temperatures).contains(&self.temperatures) {
            return Err(Error::Setting {
                name: "temperatures",
                value: self.temperatures.to_string(),
                remedy: "give a number from min_temperatures to max_temperatures",
            });
        }
        if self.hmc_transitions + self.slice_updates == 0 {
            return Err(Error::Setting {
                name: "hmc_transitions",
                value: self.hmc_transitions.to_string(),
                remedy: "give at least one HMC transition or slice update per scan",
            });
        }
        let remedy = if self.hmc_transitions > 0 {
            Some(
                "give no HMC transitions, whose place moves along the surrogate take, or no surrogate",
            )
        } else if self.smc_particles == 0 {
            Some("give SMC particles, from which the first surrogate learns, or no surrogate")
        } else {
            None
        };
        if let (true, Some(remedy)) = (self.surrogate, remedy) {
            return Err(Error::Setting {
                name: "surrogate",
                value: self.surrogate.to_string(),
                remedy,
            });
        }
        if self.particles_per_sampler() > MAX_PARTICLES {
            return Err(Error::Setting {
                name: "smc_particles",
                value: self.smc_particles.to_string(),
                remedy: "give fewer SMC particles per chain set, fewer chain sets or more SMC samplers: an SMC sampler has at most 2^19",
            });
        }
        self.memory(dim).check()?;
        Ok(())
    }

    /// An estimate of the memory of a run of `dim` parameters: the levels of its SMC samplers, or its last round with
    /// all extensions, or the positions of the longest round that a mixture is fitted to, whichever is largest, since
    /// they are not held together; and the mixture's fit.
    #[must_use]
    pub fn memory(&self, dim: usize) -> Memory {
        const NUMBER: f64 = size_of::<f64>() as f64;
        let (dim, chain_sets) = (dim as f64, self.chain_sets as f64);
        let temperatures = self.max_temperatures as f64;
        // Of every level coordinates and ln L, twice when the chain sets begin.
        let particles = (self.clusters() * self.particles_per_sampler()) as f64;
        let levels = Memory::default().with(
            "smc_particles",
            NUMBER * particles * 2.0 * LEVELS * (dim + 1.0),
        );
        // Of every scan ln L at all temperatures; coordinates as drawn, by parameter, and as the result's draws.
        let scans = chain_sets * self.scans(self.rounds - 1) as f64;
        let scan = NUMBER * (temperatures + COPIES * dim + NUMBERS_PER_DRAW);
        let more = chain_sets * self.scans_with(self.extensions) as f64 - scans;
        let last = Memory::default()
            .with("rounds", scan * scans)
            .with("extensions", scan * more);
        // Every move of every scan of the round before.
        let hmc_transitions = (self.slice_updates + self.hmc_transitions) as f64;
        let mixes = self.mixture_rounds > 0;
        let trails = if mixes {
            0.5 * scans * hmc_transitions
        } else {
            0.0
        };
        let trails = Memory::default().with("rounds", NUMBER * 2.0 * dim * trails);
        let held = [levels, last, trails];
        // Examples in single precision as kept, twice while a state changes, chosen and in the network's units; as many residuals as
        // coordinates twice.
        let examples = if self.surrogate { EXAMPLES_KEPT } else { 0 } as f64;
        let examples = Memory::default().with("surrogate", 20.0 * examples * 3.0 * dim);
        let most = held
            .into_iter()
            .max_by(|a, b| a.bytes().total_cmp(&b.bytes()));
        // At every temperature two matrices, and the states of its pools.
        let temperature = NUMBER * dim * (2.0 * dim + POOL);
        let memory = most
            .unwrap_or_default()
            .and(&examples, "")
            .with("max_temperatures", temperature * temperatures);
        if mixes {
            let row = NUMBER * (COPIES_OF_TRAINING * dim + COMPONENTS);
            memory.with("mixture_rounds", TRAINING * row)
        } else {
            memory
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_that_do_not_go_together_are_refused_by_name() {
        let name = |change: &dyn Fn(&mut Settings)| {
            let mut settings = Settings::default();
            change(&mut settings);
            match settings.check(3) {
                Err(Error::Setting { name, .. }) => name,
                other => panic!("{other:?}"),
            }
        };
        assert!(Settings::default().check(3).is_ok());
        assert_eq!(name(&|s| s.temperatures = 65), "temperatures");
        assert_eq!(name(&|s| s.min_temperatures = 65), "temperatures");
        assert_eq!(name(&|s| s.hmc_transitions = 0), "hmc_transitions");
        let crowd = |s: &mut Settings| (s.smc_particles, s.chain_sets) = (65_536, 1024);
        assert_eq!(name(&crowd), "smc_particles");
    }

    #[test]
    fn a_run_that_would_remember_too_much_is_refused_by_name() {
        let key = |change: &dyn Fn(&mut Settings)| {
            let mut settings = Settings::default();
            change(&mut settings);
            match settings.check(13) {
                Err(Error::TooMuchMemory(much)) => much.key,
                other => panic!("{other:?}"),
            }
        };
        assert_eq!(key(&|s| s.rounds = 24), "rounds");
        let long = |s: &mut Settings| (s.rounds, s.extensions) = (12, 24);
        assert_eq!(key(&long), "extensions");
        let crowd =
            |s: &mut Settings| (s.smc_particles, s.chain_sets, s.smc_samplers) = (65_536, 64, 64);
        assert_eq!(key(&crowd), "smc_particles");
    }
}
