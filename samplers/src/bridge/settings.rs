//! What a user may set of a refinement.

use crate::error::{Error, Result};
use serde::{Deserialize, Serialize};

/// Most members: each has random streams of its own.
const MOST_MEMBERS: usize = 1 << 20;

/// Settings of [`bridge::run`](super::run).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// Draws of the coarse run that are carried over, and draws of the result.
    pub members: usize,
    /// Slices of each member after each step.
    pub sweeps: usize,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            members: 2_000,
            sweeps: 12,
        }
    }
}

impl Settings {
    /// Whether a refinement can work with these numbers on a target of `dim` parameters.
    ///
    /// # Errors
    /// [`Error::Setting`] names the first one that is out of its range.
    pub fn check(&self, dim: usize) -> Result<()> {
        if !(10 * dim..=MOST_MEMBERS).contains(&self.members) {
            return Err(Error::Setting {
                name: "members",
                value: self.members.to_string(),
                remedy: "give at least ten per parameter, 2,000 is usual, and at most 2^20",
            });
        }
        if self.sweeps == 0 {
            return Err(Error::Setting {
                name: "sweeps",
                value: "0".to_owned(),
                remedy: "give at least 1, about as many as parameters is usual",
            });
        }
        Ok(())
    }
}
