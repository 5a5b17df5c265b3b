//! The mass that a progenitor loses: by which law, and its parameter (docs/physics.md, section 2).

use crate::error::Result;
use crate::params::StreamPrior;
use crate::potential::MassFraction;
use crate::scalar::Real;
use serde::{Deserialize, Serialize};

/// How the mass of the progenitor falls from the first release to today.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MassLoss {
    /// Linearly in time.
    Linear,
    /// Exponentially in time.
    Exponential,
}

/// The parameter of the law: the fraction of the mass that is left today.
const MASS_LEFT: &str = "m_prog_left";

/// Checks that a prior has the fraction that is left, if mass is lost, and otherwise not.
///
/// # Errors
/// [`Error::Setting`](crate::Error::Setting) if it lacks a value or a distribution, or has one in vain.
pub(super) fn check_prior(law: Option<MassLoss>, prior: &StreamPrior) -> Result<()> {
    prior.check_belongs(
        MASS_LEFT,
        law.is_some(),
        "`model.mass_loss`",
        Some("{ kind = \"uniform\", lo = 0.1, hi = 1 }"),
    )
}

/// The fraction of the mass at the time `tau`, from -1 at the first release to 0 today, if the fraction `left` is left today.
#[inline(always)]
pub(super) fn mass_fraction<S: Real>(law: Option<MassLoss>, left: S, tau: f64) -> MassFraction<S> {
    let since = tau + 1.0;
    match law {
        None => MassFraction::whole(),
        Some(MassLoss::Linear) => MassFraction {
            value: (left - 1.0) * since + 1.0,
            slope: S::from_f64(since),
        },
        Some(MassLoss::Exponential) => {
            let value = (left.ln() * since).exp();
            MassFraction {
                value,
                slope: value * since / left,
            }
        }
    }
}
