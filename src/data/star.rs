//! Line-of-sight velocities of single stars of a stream.

use super::measured::Measured;
use serde::{Deserialize, Serialize};

/// Largest number of single stars of a mock, and of rows of them in a file.
pub(super) const MAX_STARS: usize = 100_000;

/// The line-of-sight velocity of one star.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StarVelocity {
    /// Its angle from the progenitor, degrees.
    pub phi_deg: f64,
    /// Its velocity relative to the host, away from the observer, km/s.
    pub v_km_s: Measured,
}
