//! The recipes (docs/physics.md, section 4).

use super::Tidal;
use crate::scalar::Real;
use crate::units::G;
use serde::{Deserialize, Serialize};

/// Largest number of standard normals of a particle in any recipe.
pub const MAX_NORMALS: usize = 5;

/// The tail that a particle leaves into.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Tail {
    /// Through L1, towards the host: the leading tail.
    Leading,
    /// Through L2: the trailing tail.
    Trailing,
}

impl Tail {
    /// Its name in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Leading => "leading",
            Self::Trailing => "trailing",
        }
    }

    /// -1 for the leading tail, +1 for the trailing one.
    #[must_use]
    pub fn sign(self) -> f64 {
        match self {
            Self::Leading => -1.0,
            Self::Trailing => 1.0,
        }
    }
}

/// Position and velocity of a particle relative to the progenitor at its release, along the unit vectors of [`Tidal::frame`], over the
/// recipe's scales ([`Recipe::scales`]).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReleaseOffset {
    /// Position over the length scale.
    pub position: [f64; 3],
    /// Velocity over the velocity scale.
    pub velocity: [f64; 3],
}

impl ReleaseOffset {
    /// Sum of the squared differences of all six numbers.
    pub(super) fn squared_distance(&self, other: &Self) -> f64 {
        let all = |offset: &Self| offset.position.into_iter().chain(offset.velocity);
        all(self)
            .zip(all(other))
            .map(|(a, b)| (a - b) * (a - b))
            .sum()
    }
}

/// A published distribution of the release offsets.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Recipe {
    /// Fardal et al. 2015 in the form in which gala and other codes have it.
    #[default]
    Fardal2015,
    /// Fardal et al. 2015 with the published numbers.
    Fardal2015Published,
    /// Chen et al. 2025.
    Chen2025,
}

impl Recipe {
    /// Number of standard normals of a particle.
    #[must_use]
    pub fn normals(self) -> usize {
        match self {
            Self::Fardal2015 | Self::Fardal2015Published => 4,
            Self::Chen2025 => 5,
        }
    }

    /// The release offset of the standard normals `xi`, of which the first [`normals`](Self::normals) are used. `None` if the recipe has
    /// no offset for them (a radius of Chen et al. at or below zero): then others must be drawn.
    #[must_use]
    pub fn release_offset(self, xi: &[f64; MAX_NORMALS], tail: Tail) -> Option<ReleaseOffset> {
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
            // Escape speed of a point mass at r_j; the release offset has the factor (r_j/r)^(1/2).
            Self::Chen2025 => (tidal.r_j, (mass * (2.0 * G) / tidal.r_j).sqrt()),
        }
    }
}

/// `(k_r, k_z, k_vphi, k_vz)` with the standard deviation `in_plane` of the first and third.
fn fardal(xi: &[f64; MAX_NORMALS], in_plane: f64) -> [f64; 4] {
    [
        2.0 + in_plane * xi[0],
        0.5 * xi[1],
        0.3 + in_plane * xi[2],
        0.5 * xi[3],
    ]
}

/// The release offset of Chen et al. 2025: r in tidal radii, angles in degrees. r and alpha are correlated, by the Cholesky factor of
/// their covariance.
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
