//! ln Z from the log-likelihoods of tempered chains: Bennett's estimate, its error, and three other estimates.

use crate::diagnostics::{error_of_mean, ln_sum_exp};
use crate::hmc::Screened;
use crate::valid::{Valid, ensure, rows};
use serde::{Deserialize, Serialize};

/// Blocks of scans that are averaged before their autocorrelation is computed: a weak correlation over hundreds of
/// scans is hidden by the noise of single ones.
const BLOCKS: usize = 256;

/// ln L of every chain of every chain set, scan by scan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Traces {
    temperatures: usize,
    /// Chain-set-major.
    values: Vec<Vec<f64>>,
    /// The draws of the reference of each chain set, where it is screened.
    screened: Vec<Screened>,
}

impl Traces {
    /// No scans yet.
    #[must_use]
    pub fn new(chain_sets: usize, temperatures: usize) -> Self {
        Self {
            temperatures,
            values: vec![Vec::new(); chain_sets * temperatures],
            screened: vec![Screened::default(); chain_sets],
        }
    }

    /// Checks traces that were read from a file: as many scans in every chain, all with a likelihood at beta = 1.
    pub(super) fn check(&self, chain_sets: usize, temperatures: usize) -> Valid {
        let scans = self.scans();
        ensure(
            self.temperatures == temperatures
                && rows(self.values.len(), chain_sets, temperatures)
                && self.screened.len() == chain_sets
                && self.values.iter().all(|trace| trace.len() == scans),
            "traces of other chain sets, temperatures or scans",
        )?;
        self.screened.iter().try_for_each(Screened::check)?;
        let sound = |(chain, trace): (usize, &Vec<f64>)| {
            let cold = (chain + 1).is_multiple_of(temperatures);
            let mut values = trace.iter();
            values.all(|l| l.is_finite() || !cold && *l == f64::NEG_INFINITY)
        };
        ensure(
            self.values.iter().enumerate().all(sound),
            "a trace is not finite",
        )
    }

    /// Adds one value of one chain.
    pub fn push(&mut self, chain_set: usize, temperature: usize, ln_likelihood: f64) {
        self.values[chain_set * self.temperatures + temperature].push(ln_likelihood);
    }

    /// Adds draws of the screened reference of a chain set.
    pub fn push_screened(&mut self, chain_set: usize, screened: &Screened) {
        self.screened[chain_set].add(screened);
    }

    /// ln of the integral of the reference of these chain sets as it is normalised, and its variance.
    fn reference_integral(&self, chain_sets: &[usize]) -> (f64, f64) {
        let mut all = Screened::default();
        (chain_sets.iter()).for_each(|chain_set| all.add(&self.screened[*chain_set]));
        all.ln_integral()
    }

    /// The traces before scan number `scan` and from it on; only of a path from the prior, whose reference is not screened.
    #[must_use]
    pub fn split_at(&self, scan: usize) -> [Self; 2] {
        let part = |from: usize, to: usize| Self {
            temperatures: self.temperatures,
            values: self.values.iter().map(|v| v[from..to].to_vec()).collect(),
            screened: vec![Screened::default(); self.screened.len()],
        };
        [part(0, scan), part(scan, self.scans())]
    }

    /// One chain's values.
    #[must_use]
    pub fn of(&self, chain_set: usize, temperature: usize) -> &[f64] {
        &self.values[chain_set * self.temperatures + temperature]
    }

    /// Chain sets.
    #[must_use]
    pub fn chain_sets(&self) -> usize {
        self.values.len() / self.temperatures
    }

    /// Temperatures.
    #[must_use]
    pub fn temperatures(&self) -> usize {
        self.temperatures
    }

    /// Scans recorded in every chain.
    #[must_use]
    pub fn scans(&self) -> usize {
        self.values.last().map_or(0, Vec::len)
    }

    /// Mean and variance (ln L, nats) over the finite values of these chain sets at one temperature.
    #[must_use]
    pub fn moments(&self, chain_sets: &[usize], temperature: usize) -> (f64, f64) {
        let values = || {
            (chain_sets.iter())
                .flat_map(|chain_set| self.of(*chain_set, temperature))
                .filter(|l| l.is_finite())
        };
        let count = values().count().max(1) as f64;
        let mean = values().sum::<f64>() / count;
        let variance = values().map(|l| (l - mean).powi(2)).sum::<f64>() / count;
        (mean, variance)
    }
}

/// ln Z, its errors and other estimates of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimate {
    /// Bennett's estimate of ln Z, the mean over annealing paths of that from all their chain sets together: the one to quote.
    pub ln_z: f64,
    /// Stepping-stone estimate from the side of the reference: the sum of `ln <exp(db l)>` at the smaller beta of each pair.
    pub forward: f64,
    /// From the side of the posterior: minus the sum of `ln <exp(-db l)>` at the larger beta of each pair, plus that of the fraction of the states at
    /// the smaller one whose `l` is not below all at the larger. Minus infinity if there is none.
    pub backward: f64,
    /// Corrected trapezoid of the mean ln L over beta, too high by tenths with few temperatures; `None` where the prior has
    /// points without a likelihood.
    pub thermodynamic: Option<f64>,
    /// Fraction of prior draws with a likelihood.
    pub valid: f64,
    /// Bennett's estimate per chain set.
    pub chain_sets: Vec<f64>,
    /// Error of each chain set's estimate, from its own scans.
    pub chain_set_errors: Vec<f64>,
    /// Standard error from the estimates of the clusters of chain sets, `sd / sqrt(clusters)`.
    pub error_chain_sets: f64,
    /// Error from the scans of all chain sets, with their autocorrelation.
    pub error_scans: f64,
}

impl Estimate {
    /// The error to quote: the larger of the two.
    #[must_use]
    pub fn error(&self) -> f64 {
        self.error_chain_sets.max(self.error_scans)
    }
}

/// Estimates ln Z from the extensions of a round: inverse temperatures, and the traces of the chain sets at them. Each
/// extension gives one estimate, weighted by its scans.
///
/// Chain set `k` belongs to cluster `k % clusters`; only clusters are independent. Cluster `c` follows the annealing path
/// `c % paths`; the estimates of different paths are averaged, with the number of their chain sets as weight. The difference
/// of the forward and the backward estimate is a check and no error, because it is smaller than the true error
/// (docs/decisions.md, section 3). With a single scan errors are infinite.
#[must_use]
pub fn estimate(extensions: &[(&[f64], &Traces)], clusters: usize, paths: usize) -> Estimate {
    let count = extensions
        .first()
        .map_or(0, |(_, traces)| traces.chain_sets());
    let all: Vec<usize> = (0..count).collect();
    let clusters = clusters.min(count);
    let of_path = |path: usize| -> Vec<usize> {
        let on_path = |k: &usize| (k % clusters) % paths == path;
        all.iter().copied().filter(on_path).collect()
    };
    let whole: Vec<OfPath> = (0..paths)
        .map(of_path)
        .filter(|chain_sets| !chain_sets.is_empty())
        .map(|chain_sets| OfPath::new(extensions, &chain_sets, count))
        .collect();
    let single: Vec<Bennett> = all
        .iter()
        .map(|chain_set| bennett(extensions, &[*chain_set]))
        .collect();
    let chain_sets: Vec<f64> = single.iter().map(|b| b.ln_z).collect();
    let clusters: Vec<f64> = (0..clusters)
        .map(|cluster| {
            let particles: Vec<usize> = all
                .iter()
                .copied()
                .skip(cluster)
                .step_by(clusters)
                .collect();
            bennett(extensions, &particles).ln_z
        })
        .collect();
    let mean = clusters.iter().sum::<f64>() / clusters.len() as f64;
    let scatter = clusters.iter().map(|l| (l - mean).powi(2)).sum::<f64>();
    let degrees_of_freedom = clusters.len().saturating_sub(1) as f64;
    let spread = scatter / (degrees_of_freedom * clusters.len() as f64);
    let mean_of = |of: fn(&OfPath) -> f64| whole.iter().map(|path| path.weight * of(path)).sum();
    let valid: f64 = mean_of(|path| path.valid);
    Estimate {
        ln_z: mean_of(|path| path.bennett.ln_z),
        forward: ln_mean(whole.iter().map(|path| (path.weight, path.forward))),
        backward: -ln_mean(whole.iter().map(|path| (path.weight, -path.backward))),
        thermodynamic: (whole.iter().all(|path| path.valid >= 1.0))
            .then(|| mean_of(|path| path.thermodynamic)),
        valid,
        chain_set_errors: single.iter().map(|b| b.error).collect(),
        chain_sets,
        error_chain_sets: if spread.is_finite() {
            spread.sqrt()
        } else {
            f64::INFINITY
        },
        error_scans: (whole.iter())
            .map(|path| (path.weight * path.bennett.error).powi(2))
            .sum::<f64>()
            .sqrt(),
    }
}

/// The estimates of the chain sets of one annealing path.
struct OfPath {
    /// Fraction of all chain sets.
    weight: f64,
    bennett: Bennett,
    forward: f64,
    backward: f64,
    thermodynamic: f64,
    valid: f64,
}

impl OfPath {
    fn new(extensions: &[(&[f64], &Traces)], chain_sets: &[usize], count: usize) -> Self {
        let stones: Vec<Stones> = extensions
            .iter()
            .map(|(beta, traces)| stepping_stones(beta, traces, chain_sets))
            .collect();
        let mean_of = |of: fn(&Stones) -> f64| mean_by_scans(extensions, stones.iter().map(of));
        let paths = extensions
            .iter()
            .map(|(beta, traces)| thermodynamic(beta, traces, chain_sets));
        Self {
            weight: chain_sets.len() as f64 / count as f64,
            bennett: bennett(extensions, chain_sets),
            forward: ln_mean(by_scans(extensions, stones.iter().map(|s| s.forward))),
            backward: -ln_mean(by_scans(extensions, stones.iter().map(|s| -s.backward))),
            thermodynamic: mean_by_scans(extensions, paths),
            valid: mean_of(|stones| stones.valid),
        }
    }
}

/// One number per extension, after its scans.
fn by_scans(
    extensions: &[(&[f64], &Traces)],
    numbers: impl Iterator<Item = f64>,
) -> impl Iterator<Item = (f64, f64)> {
    let scans = (extensions.iter()).map(|(_, traces)| traces.scans() as f64);
    scans.zip(numbers)
}

/// Mean of one number per extension, weighted by its scans.
fn mean_by_scans(extensions: &[(&[f64], &Traces)], numbers: impl Iterator<Item = f64>) -> f64 {
    let sums = by_scans(extensions, numbers).fold((0.0, 0.0), |(sum, scans), (more, x)| {
        (sum + x * more, scans + more)
    });
    sums.0 / sums.1
}

/// Logarithm of the weighted mean of the exponentials of numbers. Stepping-stone estimates are unbiased as Z and 1 / Z, so that
/// the bias of their means falls with the number of parts; means of their logarithms would keep that of one part.
fn ln_mean(weighted: impl Iterator<Item = (f64, f64)>) -> f64 {
    let (weights, terms): (Vec<f64>, Vec<f64>) = weighted
        .map(|(weight, ln)| (weight, ln + weight.ln()))
        .unzip();
    if terms.contains(&f64::INFINITY) {
        return f64::INFINITY;
    }
    ln_sum_exp(&terms) - weights.iter().sum::<f64>().ln()
}

struct Stones {
    forward: f64,
    backward: f64,
    /// Fraction of the reference's draws with a likelihood.
    valid: f64,
}

fn stepping_stones(beta: &[f64], traces: &Traces, chain_sets: &[usize]) -> Stones {
    let finite = |temperature: usize| -> (Vec<f64>, f64) {
        let all = chain_sets.iter().flat_map(|k| traces.of(*k, temperature));
        let total = all.clone().count() as f64;
        (all.copied().filter(|l| l.is_finite()).collect(), total)
    };
    let ln_mean_exp = |values: &[f64], factor: f64, total: f64| {
        let terms: Vec<f64> = values.iter().map(|l| factor * l).collect();
        ln_sum_exp(&terms) - total.ln()
    };
    let (draws, total) = finite(0);
    let valid = draws.len() as f64 / total.max(1.0);
    let (reference, _) = traces.reference_integral(chain_sets);
    let (mut forward, mut backward) = (reference, reference);
    for (temperature, gap) in beta.windows(2).enumerate() {
        let step = gap[1] - gap[0];
        let ((hotter, total), (mut colder, _)) = (finite(temperature), finite(temperature + 1));
        forward += ln_mean_exp(&hotter, step, total);
        // The estimate of the colder side is that of the states above a bound, whatever the bound: of those that it never meets it knows nothing. The
        // smallest of its own is the bound, and is left out.
        colder.sort_by(|a, b| b.total_cmp(a));
        let least = colder.pop().unwrap_or(f64::INFINITY);
        let met = hotter.iter().filter(|l| **l >= least).count() as f64;
        backward += (met / total).ln() - ln_mean_exp(&colder, -step, colder.len() as f64);
    }
    Stones {
        forward,
        backward,
        valid,
    }
}

/// Trapezoid with the end correction that the variance, the slope of the mean, gives.
fn thermodynamic(beta: &[f64], traces: &Traces, chain_sets: &[usize]) -> f64 {
    let moments: Vec<(f64, f64)> = (0..beta.len())
        .map(|temperature| traces.moments(chain_sets, temperature))
        .collect();
    let path: f64 = beta
        .windows(2)
        .zip(moments.windows(2))
        .map(|(b, m)| {
            let h = b[1] - b[0];
            0.5 * h * (m[0].0 + m[1].0) - h * h * (m[1].1 - m[0].1) / 12.0
        })
        .sum();
    traces.reference_integral(chain_sets).0 + path
}

struct Bennett {
    ln_z: f64,
    error: f64,
}

/// Bennett's acceptance ratio pair by pair of temperatures, and the error of the sum from the contribution of each
/// block of scans to it: of all pairs at once and with the autocorrelation of the blocks, so that it includes how long
/// a state stays in a small mode.
fn bennett(extensions: &[(&[f64], &Traces)], chain_sets: &[usize]) -> Bennett {
    let scans = extensions
        .iter()
        .map(|(_, traces)| traces.scans())
        .sum::<usize>();
    // ln Z of each extension, and the contribution of each block to it: their sum is unbiased to first order.
    let of_extension = |(beta, traces): &(&[f64], &Traces)| {
        let blocks = (BLOCKS * traces.scans()).div_ceil(scans.max(1));
        bennett_of_extension(beta, traces, chain_sets, blocks.min(traces.scans()))
    };
    let parts: Vec<(f64, Vec<Vec<f64>>)> = extensions.iter().map(of_extension).collect();
    let chains: Vec<Vec<f64>> = (0..chain_sets.len())
        .map(|chain_set| {
            let part = |(ln_z, moves): &(f64, Vec<Vec<f64>>)| -> Vec<f64> {
                moves[chain_set].iter().map(|moved| ln_z + moved).collect()
            };
            parts.iter().flat_map(part).collect()
        })
        .collect();
    let chains: Vec<&[f64]> = chains.iter().map(Vec::as_slice).collect();
    let of_reference = |(_, traces): &(&[f64], &Traces)| {
        let (_, variance) = traces.reference_integral(chain_sets);
        variance * (traces.scans() as f64 / scans as f64).powi(2)
    };
    let variance: f64 = extensions.iter().map(of_reference).sum();
    let error = error_of_mean(&chains).hypot(variance.sqrt());
    Bennett {
        ln_z: mean_by_scans(extensions, parts.iter().map(|(ln_z, _)| *ln_z)),
        error: if error.is_finite() {
            error
        } else {
            f64::INFINITY
        },
    }
}

/// The estimate of one extension, and the contribution of each block of scans of each chain set to it. Draws of the
/// reference without a likelihood enter as zeros, which is exact.
fn bennett_of_extension(
    beta: &[f64],
    traces: &Traces,
    chain_sets: &[usize],
    blocks: usize,
) -> (f64, Vec<Vec<f64>>) {
    let scans = traces.scans();
    let (mut ln_z, _) = traces.reference_integral(chain_sets);
    let mut influence = vec![vec![0.0; blocks]; chain_sets.len()];
    for (temperature, gap) in beta.windows(2).enumerate() {
        let step = gap[1] - gap[0];
        let side = |temperature: usize| -> Vec<&[f64]> {
            chain_sets
                .iter()
                .map(|m| traces.of(*m, temperature))
                .collect()
        };
        let (hot, cold) = (side(temperature), side(temperature + 1));
        let root = solve(&hot, &cold, step);
        ln_z += root;
        let mut sums = vec![vec![Balance::default(); blocks]; chain_sets.len()];
        for (sums, (hot, cold)) in sums.iter_mut().zip(hot.iter().zip(&cold)) {
            for (scan, (h, c)) in hot.iter().zip(cold.iter()).enumerate() {
                sums[scan * blocks / scans].add(step * h, step * c, root);
            }
        }
        let units = (chain_sets.len() * blocks) as f64;
        let slope: f64 = sums.iter().flatten().map(|sum| sum.slope).sum();
        for (influence, sum) in influence.iter_mut().flatten().zip(sums.iter().flatten()) {
            *influence += units * sum.excess / slope;
        }
    }
    (ln_z, influence)
}

/// The sum at the smaller beta minus that at the larger one in Bennett's equation, and minus their slope.
#[derive(Clone, Copy, Debug, Default)]
struct Balance {
    excess: f64,
    slope: f64,
}

impl Balance {
    fn add(&mut self, hot: f64, cold: f64, at: f64) {
        let (h, c) = (logistic(hot - at), logistic(at - cold));
        self.excess += h - c;
        self.slope += h * (1.0 - h) + c * (1.0 - c);
    }
}

fn logistic(x: f64) -> f64 {
    1.0 / (1.0 + (-x).exp())
}

/// The root `C` of `sum_hot sigma(db l - C) = sum_cold sigma(C - db l)`: Newton steps kept inside a bracket.
/// Minus infinity if no value at the smaller beta is finite.
fn solve(hot: &[&[f64]], cold: &[&[f64]], step: f64) -> f64 {
    let finite = |side: &[&[f64]]| -> Vec<f64> {
        side.iter()
            .flat_map(|trace| trace.iter())
            .filter(|l| l.is_finite())
            .map(|l| step * l)
            .collect()
    };
    let (h, c) = (finite(hot), finite(cold));
    if h.is_empty() || c.is_empty() {
        return f64::NEG_INFINITY;
    }
    let negated: Vec<f64> = c.iter().map(|x| -x).collect();
    let total: usize = hot.iter().map(|trace| trace.len()).sum();
    let forward = ln_sum_exp(&h) - (total as f64).ln();
    let backward =
        (h.len() as f64 / total as f64).ln() - ln_sum_exp(&negated) + (c.len() as f64).ln();
    let (mut low, mut high) = (forward.min(backward) - 1.0, forward.max(backward) + 1.0);
    let balance = |at: f64| {
        let mut sum = Balance::default();
        for x in &h {
            let s = logistic(x - at);
            sum.excess += s;
            sum.slope += s * (1.0 - s);
        }
        for x in &c {
            let s = logistic(at - x);
            sum.excess -= s;
            sum.slope += s * (1.0 - s);
        }
        sum
    };
    // The excess falls with C; the two one-sided estimates nearly always bracket the root, and if not, widen.
    let mut at = 0.5 * (forward + backward);
    let mut width = high - low;
    while balance(low).excess < 0.0 {
        low -= width;
        width *= 2.0;
    }
    while balance(high).excess > 0.0 {
        high += width;
        width *= 2.0;
    }
    for _ in 0..200 {
        let now = balance(at);
        // The two sides are so different that every term underflows: the middle is the root of the leading terms.
        if now.slope <= 0.0 {
            break;
        }
        if now.excess > 0.0 {
            low = at;
        } else {
            high = at;
        }
        let newton = at + now.excess / now.slope;
        let next = if newton > low && newton < high {
            newton
        } else {
            0.5 * (low + high)
        };
        let moved = (next - at).abs();
        at = next;
        if moved <= 1e-13 * at.abs().max(1.0) {
            break;
        }
    }
    at
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Domain, standard_normal, stream};

    /// Exact draws of `l = -4.5 |z|^2` at each temperature, with autocorrelation `memory` of `z` from scan to scan.
    fn toy(dim: usize, beta: &[f64], scans: usize, memory: f64, seed: u64) -> Traces {
        let mut traces = Traces::new(4, beta.len());
        let fresh = (1.0 - memory * memory).sqrt();
        for chain_set in 0..4 {
            for (temperature, b) in beta.iter().enumerate() {
                let mut rng = stream(seed, Domain::Test, chain_set as u64, temperature as u64);
                let mut z: Vec<f64> = (0..dim).map(|_| standard_normal(&mut rng)).collect();
                for _ in 0..scans {
                    for z in &mut z {
                        *z = memory * *z + fresh * standard_normal(&mut rng);
                    }
                    let square: f64 = z.iter().map(|z| z * z).sum();
                    traces.push(chain_set, temperature, -4.5 * square / (1.0 + 9.0 * b));
                }
            }
        }
        traces
    }

    fn of(beta: &[f64], traces: &Traces) -> Estimate {
        estimate(&[(beta, traces)], usize::MAX, 1)
    }

    fn even(n: usize) -> Vec<f64> {
        (0..n)
            .map(|k| (10_f64.powf(k as f64 / (n - 1) as f64) - 1.0) / 9.0)
            .collect()
    }

    #[test]
    fn all_four_estimates_agree_with_the_exact_evidence_and_their_error_is_honest() {
        let beta = even(8);
        let truth = -6.5 * 10_f64.ln();
        let mut pulls = Vec::new();
        for seed in 0..40 {
            let e = of(&beta, &toy(13, &beta, 500, 0.0, seed));
            pulls.push((e.ln_z - truth) / e.error_scans);
            assert!((e.forward - truth).abs() < 0.3 && (e.backward - truth).abs() < 0.3);
            assert!((e.thermodynamic.unwrap() - truth).abs() < 0.2);
        }
        normal(&pulls);
    }

    #[test]
    fn the_error_knows_scans_that_remember_hundreds_before_them() {
        // ln L decorrelates at the rate of z squared: 100 scans, so that the 3,000 scans of each chain set have an ESS
        // of 15.
        let beta = even(8);
        let truth = -1.5 * 10_f64.ln();
        let pulls: Vec<f64> = (0..40)
            .map(|seed| of(&beta, &toy(3, &beta, 3000, 0.995, seed)))
            .map(|e| (e.ln_z - truth) / e.error_scans)
            .collect();
        normal(&pulls);
    }

    #[test]
    fn extensions_at_other_temperatures_count_by_their_scans() {
        let truth = -6.5 * 10_f64.ln();
        let (few, many) = (even(6), even(9));
        let pulls: Vec<f64> = (0..40)
            .map(|seed| {
                let short = toy(13, &few, 200, 0.0, seed);
                let long = toy(13, &many, 600, 0.0, 100 + seed);
                let parts = [of(&few, &short), of(&many, &long)];
                let both = estimate(&[(&few, &short), (&many, &long)], usize::MAX, 1);
                let mean = 0.25 * parts[0].ln_z + 0.75 * parts[1].ln_z;
                assert!((both.ln_z - mean).abs() < 1e-12);
                assert!(both.error_scans < parts[0].error_scans);
                (both.ln_z - truth) / both.error_scans
            })
            .collect();
        normal(&pulls);
    }

    #[test]
    fn states_that_the_colder_side_never_meets_do_not_make_its_estimate_larger() {
        // The same, but a fifth of the draws at beta = 0 have a likelihood that is next to none.
        let beta = even(6);
        let truth = -6.5 * 10_f64.ln() + 0.8_f64.ln();
        let mut traces = toy(13, &beta, 2_000, 0.0, 1);
        for value in traces.values.iter_mut().step_by(beta.len()) {
            value.iter_mut().step_by(5).for_each(|l| *l -= 1e4);
        }
        let e = of(&beta, &traces);
        for value in [e.ln_z, e.forward, e.backward] {
            assert!((value - truth).abs() < 0.15, "{value} {truth}");
        }
    }

    #[test]
    fn one_sided_estimates_of_many_short_parts_are_as_near_as_their_scans_allow() {
        let beta = even(4);
        let parts: Vec<Traces> = (0..40).map(|seed| toy(13, &beta, 50, 0.0, seed)).collect();
        let gap = |e: &Estimate| e.backward - e.forward;
        let alone = parts.iter().map(|part| gap(&of(&beta, part))).sum::<f64>() / 40.0;
        let all: Vec<(&[f64], &Traces)> = parts.iter().map(|part| (&beta[..], part)).collect();
        let together = gap(&estimate(&all, usize::MAX, 1));
        assert!(alone > 0.1 && together < 0.75 * alone, "{alone} {together}");
    }

    /// Three standard errors of the mean and of the deviation of 40 pulls.
    fn normal(pulls: &[f64]) {
        let mean = pulls.iter().sum::<f64>() / 40.0;
        let sd = (pulls.iter().map(|p| (p - mean).powi(2)).sum::<f64>() / 39.0).sqrt();
        assert!(mean.abs() < 0.48, "{mean}");
        assert!((0.66..1.34).contains(&sd), "{sd}");
    }

    #[test]
    fn prior_draws_without_likelihood_count_as_zeros() {
        // L = 1 on a quarter of the prior: every estimate is the logarithm of the counted fraction.
        let mut traces = Traces::new(2, 3);
        for scan in 0..400 {
            for chain_set in 0..2 {
                let l = if scan % 4 == 0 {
                    0.0
                } else {
                    f64::NEG_INFINITY
                };
                traces.push(chain_set, 0, l);
                traces.push(chain_set, 1, 0.0);
                traces.push(chain_set, 2, 0.0);
            }
        }
        let e = of(&[0.0, 0.5, 1.0], &traces);
        for value in [e.ln_z, e.forward, e.backward] {
            assert!((value - 0.25_f64.ln()).abs() < 1e-10, "{value}");
        }
        assert_eq!(e.thermodynamic, None);
    }

    #[test]
    fn depths_of_a_million_do_not_overflow() {
        let mut traces = Traces::new(2, 2);
        for scan in 0..50 {
            for chain_set in 0..2 {
                traces.push(chain_set, 0, -1e6 - f64::from(scan));
                traces.push(chain_set, 1, -3.0 - 0.01 * f64::from(scan));
            }
        }
        let e = of(&[0.0, 1.0], &traces);
        assert!(e.ln_z.is_finite() && e.forward.is_finite() && e.ln_z > e.forward);
        // The colder side never meets a state of the hotter one.
        assert!(e.backward < f64::MIN, "{}", e.backward);
    }
}
