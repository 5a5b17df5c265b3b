//! Nested sampling: live points shrinking onto the peak (Skilling 2006), in iterations.
//!
//! [`run`] replaces the lowest tenth of the live points at once by new ones above their contour, until the rest could
//! no longer raise the evidence. Ties with the contour die with it, so plateaus of the likelihood, rejected points
//! among them, need no other rule. New points come from ellipsoids around the live ones, or from slices or walks whose
//! steps are those ellipsoids' ([`Kernel`]). Weights, evidence and errors all follow from the contour above which
//! each point was born and its own likelihood. A chain's point resembles its seed until it has made steps enough: it is of its
//! seed's lineage, the other half of the lineages alone tells a chain where to go, and the scatter of lineages is the error of means
//! that is quoted, as that of lineages founded lately, of recent lineages, is of ln Z. So few steps cost digits, not truth. More live points can be added later, where they tell most: a run with a
//! target ([`Settings::target_ess`]) does so until it is met. Runs of several seeds are one longer run ([`merge`]).
//!
//! ```
//! use oblate_samplers::control::{Control, Silent};
//! use oblate_samplers::{Marginal, Outcome, Prior, Target, nested};
//!
//! struct Peak(Prior);
//! impl Target for Peak {
//!     fn prior(&self) -> &Prior {
//!         &self.0
//!     }
//!     fn ln_likelihood(&self, theta: &[f64]) -> Outcome {
//!         Outcome::from_ln_likelihood((1.0 - theta[0] * theta[0]).ln())
//!     }
//! }
//!
//! # fn main() -> oblate_samplers::Result<()> {
//! let peak = Peak(Prior::new([("x", "", Marginal::Uniform { lo: 0.0, hi: 1.0 })])?);
//! let settings = nested::Settings { n_live: 200, ..nested::Settings::default() };
//! let run = nested::run(&peak, &settings, 1, &mut Control::new(&mut Silent))?;
//! assert!((run.evidence.ln_z - (2.0_f64 / 3.0).ln()).abs() < 4.0 * run.evidence.error);
//! # Ok(())
//! # }
//! ```

mod bound;
mod checks;
mod dynamic;
mod evidence;
mod finish;
mod kernel;
mod likelihood;
mod live;
mod merge;
mod rank;
mod results;
mod run;
mod settings;
mod state;
mod tuning;

pub use merge::merge;
pub use run::run;
pub use settings::{Kernel, Settings};
