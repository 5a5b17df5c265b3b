//! Pure functions of draws: quantiles, effective sizes, ranks, distances.

mod chains;
mod clusters;
mod distance;
mod modes;
mod pareto;

pub use chains::{autocovariance, bulk_ess, error_of_mean, mean_ess, r_hat, tail_ess};
pub use clusters::{clustered_bulk_ess, clustered_tail_ess, size_of_mean, sums_by_group};
pub use distance::{Distance, wasserstein};
pub use modes::{mode_agreement, two_means};
pub use pareto::pareto_k;

use crate::normal;
use statrs::distribution::{ChiSquared, ContinuousCDF, StudentsT};

/// Weighted quantile of `values` at probability `p`: the smallest value whose cumulative weight reaches `p`, by
/// linear interpolation between the mid-points of the weights. Weights need not be normalised. NaN without values.
#[must_use]
pub fn weighted_quantile(values: &[f64], weights: &[f64], p: f64) -> f64 {
    let rows = values.len().min(weights.len());
    let mut order: Vec<usize> = (0..rows).filter(|&i| weights[i] > 0.0).collect();
    order.sort_by(|&a, &b| values[a].total_cmp(&values[b]));
    let total: f64 = order.iter().map(|&i| weights[i]).sum();
    let mut below = 0.0;
    let mut last: Option<(f64, f64)> = None;
    for i in order {
        let middle = (below + 0.5 * weights[i]) / total;
        if middle >= p {
            return match last {
                // Infinite values have no number between them.
                Some((m, v)) if middle > m && v.is_finite() && v < values[i] => {
                    v + (values[i] - v) * (p - m) / (middle - m)
                }
                _ => values[i],
            };
        }
        below += weights[i];
        last = Some((middle, values[i]));
    }
    last.map_or(f64::NAN, |(_, v)| v)
}

/// Mean and variance of `values` with weights that add up to 1.
#[must_use]
pub fn weighted_moments(values: &[f64], weights: &[f64]) -> (f64, f64) {
    let rows = || values.iter().zip(weights);
    let mean: f64 = rows().map(|(x, w)| w * x).sum();
    let variance = rows().map(|(x, w)| w * (x - mean).powi(2)).sum();
    (mean, variance)
}

/// Mean and variance of every column of `rows` of `columns` numbers each, one row after the other.
#[must_use]
pub fn column_moments(rows: &[f64], columns: usize) -> Vec<(f64, f64)> {
    let count = (rows.len() / columns) as f64;
    (0..columns)
        .map(|c| {
            let column = || rows.iter().skip(c).step_by(columns);
            let mean = column().sum::<f64>() / count;
            let variance = column().map(|x| (x - mean).powi(2)).sum::<f64>() / count;
            (mean, variance)
        })
        .collect()
}

/// p-value of the chi-square `chi2` of `count` values about their common mean.
#[must_use]
pub fn chi2_p_value(chi2: f64, count: usize) -> f64 {
    chi2_tail(chi2, (count as f64 - 1.0).max(1.0))
}

/// Probability that a chi-square of this number of degrees of freedom, above 0, is larger than `chi2`.
#[must_use]
pub fn chi2_tail(chi2: f64, degrees_of_freedom: f64) -> f64 {
    ChiSquared::new(degrees_of_freedom).map_or(0.0, |law| law.sf(chi2))
}

/// The standard-normal deviate with the tail probability of Student's `t`, a difference over a standard error that is itself
/// estimated with these degrees of freedom. `t` itself where the degrees of freedom are NaN.
#[must_use]
pub fn normal_deviate(t: f64, degrees_of_freedom: f64) -> f64 {
    // The tail probability is at least that of the normal distribution at `t`, so that its quantile is finite.
    let rare = |law: StudentsT| normal::quantile(law.cdf(-t.abs())).abs().min(t.abs());
    StudentsT::new(0.0, 1.0, degrees_of_freedom).map_or(t, |law| rare(law).copysign(t))
}

/// Kish's effective number of weights, `(sum w)^2 / sum w^2`; 0 if all are 0.
#[must_use]
pub fn effective_number(weights: impl IntoIterator<Item = f64>) -> f64 {
    let (sum, squares) = weights
        .into_iter()
        .fold((0.0, 0.0), |(s, q), w| (s + w, q + w * w));
    if squares > 0.0 {
        sum * sum / squares
    } else {
        0.0
    }
}

/// Effective number of different labels, each weighted by how often it occurs (Kish).
#[must_use]
pub fn effective_kinds<T: Ord>(labels: impl IntoIterator<Item = T>) -> f64 {
    let mut labels: Vec<T> = labels.into_iter().collect();
    labels.sort_unstable();
    effective_number(labels.chunk_by(|a, b| a == b).map(|own| own.len() as f64))
}

/// Kish effective size of normalised log weights.
#[must_use]
pub fn kish_ess(ln_weight: &[f64]) -> f64 {
    effective_number(ln_weight.iter().map(|w| w.exp()))
}

/// `ln sum exp`, minus infinity for an empty or all minus-infinite slice.
#[must_use]
pub fn ln_sum_exp(values: &[f64]) -> f64 {
    let top = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if top == f64::NEG_INFINITY {
        return top;
    }
    top + values.iter().map(|v| (v - top).exp()).sum::<f64>().ln()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_of_few_numbers_make_differences_less_rare() {
        // Quantiles of Student's t: exceeded once in twenty cases, and once in a hundred (4.604 with 4 degrees of
        // freedom).
        for (t, degrees_of_freedom, z) in [
            (4.302_653, 2.0, 1.959_964),
            (-2.776_445, 4.0, -1.959_964),
            (4.604_095, 4.0, 2.575_829),
            (-3.0, f64::INFINITY, -3.0),
            (3.0, f64::NAN, 3.0),
            (0.0, 5.0, 0.0),
        ] {
            let ours = normal_deviate(t, degrees_of_freedom);
            assert!(
                (ours - z).abs() < 1e-5,
                "{t} {degrees_of_freedom}: {ours} {z}"
            );
        }
        assert!(normal_deviate(1e3, 3.0) > 5.0 && normal_deviate(1e3, 1e4).is_finite());
    }

    #[test]
    fn effective_numbers_count_equal_shares_and_fall_with_unequal_ones() {
        assert!((effective_number([2.0, 2.0, 0.0]) - 2.0).abs() < 1e-12);
        assert!((effective_number([3.0, 1.0]) - 1.6).abs() < 1e-12);
        assert!(effective_number([0.0, 0.0]).abs() < 1e-300);
        assert!((effective_kinds(["a", "b", "a", "b"]) - 2.0).abs() < 1e-12);
        assert!((kish_ess(&[0.5_f64.ln(), 0.5_f64.ln()]) - 2.0).abs() < 1e-12);
    }
}
