//! Units inside the library: kpc, Gyr, solar masses and radians. Velocities are in km/s in files and parameters, and in
//! kpc/Gyr in the dynamics.

/// 1 km/s in kpc/Gyr.
pub const KM_S_IN_KPC_PER_GYR: f64 = 1.022_712_165_053_707_7;

/// The gravitational constant in kpc^3 / (Msun Gyr^2): 4.30091e-6 kpc (km/s)^2 / Msun, converted and rounded once.
pub const G: f64 = 4.498_494_547_517_041e-6;

/// The critical density 3 H0^2 / (8 pi G) in Msun/kpc^3 for H0 = 70 km/s/Mpc.
pub const CRITICAL_DENSITY: f64 = 3.0 * (0.07 * KM_S_IN_KPC_PER_GYR) * (0.07 * KM_S_IN_KPC_PER_GYR)
    / (8.0 * std::f64::consts::PI * G);

/// kpc/Gyr to km/s.
#[must_use]
pub fn km_s_from_kpc_per_gyr(v: f64) -> f64 {
    v / KM_S_IN_KPC_PER_GYR
}
