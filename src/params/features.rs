//! The parameters as a track depends on them: without the exact degeneracy of mass, velocity and age, and with halo shapes that are
//! the same halo at the same place (docs/physics.md, section 9). A surrogate of ln L learns from these numbers.

use super::layout::{DIM, StreamParams};
use super::shape::QRange;
use crate::scalar::{Real, Vec3, gradient_of, lift};
use std::f64::consts::LN_10;

/// Number of features.
pub const FEATURES: usize = 15;

/// The three velocities in units of the halo's velocity scale, ln of the age in units of its time, lg of the progenitor's mass in
/// units of the halo's, the four lengths, and the six numbers xx, xy, xz, yy, yz, zz of `(1 / q^2 - 1) n n^T` with the axis `n`: what the
/// potential adds to a spherical one, the same for `n` and `-n`, and smooth where q = 1.
#[must_use]
pub fn features(params: &StreamParams<f64>, q_range: QRange) -> [f64; FEATURES] {
    let speed = speed(params.log10_m_halo);
    let [xx, xy, xz, yy, yz, zz] = excess(params.dir(), q_range);
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
        xx,
        xy,
        xz,
        yy,
        yz,
        zz,
    ]
}

/// From the derivatives of a result by the features those by the parameters.
#[must_use]
pub fn features_vjp(
    params: &StreamParams<f64>,
    q_range: QRange,
    features_bar: &[f64; FEATURES],
) -> StreamParams<f64> {
    let speed = speed(params.log10_m_halo);
    let [
        vx,
        vy,
        vz,
        age,
        mass,
        r_s_halo,
        r_s_prog,
        x0,
        z0,
        shape @ ..,
    ] = *features_bar;
    let along = vx * params.vx0_km_s + vy * params.vy0_km_s + vz * params.vz0_km_s;
    let [x, y, z] = lift(&params.dir().to_array());
    let mut dir = [0.0; 3];
    for (number, bar) in excess(Vec3::new(x, y, z), q_range).iter().zip(shape) {
        for (slot, slope) in dir.iter_mut().zip(gradient_of(number)) {
            *slot += bar * slope;
        }
    }
    StreamParams {
        log10_m_halo: 0.5 * LN_10 * (age - along / speed) - mass,
        r_s_halo_kpc: r_s_halo,
        dir_x: dir[0],
        dir_y: dir[1],
        dir_z: dir[2],
        log10_m_prog: mass,
        r_s_prog_kpc: r_s_prog,
        x0_kpc: x0,
        z0_kpc: z0,
        vx0_km_s: vx / speed,
        vy0_km_s: vy / speed,
        vz0_km_s: vz / speed,
        age_gyr: age / params.age_gyr,
        ..StreamParams::from_array([0.0; DIM])
    }
}

/// The halo's velocity scale, up to a factor.
fn speed(log10_m_halo: f64) -> f64 {
    ((log10_m_halo - 12.0) * (0.5 * LN_10)).exp()
}

/// The features of a shape vector.
fn excess<S: Real>(dir: Vec3<S>, q_range: QRange) -> [S; 6] {
    let shape = q_range.shape(dir);
    let excess = S::one() / (shape.q * shape.q) - S::one();
    let n = shape.axis;
    [
        excess * n.x * n.x,
        excess * n.x * n.y,
        excess * n.x * n.z,
        excess * n.y * n.y,
        excess * n.y * n.z,
        excess * n.z * n.z,
    ]
}
