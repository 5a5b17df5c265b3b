//! Insertion ranks: a new point that is uniform above the likelihood bound has every rank among the live points with
//! equal probability (Fowlie, Handley & Su 2020). The points of a kernel with too few steps do not.

use crate::rng::{RandomStream, unit_open};
use crate::valid::{Valid, ensure};
use serde::{Deserialize, Serialize};

/// Ranks in order of insertion.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Ranks {
    rank: Vec<u32>,
    size: Vec<u32>,
}

impl Ranks {
    /// Records a rank in `0..=size` among `size` others.
    pub fn push(&mut self, rank: u32, size: u32) {
        self.rank.push(rank);
        self.size.push(size);
    }

    /// Checks ranks that were read from a file.
    pub fn check(&self) -> Valid {
        let within = |(rank, size): (&u32, &u32)| rank <= size;
        ensure(
            self.rank.len() == self.size.len() && self.rank.iter().zip(&self.size).all(within),
            "an insertion rank is above the number of live points",
        )
    }

    pub fn len(&self) -> usize {
        self.rank.len()
    }

    /// Mid-ranks `(r + 1/2) / (N + 1)`, in (0, 1).
    pub fn fractions(&self) -> Vec<f64> {
        self.rank
            .iter()
            .zip(&self.size)
            .map(|(&r, &n)| (f64::from(r) + 0.5) / (f64::from(n) + 1.0))
            .collect()
    }

    /// Normal deviate of the sum of mid-ranks from row `from` on. The rank takes N + 1 values, hence
    /// `Var = (1 - (N+1)^-2) / 12`; dividing by N instead drifts by `sqrt(12 M) / 2N` standard deviations.
    pub fn z_score(&self, from: usize) -> f64 {
        let (mut sum, mut variance) = (0.0, 0.0);
        for (&r, &n) in self.rank.iter().zip(&self.size).skip(from) {
            let places = f64::from(n) + 1.0;
            sum += (f64::from(r) + 0.5) / places - 0.5;
            variance += (1.0 - places.powi(-2)) / 12.0;
        }
        if variance > 0.0 {
            sum / variance.sqrt()
        } else {
            0.0
        }
    }

    /// Kolmogorov-Smirnov probabilities of the ranks in windows of `window` insertions (the last one may be up to
    /// twice as long). Ranks are turned into continuous numbers at random, because the test is for continuous
    /// numbers.
    pub fn ks_windows(&self, window: usize, rng: &mut RandomStream) -> Vec<f64> {
        let values: Vec<f64> = self
            .rank
            .iter()
            .zip(&self.size)
            .map(|(&r, &n)| (f64::from(r) + unit_open(rng)) / (f64::from(n) + 1.0))
            .collect();
        let count = (values.len() / window.max(1)).max(1);
        (0..count)
            .map(|w| {
                let start = w * window;
                let end = if w + 1 == count {
                    values.len()
                } else {
                    start + window
                };
                ks_probability(&values[start..end])
            })
            .collect()
    }
}

/// Probability that `values`, if uniform on (0, 1), lie at least as far from uniform (Stephens' form of Kolmogorov's
/// distribution). 1 without values.
pub(super) fn ks_probability(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let count = sorted.len() as f64;
    let distance = sorted
        .iter()
        .enumerate()
        .map(|(i, v)| (v - i as f64 / count).max((i as f64 + 1.0) / count - v))
        .fold(0.0, f64::max);
    let root = count.sqrt();
    let x = (root + 0.12 + 0.11 / root.max(1.0)) * distance;
    if x < 0.2 {
        return 1.0;
    }
    let tail: f64 = (1..=100)
        .map(|k| {
            let k = f64::from(k);
            let sign = if k % 2.0 > 0.5 { 1.0 } else { -1.0 };
            sign * (-2.0 * k * k * x * x).exp()
        })
        .sum();
    (2.0 * tail).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Domain, below, stream};

    #[test]
    fn rank_score_of_uniform_ranks_is_standard_normal() {
        for (case, size) in [(0, 20_u32), (1, 500)] {
            let scores: Vec<f64> = (0..2000)
                .map(|i| {
                    let mut rng = stream(7, Domain::Test, case, i);
                    let mut ranks = Ranks::default();
                    for _ in 0..1000 {
                        let rank = below(&mut rng, size as usize + 1);
                        ranks.push(u32::try_from(rank).unwrap(), size);
                    }
                    ranks.z_score(0)
                })
                .collect();
            let mean = scores.iter().sum::<f64>() / 2000.0;
            let sd = (scores.iter().map(|z| (z - mean).powi(2)).sum::<f64>() / 1999.0).sqrt();
            // Three standard errors of a mean and of a standard deviation over 2000 sequences.
            assert!(mean.abs() < 0.067, "N = {size}: mean {mean}");
            assert!((sd - 1.0).abs() < 0.05, "N = {size}: sd {sd}");
        }
    }

    #[test]
    fn ks_probabilities_of_uniform_ranks_are_uniform_and_of_squares_are_not() {
        let mut rng = stream(8, Domain::Test, 0, 0);
        let p: Vec<f64> = (0..500)
            .map(|_| {
                let v: Vec<f64> = (0..300).map(|_| unit_open(&mut rng)).collect();
                ks_probability(&v)
            })
            .collect();
        assert!(ks_probability(&p) > 1e-3);
        let v: Vec<f64> = (0..300).map(|_| unit_open(&mut rng).powi(2)).collect();
        assert!(ks_probability(&v) < 1e-6);
    }
}
