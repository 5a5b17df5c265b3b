//! Local moves on a tempered posterior `pi_beta(z) ~ N(z; 0, I) L(z)^beta`, or on an annealing path from another
//! [`Reference`] than the prior: HMC transitions with their metric and step size, slice updates where gradients do not
//! help, and symmetry moves declared by the target.
//!
//! Everything works in standard-normal coordinates and in whitened momenta `r = L' p`, where `L L' = V` is the
//! metric (an estimate of the posterior's covariance): kinetic energy is `|r|^2 / 2`, the velocity is `L r` and the
//! whitened force `L' (beta grad l - z)`.

mod leapfrog;
mod metric;
mod moments;
mod moved_copies;
mod point;
mod reference;
mod screen;
mod slice;
mod step_size;
mod surrogate_move;
mod symmetry;

pub use leapfrog::{End, LocalSampler, MAX_ENERGY_RANGE, Plan, Transition, shorten};
pub use metric::Metric;
pub use moments::Moments;
pub use moved_copies::with_moved_copies;
pub use point::{Evaluator, Point, screen};
pub use reference::{Reference, evenly_spaced, thinned};
pub use screen::{Screen, Screened};
pub use slice::{slice, slice_updates};
pub use step_size::{MAX_STEP, StepSize};
pub use surrogate_move::{MOVE_LENGTHS, MoveLength, surrogate_move};
pub use symmetry::{propose_involution, refresh, try_involutions, try_one_involution};
