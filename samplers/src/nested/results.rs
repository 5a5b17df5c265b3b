//! Evidence, effective sample sizes and their errors, from the points of one run or of several.

use super::evidence::{DeadPoints, Weighted};
use super::live::{REJECTED, lineages, narrow, recent_lineages};
use super::settings::Settings;
use crate::diagnostics::{kish_ess, sums_by_group};
use crate::error::Result;
use crate::output::{Draws, Ess, Evidence, History, Origin};
use crate::target::Target;
use std::collections::BTreeMap;

/// Minimum effective number of lineages of the posterior; docs/targets.md, section 1, has how well errors of means
/// hold with few lineages (`cargo bench -p oblate-samplers --bench errors_of_means`).
pub(super) const MIN_LINEAGES: f64 = 12.0;

/// The points of a run and everything that follows from them.
pub(super) struct Results {
    pub history: DeadPoints,
    pub weighted: Weighted,
    errors: Errors,
}

/// Errors of ln Z, by their origin.
#[derive(Clone, Copy, Debug)]
pub(super) struct Errors {
    /// Unknown volumes, for independent draws.
    pub simulated: f64,
    /// Dependence of new points on recent seeds: the scatter of recent lineages.
    pub bootstrapped: f64,
    /// Excess coalescence: see [`excess_coalescence`].
    pub coalescence: f64,
}

/// Numbers on which the checks of the evidence rest.
pub(super) struct CheckInputs {
    pub errors: Errors,
    /// ln Z of the even and of the odd recent lineages.
    pub halves: [f64; 2],
    /// Effective number of lineages of the posterior.
    pub lineages: f64,
}

impl Errors {
    /// Of one run with these settings and seed.
    pub fn of(history: &DeadPoints, weighted: &Weighted, settings: &Settings, seed: u64) -> Self {
        let recent_lineages = recent_lineages(settings.n_live) as f64;
        // So few clusters, with random weights, have a smaller standard deviation about their own mean than about the
        // true value.
        let degrees_of_freedom = ((recent_lineages + 1.0) / (recent_lineages - 1.0)).sqrt();
        let ln_z = history.bootstrap(seed, settings.bootstraps);
        Self {
            simulated: simulated(history, settings, seed),
            bootstrapped: degrees_of_freedom * deviation(&ln_z),
            coalescence: excess_coalescence(history, weighted, settings.n_live),
        }
    }
}

impl Results {
    /// Of a history.
    pub fn of(history: DeadPoints, errors: impl FnOnce(&DeadPoints, &Weighted) -> Errors) -> Self {
        let weighted = history.weigh();
        Self {
            errors: errors(&history, &weighted),
            history,
            weighted,
        }
    }

    pub fn evidence(&self) -> Evidence {
        let best = self.history.ln_l.last();
        if best.is_none_or(|l| *l <= REJECTED) {
            return Evidence {
                ln_z: f64::NEG_INFINITY,
                error: f64::INFINITY,
                ..Evidence::default()
            };
        }
        let Errors {
            simulated,
            bootstrapped,
            coalescence,
        } = self.errors;
        Evidence {
            ln_z: self.weighted.ln_z,
            error: simulated.max(bootstrapped).max(coalescence),
            error_parts: named([
                ("simulated", simulated),
                ("bootstrap", bootstrapped),
                ("ancestry", coalescence),
            ]),
            estimates: named([("ln-of-mean-z", self.history.ln_of_mean_z())]),
            information: self.weighted.information,
        }
    }

    pub fn measured(&self) -> CheckInputs {
        CheckInputs {
            errors: self.errors,
            halves: self.history.halves(),
            lineages: self.history.effective_lineages(&self.weighted),
        }
    }

    /// The history from the prior to the peak, with the insertion ranks.
    pub fn run_history(&self, insertion_rank: Vec<f64>) -> History {
        let shown = |l: &f64| {
            if *l <= REJECTED {
                f64::NEG_INFINITY
            } else {
                *l
            }
        };
        let mut sum = 0.0;
        History::Nested {
            ln_x: self
                .history
                .expected_ln_t()
                .iter()
                .map(|t| {
                    sum += t;
                    sum
                })
                .collect(),
            ln_likelihood: self.history.ln_l.iter().map(shown).collect(),
            ln_likelihood_birth: self.history.birth.clone(),
            live: self.history.live.clone(),
            insertion_rank,
        }
    }
}

/// The points of a history in order of death, without the rejected ones, which have no likelihood and no weight; `theta` as the points were given.
pub(super) fn draws(
    history: &DeadPoints,
    weighted: &Weighted,
    target: &dyn Target,
    theta: &[f64],
) -> Result<Draws> {
    let dim = target.dim();
    let mut draws = Draws::of(target);
    for (death, &row) in history.order.iter().enumerate() {
        let ln_l = history.ln_l[death];
        if ln_l > REJECTED {
            let theta = &theta[row * dim..(row + 1) * dim];
            let origin = Origin {
                chain: 0,
                cluster: history.lineages.of[death],
            };
            draws.push(target, theta, ln_l, weighted.ln_p[death], origin)?;
        }
    }
    Ok(draws)
}

/// Effective sizes of the draws.
pub(super) fn ess(draws: &Draws) -> Ess {
    let (bulk, tail) = draws.clustered_ess();
    let kish = kish_ess(&draws.ln_weight);
    Ess {
        kish,
        quoted: Ess::smallest(&bulk, &tail).min(kish),
        bulk,
        tail,
        ..Ess::default()
    }
}

/// Error of ln Z by the unknown volumes, for independent draws.
pub(super) fn simulated(history: &DeadPoints, settings: &Settings, seed: u64) -> f64 {
    deviation(&history.simulate(seed, settings.simulations))
}

/// Error of ln Z by excess coalescence, after the estimate of Lee & Whiteley (2018) for particle filters. If few first
/// points have descendants at the peak, and it is random which ones, two draws of the posterior descend from the same
/// first point more often than random seeds imply. The excess is the relative variance of Z.
fn excess_coalescence(history: &DeadPoints, weighted: &Weighted, n_live: usize) -> f64 {
    let alike = 1.0 / history.effective_lineages(weighted);
    // Batches that begin with the prior have lineages of their own, and not all of them the same share of the posterior.
    let of_batch = lineages(n_live);
    let labels = history.lineages.of.iter();
    let batches: Vec<u32> = labels.map(|label| label / narrow(of_batch)).collect();
    let shares = sums_by_group(&batches, weighted.p.iter().copied());
    let of_one_batch: f64 = shares.iter().map(|share| share * share).sum();
    let at_first = 1.0 / of_batch as f64;
    // With n live points every e-fold replaces n, and each time 2 / n^2 of the pairs get a common ancestor.
    let siblings = -(-2.0 * weighted.information / n_live as f64).exp_m1();
    let by_chance = (at_first + (1.0 - at_first) * siblings) * of_one_batch;
    (alike - by_chance).max(0.0).sqrt()
}

fn named<const N: usize>(pairs: [(&str, f64); N]) -> BTreeMap<String, f64> {
    pairs.map(|(name, value)| (name.to_owned(), value)).into()
}

/// Standard deviation about the mean.
fn deviation(values: &[f64]) -> f64 {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let sum: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
    (sum / (count - 1.0)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nested::live::Genealogy;

    /// Error from excess coalescence, for 20 first lineages of 100 live points and a posterior from the last `shared`
    /// of them.
    fn error(shared: u32) -> f64 {
        let count = 2_000;
        let ln_l: Vec<f64> = (0..count).map(f64::from).collect();
        let birth: Vec<f64> = (0..count)
            .map(|i| f64::from(i - 100).max(-1.0))
            .map(|l| if l < 0.0 { f64::NEG_INFINITY } else { l })
            .collect();
        let genealogy: Vec<Genealogy> = (0..20_u32)
            .cycle()
            .take(ln_l.len())
            .map(|i| Genealogy::from(i % shared))
            .collect();
        let history = DeadPoints::new(&ln_l, &birth, &genealogy);
        // A uniform likelihood on a hundredth of the prior: ln X = -4.6.
        let mut weighted = history.weigh();
        let end = 460..660;
        weighted.p = (0..ln_l.len())
            .map(|i| if end.contains(&i) { 1.0 / 200.0 } else { 0.0 })
            .collect();
        weighted.information = 4.6;
        excess_coalescence(&history, &weighted, 100)
    }

    #[test]
    fn few_ancestors_are_an_error_where_chance_would_have_left_more() {
        // After 4.6 e-folds the effective number of 20 lineages is 7.5.
        assert!(error(20) < 1e-12 && error(10) < 1e-12);
        // Two lineages have half of the volume: 1/2 minus the 0.13 of random seeds.
        assert!(
            (error(2) - (0.5_f64 - 0.1335).sqrt()).abs() < 2e-3,
            "{}",
            error(2)
        );
        assert!((error(1) - (1.0_f64 - 0.1335).sqrt()).abs() < 2e-3);
    }
}
