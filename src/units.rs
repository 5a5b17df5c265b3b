//! One system inside: kpc, Gyr, solar masses, radians. Velocities cross the door in km/s and are converted here.

/// 1 km/s in kpc/Gyr.
pub const KPC_PER_GYR_IN_KM_S: f64 = 1.022_712_165_053_707_7;

/// The gravitational constant in kpc^3 / (Msun Gyr^2): 4.30091e-6 kpc (km/s)^2 / Msun in our units, rounded once.
pub const G: f64 = 4.498_494_547_517_041e-6;

/// The critical density 3 H0^2 / (8 pi G) in Msun/kpc^3 for H0 = 70 km/s/Mpc.
pub const CRITICAL_DENSITY: f64 = 3.0 * (0.07 * KPC_PER_GYR_IN_KM_S) * (0.07 * KPC_PER_GYR_IN_KM_S)
    / (8.0 * std::f64::consts::PI * G);

/// km/s to kpc/Gyr.
#[must_use]
pub fn kpc_per_gyr_from_km_s(v: f64) -> f64 {
    v * KPC_PER_GYR_IN_KM_S
}

/// kpc/Gyr to km/s.
#[must_use]
pub fn km_s_from_kpc_per_gyr(v: f64) -> f64 {
    v / KPC_PER_GYR_IN_KM_S
}
