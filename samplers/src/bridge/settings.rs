//! Settings of a bridge.

use crate::error::{Error, Result};
use crate::limits::{Memory, in_range};
use serde::{Deserialize, Serialize};

/// Number of further MCMC steps after which the places of the particles are kept, for the densities of independent proposals. More would
/// not make these better.
pub(super) const FITTED_STEPS: usize = 32;

/// Memory of the coordinates of an SMC particle: its own, those of its copies, those of the draw that it becomes, and where it has been.
const BYTES_PER_COORDINATE: f64 = (5 + FITTED_STEPS) as f64 * 8.0;

/// Memory of everything else of an SMC particle.
const BYTES_PER_MEMBER: f64 = 50.0 * 8.0;

/// Most values of ln L that the surrogate of the fine likelihood is fitted to, the newest.
pub(super) const EXAMPLES_KEPT: usize = 50_000;

/// Settings of [`bridge::run`](super::run).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// Number of SMC particles of a batch: draws taken from the coarse run, and draws of the result.
    pub smc_particles: usize,
    /// MCMC steps of each particle after each step: slice updates, or moves along the surrogate of a coarse run that has one.
    pub mcmc_steps: usize,
    /// Maximum number of further MCMC steps of all particles at the fine likelihood after each batch, made while the effective sample size is
    /// too small.
    pub further_mcmc_steps: usize,
    /// Maximum number of batches. Another one begins while the effective sample size is too small after all further MCMC steps.
    pub max_batches: usize,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            smc_particles: 2_000,
            mcmc_steps: 12,
            further_mcmc_steps: 0,
            max_batches: 1,
        }
    }
}

impl Settings {
    /// Checks every number by itself: the ranges of docs/limits.md.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] names the first one that is out of its range.
    pub fn check_ranges(&self) -> Result<()> {
        in_range("smc_particles", self.smc_particles, 10..=1_000_000)?;
        in_range("mcmc_steps", self.mcmc_steps, 1..=1000)?;
        in_range("further_mcmc_steps", self.further_mcmc_steps, 0..=100_000)?;
        in_range("max_batches", self.max_batches, 1..=1_000)?;
        Ok(())
    }

    /// Checks the settings for a target of `dim` parameters.
    ///
    /// # Errors
    /// As of [`check_ranges`](Self::check_ranges); [`Error::Setting`] for fewer than ten SMC particles per parameter;
    /// [`Error::TooMuchMemory`] by the estimate of [`memory`](Self::memory).
    pub fn check(&self, dim: usize) -> Result<()> {
        self.check_ranges()?;
        if self.smc_particles < 10 * dim {
            return Err(Error::Setting {
                name: "smc_particles",
                value: self.smc_particles.to_string(),
                remedy: "give at least ten per parameter",
            });
        }
        self.memory(dim).check()?;
        Ok(())
    }

    /// An estimate of the memory of a bridge: every SMC particle with its coordinates, in three copies while it moves, and as a draw; and
    /// the values that a surrogate learns from.
    #[must_use]
    pub fn memory(&self, dim: usize) -> Memory {
        let particle = BYTES_PER_MEMBER + BYTES_PER_COORDINATE * dim as f64;
        // In single precision as kept and in the network's units; about as many residuals as coordinates, twice.
        let examples = 2.0 * 4.0 * (3 * dim + 1) as f64 * EXAMPLES_KEPT as f64;
        Memory::default().with(
            "smc_particles",
            particle * (self.smc_particles * self.max_batches) as f64 + examples,
        )
    }
}
