//! What the moves along surrogates have in common: the surrogates, and what was fitted to the surviving points.

use crate::mixture::Mixture;
use crate::normal;
use crate::surrogate::Surrogate;
use nalgebra::DMatrix;

/// The same for all moves of an iteration. Of each pair the first is of the points of even lineages, the second of odd ones: a chain has that of
/// the half that does not contain its seed.
pub(in crate::nested) struct Along<'a> {
    /// Surrogates.
    pub surrogates: [&'a Surrogate; 2],
    /// Cholesky factors of the covariances of points, in standard-normal coordinates.
    pub metrics: [DMatrix<f64>; 2],
    /// Densities fitted to points; none where these are too few.
    pub proposals: [Option<Proposals<'a>>; 2],
    /// Width of the narrowest wall at the likelihood bound, in units of ln L.
    pub width: f64,
    /// Step of the leapfrog in units of the metric.
    pub step: f64,
    /// How often a proposal and a set of trajectories are made for a point.
    pub sets: usize,
}

/// What a chain has from the half of the lineages that does not contain its seed, for one set of moves.
pub(super) struct OtherHalf<'a> {
    pub surrogate: &'a Surrogate,
    pub metric: &'a DMatrix<f64>,
    pub proposals: Option<&'a Proposals<'a>>,
    /// Width of the wall at the likelihood bound, in units of ln L.
    pub width: f64,
    /// Step of the leapfrog in units of the metric.
    pub step: f64,
}

impl Along<'_> {
    /// For a chain whose seed is of an even lineage or of an odd one, inside a wall so many times as wide as the narrowest.
    pub(super) fn other_half(&self, even: bool, width: f64) -> OtherHalf<'_> {
        let other = usize::from(even);
        OtherHalf {
            surrogate: self.surrogates[other],
            metric: &self.metrics[other],
            proposals: self.proposals[other].as_ref(),
            width: self.width * width,
            step: self.step,
        }
    }
}

/// A density whose draws are proposals.
pub(in crate::nested) struct Proposals<'a> {
    /// The density in standard-normal coordinates.
    pub mixture: &'a Mixture,
    /// ln of the ratio of prior to density from which on all draws above the bound are kept.
    pub ln_most: f64,
}

impl Proposals<'_> {
    /// ln of the ratio of prior to density at a place.
    pub fn ln_ratio(mixture: &Mixture, z: &[f64]) -> f64 {
        let prior: f64 = z.iter().map(|z| normal::ln_pdf(*z)).sum();
        prior - mixture.ln_density(z)
    }
}
