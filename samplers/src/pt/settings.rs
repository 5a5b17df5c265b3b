//! Settings of a tempered run.

use crate::error::{Error, Result};
use crate::hmc::MetricKind;
use serde::{Deserialize, Serialize};

/// Most members of a population: each has a random stream of its own.
const MOST_MEMBERS: usize = 1 << 19;

/// Fewest sweeps at each temperature, if their number is not given.
const LEAST_SWEEPS: usize = 8;

/// Settings of a tempered run; the defaults suit smooth posteriors of up to a few dozen parameters.
///
/// The cost in gradients is about `2^rounds first_scans x ladders x temperatures x moves x leapfrogs`, where leapfrogs
/// is 2-10 for a rung whose metric fits and at most `max_leapfrogs`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// Independent ladders, at least 2: their agreement is the measure of the error.
    pub ladders: usize,
    /// Rounds, each twice as long as the one before; all but the last adapt.
    pub rounds: usize,
    /// How many times the last round may go on for as long again, until the run passes its checks; 0: it is as long as planned. On a
    /// path from the prior all of its scans count. On one from a mixture it goes on in legs: mixture, temperatures and metrics are
    /// fitted anew each time to all that it has drawn, and of the legs the later half counts, rounded up. A run that ended too soon
    /// goes on from its checkpoint if it is allowed more.
    pub extensions: usize,
    /// Scans of the first round.
    pub first_scans: usize,
    /// Temperatures of the first rounds.
    pub temperatures: usize,
    /// Fewest temperatures later on, at which gaps stay narrow enough for one-sided estimates of the evidence to
    /// serve as a check; equal to `temperatures` and `max_temperatures`, their number stays.
    pub min_temperatures: usize,
    /// Most temperatures later on.
    pub max_temperatures: usize,
    /// Mean acceptance of local moves that step sizes are steered to.
    pub target_acceptance: f64,
    /// Shape of the metric.
    pub metric: MetricKind,
    /// Most leapfrog steps of one move.
    pub max_leapfrogs: usize,
    /// Mean length of a trajectory in metric units.
    pub trajectory: f64,
    /// Whether trajectories of all rounds but the early ones find their own length, by doubling until they turn back, up to
    /// `max_leapfrogs`. `trajectory` then counts for the early ones only.
    pub no_u_turn: bool,
    /// Hamiltonian moves per scan and temperature.
    pub moves: usize,
    /// Members per ladder of populations that are cooled from the prior to find the first states, temperatures and metrics;
    /// 0: prior draws everywhere. For posteriors of many hollows; costs about 50 slices per member and nat of ln L's spread.
    pub annealing: usize,
    /// Independent populations, at most one per ladder. Ladders take turns to share them: a large population weighs its
    /// hollows against each other, many small ones only show how little each knows. Errors are the scatter of populations.
    pub populations: usize,
    /// Slices of each member at each temperature of its population; 0: as many as parameters, at least 8. A population that
    /// is cooled faster than its members move falls behind, and its evidence is too small.
    pub sweeps: usize,
    /// Slices per scan and temperature, before the Hamiltonian moves: for likelihoods too rough for long trajectories. Each
    /// costs about 3 to 8 values and no gradient.
    pub slices: usize,
    /// Rounds at the end whose ladders begin at a mixture fitted to what was drawn before, most of it in the round before, and a
    /// little of the prior, instead of at the prior: a shorter path, once the draws know the posterior's hollows. 0: all begin at
    /// the prior. With as many as `rounds` the first begins at a mixture of what `annealing` has found; without, at the prior.
    pub mixture_rounds: usize,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            ladders: 4,
            rounds: 10,
            extensions: 0,
            first_scans: 4,
            temperatures: 20,
            min_temperatures: 8,
            max_temperatures: 64,
            target_acceptance: 0.8,
            metric: MetricKind::Dense,
            max_leapfrogs: 256,
            trajectory: std::f64::consts::FRAC_PI_2,
            no_u_turn: false,
            moves: 1,
            annealing: 0,
            populations: 4,
            sweeps: 0,
            slices: 0,
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

    /// Whether the ladders of a round, the first of which is 0, are to begin at a mixture.
    #[must_use]
    pub(super) fn mixes(&self, round: usize) -> bool {
        (round > 0 || self.annealing > 0) && round + self.mixture_rounds >= self.rounds
    }

    /// Groups of ladders that started independently of each other.
    #[must_use]
    pub fn families(&self) -> usize {
        if self.annealing > 0 {
            self.populations.min(self.ladders)
        } else {
            self.ladders
        }
    }

    /// Members of each population: rounded up, so that no ladder has fewer than its own.
    #[must_use]
    pub fn members(&self) -> usize {
        (self.annealing * self.ladders).div_ceil(self.families())
    }

    /// Slices of each member at each temperature, for a target of `dim` parameters.
    #[must_use]
    pub(super) fn sweeps(&self, dim: usize) -> usize {
        if self.sweeps > 0 {
            self.sweeps
        } else {
            dim.max(LEAST_SWEEPS)
        }
    }

    /// Refuses what cannot run.
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
            "ladders",
            self.ladders,
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
        whole("moves", self.moves, 1, 1 << 20, "give 1 or more")?;
        whole(
            "annealing",
            self.annealing,
            0,
            1 << 16,
            "give 0 to 65536 members; some ten per parameter are usual",
        )?;
        whole(
            "populations",
            self.populations,
            2,
            1024,
            "give 2 to 1024, 4 is usual: their scatter is the measure of the error",
        )?;
        whole(
            "annealing",
            self.members(),
            0,
            MOST_MEMBERS,
            "give fewer members per ladder, fewer ladders or more populations: a population has at most 2^19",
        )?;
        whole("sweeps", self.sweeps, 0, 1 << 20, "give 0 or more")?;
        whole("slices", self.slices, 0, 1 << 20, "give 0 or more")?;
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
