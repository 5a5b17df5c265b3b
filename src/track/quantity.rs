//! What a bin of a track may have beside its mean radius.

use serde::{Deserialize, Serialize};

/// A quantity of a bin beside its mean radius.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BinQuantity {
    /// Mean line-of-sight velocity relative to the host, away from the observer, km/s.
    Velocity,
    /// Standard deviation of the projected radii of the stars in the bin, kpc.
    Width,
    /// Number of stars per degree of phi.
    Density,
}

impl BinQuantity {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Velocity, Self::Width, Self::Density];
}
