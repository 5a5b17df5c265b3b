//! Wasserstein distance of two marginals, and its expectation for equal distributions.

use std::f64::consts::FRAC_2_PI;

/// A distance of two sets of draws, and its expectation for equal distributions; both in the units of the draws.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Distance {
    /// First Wasserstein distance: the area between the two cumulative distributions.
    pub distance: f64,
    /// Its expectation for independent draws of one distribution, as many as the effective sizes.
    pub expected: f64,
}

/// The distance of two sets of draws, each given by its values, their weights (any sum) and its effective size.
///
/// `expected` comes from the pooled distribution F: the difference of two empirical ones is Gaussian with variance `F
/// (1 - F) (1 / n_a + 1 / n_b)`, and the mean absolute value of a Gaussian is `sqrt(2 / pi)` of its standard deviation.
#[must_use]
pub fn wasserstein(a: (&[f64], &[f64], f64), b: (&[f64], &[f64], f64)) -> Distance {
    let total = |weights: &[f64]| weights.iter().sum::<f64>();
    let (sum_a, sum_b) = (total(a.1), total(b.1));
    let rows_a = a.0.iter().zip(a.1).map(|(x, w)| (*x, w / sum_a, 0.0));
    let rows_b = b.0.iter().zip(b.1).map(|(x, w)| (*x, 0.0, w / sum_b));
    let mut rows: Vec<(f64, f64, f64)> = rows_a.chain(rows_b).collect();
    rows.sort_by(|p, q| p.0.total_cmp(&q.0));
    let chance = (FRAC_2_PI * (1.0 / a.2 + 1.0 / b.2)).sqrt();
    let (mut below_a, mut below_b) = (0.0, 0.0);
    let mut found = Distance::default();
    for pair in rows.windows(2) {
        below_a += pair[0].1;
        below_b += pair[0].2;
        let gap = pair[1].0 - pair[0].0;
        let pooled = (a.2 * below_a + b.2 * below_b) / (a.2 + b.2);
        found.distance += gap * (below_a - below_b).abs();
        found.expected += gap * chance * (pooled * (1.0 - pooled)).max(0.0).sqrt();
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Domain, standard_normal, stream};

    #[test]
    fn a_shift_is_its_own_distance_and_weights_count() {
        let (a, even) = ([0.0, 1.0, 5.0], [1.0; 3]);
        let shifted = a.map(|x| x + 0.25);
        let size = 3.0;
        let same = wasserstein((&a, &even, size), (&a, &even, size)).distance;
        assert!(same.abs() < 1e-12, "{same}");
        let found = wasserstein((&a, &even, size), (&shifted, &even, size)).distance;
        assert!((found - 0.25).abs() < 1e-12, "{found}");
        // Half of the mass moves by 4, at any sum of the weights.
        let found = wasserstein(
            (&[1.0, 5.0], &[2.0, 2.0], 2.0),
            (&[1.0, 5.0], &[3.0, 0.0], 2.0),
        );
        assert!((found.distance - 2.0).abs() < 1e-12, "{found:?}");
    }

    #[test]
    fn draws_of_one_distribution_are_as_far_apart_as_chance_says() {
        let draws = |task: u64, pair: u64, n: usize| -> Vec<f64> {
            let mut rng = stream(3, Domain::Post, task, pair);
            (0..n).map(|_| standard_normal(&mut rng)).collect()
        };
        let (n, m) = (100, 400);
        let ratios: Vec<f64> = (0..400)
            .map(|pair| {
                let (a, b) = (draws(0, pair, n), draws(1, pair, m));
                let found = wasserstein((&a, &vec![1.0; n], 100.0), (&b, &vec![1.0; m], 400.0));
                found.distance / found.expected
            })
            .collect();
        let count = ratios.len() as f64;
        let mean = ratios.iter().sum::<f64>() / count;
        let variance = ratios.iter().map(|r| (r - mean).powi(2)).sum::<f64>() / (count - 1.0);
        // Four of the mean's own errors, and what the tails of so few draws leave out.
        assert!(
            (mean - 1.0).abs() < 4.0 * (variance / count).sqrt() + 0.02,
            "{mean}"
        );
    }
}
