//! The observed track.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::ops::RangeInclusive;

/// Relative error of a radius where a file gives none: `sigma_b = 0.02 r_b` (Chemaly et al. 2026).
pub const DEFAULT_RELATIVE_ERROR: f64 = 0.02;

/// Numbers of bins that a track may have.
pub const NUMBERS_OF_BINS: RangeInclusive<usize> = 3..=10_000;

/// Radii that a track may have, kpc: from a parsec to a hundred megaparsecs.
pub const RADII_KPC: RangeInclusive<f64> = 1e-3..=1e5;

/// Standard errors that radii may have, kpc. The smallest is that of a mock without noise: squared, it leaves ln L finite.
pub const RADIUS_ERRORS_KPC: RangeInclusive<f64> = 1e-9..=1e5;

/// Numbers of stars that a bin may have.
pub const STARS: RangeInclusive<f64> = 0.0..=1e12;

/// A track on the sky: one mean projected radius per bin of angle around the host, counted from the progenitor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ObservedTrack {
    /// The stream's name: the header's `name`, or the file's stem.
    pub name: String,
    /// Bin centres in degrees, increasing, each at `(k + 1/2) bin_width_deg` for a whole number k. Bins may be missing.
    pub phi_deg: Vec<f64>,
    /// Width of every bin in degrees.
    pub bin_width_deg: f64,
    /// Mean projected radius per bin, in kpc.
    pub r_kpc: Vec<f64>,
    /// Its standard error, in kpc.
    pub r_err_kpc: Vec<f64>,
    /// Whether the errors are [`DEFAULT_RELATIVE_ERROR`] times the radius because the source gave none.
    pub r_err_assumed: bool,
    /// Stars (or particles) per bin, where known.
    pub n: Option<Vec<f64>>,
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

    /// The whole number k of each bin, which covers `[k, k + 1) bin_width_deg`.
    #[must_use]
    pub fn bins(&self) -> Vec<i64> {
        self.phi_deg
            .iter()
            .map(|phi| bin_of(*phi, self.bin_width_deg))
            .collect()
    }
}

/// The number of the bin with this centre.
#[allow(
    clippy::cast_possible_truncation,
    reason = "checked tracks hold centres of a few turns at most; the cast saturates elsewhere"
)]
fn bin_of(phi_deg: f64, width_deg: f64) -> i64 {
    (phi_deg / width_deg - 0.5).round() as i64
}

/// The errors of radii without errors.
pub(super) fn default_errors(r_kpc: &[f64]) -> Vec<f64> {
    r_kpc.iter().map(|r| DEFAULT_RELATIVE_ERROR * r).collect()
}
