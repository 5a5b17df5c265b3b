//! Nested sampling (Skilling 2006) with many points replaced at once.
//!
//! [`run`] replaces the lowest tenth of the live points at once by new ones above the likelihood bound, until the rest
//! could raise the evidence by less than [`Settings::dlnz`]. Points of equal likelihood at the bound are replaced together,
//! so that plateaus of the likelihood, rejected points among them, need no other rule. New points come from ellipsoids
//! around the live ones, or from slice updates or walks in the metric of those ellipsoids ([`Kernel`]). Weights, evidence
//! and errors follow from the bound above which each point was drawn and from its own likelihood.
//!
//! A point drawn by a chain resembles its seed until the chain has made enough steps. It therefore belongs to the
//! lineage of its seed; chains of one half of the lineages take directions and metrics from the other half; and the
//! errors of means come from the scatter of lineages, that of ln Z from recent lineages, whose ancestors are chosen
//! anew whenever few are left. With too few steps the errors grow and ln Z is biased (docs/targets.md, section 1);
//! the checks `seed-rank-correlation` and `relative-jump-distance` detect it. A run with a target
//! ([`Settings::target_ess`]) adds batches of live points where they reduce the errors most, and runs with several
//! seeds can be merged ([`merge`]).
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
pub mod check_names;
mod checks;
mod dynamic;
mod evidence;
mod finish;
mod kernel;
mod learning;
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
