//! The parameters as a track depends on them: without the exact degeneracy of mass, velocity and age, and with halo shapes that are
//! the same halo at the same place (docs/physics.md, section 9). A surrogate of ln L learns from these numbers.

use super::layout::StreamParams;
use super::shape::QRange;
use crate::scalar::Real;
use std::f64::consts::LN_10;

/// Number of features.
pub const FEATURES: usize = 15;

/// The three velocities in units of the halo's velocity scale, ln of the age in units of its time, lg of the progenitor's mass in
/// units of the halo's, the four lengths, and the six numbers of `(1 / q^2 - 1) n n^T` with the axis `n`: what the potential adds to
/// a spherical one, the same for `n` and `-n`, and smooth where q = 1.
pub fn features<S: Real>(params: &StreamParams<S>, q_range: QRange) -> [S; FEATURES] {
    let speed = ((params.log10_m_halo - S::from_f64(12.0)) * (0.5 * LN_10)).exp();
    let shape = q_range.shape(params.dir());
    let excess = S::one() / (shape.q * shape.q) - S::one();
    let n = shape.axis;
    [
        params.vx0_km_s / speed,
        params.vy0_km_s / speed,
        params.vz0_km_s / speed,
        (params.age_gyr * speed).ln(),
        params.log10_m_prog - params.log10_m_halo,
        params.r_s_halo_kpc,
        params.r_s_prog_kpc,
        params.x0_kpc,
        params.z0_kpc,
        excess * n.x * n.x,
        excess * n.x * n.y,
        excess * n.x * n.z,
        excess * n.y * n.y,
        excess * n.y * n.z,
        excess * n.z * n.z,
    ]
}
