//! The rule for bins that the model does not cover (docs/physics.md, section 7).

use crate::error::{Rejection, Result};
use crate::scalar::{Real, smooth_step};
use oblate_samplers::limits::in_range;
use oblate_samplers::normal::LN_SQRT_2PI;
use serde::{Deserialize, Serialize};

/// The rule for a bin of the data that the model does not cover.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Coverage {
    /// The likelihood is zero, as in Chemaly et al. (2026).
    Reject,
    /// ln L is finite and has continuous second derivatives: below the threshold, ln L of a datum is interpolated to that of a residual of
    /// `z_miss` standard errors, and a penalty is subtracted.
    Penalty {
        /// Residual of a bin without particles, in standard errors of the data.
        z_miss: f64,
        /// The penalty if no bin is covered.
        lambda: f64,
    },
}

impl Default for Coverage {
    fn default() -> Self {
        Self::Penalty {
            z_miss: 10.0,
            lambda: 1_000.0,
        }
    }
}

impl Coverage {
    /// Checks that every number is in its range of docs/limits.md.
    ///
    /// # Errors
    /// [`Error::OutOfRange`](crate::Error::OutOfRange) with the first one that is out of its range.
    pub(super) fn check(&self) -> Result<()> {
        if let Self::Penalty { z_miss, lambda } = *self {
            in_range("likelihood.coverage.penalty.z_miss", z_miss, 1e-3..=1e3)?;
            in_range("likelihood.coverage.penalty.lambda", lambda, 0.0..=1e7)?;
        }
        Ok(())
    }

    /// The cover of a bin with this weight, 0 to 1.
    ///
    /// # Errors
    /// [`Rejection::Uncovered`] under [`Coverage::Reject`] if it is not covered.
    pub(super) fn of<S: Real>(
        &self,
        weight: S,
        threshold: f64,
    ) -> std::result::Result<S, Rejection> {
        match self {
            // A bin without particles has no mean, even if the threshold is 0.
            Self::Reject if weight.re() < threshold || weight.re() <= 0.0 => {
                Err(Rejection::Uncovered)
            }
            Self::Reject => Ok(S::one()),
            Self::Penalty { .. } if threshold > 0.0 => Ok(smooth_step(weight / threshold)),
            Self::Penalty { .. } => Ok(smooth_step(weight)),
        }
    }

    /// ln L of a datum in a bin with this cover: `ln_covered` if it is covered; `sd` is the standard error of a bin without particles.
    pub(super) fn ln_likelihood<S: Real>(&self, covered: S, ln_covered: S, sd: S) -> S {
        match self {
            Self::Reject => ln_covered,
            Self::Penalty { z_miss, .. } => {
                let ln_miss = S::from_f64(-0.5 * z_miss * z_miss) - sd.ln() - LN_SQRT_2PI;
                covered * (ln_covered - ln_miss) + ln_miss
            }
        }
    }

    /// The square of the residual of an uncovered bin, in standard errors.
    pub(super) fn square_of_missed(&self) -> f64 {
        match self {
            // A point with an uncovered bin is rejected.
            Self::Reject => 0.0,
            Self::Penalty { z_miss, .. } => z_miss * z_miss,
        }
    }

    /// The penalty at this mean cover of the bins.
    pub(super) fn penalty<S: Real>(&self, mean_cover: S) -> S {
        match *self {
            Self::Reject => S::zero(),
            Self::Penalty { lambda, .. } => {
                let missing = (S::one() - mean_cover).max(S::zero());
                missing * missing * lambda
            }
        }
    }
}

/// The smallest weight that means are computed with, so that they are finite where the cover is 0: the cover of a bin with so little
/// weight is 1e-8.
pub(super) fn least_weight<S: Real>(threshold: f64) -> S {
    S::from_f64(1e-3 * threshold).max(S::from_f64(1e-9))
}
