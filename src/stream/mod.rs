//! The particles of a stream today from a system and a table of releases, and their derivatives (docs/physics.md, sections 3 to 5 and 8).
//!
//! A stream is made in two stages. The [`ProgenitorSolution`] is the progenitor's orbit and one [`ReleaseFrame`] per release time, on
//! any [`Real`](crate::scalar::Real) number type. The particles are then integrated from their releases to today, in SIMD lanes
//! ([`Model::integrate`]), or one by one on any number type as a reference ([`Model::integrate_one_by_one`]).
//!
//! [`Model::vjp`] differentiates both stages: the particles in reverse mode, the progenitor solution in forward mode. The adjoint of a
//! file is in the file of the same name with `_vjp` appended.

mod angle;
mod any_host;
mod baryons;
mod compiled;
mod cotangents;
mod forward;
mod friction;
mod gradient;
mod integrate;
mod integrate_vjp;
mod lane_groups;
mod mass_loss;
mod memory;
mod minor_axis;
mod model;
mod particle_table;
mod particles;
mod progenitor_solution;
mod progenitor_solution_vjp;
mod release_rate;
mod second_axis;
mod settings;
mod step_schedules;
mod step_schedules_vjp;
mod step_sizes;
mod system;
mod threads;

pub use any_host::{AnyHost, StreamInput, host_of};
pub use baryons::{BaryonSettings, BulgeProfile, DiscPlane, DiscSettings};
pub use compiled::{CompiledHost, Kernels};
pub use gradient::{Adjoint, MAX_STRETCH, Workspace};
pub use integrate::IntegrateKernel;
pub use integrate_vjp::VjpKernel;
pub use lane_groups::{LaneGroup, StepSchedules};
pub use mass_loss::{MassLoss, MassOverTime};
pub use minor_axis::MinorAxis;
pub use model::Model;
pub use particle_table::ParticleTable;
pub use particles::Particles;
pub use progenitor_solution::{ProgenitorSolution, ReleaseFrame, Releases, SolutionMemory};
pub use progenitor_solution_vjp::SolutionVjpKernel;
pub use release_rate::ReleaseRate;
pub use settings::{ModelSettings, Precision, StepRule, StepsPer};
pub use step_sizes::StepSizes;
pub use system::{SYSTEM_LEN, System};
pub use threads::Threads;
