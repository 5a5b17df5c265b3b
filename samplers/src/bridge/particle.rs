//! A particle of a bridge.

use serde::{Deserialize, Serialize};

/// ln L of the coarse and of the fine likelihood at one point.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Both {
    pub coarse: f64,
    pub fine: f64,
}

impl Both {
    /// ln L of the fine likelihood minus that of the coarse one.
    pub fn gap(self) -> f64 {
        self.fine - self.coarse
    }

    /// ln L of the intermediate likelihood with the exponent `s`.
    pub fn at(self, fraction: f64) -> f64 {
        (1.0 - fraction) * self.coarse + fraction * self.fine
    }
}

/// One SMC particle.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Particle {
    pub(super) z: Vec<f64>,
    /// In further MCMC steps the coarse one is that of an earlier point.
    pub(super) both: Both,
    /// Eve index: the row of the parent's draws from which it descends.
    pub(super) eve: usize,
    /// Cluster of dependent draws to which that row belongs.
    pub(super) lineage: u32,
}
