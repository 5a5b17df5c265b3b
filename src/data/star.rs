//! Line-of-sight velocities of single stars of a stream.

use super::measured::Measured;
use super::observed::ObservedTrack;
use crate::error::TrackFault;
use crate::track::BinQuantity;
use serde::{Deserialize, Serialize};

/// The line-of-sight velocity of one star.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StarVelocity {
    /// Its angle from the progenitor, degrees.
    pub phi_deg: f64,
    /// Its velocity relative to the host, away from the observer, km/s.
    pub v_km_s: Measured,
}

impl StarVelocity {
    /// What is wrong with a star of a track: it is in no bin of it, or a number is out of its range.
    pub(super) fn fault(&self, track: &ObservedTrack) -> Option<TrackFault> {
        let column = BinQuantity::Velocity.column();
        let Measured { value, error } = self.v_km_s;
        for (name, number) in [
            ("phi", self.phi_deg),
            (column.value, value),
            (column.error, error),
        ] {
            if !number.is_finite() {
                return Some(TrackFault::NotFinite {
                    column: name,
                    value: number,
                });
            }
        }
        if !track.bins().contains(&track.bin_at(self.phi_deg)) {
            return Some(TrackFault::StarOutside {
                phi_deg: self.phi_deg,
            });
        }
        for (name, number, range) in [
            (column.value, value, &column.values),
            (column.error, error, &column.errors),
        ] {
            if !range.contains(&number) {
                return Some(TrackFault::OutOfRange {
                    column: name,
                    value: number,
                    lo: *range.start(),
                    hi: *range.end(),
                    unit: column.unit,
                });
            }
        }
        None
    }
}
