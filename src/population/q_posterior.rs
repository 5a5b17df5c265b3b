//! The posterior of q of one stream, as weighted draws, with the prior of the fit.

use crate::error::{Error, PosteriorFault, Result};
use crate::params::QPrior;

/// How far the weights' sum may be from 1: the rounding of some 1e5 exponentials, read back from a file.
const WEIGHT_SUM_TOLERANCE: f64 = 1e-6;

/// The posterior of q of one stream, as draws.
#[derive(Clone, Debug, PartialEq)]
pub struct QPosterior {
    /// The stream's name in messages and reports.
    pub name: String,
    /// Draws of q; no unit.
    pub q: Vec<f64>,
    /// Their log weights, one per draw; the exponentials add up to 1.
    pub ln_weight: Vec<f64>,
    /// Number of independent draws that they are worth: their effective sample size.
    pub effective_size: f64,
    /// The prior of q in the fit.
    pub prior: QPrior,
}

impl QPosterior {
    /// A posterior of independent draws of equal weight.
    #[must_use]
    pub fn equal_weights(name: &str, q: Vec<f64>, prior: QPrior) -> Self {
        let ln_weight = vec![-(q.len() as f64).ln(); q.len()];
        Self {
            name: name.to_owned(),
            effective_size: q.len() as f64,
            q,
            ln_weight,
            prior,
        }
    }

    /// Checks that the prior of a fit is known and reaches over `support`; returns its range.
    ///
    /// # Errors
    /// [`PosteriorFault::UnknownPrior`] or [`PosteriorFault::NarrowPrior`].
    pub fn check_prior(
        prior: QPrior,
        (from, to): (f64, f64),
    ) -> std::result::Result<(f64, f64), PosteriorFault> {
        let QPrior::Uniform { lo, hi } = prior else {
            return Err(PosteriorFault::UnknownPrior);
        };
        if !(lo <= from && hi >= to) {
            return Err(PosteriorFault::NarrowPrior { lo, hi, from, to });
        }
        Ok((lo, hi))
    }

    /// Checks the draws, and that the fit's prior reaches over `support`. Returns the prior's log density, which is
    /// the same for every draw.
    ///
    /// # Errors
    /// [`Error::Posterior`] with the stream's name: no draws, lengths that differ, weights that do not add up to 1, a
    /// draw outside its own prior, an effective size that is none, an unknown prior, or one that does not cover the support.
    pub fn check(&self, support: (f64, f64)) -> Result<f64> {
        let refuse = |fault| {
            Err(Error::Posterior {
                name: self.name.clone(),
                fault,
            })
        };
        if self.q.is_empty() {
            return refuse(PosteriorFault::NoDraws);
        }
        if self.q.len() != self.ln_weight.len() {
            return refuse(PosteriorFault::Lengths {
                draws: self.q.len(),
                weights: self.ln_weight.len(),
            });
        }
        let (lo, hi) = match Self::check_prior(self.prior, support) {
            Ok(range) => range,
            Err(fault) => return refuse(fault),
        };
        if let Some(&q) = self.q.iter().find(|q| !(**q >= lo && **q <= hi)) {
            return refuse(PosteriorFault::OutsideOwnPrior { q, lo, hi });
        }
        let size = self.effective_size;
        // A NaN is not above zero.
        if !(size > 0.0 && size.is_finite()) {
            return refuse(PosteriorFault::EffectiveSize { size });
        }
        let sum: f64 = self.ln_weight.iter().map(|w| w.exp()).sum();
        // A NaN weight makes a NaN sum.
        if sum.is_nan() || (sum - 1.0).abs() > WEIGHT_SUM_TOLERANCE {
            return refuse(PosteriorFault::WeightSum { sum });
        }
        Ok(-(hi - lo).ln())
    }

    /// At most `count` equal-weight draws: the quantiles `(i + 1/2) / count` of the weighted ones, by systematic
    /// resampling of the draws in order of q. No random number, and an error of order `1 / count` in the
    /// distribution function where random thinning has `1 / sqrt count`. Fewer draws than that are left as they are. Their
    /// effective size is at most their number.
    #[must_use]
    pub fn thinned(&self, count: usize) -> Self {
        if self.q.len() <= count || count == 0 {
            return self.clone();
        }
        let mut order: Vec<usize> = (0..self.q.len()).collect();
        order.sort_by(|&a, &b| self.q[a].total_cmp(&self.q[b]));
        let mut thinned = Vec::with_capacity(count);
        let mut cumulative = 0.0;
        for &row in &order {
            cumulative += self.ln_weight[row].exp() * count as f64;
            while thinned.len() < count && (thinned.len() as f64 + 0.5) < cumulative {
                thinned.push(self.q[row]);
            }
        }
        // Weights that add up to 1 leave at least half a cell of margin; their tolerance cannot lose a draw unless
        // count is near 1e6.
        let kept = Self::equal_weights(&self.name, thinned, self.prior);
        Self {
            effective_size: self.effective_size.min(kept.effective_size),
            ..kept
        }
    }
}
