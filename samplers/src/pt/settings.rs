//! Settings of a tempered run.

use crate::error::{Error, Result};
use serde::{Deserialize, Serialize};

/// Most SMC particles of an SMC sampler: each has a random stream of its own.
const MAX_PARTICLES: usize = 1 << 19;

/// Fewest MCMC steps at each temperature, if their number is not given.
const MIN_MCMC_STEPS: usize = 8;

/// Settings of a tempered run; the defaults suit smooth posteriors of up to a few dozen parameters.
///
/// The cost in gradients is about `2^rounds first_scans x chain_sets x temperatures x hmc_transitions x leapfrogs`, where leapfrogs
/// is 2-10 for a temperature whose metric fits and at most `max_leapfrogs`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// Independent chain sets, at least 2: their agreement is the measure of the error.
    pub chain_sets: usize,
    /// Rounds, each twice as long as the one before; all but the last adapt.
    pub rounds: usize,
    /// Maximum number of extensions: the last round is continued for as long again until the run passes its checks. 0: none.
    /// From the prior all scans count. From a mixture the mixture, temperatures and metrics are fitted anew to all draws
    /// before each extension, and the later half of the extensions counts, rounded up. A run that ended too soon is
    /// continued from its checkpoint if more are allowed.
    pub extensions: usize,
    /// Scans of the first round.
    pub first_scans: usize,
    /// Temperatures of the first rounds.
    pub temperatures: usize,
    /// Fewest temperatures later on: gaps stay narrow enough for one-sided estimates of the evidence to serve as a check. If
    /// equal to `temperatures` and `max_temperatures`, the number is fixed.
    pub min_temperatures: usize,
    /// Most temperatures later on.
    pub max_temperatures: usize,
    /// Mean acceptance of HMC transitions to which step sizes are adapted.
    pub target_acceptance: f64,
    /// Most leapfrog steps of one HMC transition; 1 is MALA.
    pub max_leapfrogs: usize,
    /// Mean length of a trajectory in metric units.
    pub trajectory: f64,
    /// HMC transitions per scan and temperature.
    pub hmc_transitions: usize,
    /// SMC particles per chain set, with which SMC from the prior finds the first states, temperatures and metrics; 0: draws
    /// of the prior everywhere. For posteriors of many modes; costs about 50 slice updates per particle and nat of the
    /// spread of ln L.
    pub smc_particles: usize,
    /// Independent SMC samplers, at most one per chain set; chain set `k` starts from number `k` modulo their number. One of
    /// many particles weighs its modes against each other, many of few particles only show the errors of each. Errors are
    /// the scatter of SMC samplers.
    pub smc_samplers: usize,
    /// Slice updates of each SMC particle per temperature; 0: as many as parameters, at least 8. With too few the particles
    /// are not in equilibrium, and ln Z is too small.
    pub mcmc_steps: usize,
    /// Slice updates per scan and temperature, before the HMC transitions: for likelihoods too rough for long trajectories.
    /// Each costs about 3 to 8 values and no gradient.
    pub slice_updates: usize,
    /// Rounds at the end whose reference is a mixture fitted to earlier draws, most of them of the round before, and a
    /// little of the prior, instead of the prior: a shorter annealing path, once the draws have found the modes. 0: none.
    /// With as many as `rounds`, the first reference is fitted to the SMC particles, or is the prior without them.
    pub mixture_rounds: usize,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            chain_sets: 4,
            rounds: 10,
            extensions: 0,
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
            mixture_rounds: 0,
        }
    }
}

impl Settings {
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

    /// Groups of chain sets that started independently of each other.
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

    /// Slices of each SMC particle at each temperature, for a target of `dim` parameters.
    #[must_use]
    pub(super) fn mcmc_steps(&self, dim: usize) -> usize {
        if self.mcmc_steps > 0 {
            self.mcmc_steps
        } else {
            dim.max(MIN_MCMC_STEPS)
        }
    }

    /// Checks the ranges.
    ///
    /// # Errors
    /// [`Error::Setting`] naming the first setting out of its range.
    pub fn check(&self) -> Result<()> {
        let whole = |name, value: usize, lo: usize, hi: usize, remedy| {
            if (lo..=hi).contains(&value) {
                Ok(())
            } else {
                Err(Error::Setting {
                    name,
                    value: value.to_string(),
                    remedy,
                })
            }
        };
        let real = |name, value: f64, lo: f64, hi: f64, remedy| {
            if value > lo && value < hi {
                Ok(())
            } else {
                Err(Error::Setting {
                    name,
                    value: value.to_string(),
                    remedy,
                })
            }
        };
        whole(
            "chain_sets",
            self.chain_sets,
            2,
            1024,
            "give 2 to 1024, 4 is usual",
        )?;
        whole("rounds", self.rounds, 2, 24, "give 2 to 24, 10 is usual")?;
        whole("extensions", self.extensions, 0, 1024, "give 0 to 1024")?;
        whole(
            "first_scans",
            self.first_scans,
            2,
            4096,
            "give 2 to 4096, 4 is usual",
        )?;
        whole(
            "temperatures",
            self.temperatures,
            self.min_temperatures,
            self.max_temperatures,
            "give a number from min_temperatures to max_temperatures",
        )?;
        whole(
            "min_temperatures",
            self.min_temperatures,
            3,
            1024,
            "give 3 to 1024",
        )?;
        whole(
            "max_temperatures",
            self.max_temperatures,
            3,
            1024,
            "give 3 to 1024",
        )?;
        whole(
            "max_leapfrogs",
            self.max_leapfrogs,
            1,
            1 << 20,
            "give 1 or more, 256 is usual",
        )?;
        whole(
            "hmc_transitions",
            self.hmc_transitions,
            1,
            1 << 20,
            "give 1 or more",
        )?;
        whole(
            "smc_particles",
            self.smc_particles,
            0,
            1 << 16,
            "give 0 to 65536 SMC particles; some ten per parameter are usual",
        )?;
        whole(
            "smc_samplers",
            self.smc_samplers,
            2,
            1024,
            "give 2 to 1024, 4 is usual: their scatter is the measure of the error",
        )?;
        whole(
            "smc_particles",
            self.particles_per_sampler(),
            0,
            MAX_PARTICLES,
            "give fewer SMC particles per chain set, fewer chain sets or more SMC samplers: an SMC sampler has at most 2^19",
        )?;
        whole("mcmc_steps", self.mcmc_steps, 0, 1 << 20, "give 0 or more")?;
        whole(
            "slice_updates",
            self.slice_updates,
            0,
            1 << 20,
            "give 0 or more",
        )?;
        whole(
            "mixture_rounds",
            self.mixture_rounds,
            0,
            1 << 20,
            "give 0 or more",
        )?;
        real(
            "target_acceptance",
            self.target_acceptance,
            0.2,
            0.99,
            "give a number between 0.2 and 0.99, 0.8 is usual",
        )?;
        real(
            "trajectory",
            self.trajectory,
            0.0,
            1e3,
            "give a length above 0, pi/2 is usual",
        )
    }
}
