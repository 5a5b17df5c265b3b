//! The shape of the tail of importance weights.

/// Fewest weights that a tail is fitted to.
const MIN_TAIL: usize = 5;

/// Shape `k` of the generalised Pareto distribution fitted to the largest of some weights, which are given by their logarithms (Vehtari et al.
/// 2024): above 0.7 a sum over so many weights cannot be trusted. The tail has `min(n / 5, 3 sqrt n)` of the `n` weights, and the fit is that of Zhang
/// & Stephens (2009) with the weak prior of Vehtari et al.: `k` is drawn towards 0.5 by ten weights. Minus infinity if all weights of the tail are
/// equal; infinity if there are too few for a tail, without those that are zero, or if one is not a number. Weights equal to the threshold, of which weights with few different values have many, do not
/// belong to the tail.
#[must_use]
pub fn pareto_k(ln_weights: &[f64]) -> f64 {
    if ln_weights.iter().any(|w| w.is_nan()) {
        return f64::INFINITY;
    }
    let mut sorted: Vec<f64> = ln_weights.to_vec();
    sorted.sort_by(f64::total_cmp);
    let n = sorted.len();
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "at most n"
    )]
    let tail = (0.2 * n as f64).min(3.0 * (n as f64).sqrt()).ceil() as usize;
    let top = sorted.last().copied().unwrap_or(f64::NAN);
    // Draws without weight belong to no tail.
    let weighted = sorted.iter().filter(|w| (*w - top).exp() > 0.0).count();
    if tail < MIN_TAIL || weighted < MIN_TAIL || !top.is_finite() {
        return f64::INFINITY;
    }
    let start = n - tail;
    let threshold = (sorted[start - 1] - top).exp();
    let excess: Vec<f64> = sorted[start..]
        .iter()
        .map(|w| (w - top).exp() - threshold)
        .filter(|excess| *excess > 0.0)
        .collect();
    if excess.is_empty() {
        return f64::NEG_INFINITY;
    }
    shape(&excess)
}

/// The shape from excesses over the threshold, in increasing order.
fn shape(excess: &[f64]) -> f64 {
    let n = excess.len() as f64;
    let largest = excess[excess.len() - 1];
    // Candidates of b = -k / sigma around the inverse of the largest excess, weighted by their profile likelihood.
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a quarter of the number of excesses"
    )]
    let quartile = excess[((n / 4.0 + 0.5) as usize).max(1) - 1];
    let candidates = 30.0 + n.sqrt().floor();
    let k_of = |b: f64| excess.iter().map(|x| (-b * x).ln_1p()).sum::<f64>() / n;
    let b: Vec<f64> = (1..)
        .map(f64::from)
        .take_while(|i| *i <= candidates)
        .map(|i| 1.0 / largest + (1.0 - (candidates / (i - 0.5)).sqrt()) / (3.0 * quartile))
        .collect();
    let profile: Vec<f64> = b
        .iter()
        .map(|b| {
            let k = k_of(*b);
            n * ((-b / k).ln() - k - 1.0)
        })
        .collect();
    let top = profile.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let (mut sum, mut mean) = (0.0, 0.0);
    for (b, l) in b.iter().zip(&profile) {
        let weight = (l - top).exp();
        if weight.is_finite() {
            sum += weight;
            mean += weight * b;
        }
    }
    let k = k_of(mean / sum);
    (n * k + 5.0) / (n + 10.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Domain, stream, unit_open};

    /// Weights `u^-k` are a generalised Pareto distribution of shape k; their whole upper tail is one too.
    #[test]
    fn the_shape_of_a_pareto_distribution_is_found() {
        for (task, k) in [-0.3, 0.1, 0.5, 0.7, 1.0].into_iter().enumerate() {
            let mut rng = stream(1, Domain::Post, task as u64, 0);
            let mean = (0..20).map(|_| {
                let ln: Vec<f64> = (0..5_000)
                    .map(|_| {
                        let u = unit_open(&mut rng);
                        // sigma = 1: the inverse of 1 - (1 + k x)^(-1/k).
                        ((u.powf(-k) - 1.0) / k).ln()
                    })
                    .collect();
                pareto_k(&ln)
            });
            let mean = mean.sum::<f64>() / 20.0;
            // 213 excesses: each fit has a standard error of (1 + k) / sqrt 213 at most, 0.14, the mean of twenty 0.03; the
            // prior moves k by at most 10 / 223 of its distance from 0.5.
            let pulled = (213.0 * k + 5.0) / 223.0;
            assert!((mean - pulled).abs() < 0.09, "{k}: {mean}");
        }
    }

    #[test]
    fn tails_that_have_no_shape_are_named() {
        assert!(pareto_k(&[0.0; 5]).is_infinite() && pareto_k(&[0.0; 5]) > 0.0);
        assert!(pareto_k(&[0.0; 1_000]) < 0.0);
        // Weights of two values: those of the lower one fill the tail but for 20, and have no excess.
        let two = |high: usize| [vec![0.0; 1_000 - high], vec![1.0; high]].concat();
        for high in [1, 20, 95] {
            let k = pareto_k(&two(high));
            assert!(k.is_finite() && k < 0.7, "{high}: {k}");
        }
        assert!(pareto_k(&two(900)) < 0.0);
        let mut one_nan = vec![0.0; 1_000];
        one_nan[3] = -f64::NAN;
        assert!(pareto_k(&one_nan) > 1.0);
        // All but one draw have no weight.
        let mut single = vec![f64::NEG_INFINITY; 1_000];
        single[5] = 0.0;
        assert!(pareto_k(&single) > 0.7);
    }
}
