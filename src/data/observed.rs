//! The observed track.

use super::assumed_error::AssumedError;
use super::measured::Measured;
use super::star::StarVelocity;
use crate::params::NAMES;
use crate::track::BinQuantity;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::ops::RangeInclusive;

/// Numbers of bins that a track may have.
pub const NUMBERS_OF_BINS: RangeInclusive<usize> = 3..=10_000;

/// Radii that a track may have, kpc: from a parsec to a hundred megaparsecs.
pub const RADII_KPC: RangeInclusive<f64> = 1e-3..=1e5;

/// Standard errors that radii may have, kpc. The smallest is that of a mock without noise: squared, it leaves ln L finite.
pub const RADIUS_ERRORS_KPC: RangeInclusive<f64> = 1e-9..=1e5;

/// Numbers of stars that a bin may have.
pub const STARS: RangeInclusive<f64> = 0.0..=1e12;

/// Maximum difference of the distance between two neighbouring bin centres from whole bin widths, as a fraction of the bin width, because
/// files round their angles. A bin edge as near to the progenitor is at the progenitor.
pub(super) const SLACK: f64 = 1e-3;

/// Maximum sum of these differences from the first bin to any other, as a fraction of the bin width.
pub(super) const MAX_DRIFT: f64 = 0.1;

/// Key of the header of a track whose phi was mirrored when it was read.
pub(super) const MIRRORED: &str = "phi_mirrored";

/// A track on the sky: one mean projected radius per bin of angle around the host, counted from the progenitor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ObservedTrack {
    /// The stream's name: the header's `name`, or the file's stem.
    pub name: String,
    /// Bin centres in degrees, increasing, at whole bin widths from each other. Bins may be missing.
    pub phi_deg: Vec<f64>,
    /// Width of every bin in degrees.
    pub bin_width_deg: f64,
    /// Mean projected radius per bin, in kpc.
    pub r_kpc: Vec<f64>,
    /// Its standard error towards smaller radii, in kpc.
    pub r_err_lo_kpc: Vec<f64>,
    /// Its standard error towards larger radii, in kpc.
    pub r_err_hi_kpc: Vec<f64>,
    /// The relative error that the user assumed, because the source gives no errors.
    pub assumed_error: Option<AssumedError>,
    /// Stars (or particles) per bin, where known.
    pub n: Option<Vec<f64>>,
    /// What is measured beside the radii, bin by bin; a value may be missing in any bin, but not in all.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub measured: BTreeMap<BinQuantity, Vec<Option<Measured>>>,
    /// Velocities of single stars.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub stars: Vec<StarVelocity>,
    /// Everything else that the header says (origin, distance, truth), as it was read.
    pub meta: BTreeMap<String, serde_json::Value>,
}

impl ObservedTrack {
    /// Number of bins with data.
    #[must_use]
    pub fn len(&self) -> usize {
        self.phi_deg.len()
    }

    /// Whether there is no bin.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.phi_deg.is_empty()
    }

    /// Angle in degrees from the progenitor to the lower edge of bin 0, at most half of a bin to either side; 0 if an edge is at the
    /// progenitor, to a thousandth of a bin.
    #[must_use]
    pub fn offset_deg(&self) -> f64 {
        let Some(first) = self.phi_deg.first() else {
            return 0.0;
        };
        // The mean over all bins, because files round their angles.
        let from_first = |phi: &f64| (phi - first) / self.bin_width_deg;
        let roundings = self.phi_deg.iter().map(from_first).map(|x| x - x.round());
        let mean = roundings.sum::<f64>() / self.len() as f64;
        let edge = first / self.bin_width_deg - 0.5;
        let offset = edge - edge.round() + mean;
        if offset.abs() <= SLACK {
            0.0
        } else {
            offset * self.bin_width_deg
        }
    }

    /// The whole number k of each bin, which covers `offset_deg() + [k, k + 1) bin_width_deg`.
    #[must_use]
    pub fn bins(&self) -> Vec<i64> {
        let offset_deg = self.offset_deg();
        self.phi_deg
            .iter()
            .map(|phi| bin_of(phi - offset_deg, self.bin_width_deg))
            .collect()
    }

    /// The whole number k of the bin, with data or without, that an angle in degrees is in.
    #[must_use]
    pub fn bin_at(&self, phi_deg: f64) -> i64 {
        bin_of(phi_deg - self.offset_deg(), self.bin_width_deg)
    }

    /// Whether it has line-of-sight velocities: means in bins, or those of single stars.
    #[must_use]
    pub fn has_velocities(&self) -> bool {
        !self.stars.is_empty() || self.measured.contains_key(&BinQuantity::Velocity)
    }

    /// Whether each radius has the same error to both sides.
    #[must_use]
    pub fn has_symmetric_errors(&self) -> bool {
        let mut pairs = self.r_err_lo_kpc.iter().zip(&self.r_err_hi_kpc);
        pairs.all(|(lo, hi)| lo.total_cmp(hi).is_eq())
    }

    /// True values that the header gives, by the names of parameters and `q`: those of its mapping `truth`, and `q_true`.
    #[must_use]
    pub fn truth(&self) -> BTreeMap<String, f64> {
        let number = serde_json::Value::as_f64;
        let map = self.meta.get("truth").and_then(|truth| truth.as_object());
        let named = |name: &&str| {
            let value = map?.get(*name).and_then(number)?;
            Some(((*name).to_owned(), value))
        };
        let mut known: BTreeMap<String, f64> =
            NAMES.iter().chain(&["q"]).filter_map(named).collect();
        if let Some(q) = self.meta.get("q_true").and_then(number) {
            known.insert("q".to_owned(), q);
        }
        known
    }

    /// Whether another track has the same name and the same data at the same angles, so that fits of both have the same posterior.
    #[must_use]
    pub fn has_data_of(&self, other: &Self) -> bool {
        let columns = |track: &Self| {
            [
                &track.phi_deg,
                &track.r_kpc,
                &track.r_err_lo_kpc,
                &track.r_err_hi_kpc,
            ]
            .map(Clone::clone)
        };
        self.name == other.name
            && columns(self) == columns(other)
            && self.measured == other.measured
            && self.stars == other.stars
    }

    /// Whether the sign of phi was changed when it was read.
    #[must_use]
    pub fn is_mirrored(&self) -> bool {
        self.meta.contains_key(MIRRORED)
    }

    /// What was assumed because the source does not say it, and what was changed on reading, one sentence each.
    #[must_use]
    pub fn assumptions(&self) -> Vec<String> {
        let error = self.assumed_error.map(|assumed| {
            format!("the errors of r are {assumed} of r, because the track has none")
        });
        let mirrored = self.is_mirrored().then(|| {
            "phi was mirrored on reading, so that the leading tail is at positive phi; angles of a disc are those of the mirrored sky".to_owned()
        });
        let turn = self.gap_of_a_turn_deg().map(|gap_deg| {
            format!(
                "phi is taken as it is, with the progenitor at or beyond its end and a gap of {gap_deg} deg inside; if phi was counted modulo 360, \
                 change one side of the gap by 360"
            )
        });
        error.into_iter().chain(mirrored).chain(turn).collect()
    }

    /// The widest step of phi, if it may be the part of the circle without the stream: phi modulo 360 has it inside, and the progenitor at an end.
    fn gap_of_a_turn_deg(&self) -> Option<f64> {
        let (first, last) = (self.phi_deg.first()?, self.phi_deg.last()?);
        let steps = self.phi_deg.windows(2).map(|pair| pair[1] - pair[0]);
        let widest = steps.max_by(f64::total_cmp)?;
        let outside = 360.0 - (last - first);
        let is_beyond = *first >= 0.0 || *last <= 0.0;
        (is_beyond && outside > 0.0 && widest > outside + 0.5 * self.bin_width_deg)
            .then_some(widest)
    }
}

/// The number of the bin that an angle is in; its lower edge belongs to it.
#[allow(
    clippy::cast_possible_truncation,
    reason = "checked tracks hold centres of a few turns at most; the cast saturates elsewhere"
)]
pub(super) fn bin_of(phi_deg: f64, width_deg: f64) -> i64 {
    (phi_deg / width_deg).floor() as i64
}
