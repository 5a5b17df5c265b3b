//! Can these importance weights be trusted? The tail index of the generalised Pareto distribution fitted to the largest.

use super::ln_sum_exp;

/// Fewest weights of a tail that a distribution is fitted to.
const FEWEST: usize = 5;

/// The tail of a set of importance weights, smoothed (Vehtari et al. 2024).
#[derive(Clone, Debug, PartialEq)]
pub struct Tail {
    /// Shape of the generalised Pareto distribution: the weights' mean converges usefully below 0.7, their variance is finite
    /// below 0.5. Minus infinity where the largest weights are all the same; infinity where there are too few to tell.
    pub k: f64,
    /// The largest log weights as they are, ascending.
    pub raw: Vec<f64>,
    /// What they are replaced by: the quantiles of the distribution, none above the largest raw weight.
    pub smooth: Vec<f64>,
}

impl Tail {
    /// The tail of these log weights (any normalisation; minus infinity is a weight of 0): the largest `3 sqrt(n)` of them, a
    /// fifth at most.
    #[must_use]
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a count below the number of weights"
    )]
    pub fn of(ln_weight: &[f64]) -> Self {
        let count = ln_weight.len() as f64;
        let length = (0.2 * count).min(3.0 * count.sqrt()) as usize;
        let mut sorted = ln_weight.to_vec();
        sorted.sort_by(f64::total_cmp);
        let raw = sorted.split_off(sorted.len() - length.min(sorted.len()));
        let untold = |k: f64| Self {
            k,
            raw: raw.clone(),
            smooth: raw.clone(),
        };
        let (Some(&cut), Some(&top)) = (sorted.last(), raw.last()) else {
            return untold(f64::INFINITY);
        };
        if length < FEWEST || top == f64::NEG_INFINITY {
            return untold(f64::INFINITY);
        }
        // In units of the largest weight.
        let floor = (cut - top).exp();
        let excess: Vec<f64> = raw.iter().map(|w| (w - top).exp() - floor).collect();
        if excess[length - 1] - excess[0] <= 100.0 * f64::EPSILON {
            return untold(f64::NEG_INFINITY);
        }
        let (k, scale) = generalised_pareto(&excess);
        let smooth = (0..length)
            .map(|i| (i as f64 + 0.5) / length as f64)
            .map(|p| top + (floor + quantile(p, k, scale)).ln().min(0.0))
            .collect();
        Self { k, raw, smooth }
    }

    /// What the sum of all weights is with the smoothed tail in place of the raw one, as a logarithm.
    #[must_use]
    pub fn ln_smooth_sum(&self, ln_weight: &[f64]) -> f64 {
        let all = ln_sum_exp(ln_weight);
        let change: f64 = self
            .smooth
            .iter()
            .zip(&self.raw)
            .map(|(smooth, raw)| (smooth - all).exp() - (raw - all).exp())
            .sum();
        all + change.ln_1p()
    }
}

fn quantile(p: f64, k: f64, scale: f64) -> f64 {
    if k.abs() < 1e-12 {
        -scale * (-p).ln_1p()
    } else {
        scale * (-k * (-p).ln_1p()).exp_m1() / k
    }
}

/// Shape and scale of the generalised Pareto distribution of ascending excesses: the posterior mean of Zhang & Stephens (2009)
/// over a grid, its shape drawn towards 1/2 as ten more excesses of that shape would (Vehtari et al. 2024, appendix C).
fn generalised_pareto(excess: &[f64]) -> (f64, f64) {
    let count = excess.len();
    let n = count as f64;
    let largest = excess[count - 1];
    // The first quartile, counted from 1 and rounded.
    let quartile = excess[((count + 2) / 4).max(1) - 1].max(f64::MIN_POSITIVE);
    let grid = 30.0 + n.sqrt().floor();
    let shape = |theta: f64| excess.iter().map(|x| (-theta * x).ln_1p()).sum::<f64>() / n;
    let mut places = Vec::new();
    let mut ln_posterior = Vec::new();
    let mut j = 0.5;
    while j < grid {
        let theta = 1.0 / largest + (1.0 - (grid / j).sqrt()) / (3.0 * quartile);
        let k = shape(theta);
        let ln_l = n * ((-theta / k).ln() - k - 1.0);
        if ln_l.is_finite() {
            places.push(theta);
            ln_posterior.push(ln_l);
        }
        j += 1.0;
    }
    let sum = ln_sum_exp(&ln_posterior);
    let theta: f64 = places
        .iter()
        .zip(&ln_posterior)
        .map(|(theta, l)| theta * (l - sum).exp())
        .sum();
    let k = shape(theta);
    ((n * k + 5.0) / (n + 10.0), -k / theta)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Domain, stream, unit_open};

    /// Log weights whose tail is Pareto's with this index.
    fn weights(k: f64, count: usize, seed: u64) -> Vec<f64> {
        let mut rng = stream(seed, Domain::Test, 1, 0);
        (0..count)
            .map(|_| quantile(unit_open(&mut rng), k, 1.0).ln())
            .collect()
    }

    #[test]
    fn the_index_of_a_pareto_tail_is_found() {
        // 600 weights in the tail: the index has an error of (1 + k) / sqrt(600) for k > -1/2 (Smith 1987); the mean of ten
        // sets a third of it. The pull towards 1/2 is at most 10 / 610 of the distance.
        for k in [-0.3, 0.1, 0.5, 0.9] {
            let mean = (0..10)
                .map(|s| Tail::of(&weights(k, 40_000, s)).k)
                .sum::<f64>()
                / 10.0;
            let error = (1.0 + k) / 600.0_f64.sqrt() / 10.0_f64.sqrt();
            assert!((mean - k).abs() < 3.0 * error + 0.02, "{k}: {mean}");
        }
    }

    #[test]
    fn a_smooth_tail_is_no_larger_than_the_largest_weight_and_changes_the_sum_little() {
        let raw = weights(0.4, 10_000, 3);
        let tail = Tail::of(&raw);
        let top = raw.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        assert_eq!(tail.raw.len(), 300);
        assert!(tail.smooth.iter().all(|w| *w <= top));
        assert!(tail.smooth.is_sorted());
        let change = tail.ln_smooth_sum(&raw) - ln_sum_exp(&raw);
        assert!(change.abs() < 0.02, "{change}");
    }

    #[test]
    fn equal_weights_have_no_tail_and_few_tell_nothing() {
        let k = |ln_weight: &[f64]| Tail::of(ln_weight).k;
        assert!(k(&[2.0; 1000]).is_infinite() && k(&[2.0; 1000]) < 0.0);
        for untold in [&[2.0, 1.0, 0.0][..], &[], &[f64::NEG_INFINITY; 1000]] {
            assert!(k(untold).is_infinite() && k(untold) > 0.0);
        }
    }
}
