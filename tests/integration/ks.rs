//! The Kolmogorov-Smirnov distance, for tests of distributions.

/// Distance times `sqrt n` that a true distribution exceeds with probability 1e-4: `sqrt(-ln(0.5e-4) / 2)`, the
/// asymptotic law (Kolmogorov 1933), good from a few hundred draws on.
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
