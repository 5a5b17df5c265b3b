//! Moving bodies: the progenitor's dense orbit, and the leapfrog that carries the particles.

mod adjoint;
mod clock;
mod flight;
mod leapfrog;
mod progenitor;

pub use adjoint::{ByStep, reverse};
pub use clock::Clock;
pub use flight::{Course, Flight, HalfAndHalf};
pub use leapfrog::{Arrival, advance, crossing};
pub use progenitor::{DenseOrbit, Moment, Node, OrbitMethod, Placement, add_placed};

use crate::scalar::Vec3;

/// Position in kpc and velocity in kpc/Gyr.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State<S> {
    /// Position.
    pub x: Vec3<S>,
    /// Velocity.
    pub v: Vec3<S>,
}
