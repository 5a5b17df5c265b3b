//! Merges nested runs with different seeds into one run.
//!
//! Births and deaths of independent runs are weighted together like those of one run with the live points of all of
//! them (Skilling 2006; Higson et al. 2019). Their evidences and means are compared first: a mode that one run has
//! missed shows as a difference.

use super::check_names;
use super::checks::{MORE_DRAWS, by_lineages};
use super::evidence::DeadPoints;
use super::live::{self, Genealogy, REJECTED, narrow};
use super::results::{Errors, Results, draws, ess, simulated};
use super::settings::Settings;
use crate::diagnostics::{chi2_p_value, weighted_moments};
use crate::error::{Error, Result};
use crate::output::{
    Check, Cost, Draws, ESS_BULK, ESS_TAIL, History, MIN_ESS, Method, Run, Status,
};
use crate::target::Target;
use std::collections::{BTreeSet, HashSet};

/// Minimum p-value of the differences between the runs.
const MIN_PROBABILITY: f64 = 0.01;

/// Merges nested runs on the same `target` with different seeds, without further likelihood calls. Its checks are the
/// worst of the runs' own and those of their agreement; its seed is that of the first run.
///
/// # Errors
/// [`Error::TooFewRuns`], [`Error::SameSeed`], [`Error::SharedDraws`] and [`Error::NotNested`]; [`Error::OtherParameters`], [`Error::NoDraws`] and
/// [`Error::OtherLikelihood`] for a run on another target; [`Error::Fatal`] and [`Error::Infinite`] from the target.
pub fn merge(target: &dyn Target, runs: &[&Run]) -> Result<Run> {
    let parts = runs
        .iter()
        .map(|run| RunHistory::of(target, run))
        .collect::<Result<Vec<RunHistory<'_>>>>()?;
    let [first, _, ..] = runs else {
        return Err(Error::TooFewRuns { given: runs.len() });
    };
    let mut seeds = BTreeSet::new();
    if let Some(run) = runs.iter().find(|run| !seeds.insert(run.seed)) {
        return Err(Error::SameSeed { seed: run.seed });
    }
    let dim = target.dim();
    if let Some(seed) = seed_of_shared_draws(runs, dim) {
        return Err(Error::SharedDraws { seed });
    }
    let mut all = MergedPoints::default();
    for part in &parts {
        all.add(part, dim);
    }
    if all.lineages > Draws::MAX_LABEL {
        return Err(Error::TooManyLineages);
    }
    let history = DeadPoints::new(&all.ln_l, &all.birth, &all.genealogy);
    let results = Results::of(history, |history, _| Errors {
        simulated: simulated(history, &Settings::default(), first.seed),
        bootstrapped: together(runs, &parts, "bootstrap"),
        coalescence: together(runs, &parts, "ancestry"),
    });
    let draws = draws(&results.history, &results.weighted, target, &all.theta)?;
    let ess = ess(&draws);
    let mut checks = worst(runs);
    checks.extend(by_lineages(&results.measured()));
    checks.extend(ess.checks(MIN_ESS, MORE_DRAWS));
    checks.extend(agreement(runs));
    let ranks = parts.iter().flat_map(|part| part.insertion_rank);
    Ok(Run {
        method: Method::Nested,
        status: status(runs),
        seed: first.seed,
        stream_version: first.stream_version,
        names: first.names.clone(),
        units: first.units.clone(),
        derived_names: first.derived_names.clone(),
        draws,
        evidence: results.evidence(),
        ess,
        cost: cost(runs),
        history: results.run_history(ranks.copied().collect()),
        checks,
        warnings: runs.iter().flat_map(|run| run.warnings.clone()).collect(),
        surrogate: None,
    })
}

/// The seed of the first run that has a draw of one before it. A merger keeps the seed of its first run alone.
fn seed_of_shared_draws(runs: &[&Run], dim: usize) -> Option<u64> {
    let mut seen: HashSet<Vec<u64>> = HashSet::new();
    for run in runs {
        let rows = run.draws.theta.chunks_exact(dim);
        let own: HashSet<Vec<u64>> = rows
            .map(|row| row.iter().map(|x| x.to_bits()).collect())
            .collect();
        if !seen.is_disjoint(&own) {
            return Some(run.seed);
        }
        seen.extend(own);
    }
    None
}

/// The parts of a run.
struct RunHistory<'a> {
    draws: &'a Draws,
    ln_l: &'a [f64],
    birth: &'a [f64],
    live: &'a [u32],
    insertion_rank: &'a [f64],
}

impl<'a> RunHistory<'a> {
    fn of(target: &dyn Target, run: &'a Run) -> Result<Self> {
        run.check_belongs(target, "a run to merge")?;
        if run.ess.bulk.len() != target.dim() {
            return Err(Error::NoEss);
        }
        let History::Nested {
            ln_likelihood,
            ln_likelihood_birth,
            live,
            insertion_rank,
            ..
        } = &run.history
        else {
            return Err(Error::NotNested { seed: run.seed });
        };
        Ok(Self {
            draws: &run.draws,
            ln_l: ln_likelihood,
            birth: ln_likelihood_birth,
            live,
            insertion_rank,
        })
    }

    /// Number of dead points without a likelihood, which are not among the draws.
    fn rejected(&self) -> usize {
        self.ln_l.len() - self.draws.len()
    }

    fn first_lineages(&self) -> usize {
        live::lineages(self.live.first().map_or(0, |n| *n as usize))
    }
}

/// The points of all runs.
#[derive(Default)]
struct MergedPoints {
    ln_l: Vec<f64>,
    birth: Vec<f64>,
    genealogy: Vec<Genealogy>,
    /// Zero where a point has no likelihood, and so no weight.
    theta: Vec<f64>,
    /// Lineages so far.
    lineages: u32,
}

impl MergedPoints {
    /// Adds a run; its lineages are numbered after those before, even ones stay even.
    fn add(&mut self, part: &RunHistory<'_>, dim: usize) {
        self.ln_l.extend(part.ln_l.iter().map(|l| l.max(REJECTED)));
        self.birth.extend(part.birth);
        let first_lineages = narrow(part.first_lineages());
        let rejected = (0..first_lineages).cycle().take(part.rejected());
        let first = self.lineages;
        let own = rejected.chain(part.draws.cluster.iter().copied());
        self.genealogy
            .extend(own.map(|l| Genealogy::from(first + l)));
        let last = part.draws.cluster.iter().max().map_or(0, |l| l + 1);
        self.lineages += last.max(first_lineages).next_multiple_of(2);
        self.theta
            .extend(std::iter::repeat_n(0.0, part.rejected() * dim));
        self.theta.extend(&part.draws.theta);
    }
}

/// For each check that all runs have, and whose value does not depend on the number of runs: a failed one, or else the first.
fn worst(runs: &[&Run]) -> Vec<Check> {
    const NOT_OF_ONE: [&str; 7] = [
        check_names::EFFECTIVE_LINEAGES,
        check_names::BOOTSTRAP_TO_SIMULATED,
        check_names::LINEAGE_HALVES,
        ESS_BULK,
        ESS_TAIL,
        check_names::TARGET_ESS,
        check_names::TARGET_LN_Z_ERROR,
    ];
    let of = |name: &str| -> Option<Check> {
        let own = |run: &&Run| run.checks.iter().find(|g| g.name == name).cloned();
        let all: Vec<Check> = runs.iter().filter_map(own).collect();
        let failed = all.iter().find(|g| !g.pass);
        failed.or(all.first()).cloned()
    };
    let names = runs
        .iter()
        .flat_map(|run| run.checks.iter().map(|g| &g.name));
    let mut seen = BTreeSet::new();
    names
        .filter(|name| !NOT_OF_ONE.contains(&name.as_str()) && seen.insert(*name))
        .filter_map(|name| of(name))
        .collect()
}

/// Whether the runs agree on ln Z, and on the mean of every parameter.
fn agreement(runs: &[&Run]) -> [Check; 2] {
    let ln_z = runs.iter().map(|r| (r.evidence.ln_z, r.evidence.error));
    let dim = runs[0].names.len();
    let least = (0..dim)
        .map(|k| probability(runs.iter().map(|run| mean(run, k))))
        .fold(1.0, f64::min);
    [
        Check::at_least(
            check_names::LN_Z_AGREEMENT_OF_SEEDS,
            probability(ln_z),
            MIN_PROBABILITY,
            "p-value of the differences of ln Z between the runs; if too small, some run misses a mode or its error is too small: double `n_live` or `steps`",
        ),
        Check::at_least(
            check_names::MEAN_AGREEMENT_OF_SEEDS,
            least,
            MIN_PROBABILITY / dim as f64,
            "smallest p-value, over parameters, of the differences between the means of the runs; if too small, some run misses a mode: double `n_live`",
        ),
    ]
}

/// Error of ln Z of the merged run from the runs' independent errors of this name, each weighted by its number of live
/// points, because a finished run stores neither its recent lineages nor its number of ancestors.
fn together(runs: &[&Run], parts: &[RunHistory<'_>], name: &str) -> f64 {
    let size = |part: &RunHistory<'_>| part.live.first().map_or(0.0, |n| f64::from(*n));
    let all: f64 = parts.iter().map(size).sum();
    let own = |run: &Run| run.evidence.error_parts.get(name).copied().unwrap_or(0.0);
    let squares = runs.iter().zip(parts);
    let sum: f64 = squares
        .map(|(run, part)| (size(part) * own(run)).powi(2))
        .sum();
    sum.sqrt() / all
}

/// Posterior mean of a parameter and its error.
fn mean(run: &Run, parameter: usize) -> (f64, f64) {
    let weights = run.draws.weights();
    let column = run.draws.column(parameter);
    let (mean, variance) = weighted_moments(&column, &weights);
    (mean, (variance / run.draws.ess_of_mean(&column)).sqrt())
}

/// p-value that values with these standard errors differ from their weighted mean by at least as much (chi-square). Values with
/// an error of zero must be equal.
fn probability(values: impl Iterator<Item = (f64, f64)>) -> f64 {
    let values: Vec<(f64, f64)> = values.collect();
    let weight = |error: f64| error.max(f64::MIN_POSITIVE.sqrt()).powi(-2);
    let sum: f64 = values.iter().map(|(_, e)| weight(*e)).sum();
    let mean = values
        .iter()
        .map(|(x, e)| x * weight(*e) / sum)
        .sum::<f64>();
    let chi2: f64 = values
        .iter()
        .map(|(x, e)| (x - mean).powi(2) * weight(*e))
        .sum();
    chi2_p_value(chi2, values.len())
}

/// Complete if all are, otherwise the status of the first that is not.
fn status(runs: &[&Run]) -> Status {
    let ends = runs.iter().map(|run| run.status);
    ends.into_iter()
        .find(|status| *status != Status::Complete)
        .unwrap_or(Status::Complete)
}

fn cost(runs: &[&Run]) -> Cost {
    let mut sum = Cost::default();
    runs.iter().for_each(|run| sum.add(&run.cost));
    sum
}
