//! The published release recipes (docs/physics.md, section 4).

use super::Tidal;
use crate::scalar::Real;
use crate::units::G;
use serde::{Deserialize, Serialize};

/// Most standard normals of a particle in any recipe.
pub const MAX_NORMALS: usize = 5;

/// The side a star leaves from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Tail {
    /// Through L1, towards the host: the leading tail.
    Leading,
    /// Through L2: the trailing tail.
    Trailing,
}

impl Tail {
    /// -1 for leading, +1 for trailing.
    #[must_use]
    pub fn sign(self) -> f64 {
        match self {
            Self::Leading => -1.0,
            Self::Trailing => 1.0,
        }
    }
}

/// A particle's release in the tidal frame (outwards, along the motion, along the angular momentum): position in the
/// recipe's length scale, velocity in its velocity scale, both relative to the progenitor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReleaseOffset {
    /// Offset over the length scale.
    pub position: [f64; 3],
    /// Offset over the velocity scale.
    pub velocity: [f64; 3],
}

impl ReleaseOffset {
    /// The squares of the differences of all components, added.
    pub(super) fn squared_distance(&self, other: &Self) -> f64 {
        let all = |kick: &Self| kick.position.into_iter().chain(kick.velocity);
        all(self)
            .zip(all(other))
            .map(|(a, b)| (a - b) * (a - b))
            .sum()
    }
}

/// A published release recipe.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Recipe {
    /// Fardal et al. 2015 as the field's codes have it: all dispersions 0.5, `k_r` multiplies the tangential velocity.
    #[default]
    Fardal2015,
    /// Fardal et al. 2015 with the published numbers: dispersion 0.4 in `k_r` and `k_vphi`, no factor `k_r` in the velocity.
    Fardal2015Published,
    /// Chen et al. 2025: five normals, velocities in the point-mass escape speed.
    Chen2025,
}

impl Recipe {
    /// Number of standard normals per particle.
    #[must_use]
    pub fn normals(self) -> usize {
        match self {
            Self::Fardal2015 | Self::Fardal2015Published => 4,
            Self::Chen2025 => 5,
        }
    }

    /// The release offset made of standard normals `xi` (the first [`normals`](Self::normals) are used). `None` if the recipe has
    /// no offset for them (a radius of Chen et al. at or below zero, probability 2.4e-6): then other normals must be drawn.
    #[must_use]
    pub fn kick(self, xi: &[f64; MAX_NORMALS], tail: Tail) -> Option<ReleaseOffset> {
        let sign = tail.sign();
        match self {
            Self::Fardal2015 => {
                let [k_r, k_z, k_vphi, k_vz] = fardal(xi, 0.5);
                Some(ReleaseOffset {
                    position: [sign * k_r, 0.0, sign * k_z],
                    velocity: [0.0, sign * k_r * k_vphi, sign * k_vz],
                })
            }
            Self::Fardal2015Published => {
                let [k_r, k_z, k_vphi, k_vz] = fardal(xi, 0.4);
                Some(ReleaseOffset {
                    position: [sign * k_r, 0.0, sign * k_z],
                    velocity: [0.0, sign * k_vphi, sign * k_vz],
                })
            }
            Self::Chen2025 => chen(xi, sign),
        }
    }

    /// The length (kpc) and velocity (kpc/Gyr) scales of the release offsets, for a progenitor of `mass` Msun.
    #[inline(always)]
    pub fn scales<S: Real>(self, tidal: &Tidal<S>, mass: S) -> (S, S) {
        match self {
            Self::Fardal2015 | Self::Fardal2015Published => (tidal.r_j, tidal.omega * tidal.r_j),
            // Escape speed of a point mass at r_j; the offset contains 1/sqrt(r/r_j).
            Self::Chen2025 => (tidal.r_j, (mass * (2.0 * G) / tidal.r_j).sqrt()),
        }
    }
}

/// `(k_r, k_z, k_vphi, k_vz)` with means (2, 0, 0.3, 0), dispersion `planar` in the plane and 0.5 out of it.
fn fardal(xi: &[f64; MAX_NORMALS], planar: f64) -> [f64; 4] {
    [
        2.0 + planar * xi[0],
        0.5 * xi[1],
        0.3 + planar * xi[2],
        0.5 * xi[3],
    ]
}

/// Chen et al. 2025: means and covariance of (r, phi, theta, alpha, beta) with r and alpha correlated, by its lower
/// Cholesky factor; r in tidal radii, angles in degrees. The leading tail is a half turn about the pole.
fn chen(xi: &[f64; MAX_NORMALS], sign: f64) -> Option<ReleaseOffset> {
    let r = 1.6 + 0.35 * xi[0];
    if r <= 0.0 {
        return None;
    }
    let phi = (-30.0 + 23.0 * xi[1]).to_radians();
    let theta = (12.0 * xi[2]).to_radians();
    let alpha = (20.0 - 14.0 * xi[0] + 204.0_f64.sqrt() * xi[3]).to_radians();
    let beta = (22.0 * xi[4]).to_radians();
    let direction = |azimuth: f64, height: f64| {
        [
            sign * height.cos() * azimuth.cos(),
            sign * height.cos() * azimuth.sin(),
            height.sin(),
        ]
    };
    Some(ReleaseOffset {
        position: direction(phi, theta).map(|c| c * r),
        velocity: direction(alpha, beta).map(|c| c / r.sqrt()),
    })
}
