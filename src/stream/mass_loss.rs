//! The mass that a progenitor loses: by which law, and its parameter (docs/physics.md, section 2).

use crate::error::{Error, Result};
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
/// [`Error::Setting`] if it lacks a value or a distribution, or has one in vain.
pub(super) fn check_prior(law: Option<MassLoss>, prior: &StreamPrior) -> Result<()> {
    let (value, remedy) = match (law.is_some(), prior.has(MASS_LEFT)) {
        (true, true) | (false, false) => return Ok(()),
        (true, false) => (
            "none",
            "give a distribution, such as { kind = \"uniform\", lo = 0.1, hi = 1 }, or a value by prior.fixed.m_prog_left: it is the fraction of the progenitor's mass that is left today",
        ),
        (false, true) => (
            "given",
            "leave m_prog_left out, or give `model.mass_loss = \"linear\"` or \"exponential\"",
        ),
    };
    Err(Error::Setting {
        key: format!("prior.marginals.{MASS_LEFT}"),
        value: value.to_owned(),
        remedy: remedy.to_owned(),
    })
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
