//! The Kolmogorov-Smirnov distance and moments of ranks, for tests of distributions.

/// Distance times `sqrt n` that a true distribution exceeds with probability 1e-4: `sqrt(-ln(0.5e-4) / 2)`, the
/// asymptotic law (Kolmogorov 1933). Of few draws it is exceeded less often still, and by gross errors alone: of 24 it is
/// a distance of 0.45, which ranks in posteriors a quarter as wide, or shifted by a standard deviation, need not have.
pub const LIMIT: f64 = 2.226;

/// `sqrt n` times the largest distance between the empirical distribution of values in (0, 1) and the uniform one.
/// Give each draw's cumulative probability.
pub fn distance_from_uniform(mut u: Vec<f64>) -> f64 {
    u.sort_by(f64::total_cmp);
    let n = u.len() as f64;
    let distance = u
        .iter()
        .enumerate()
        .map(|(i, u)| (u - i as f64 / n).abs().max(((i + 1) as f64 / n - u).abs()))
        .fold(0.0, f64::max);
    distance * n.sqrt()
}

/// How far the mean of ranks is from 1/2, and that of `(p - 1/2)^2` from 1/12, in standard errors of `n` uniform numbers:
/// the variances of one are 1/12 and 1/180. The first is large for shifted posteriors, the second for posteriors that are
/// too narrow or too wide.
pub fn deviations_of_moments(ranks: &[f64]) -> [f64; 2] {
    let n = ranks.len() as f64;
    let mean = ranks.iter().sum::<f64>() / n;
    let square = ranks.iter().map(|p| (p - 0.5).powi(2)).sum::<f64>() / n;
    [
        (mean - 0.5) * (12.0 * n).sqrt(),
        (square - 1.0 / 12.0) * (180.0 * n).sqrt(),
    ]
}
