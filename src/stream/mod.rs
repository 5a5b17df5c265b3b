//! From a halo, a progenitor and a table of releases to the particles of a stream today, and the derivatives backwards.
//!
//! A stream is made in two stages. The [`ProgenitorSolution`] is the progenitor's orbit and one [`ReleaseFrame`] per release time, on
//! any [`Real`](crate::scalar::Real) number type. The particles are then integrated from their releases to today, in SIMD lanes
//! ([`Model::integrate`]), or one by one on any number type as a reference ([`Model::integrate_one_by_one`]).
//!
//! [`Model::vjp`] is the exact derivative of both stages: reverse mode through the particles, forward mode through the progenitor
//! solution. Each file of the forward computation has its adjoint beside it, in the file whose name ends in `_vjp`.

mod compiled;
mod cotangents;
mod forward;
mod gradient;
mod integrate;
mod integrate_vjp;
mod lane_groups;
mod memory;
mod model;
mod particles;
mod progenitor_solution;
mod progenitor_solution_vjp;
mod settings;
mod step_schedules;
mod step_schedules_vjp;
mod step_sizes;
mod system;
mod threads;

pub use compiled::{CompiledHalo, Kernels};
pub use gradient::{Adjoint, MAX_STRETCH, Workspace};
pub use integrate::IntegrateKernel;
pub use integrate_vjp::VjpKernel;
pub use lane_groups::{Group, StepSchedules};
pub use model::Model;
pub use particles::Particles;
pub use progenitor_solution::{ProgenitorSolution, ReleaseFrame, SolutionMemory};
pub use progenitor_solution_vjp::SolutionVjpKernel;
pub use settings::{ModelSettings, StepRule, StepsPer};
pub use step_sizes::StepSizes;
pub use system::{SYSTEM_LEN, System};
pub use threads::Threads;
