//! Diagnostics of weighted draws that are dependent within clusters, and independent between them (design effect; Kish 1965).
//!
//! Weights add up to 1; a cluster is the label of each row, counted from 0.

use super::{effective_number, weighted_moments, weighted_quantile};
use crate::normal;

/// Sums of one number per row over the rows of each cluster; `clusters` has the cluster of each row, counted from 0.
#[must_use]
pub fn sums_by_group(groups: &[u32], numbers: impl Iterator<Item = f64>) -> Vec<f64> {
    let count = groups.iter().max().map_or(0, |last| *last as usize + 1);
    let mut sums = vec![0.0; count];
    for (group, number) in groups.iter().zip(numbers) {
        sums[*group as usize] += number;
    }
    sums
}

/// ESS of the mean of `values` with weights that add up to 1: their variance over the variance of the mean, which comes
/// from the summed deviation of each cluster of dependent rows (design effect; Kish 1965), corrected for the number of
/// clusters. 0 for a single cluster.
#[must_use]
pub fn size_of_mean(values: &[f64], weights: &[f64], groups: &[u32]) -> f64 {
    let sums = sums_by_group(groups, weights.iter().copied());
    let degrees_of_freedom = 1.0 - 1.0 / effective_number(sums);
    // The deviation of a single cluster is 0 except for rounding.
    if degrees_of_freedom < 1e-9 {
        return 0.0;
    }
    let (mean, variance) = weighted_moments(values, weights);
    let deviations = values.iter().zip(weights).map(|(x, w)| w * (x - mean));
    let sums = sums_by_group(groups, deviations);
    let scatter: f64 = sums.iter().map(|s| s * s).sum();
    variance * degrees_of_freedom / scatter
}

/// Bulk effective sample size: [`size_of_mean`] of the rank-normalised values, as [`bulk_ess`](super::bulk_ess) is of Markov chains.
#[must_use]
pub fn clustered_bulk_ess(values: &[f64], weights: &[f64], groups: &[u32]) -> f64 {
    size_of_mean(&rank_normalised(values, weights), weights, groups)
}

/// Tail effective sample size: the smaller of those of the indicators of the 5 % and 95 % quantiles.
#[must_use]
pub fn clustered_tail_ess(values: &[f64], weights: &[f64], groups: &[u32]) -> f64 {
    let of = |p: f64| {
        let cut = weighted_quantile(values, weights, p);
        let below: Vec<f64> = values
            .iter()
            .map(|x| f64::from(u8::from(*x <= cut)))
            .collect();
        size_of_mean(&below, weights, groups)
    };
    of(0.05).min(of(0.95))
}

/// Normal scores of the weights below each value and half of its own; equal values share one.
fn rank_normalised(values: &[f64], weights: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|&a, &b| values[a].total_cmp(&values[b]));
    let mut scores = vec![0.0; values.len()];
    let mut below = 0.0;
    for equal in order.chunk_by(|&a, &b| values[a].total_cmp(&values[b]).is_eq()) {
        let own: f64 = equal.iter().map(|&i| weights[i]).sum();
        // Rows without weight at either end have no score, and rounding may have brought the sum above 1.
        let p = (below + 0.5 * own).clamp(f64::EPSILON, 1.0 - f64::EPSILON);
        equal.iter().for_each(|&i| scores[i] = normal::quantile(p));
        below += own;
    }
    scores
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Domain, standard_normal, stream};

    #[test]
    fn means_are_as_many_draws_as_their_groups_scatter() {
        // Four rows of equal weight: two clusters, each with both values or with one value, or a single cluster.
        let sizes = [[0, 0, 1, 1], [0, 1, 0, 1], [0; 4]]
            .map(|groups| size_of_mean(&[1.0, 3.0, 1.0, 3.0], &[0.25; 4], &groups));
        assert!(sizes[0].is_infinite() && (sizes[1] - 1.0).abs() < 1e-12);
        assert!(sizes[2].abs() < 1e-12);
    }

    /// 64 clusters of 50 rows: deviates of variance 1 each, and one of the variance `common` of the whole cluster.
    fn rows(common: f64, seed: u64) -> (Vec<f64>, Vec<u32>) {
        let mut rng = stream(4, Domain::Test, seed, 0);
        (0..64)
            .flat_map(|cluster| {
                let shared = common.sqrt() * standard_normal(&mut rng);
                (0..50)
                    .map(|_| (shared + standard_normal(&mut rng), cluster))
                    .collect::<Vec<_>>()
            })
            .unzip()
    }

    #[test]
    fn effective_sizes_are_those_of_draws_with_a_common_part_whatever_the_scale() {
        let weights = vec![1.0 / 3_200.0; 3_200];
        for common in [0.0, 0.2] {
            // The error of one size is sqrt(2 / 64), that of the mean of 20 a twentieth and more of its square.
            let mut mean = [0.0; 3];
            for seed in 0..20 {
                let (x, groups) = rows(common, seed);
                let cubes: Vec<f64> = x.iter().map(|x| x.powi(3)).collect();
                for (mean, size) in mean.iter_mut().zip([
                    clustered_bulk_ess(&x, &weights, &groups),
                    clustered_bulk_ess(&cubes, &weights, &groups),
                    clustered_tail_ess(&x, &weights, &groups),
                ]) {
                    *mean += size / 20.0;
                }
            }
            let exact = 3_200.0 / (1.0 + 49.0 * common / (1.0 + common));
            assert!((mean[0] / exact - 1.0).abs() < 0.15, "{mean:?} {exact}");
            assert!((mean[1] / mean[0] - 1.0).abs() < 1e-9, "{mean:?}");
            // Indicators of the tails are correlated less than the values; the smaller of two is below the mean.
            assert!(
                mean[2] > 0.7 * mean[0] && mean[2] < 3.0 * mean[0],
                "{mean:?}"
            );
        }
    }

    #[test]
    fn rows_without_weight_and_constants_have_no_part() {
        let scores = rank_normalised(&[5.0, 1.0, 2.0, 9.0], &[0.5, 0.0, 0.5, 0.0]);
        assert!(scores.iter().all(|s| s.is_finite()));
        assert!((scores[0] + scores[2]).abs() < 1e-12 && scores[0] > 0.6);
        assert_eq!(rank_normalised(&[3.0; 4], &[0.25; 4]), [0.0; 4]);
    }
}
