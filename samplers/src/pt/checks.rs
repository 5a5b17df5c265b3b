//! Convergence checks of a tempered run, each with a remedy.

use super::evidence::Estimate;
use super::record::Record;
use super::schedule::round_trip_rate;
use super::state::Finished;
use crate::diagnostics::chi2_p_value;
use crate::hmc::MAX_STEP;
use crate::output::{Check, Ess};

/// The numbers that the checks need.
pub(super) struct CheckInputs<'a> {
    pub(super) record: &'a Record,
    pub(super) estimate: &'a Estimate,
    /// Rounds that ended before the one that is checked.
    pub(super) history: &'a [Finished],
    /// Step of each temperature.
    pub(super) steps: &'a [f64],
    pub(super) ess: &'a Ess,
    /// Largest R-hat over coordinates, their squares and ln L.
    pub(super) worst_r_hat: f64,
    /// p-value that the chain sets give the modes the same weights.
    pub(super) mode_agreement: f64,
    /// Whether slice updates are made as well. Then round trips, R-hat and effective sample sizes measure how far
    /// states move, and short trajectories are no failure.
    pub(super) slices: bool,
}

/// All checks of a run.
pub(super) fn checks(run: &CheckInputs<'_>) -> Vec<Check> {
    let mut checks = index_processes(run);
    checks.extend(schedule(run));
    checks.extend(evidence(run.estimate));
    checks.extend(draws(run));
    checks.extend(moves(run));
    checks
}

fn index_processes(run: &CheckInputs<'_>) -> Vec<Check> {
    let index_processes = run.record.index_processes();
    let scans = run.record.scans();
    let extension = run.record.last_long_enough();
    let replicas = (index_processes.len() * extension.traces.temperatures()) as f64;
    let fewest = index_processes
        .iter()
        .map(|(trips, _)| *trips)
        .min()
        .unwrap_or(0);
    let restarts: u64 = index_processes.iter().map(|(_, restarts)| restarts).sum();
    let trips = run.record.round_trips() as f64;
    let rate = trips / (scans * index_processes.len()).max(1) as f64;
    let expected = round_trip_rate(&extension.mean_rejection());
    vec![
        Check::at_least(
            "round-trips-worst-chain-set",
            fewest as f64,
            10.0,
            "round trips from reference to posterior and back, of the chain set that has fewest; if too few, allow more `extensions`, or add rounds: each doubles them",
        ),
        Check::at_least(
            "round-trips",
            trips,
            100.0,
            "round trips of all chain sets; if too few, allow more `extensions`, or add rounds",
        ),
        Check::at_least(
            "restarts-per-replica",
            restarts as f64 / replicas,
            1.0,
            "arrivals at the posterior from a new draw of the reference, per replica; if too few, allow more `extensions`, or add rounds",
        ),
        Check::at_least(
            "round-trip-rate",
            rate / expected,
            0.3,
            "round-trip rate over that with independent local samples; if too small, local moves are too slow: raise `slice_updates`, `hmc_transitions` or `max_leapfrogs`",
        ),
    ]
}

fn schedule(run: &CheckInputs<'_>) -> Vec<Check> {
    let rejection = run.record.last_long_enough().mean_rejection();
    let worst = rejection.iter().copied().fold(0.0, f64::max);
    let communication_barrier: f64 = rejection.iter().sum();
    let before = run
        .history
        .last()
        .map_or(0.0, |round| round.communication_barrier);
    // A flat likelihood has no communication barrier; changes of one below 0.1 are not significant.
    let change = (communication_barrier - before).abs() / before.max(0.1);
    let change = if run.history.is_empty() { 1.0 } else { change };
    vec![
        Check::at_most(
            "swap-rejection",
            worst,
            0.75,
            "largest swap rejection between neighbouring temperatures; if too large, raise `temperatures` or `max_temperatures`, or add rounds so that temperatures can adapt",
        ),
        Check::at_most(
            "communication-barrier-change",
            change,
            0.1,
            "relative change of the communication barrier since the round before; if too large, temperatures are not adapted yet: add rounds",
        ),
    ]
}

fn evidence(estimate: &Estimate) -> Vec<Check> {
    let error = estimate.error();
    let gap = (estimate.forward - estimate.backward).abs();
    // Chain sets are equivalent, so each gets the mean of their variances: one that has missed a small mode
    // underestimates its own error.
    let squares = estimate.chain_set_errors.iter().map(|e| e * e);
    let variance = squares.sum::<f64>() / estimate.chain_sets.len() as f64;
    let scatter = estimate
        .chain_sets
        .iter()
        .map(|l| (l - estimate.ln_z).powi(2));
    // A flat likelihood has no error but that of rounding.
    let chi2 = scatter.sum::<f64>() / variance.max(1e-12);
    let p = chi2_p_value(chi2, estimate.chain_sets.len());
    vec![
        Check::at_most(
            "ln-z-error",
            error,
            0.5,
            "standard error of ln Z in nats; if too large, allow more `extensions`, or add rounds",
        ),
        Check::at_most(
            "forward-backward-difference",
            if gap.is_finite() { gap } else { f64::INFINITY },
            (3.0 * error).max(0.2),
            "difference of the two one-sided (stepping-stone) estimates of ln Z; if too large, add rounds or temperatures",
        ),
        Check::at_least(
            "ln-z-agreement-of-chain-sets",
            if error.is_finite() { p } else { 0.0 },
            0.01,
            "p-value of the differences of ln Z between the chain sets, given the error of each from its own scans; if too small, some chain set misses a part of the posterior: allow more `extensions`, or add rounds",
        ),
    ]
}

fn draws(run: &CheckInputs<'_>) -> Vec<Check> {
    let least = |sizes: &[f64]| sizes.iter().copied().fold(f64::INFINITY, f64::min);
    vec![
        Check::at_most(
            "r-hat",
            run.worst_r_hat,
            1.01,
            "largest rank-normalised split R-hat of coordinates, their squares and ln L; if too large, the chain sets do not agree yet: allow more `extensions`, or add rounds",
        ),
        Check::at_least(
            "ess-bulk",
            least(&run.ess.bulk),
            400.0,
            "smallest bulk ESS over parameters; if too small, allow more `extensions`, add rounds, or raise `slice_updates` or `hmc_transitions`",
        ),
        Check::at_least(
            "ess-tail",
            least(&run.ess.tail),
            400.0,
            "smallest tail ESS over parameters; if too small, allow more `extensions`, add rounds, or raise `slice_updates` or `hmc_transitions`",
        ),
        Check::at_least(
            "mode-agreement-of-chain-sets",
            run.mode_agreement,
            0.01,
            "p-value that all chain sets give two modes (or halves) of the posterior the same weights; if too small, allow more `extensions`, or add rounds",
        ),
    ]
}

fn moves(run: &CheckInputs<'_>) -> Vec<Check> {
    let locals = &run.record.last_long_enough().locals[1..];
    let acceptance = |local: &super::record::Local| local.mean_acceptance();
    let lowest = locals.iter().map(acceptance).fold(1.0, f64::min);
    // The acceptance at the maximum step is not tested, because such a step cannot be lengthened.
    let highest = locals
        .iter()
        .zip(&run.steps[1..])
        .filter(|(_, step)| **step < 0.99 * MAX_STEP)
        .map(|(local, _)| acceptance(local))
        .fold(0.0, f64::max);
    let worst_fraction = |count: fn(&super::record::Local) -> u64| {
        locals
            .iter()
            .map(|local| count(local) as f64 / local.moves.max(1) as f64)
            .fold(0.0, f64::max)
    };
    let rejected = Check::at_most(
        "rejected-transitions",
        worst_fraction(|local| local.rejected),
        0.2,
        "fraction of HMC transitions that met a rejected point, at the worst temperature; if too large, replace rejection by a smooth penalty (of a stream: `coverage = \"penalty\"`)",
    );
    if run.slices {
        return vec![rejected];
    }
    vec![
        Check::at_least(
            "lowest-acceptance",
            lowest,
            0.5,
            "mean acceptance of HMC transitions at the worst temperature; if too small, step sizes are not adapted yet: add rounds",
        ),
        Check::at_most(
            "highest-acceptance",
            highest,
            0.95,
            "mean acceptance of HMC transitions at the best temperature; if too large, steps are shorter than needed: add rounds",
        ),
        Check::at_most(
            "truncated-trajectories",
            worst_fraction(|local| local.capped),
            0.01,
            "fraction of transitions stopped by `max_leapfrogs`, at the worst temperature; if too large, raise it",
        ),
        rejected,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn estimate(chain_sets: Vec<f64>, error: f64) -> Estimate {
        let ln_z = chain_sets.iter().sum::<f64>() / chain_sets.len() as f64;
        Estimate {
            ln_z,
            forward: ln_z,
            backward: ln_z,
            thermodynamic: None,
            valid: 1.0,
            chain_set_errors: vec![error; chain_sets.len()],
            chain_sets,
            error_chain_sets: 0.1,
            error_scans: 0.1,
        }
    }

    fn passes(name: &str, estimate: &Estimate) -> bool {
        let checks = evidence(estimate);
        checks.iter().find(|g| g.name == name).unwrap().pass
    }

    #[test]
    fn chain_sets_that_disagree_on_the_evidence_are_refused() {
        let name = "ln-z-agreement-of-chain-sets";
        assert!(passes(name, &estimate(vec![-3.0, -3.1, -2.9, -3.05], 0.1)));
        // One chain set missed a mode that holds half of the mass.
        assert!(!passes(name, &estimate(vec![-3.0, -3.1, -2.9, -3.7], 0.1)));
        assert!(!passes(name, &estimate(vec![-3.0, -3.1], f64::NAN)));
    }

    #[test]
    fn one_sided_estimates_that_disagree_are_refused() {
        let name = "forward-backward-difference";
        let mut different = estimate(vec![-3.0; 4], 0.1);
        assert!(passes(name, &different));
        different.forward -= 0.5;
        assert!(!passes(name, &different));
        different.forward = f64::NEG_INFINITY;
        assert!(!passes(name, &different));
    }
}
