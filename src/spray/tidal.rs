//! The tidal radius and the frame in which stars leave.

use crate::orbit::State;
use crate::potential::Potential;
use crate::scalar::{Real, Vec3};
use crate::units::G;

/// The progenitor's tidal surroundings at one moment.
#[derive(Clone, Copy, Debug)]
pub struct Tidal<S> {
    /// Tidal radius in kpc.
    pub r_j: S,
    /// Angular speed |L| / r^2 in 1/Gyr.
    pub omega: S,
    /// Unit vectors outwards, along the motion, and along the angular momentum.
    pub frame: [Vec3<S>; 3],
    /// Whether the tidal radius had to be bounded.
    pub bounded: bool,
}

/// The tidal radius is held below this many galactocentric radii.
const LARGEST_R_J_OVER_R: f64 = 10.0;

/// Width of the smooth bound, relative to the terms it bounds: below rounding wherever the bound is far.
const SOFTNESS: f64 = 1e-6;

/// Added to |L|^2 in (kpc^2/Gyr)^2: a radial orbit gets a null frame instead of NaN, any other is unchanged.
const TINY_L2: f64 = 1e-60;

impl<S: Real> Tidal<S> {
    /// `r_j = (G m / (Omega^2 - Phi_rr))^(1/3)` (King 1962; docs/physics.md, section 4) for a progenitor of `mass` Msun in state `s`.
    ///
    /// The bracket is bounded from below by `G m / (10 r)^3`, smoothly (a hyperbola of relative width 1e-6), because
    /// potentials other than the NFW can make it small or negative; [`bounded`](Self::bounded) says where that acted.
    /// Never NaN for finite input away from the centre: on a radial orbit the directions across it are null vectors.
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
        let reach = r * LARGEST_R_J_OVER_R;
        let floor = gm / (reach * reach * reach);
        let width = (omega * omega + gm / (r2 * r)) * SOFTNESS;
        let excess = bracket - floor;
        let smooth = floor + (excess + (excess * excess + width * width).sqrt()) * 0.5;
        Self {
            r_j: (gm / smooth).cbrt(),
            omega,
            frame: [outward, pole.cross(outward), pole],
            bounded: excess.re() < 0.0,
        }
    }
}
