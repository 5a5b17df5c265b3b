//! What accelerates the progenitor.

use crate::potential::Potential;
use crate::scalar::{Scalar, Vec3};

/// The acceleration of the progenitor, which may depend on its velocity and on the time.
pub trait OrbitForce<S: Scalar> {
    /// Whether it depends on velocity or time.
    const DEPENDS_ON_VELOCITY: bool;

    /// The acceleration in kpc/Gyr^2 at `x` kpc with the velocity `v` kpc/Gyr, at the time `tau` from -1 at the first release to 0 today.
    fn orbit_acceleration(&self, x: Vec3<S>, v: Vec3<S>, tau: f64) -> Vec3<S>;
}

/// The force of a potential alone, which depends on the place.
#[derive(Clone, Copy, Debug)]
pub struct Conservative<'a, P>(pub &'a P);

impl<S: Scalar, P: Potential<S>> OrbitForce<S> for Conservative<'_, P> {
    const DEPENDS_ON_VELOCITY: bool = false;

    #[inline(always)]
    fn orbit_acceleration(&self, x: Vec3<S>, _: Vec3<S>, _: f64) -> Vec3<S> {
        self.0.acceleration(x)
    }
}
