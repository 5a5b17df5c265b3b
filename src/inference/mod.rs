//! From a track and its settings to draws of the posterior: the likelihood as a target of [`oblate_samplers`], the policy of a fit
//! (coarse model first, then the bridge to the model itself), and its diagnostics.

mod best_fit;
mod coarse;
mod derived;
mod evaluate;
mod fit;
mod model_error;
mod posterior_predictive;
mod prior_draws;
mod prior_predictive;
mod profile;
mod sample;
mod settings;
mod speed;
mod target;

pub use best_fit::{Diagnostics, diagnose, residuals};
pub use derived::{DERIVED, derived};
pub use evaluate::{Evaluated, Wanted};
pub use fit::{Coarse, Fit, FitPlan, bridge_from, fit, fit_with, summarize};
pub(crate) use model_error::{PARTICLES_CHECKS, STEPS_CHECKS};
pub use posterior_predictive::posterior_predictive_p;
pub use prior_draws::prior_draws;
pub use prior_predictive::check_prior_predictive;
pub use profile::Profile;
pub use sample::{bridge, merge, sample};
pub use settings::{FitSettings, Sampler, SamplerSettings, over_defaults};
pub use speed::Speed;
pub use target::StreamTarget;
