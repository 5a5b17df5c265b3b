//! The tidal radius and the unit vectors of the release frame (docs/physics.md, section 4).

use crate::orbit::State;
use crate::potential::Potential;
use crate::scalar::{Real, Vec3};
use crate::units::G;

/// The tidal radius at a state of the progenitor, and what recipes need besides.
#[derive(Clone, Copy, Debug)]
pub struct Tidal<S> {
    /// Tidal radius in kpc.
    pub r_j: S,
    /// Angular speed |L| / r^2 in 1/Gyr.
    pub omega: S,
    /// Unit vectors outwards, along the motion, and along the angular momentum; the last two are null on a radial orbit.
    pub frame: [Vec3<S>; 3],
    /// The square of the frequency of a circular orbit around the progenitor at the tidal radius, `G m / r_j^3`, in 1/Gyr^2.
    pub frequency2: S,
    /// Whether the tidal radius had to be bounded.
    pub bounded: bool,
}

/// Upper bound of the tidal radius over the distance from the halo's centre.
const MAX_R_J_OVER_R: f64 = 10.0;

/// Width of the smooth bound, relative to the terms that it bounds: below rounding except near the bound.
const SOFTNESS: f64 = 1e-6;

/// Added to |L|^2 in (kpc^2/Gyr)^2, so that a radial orbit has null vectors instead of NaN; below rounding on any other.
const TINY_L2: f64 = 1e-60;

impl<S: Real> Tidal<S> {
    /// For a progenitor of `mass` Msun in the state `s` (King 1962; docs/physics.md, section 4). Finite for finite input away from the
    /// centre.
    #[inline(always)]
    pub fn new(host: &impl Potential<S>, mass: S, s: State<S>) -> Self {
        let r2 = s.x.norm2();
        let r = r2.sqrt();
        let outward = s.x * (S::one() / r);
        let l = s.x.cross(s.v);
        let l2 = l.norm2() + TINY_L2;
        let l_norm = l2.sqrt();
        let pole = l * (S::one() / l_norm);
        let omega = l_norm / r2;
        let gm = mass * G;
        let bracket = omega * omega - host.second_derivative_along(s.x, outward);
        let reach = r * MAX_R_J_OVER_R;
        let floor = gm / (reach * reach * reach);
        let width = (omega * omega + gm / (r2 * r)) * SOFTNESS;
        let excess = bracket - floor;
        let smooth = floor + (excess + (excess * excess + width * width).sqrt()) * 0.5;
        Self {
            r_j: (gm / smooth).cbrt(),
            omega,
            frequency2: smooth,
            frame: [outward, pole.cross(outward), pole],
            bounded: excess.re() < 0.0,
        }
    }
}
