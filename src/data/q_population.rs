//! Populations of q that mocks are drawn from.

use crate::error::Result;
use oblate_samplers::limits::in_range;
use oblate_samplers::normal::{cdf, quantile, sf};
use serde::{Deserialize, Serialize};

/// A Gaussian population of q, or two of the same width and weight; truncated to the prior's range.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct QPopulation {
    /// Mean of the Gaussian.
    pub mu: f64,
    /// Mean of the other one, from which half of the streams are drawn, if there are two.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub other_mu: Option<f64>,
    /// Standard deviation.
    pub sigma: f64,
}

impl QPopulation {
    /// One Gaussian.
    #[must_use]
    pub fn gaussian(mu: f64, sigma: f64) -> Self {
        Self {
            mu,
            other_mu: None,
            sigma,
        }
    }

    /// Checks every number (docs/limits.md).
    pub(super) fn check(&self) -> Result<()> {
        let means = -100.0..=100.0;
        in_range("population.mu", self.mu, means.clone())?;
        in_range(
            "population.other_mu",
            self.other_mu.unwrap_or(self.mu),
            means,
        )?;
        in_range("population.sigma", self.sigma, 0.0..=100.0)?;
        Ok(())
    }

    /// The q between `lo` and `hi` of a uniform number, which also chooses among two Gaussians.
    pub(super) fn q(&self, lo: f64, hi: f64, uniform: f64) -> f64 {
        match self.other_mu {
            Some(other) if uniform >= 0.5 => {
                truncated(other, self.sigma, (lo, hi), 2.0 * uniform - 1.0)
            }
            Some(_) => truncated(self.mu, self.sigma, (lo, hi), 2.0 * uniform),
            None => truncated(self.mu, self.sigma, (lo, hi), uniform),
        }
    }
}

/// The quantile `u` of a truncated Gaussian, computed from the side of the tail.
fn truncated(mu: f64, sigma: f64, (lo, hi): (f64, f64), u: f64) -> f64 {
    if sigma <= 0.0 {
        return mu.clamp(lo, hi.next_down());
    }
    let (a, b) = ((lo - mu) / sigma, (hi - mu) / sigma);
    let q = if a > 0.0 {
        mu - sigma * quantile(sf(a) + u * (sf(b) - sf(a)))
    } else {
        mu + sigma * quantile(cdf(a) + u * (cdf(b) - cdf(a)))
    };
    // Beyond 38 sigmas the probability is 0 in doubles; then all of it is put at the nearer end.
    let q = if q.is_finite() { q } else { mu };
    q.clamp(lo, hi.next_down())
}
