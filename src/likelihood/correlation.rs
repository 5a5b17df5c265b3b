//! Errors of the radii that are correlated along the track: bin by bin, the error that is expected from the bins before
//! (docs/physics.md, section 7).

use crate::error::Result;
use crate::scalar::Real;
use oblate_samplers::limits::in_range;
use serde::{Deserialize, Serialize};

/// How the errors of the radii are correlated: exponentially in the difference of phi.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ErrorCorrelation {
    /// Difference of phi at which the correlation is 1/e, degrees.
    pub angle_deg: f64,
    /// Fraction of the variance that is correlated; the rest is independent from bin to bin. 1: all.
    #[serde(default = "whole")]
    pub fraction: f64,
}

fn whole() -> f64 {
    1.0
}

impl ErrorCorrelation {
    /// Checks that both numbers are in their ranges of docs/limits.md.
    ///
    /// # Errors
    /// [`Error::OutOfRange`](crate::Error::OutOfRange) with the first one that is not.
    pub fn check(&self) -> Result<()> {
        let key = |name: &str| format!("likelihood.error_correlation.{name}");
        in_range(&key("angle_deg"), self.angle_deg, 0.1..=360.0)?;
        in_range(&key("fraction"), self.fraction, 0.0..=1.0)?;
        Ok(())
    }

    /// Correlation of the correlated parts of two errors at this distance in phi.
    pub(super) fn at_distance(&self, apart_deg: f64) -> f64 {
        (-apart_deg / self.angle_deg).exp()
    }

    /// The smallest variance, over that of a datum alone, that it can have if the bins before are known; `correlation` is that with the
    /// last of them.
    pub(super) fn least_variance(&self, correlation: f64) -> f64 {
        1.0 - self.fraction * correlation * correlation
    }
}

/// The correlated part of an error, in its standard deviations, as it is expected from the bins before: a Kalman filter.
#[derive(Clone, Copy, Debug)]
pub(super) struct ExpectedError<S> {
    pub mean: S,
    pub variance: S,
}

impl<S: Real> ExpectedError<S> {
    /// That of the first bin.
    pub fn unknown() -> Self {
        Self {
            mean: S::zero(),
            variance: S::one(),
        }
    }

    /// That of the next bin, whose error has this correlation with the present one.
    pub fn next(self, correlation: f64) -> Self {
        let kept = correlation * correlation;
        Self {
            mean: self.mean * correlation,
            variance: self.variance * kept + (1.0 - kept),
        }
    }

    /// What remains of a residual beyond its expectation, and the variance of that. `sd` is the standard deviation of the correlated part,
    /// `independent` the variance of all else.
    pub fn remainder(&self, residual: S, sd: f64, independent: S) -> (S, S) {
        (
            residual - self.mean * sd,
            self.variance * (sd * sd) + independent,
        )
    }

    /// Learns from a [remainder](Self::remainder) as far as the bin is covered: all from one that is, nothing from one that is not, and a
    /// smooth function of the cover.
    pub fn learn(self, (remainder, variance): (S, S), sd: f64, covered: S) -> Self {
        let gain = covered * self.variance * sd / variance;
        Self {
            mean: self.mean + gain * remainder,
            // Of the sum of a known part of the remainder and the rest.
            variance: self.variance - gain * (-covered + 2.0) * self.variance * sd,
        }
    }
}
