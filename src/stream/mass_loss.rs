//! The mass that a progenitor loses: by which law, and its parameter (docs/physics.md, section 2).

use crate::error::Result;
use crate::params::{StreamParams, StreamPrior};
use crate::potential::MassFraction;
use crate::scalar::Real;
use serde::{Deserialize, Serialize};

/// How the mass of the progenitor falls from the first release on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MassLoss {
    /// Linearly in time.
    Linear,
    /// Exponentially in time.
    Exponential,
    /// Linearly in time until nothing is left, before today: the last stars leave then.
    Complete,
}

impl MassLoss {
    /// The name of its parameter.
    #[must_use]
    pub fn parameter(self) -> &'static str {
        match self {
            Self::Linear | Self::Exponential => "m_prog_left",
            Self::Complete => "dissolved_at",
        }
    }

    /// The law in words.
    pub(super) fn in_words(self) -> &'static str {
        match self {
            Self::Linear => "progenitor losing mass linearly",
            Self::Exponential => "progenitor losing mass exponentially",
            Self::Complete => "progenitor losing all of its mass",
        }
    }
}

/// The value of the parameter of a law, 1 without one.
pub(super) fn parameter_of<S: Real>(law: Option<MassLoss>, params: &StreamParams<S>) -> S {
    match law {
        None => S::one(),
        Some(MassLoss::Linear | MassLoss::Exponential) => params.m_prog_left,
        Some(MassLoss::Complete) => params.dissolved_at,
    }
}

/// Checks that a prior has the parameter of the law, and not that of another.
///
/// # Errors
/// [`Error::Setting`](crate::Error::Setting) if it lacks a value or a distribution, or has one in vain.
pub(super) fn check_prior(law: Option<MassLoss>, prior: &StreamPrior) -> Result<()> {
    for (other, example) in [
        (MassLoss::Linear, "{ kind = \"uniform\", lo = 0.1, hi = 1 }"),
        (
            MassLoss::Complete,
            "{ kind = \"uniform\", lo = 0.2, hi = 1 }",
        ),
    ] {
        let name = other.parameter();
        let belongs = law.is_some_and(|law| law.parameter() == name);
        prior.check_belongs(name, belongs, "`model.mass_loss`", Some(example))?;
    }
    Ok(())
}

/// A law with its parameter: the mass of a progenitor over time.
#[derive(Clone, Copy, Debug)]
pub struct MassOverTime<S> {
    /// The law; none: the mass is constant.
    pub law: Option<MassLoss>,
    /// Its parameter.
    pub parameter: S,
}

/// Smallest fraction of the mass by which releases are scaled: the tidal radius has no derivative at a mass of zero. A release time at
/// which so little is left has a weight of next to zero.
const LEAST_FRACTION: f64 = 1e-6;

impl<S: Real> MassOverTime<S> {
    /// The fraction of the mass at the time `tau`, from -1 at the first release to 0 today.
    #[inline(always)]
    pub(super) fn fraction(&self, tau: f64) -> MassFraction<S> {
        let parameter = self.parameter;
        let since = tau + 1.0;
        match self.law {
            None => MassFraction::whole(),
            Some(MassLoss::Linear) => MassFraction {
                value: (parameter - 1.0) * since + 1.0,
                slope: S::from_f64(since),
            },
            Some(MassLoss::Exponential) => {
                let value = (parameter.ln() * since).exp();
                MassFraction {
                    value,
                    slope: value * since / parameter,
                }
            }
            Some(MassLoss::Complete) => {
                let lost = S::from_f64(since) / parameter;
                if lost.re() < 1.0 {
                    MassFraction {
                        value: -lost + 1.0,
                        slope: lost / parameter,
                    }
                } else {
                    MassFraction {
                        value: S::zero(),
                        slope: S::zero(),
                    }
                }
            }
        }
    }

    /// The fraction at release time number `k` of `count`, `tau`, for the scale of releases: within the part of its interval in which the
    /// progenitor is not yet dissolved, so that it falls to 0 with the weight of that part.
    #[inline(always)]
    pub(super) fn fraction_at_release(&self, k: usize, count: usize, tau: f64) -> S {
        let part = self.part_before_its_end(k, count);
        let value = if part.re() < 1.0 {
            let within = (tau + 1.0) * count as f64 - k as f64;
            let since = part * within + k as f64;
            -(since / (self.parameter * count as f64)) + 1.0
        } else {
            self.fraction(tau).value
        };
        if value.re() < LEAST_FRACTION {
            S::from_f64(LEAST_FRACTION)
        } else {
            value
        }
    }

    /// The part of interval number `k` of `count` equal ones, from the first release to today, in which the progenitor is not yet dissolved.
    #[inline(always)]
    pub(super) fn part_before_its_end(&self, k: usize, count: usize) -> S {
        if self.law != Some(MassLoss::Complete) {
            return S::one();
        }
        let before = self.parameter * count as f64 - k as f64;
        if before.re() >= 1.0 {
            S::one()
        } else if before.re() > 0.0 {
            before
        } else {
            S::zero()
        }
    }
}
