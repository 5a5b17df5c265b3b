//! The orbit of the progenitor and the leapfrog integration of particles, with its adjoint (docs/physics.md, sections 3, 5 and 8).

mod adaptive_grid;
mod dense_orbit;
mod leapfrog;
mod leapfrog_vjp;
mod schedule;
mod winding;

pub use adaptive_grid::AdaptiveGrid;
pub use dense_orbit::{DenseOrbit, HermiteWeights, Node, OrbitMethod, OrbitTime, add_weighted};
pub use leapfrog::{FinalParticle, advance};
pub use leapfrog_vjp::{StepCotangent, reverse};
pub use schedule::{InterleavedSchedules, Schedule, StepSchedule};
pub use winding::crossing;

use crate::scalar::Vec3;

/// Position in kpc and velocity in kpc/Gyr.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State<S> {
    /// Position, kpc.
    pub x: Vec3<S>,
    /// Velocity, kpc/Gyr.
    pub v: Vec3<S>,
}
