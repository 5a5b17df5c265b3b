//! How far a track extends: the numbers over which Chemaly et al. (2026), appendix A, show the errors of q.

use super::observed::ObservedTrack;
use serde::{Deserialize, Serialize};

/// Lengths and radii of a track.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrackExtent {
    /// Angle that its bins cover, degrees.
    pub length_deg: f64,
    /// Length of the line through its points, kpc.
    pub length_kpc: f64,
    /// Mean radius, kpc.
    pub mean_kpc: f64,
    /// Standard deviation of the radii, kpc.
    pub spread_kpc: f64,
}

impl TrackExtent {
    /// That of a track.
    #[must_use]
    pub fn of(track: &ObservedTrack) -> Self {
        let count = track.len() as f64;
        let mean = track.r_kpc.iter().sum::<f64>() / count;
        let squares: f64 = track.r_kpc.iter().map(|r| (r - mean).powi(2)).sum();
        Self {
            length_deg: count * track.bin_width_deg,
            length_kpc: length_kpc(&track.phi_deg, &track.r_kpc),
            mean_kpc: mean,
            spread_kpc: (squares / count).sqrt(),
        }
    }

    /// Each number with its name.
    #[must_use]
    pub fn named(&self) -> [(&'static str, f64); 4] {
        [
            ("length_deg", self.length_deg),
            ("length_kpc", self.length_kpc),
            ("mean_kpc", self.mean_kpc),
            ("spread_kpc", self.spread_kpc),
        ]
    }
}

/// Length of the line through the points at these angles and radii, kpc.
pub(super) fn length_kpc(phi_deg: &[f64], r_kpc: &[f64]) -> f64 {
    let points = phi_deg.iter().zip(r_kpc).map(|(phi, r)| {
        let (sin, cos) = phi.to_radians().sin_cos();
        (r * cos, r * sin)
    });
    let points: Vec<(f64, f64)> = points.collect();
    let pairs = points.windows(2);
    pairs
        .map(|pair| (pair[0].0 - pair[1].0).hypot(pair[0].1 - pair[1].1))
        .sum()
}
