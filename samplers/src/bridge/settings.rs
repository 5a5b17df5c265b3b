//! Settings of a bridge.

use crate::error::{Error, Result};
use serde::{Deserialize, Serialize};

/// Most SMC particles: each has random streams of its own.
const MAX_PARTICLES: usize = 1 << 20;

/// Settings of [`bridge::run`](super::run).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// SMC particles: draws taken from the coarse run, and draws of the result.
    pub smc_particles: usize,
    /// Slice updates of each particle after each step.
    pub mcmc_steps: usize,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            smc_particles: 2_000,
            mcmc_steps: 12,
        }
    }
}

impl Settings {
    /// Checks the ranges for a target of `dim` parameters.
    ///
    /// # Errors
    /// [`Error::Setting`] names the first one that is out of its range.
    pub fn check(&self, dim: usize) -> Result<()> {
        if !(10 * dim..=MAX_PARTICLES).contains(&self.smc_particles) {
            return Err(Error::Setting {
                name: "smc_particles",
                value: self.smc_particles.to_string(),
                remedy: "give at least ten per parameter, 2,000 is usual, and at most 2^20",
            });
        }
        if self.mcmc_steps == 0 {
            return Err(Error::Setting {
                name: "mcmc_steps",
                value: "0".to_owned(),
                remedy: "give at least 1, about as many as parameters is usual",
            });
        }
        Ok(())
    }
}
