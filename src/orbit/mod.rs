//! The orbit of the progenitor and the integration of particles, with its adjoint (docs/physics.md, sections 3, 5 and 8).

mod adaptive;
mod blanes_moan;
mod dense_orbit;
mod leapfrog;
mod leapfrog_vjp;
mod node_times;
mod nystrom;
mod orbit_force;
mod schedule;
mod winding;

pub use adaptive::{AdaptiveSteps, advance_adaptively, length};
pub use blanes_moan::{DRIFTS, KICKS, STAGES, TIMES};
pub use dense_orbit::{DenseOrbit, HermiteWeights, Node, OrbitMethod, Resolution, position_vjp};
pub use leapfrog::{FinalParticle, advance};
pub use leapfrog_vjp::advance_vjp;
pub use node_times::NodeTimes;
pub use orbit_force::{Conservative, OrbitForce};
pub use schedule::{InterleavedSchedules, MAX_TOGETHER, Schedule, StepMethod, StepSchedule};
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
