//! Diagnostics of several chains of one quantity (Vehtari, Gelman, Simpson, Carpenter & Burkner 2021).
//!
//! Chains are slices of equal length; longer ones are cut to the shortest. Chains with fewer than four draws have an
//! infinite R-hat and an effective size of 0.

use crate::normal;

/// Rank-normalised split R-hat: the larger of that of the quantity and that of its distance from the median, so that
/// chains that differ in location or in width are both found. 1 for a quantity that is the same constant in all
/// chains, infinite for chains stuck at different constants.
#[must_use]
pub fn r_hat(chains: &[&[f64]]) -> f64 {
    let halves = split(chains);
    let median = quantile_of(&halves, 0.5);
    let folded: Vec<Vec<f64>> = halves
        .iter()
        .map(|chain| chain.iter().map(|x| (x - median).abs()).collect())
        .collect();
    plain_r_hat(&rank_normalised(&halves)).max(plain_r_hat(&rank_normalised(&folded)))
}

/// Bulk effective sample size, of the rank-normalised split chains.
#[must_use]
pub fn bulk_ess(chains: &[&[f64]]) -> f64 {
    ess_of(&rank_normalised(&split(chains)))
}

/// Tail effective sample size: the smaller of those of the indicators of the 5 % and 95 % quantiles.
#[must_use]
pub fn tail_ess(chains: &[&[f64]]) -> f64 {
    let halves = split(chains);
    [0.05, 0.95]
        .into_iter()
        .map(|p| {
            let cut = quantile_of(&halves, p);
            let below: Vec<Vec<f64>> = halves
                .iter()
                .map(|chain| {
                    chain
                        .iter()
                        .map(|x| f64::from(u8::from(*x <= cut)))
                        .collect()
                })
                .collect();
            ess_of(&below)
        })
        .fold(f64::INFINITY, f64::min)
}

/// Effective sample size of the mean of the chains as they are, split but not rank-normalised.
#[must_use]
pub fn mean_ess(chains: &[&[f64]]) -> f64 {
    ess_of(&split(chains))
}

/// Standard error of the mean of the chains as they are, from their standard deviation and [`mean_ess`]: NaN or infinite for too
/// few draws.
#[must_use]
pub fn error_of_mean(chains: &[&[f64]]) -> f64 {
    let count = chains.iter().map(|c| c.len()).sum::<usize>() as f64;
    let values = || chains.iter().copied().flatten();
    let mean = values().sum::<f64>() / count;
    let variance = values().map(|x| (x - mean).powi(2)).sum::<f64>() / count;
    (variance / mean_ess(chains)).sqrt()
}

/// Autocovariance of one chain at one lag, with divisor `n`.
#[must_use]
pub fn autocovariance(chain: &[f64], lag: usize) -> f64 {
    let n = chain.len();
    if lag >= n {
        return 0.0;
    }
    let mean = chain.iter().sum::<f64>() / n as f64;
    let sum: f64 = chain[..n - lag]
        .iter()
        .zip(&chain[lag..])
        .map(|(a, b)| (a - mean) * (b - mean))
        .sum();
    sum / n as f64
}

fn split(chains: &[&[f64]]) -> Vec<Vec<f64>> {
    let half = chains.iter().map(|c| c.len()).min().unwrap_or(0) / 2;
    chains
        .iter()
        .flat_map(|c| [c[..half].to_vec(), c[c.len() - half..].to_vec()])
        .collect()
}

fn quantile_of(chains: &[Vec<f64>], p: f64) -> f64 {
    let values: Vec<f64> = chains.iter().flatten().copied().collect();
    super::weighted_quantile(&values, &vec![1.0; values.len()], p)
}

/// Normal scores of the pooled ranks (ties share their mean rank): `Phi^-1((r - 3/8) / (n + 1/4))`.
fn rank_normalised(chains: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let mut order: Vec<(f64, usize, usize)> = chains
        .iter()
        .enumerate()
        .flat_map(|(c, chain)| chain.iter().enumerate().map(move |(i, x)| (*x, c, i)))
        .collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0));
    let n = order.len() as f64;
    let mut scores: Vec<Vec<f64>> = chains.iter().map(|c| vec![0.0; c.len()]).collect();
    let mut start = 0;
    while start < order.len() {
        let value = order[start].0;
        let end = start + order[start..].partition_point(|(x, _, _)| x.total_cmp(&value).is_le());
        // Ranks count from 1; the mean of ranks start + 1 ..= end.
        let rank = 0.5 * (start + 1 + end) as f64;
        let score = normal::quantile((rank - 0.375) / (n + 0.25));
        for (_, c, i) in &order[start..end] {
            scores[*c][*i] = score;
        }
        start = end;
    }
    scores
}

/// Mean within-chain variance, and the variance estimate that also includes the variance of the chain means.
fn variances(chains: &[Vec<f64>]) -> (f64, f64) {
    let n = chains[0].len() as f64;
    let m = chains.len() as f64;
    let means: Vec<f64> = chains.iter().map(|c| c.iter().sum::<f64>() / n).collect();
    let within = chains
        .iter()
        .zip(&means)
        .map(|(c, mean)| c.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0))
        .sum::<f64>()
        / m;
    let grand = means.iter().sum::<f64>() / m;
    let between = means.iter().map(|x| (x - grand).powi(2)).sum::<f64>() / (m - 1.0);
    (within, within * (n - 1.0) / n + between)
}

fn usable(chains: &[Vec<f64>]) -> bool {
    chains.len() > 1 && chains[0].len() > 1
}

fn plain_r_hat(chains: &[Vec<f64>]) -> f64 {
    if !usable(chains) {
        return f64::INFINITY;
    }
    let (within, total) = variances(chains);
    if total <= 0.0 {
        1.0
    } else {
        (total / within).sqrt()
    }
}

/// Geyer's initial monotone sequence on autocorrelations averaged over chains; at most `S log10 S` (antithetic chains),
/// as Stan does. A constant quantity has an effective size of 0 if chains disagree, and that of all draws if they
/// agree.
fn ess_of(chains: &[Vec<f64>]) -> f64 {
    if !usable(chains) {
        return 0.0;
    }
    let n = chains[0].len();
    let size = (n * chains.len()) as f64;
    let (within, total) = variances(chains);
    if total <= 0.0 {
        return size;
    }
    let rho = |lag: usize| {
        let mean = chains.iter().map(|c| autocovariance(c, lag)).sum::<f64>() / chains.len() as f64;
        // Autocovariances with divisor n, the within variance with n - 1: rho(0) is set by definition.
        1.0 - (within - mean * n as f64 / (n as f64 - 1.0)) / total
    };
    let mut sum = 0.0;
    let mut last = f64::INFINITY;
    let mut lag = 0;
    while lag + 1 < n {
        let even = if lag == 0 { 1.0 } else { rho(lag) };
        let pair = even + rho(lag + 1);
        if pair <= 0.0 {
            break;
        }
        last = last.min(pair);
        sum += last;
        lag += 2;
    }
    let time = (2.0 * sum - 1.0).max(1.0 / size.log10());
    size / time
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Domain, standard_normal, stream};

    fn ar1(phi: f64, n: usize, chains: u64, seed: u64) -> Vec<Vec<f64>> {
        (0..chains)
            .map(|c| {
                let mut rng = stream(seed, Domain::Test, c, 0);
                let mut x = standard_normal(&mut rng);
                (0..n)
                    .map(|_| {
                        x = phi * x + (1.0 - phi * phi).sqrt() * standard_normal(&mut rng);
                        x
                    })
                    .collect()
            })
            .collect()
    }

    fn slices(chains: &[Vec<f64>]) -> Vec<&[f64]> {
        chains.iter().map(Vec::as_slice).collect()
    }

    #[test]
    fn the_effective_size_of_an_autoregression_is_the_known_one() {
        for phi in [-0.4, 0.0, 0.5, 0.9] {
            let chains = ar1(phi, 20_000, 4, 1);
            let exact = 80_000.0 * (1.0 - phi) / (1.0 + phi);
            let mean = mean_ess(&slices(&chains));
            let bulk = bulk_ess(&slices(&chains));
            // The estimate itself scatters by a few percent at this length.
            assert!((mean / exact - 1.0).abs() < 0.12, "{phi} {mean} {exact}");
            assert!((bulk / exact - 1.0).abs() < 0.12, "{phi} {bulk} {exact}");
        }
    }

    #[test]
    fn tails_of_an_autoregression_mix_faster_than_its_bulk() {
        let chains = ar1(0.9, 20_000, 4, 2);
        let (bulk, tail) = (bulk_ess(&slices(&chains)), tail_ess(&slices(&chains)));
        assert!(tail > bulk && tail < 3.0 * bulk, "{bulk} {tail}");
    }

    #[test]
    fn r_hat_is_one_for_good_chains_and_sees_shifts_and_widths() {
        let good = ar1(0.3, 2000, 4, 3);
        assert!(r_hat(&slices(&good)) < 1.01);
        let mut shifted = good.clone();
        shifted[0].iter_mut().for_each(|x| *x += 0.5);
        assert!(r_hat(&slices(&shifted)) > 1.02);
        let mut wide = good.clone();
        wide[1].iter_mut().for_each(|x| *x *= 2.0);
        assert!(r_hat(&slices(&wide)) > 1.02);
        let mut drifting = good;
        for chain in &mut drifting {
            for (i, x) in chain.iter_mut().enumerate() {
                *x += i as f64 / 1000.0;
            }
        }
        assert!(r_hat(&slices(&drifting)) > 1.1, "halves of a chain differ");
    }

    #[test]
    fn constants_are_known_if_chains_agree_and_unknown_if_not() {
        let same = vec![vec![2.0; 10]; 4];
        assert!((r_hat(&slices(&same)) - 1.0).abs() < 1e-12);
        assert!((bulk_ess(&slices(&same)) - 40.0).abs() < 1e-12);
        let mut stuck = same;
        stuck[0] = vec![3.0; 10];
        assert!(r_hat(&slices(&stuck)) > 100.0);
        assert!(bulk_ess(&slices(&stuck)) < 10.0);
        assert!(r_hat(&[&[1.0, 2.0], &[1.0, 3.0]]).is_infinite());
    }
}
