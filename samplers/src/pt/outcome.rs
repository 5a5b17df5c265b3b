//! From the state of a run to its result.

use super::check_names;
use super::checks::{CheckInputs, checks, confirmation};
use super::evidence::Estimate;
use super::posterior_draws::PosteriorDraws;
use super::schedule::communication_barrier;
use super::state::State;
use crate::Event;
use crate::error::Result;
use crate::output::{
    Check, Draws, ESS_BULK, ESS_TAIL, Ess, Evidence, History, Method, Origin, Run, Status,
};
use crate::rng::STREAM_VERSION;
use crate::target::Target;

/// Swap rejection above which a pair of temperatures slows the round trips of its chain set.
const SLOW_GAP: f64 = 0.7;

/// The result of the round in progress: the last one, unless the run was stopped.
pub(super) fn assemble(target: &dyn Target, state: &State, status: Status) -> Result<Run> {
    let cold = state.record.cold();
    let Assessment {
        estimate,
        ess,
        steps,
        mut checks,
        confirmation,
    } = assess(state, &cold, target.dim());
    checks.extend(confirmation);
    let draws = draws(target, state, &cold)?;
    Ok(Run {
        method: Method::PtHmc,
        status,
        seed: state.seed,
        stream_version: STREAM_VERSION,
        names: target.prior().names().to_vec(),
        units: target.prior().units().to_vec(),
        derived_names: target.derived_names(),
        evidence: evidence(&draws, estimate),
        draws,
        ess,
        cost: state.cost.clone(),
        history: history(state, steps, cold.ln_likelihood),
        checks,
        warnings: warnings(state),
        surrogate: state.surrogate.clone(),
    })
}

/// Results and checks of the round in progress.
struct Assessment {
    estimate: Estimate,
    ess: Ess,
    /// Step of each temperature.
    steps: Vec<f64>,
    checks: Vec<Check>,
    /// Checks that a pass is no coincidence, of a run that looks more than once.
    confirmation: Vec<Check>,
}

fn assess(state: &State, cold: &PosteriorDraws, dim: usize) -> Assessment {
    let estimate = state.evidence();
    let agreement = cold.agreement(dim, state.clusters());
    let steps: Vec<f64> = state
        .temperatures
        .iter()
        .map(|temperature| temperature.step.step())
        .collect();
    let checks = checks(&CheckInputs {
        record: &state.record,
        estimate: &estimate,
        history: &state.history,
        steps: &steps,
        agreement: &agreement,
        target_ess: state.settings.target_ess,
        slices: state.slices(),
        hmc: state.settings.hmc_transitions > 0,
    });
    let confirmation = if state.settings.extensions == 0 {
        Vec::new()
    } else {
        let newest = cold.newest(state.newest_scans(), dim);
        let looks_passed = state.looks_passed(all_pass(&checks));
        confirmation(
            &newest.agreement(dim, state.clusters()),
            state.evidence_of_earlier_and_newest().as_ref(),
            looks_passed,
            state.settings.target_ess,
        )
    };
    Assessment {
        estimate,
        ess: agreement.ess,
        steps,
        checks,
        confirmation,
    }
}

fn all_pass(checks: &[Check]) -> bool {
    checks.iter().all(|check| check.pass)
}

/// What the checks say at the end of the last round or of one of its extensions.
pub(super) struct Look {
    /// Whether all checks of the draws so far passed.
    pub(super) passed: bool,
    /// Their estimate of ln Z.
    pub(super) ln_z: f64,
    /// Whether this is confirmed: the run may end.
    pub(super) confirmed: bool,
    /// The checks that have not passed.
    open: Vec<Check>,
}

impl Look {
    /// The event of a run of so many scans that goes on after this look.
    pub(super) fn event(&self, scans: usize) -> Event {
        Event::Look {
            scans,
            open: self.open.iter().map(|check| check.name.clone()).collect(),
            needed: self.open.iter().map(needed).fold(1.0, f64::max),
        }
    }
}

/// How many times as many scans a check needs to pass; 1 for one whose number does not grow with the scans of all extensions.
fn needed(check: &Check) -> f64 {
    match check.name.as_str() {
        check_names::ROUND_TRIPS_WORST_CHAIN_SET
        | check_names::ROUND_TRIPS
        | check_names::RESTARTS_PER_REPLICA
        | ESS_BULK
        | ESS_TAIL => check.limit / check.value,
        // A standard error falls with the root of the number of draws.
        check_names::LN_Z_ERROR => (check.value / check.limit).powi(2),
        _ => 1.0,
    }
}

/// A look at the draws so far.
pub(super) fn look(state: &State, dim: usize) -> Look {
    let assessment = assess(state, &state.record.cold(), dim);
    let passed = all_pass(&assessment.checks);
    let all = (assessment.checks.iter()).chain(&assessment.confirmation);
    Look {
        passed,
        ln_z: assessment.estimate.ln_z,
        confirmed: passed && all_pass(&assessment.confirmation),
        open: all.filter(|check| !check.pass).cloned().collect(),
    }
}

fn draws(target: &dyn Target, state: &State, cold: &PosteriorDraws) -> Result<Draws> {
    let count: usize = cold.ln_likelihood.iter().map(Vec::len).sum();
    let ln_weight = -(count as f64).ln();
    let clusters = u32::try_from(state.clusters()).unwrap_or(u32::MAX);
    let mut draws = Draws::of(target);
    let mut theta = vec![0.0; target.dim()];
    let chain_sets = cold.positions.iter().zip(&cold.ln_likelihood);
    for (chain, (rows, values)) in (0_u32..).zip(chain_sets) {
        for (z, &ln_l) in rows.chunks_exact(target.dim()).zip(values) {
            target.prior().theta_from_z(z, &mut theta);
            let cluster = chain % clusters;
            let origin = Origin { chain, cluster };
            draws.push(target, &theta, ln_l, ln_weight, origin)?;
        }
    }
    Ok(draws)
}

fn evidence(draws: &Draws, estimate: Estimate) -> Evidence {
    let error = estimate.error();
    let mean = draws.ln_likelihood.iter().sum::<f64>() / draws.len() as f64;
    let mut estimates = vec![
        ("bennett".to_owned(), estimate.ln_z),
        ("forward".to_owned(), estimate.forward),
        ("backward".to_owned(), estimate.backward),
    ];
    estimates.extend(
        estimate
            .thermodynamic
            .map(|value| ("thermodynamic".to_owned(), value)),
    );
    estimates.extend(
        estimate
            .chain_sets
            .into_iter()
            .enumerate()
            .map(|(chain_set, value)| (format!("chain set {chain_set}"), value)),
    );
    Evidence {
        ln_z: estimate.ln_z,
        error,
        error_parts: [
            ("chain_sets".to_owned(), estimate.error_chain_sets),
            ("scans".to_owned(), estimate.error_scans),
        ]
        .into(),
        estimates: estimates.into_iter().collect(),
        information: mean - estimate.ln_z,
    }
}

fn history(state: &State, step_size: Vec<f64>, trace: Vec<Vec<f64>>) -> History {
    let record = &state.record;
    let part = record.last_long_enough();
    let temperatures = part.beta.len();
    let chain_sets: Vec<usize> = (0..part.traces.chain_sets()).collect();
    let (mean, variance) = (0..temperatures)
        .map(|temperature| part.traces.moments(&chain_sets, temperature))
        .unzip();
    let rejection = part.mean_rejection();
    History::Tempered {
        beta: part.beta.clone(),
        mean_ln_likelihood: mean,
        variance_ln_likelihood: variance,
        communication_barrier: communication_barrier(&rejection),
        swap_rejection: rejection,
        acceptance: part
            .locals
            .iter()
            .map(|l| {
                if state.surrogate.is_some() {
                    l.mean_surrogate_acceptance()
                } else {
                    l.mean_acceptance()
                }
            })
            .collect(),
        step_size,
        mean_leapfrogs: part
            .locals
            .iter()
            .map(|l| l.leapfrogs as f64 / l.moves.max(1) as f64)
            .collect(),
        divergences: part.locals.iter().map(|l| l.diverged).collect(),
        round_trips: record
            .index_processes()
            .iter()
            .map(|(trips, _)| *trips)
            .collect(),
        trace,
    }
}

fn warnings(state: &State) -> Vec<String> {
    let mut warnings = Vec::new();
    if !state.is_last_round() {
        warnings.push(format!(
            "stopped in round {}, which still adapts: draws and evidence are provisional; resume the run to finish it",
            state.round + 1
        ));
    }
    if state.mixture_due() && state.path_from_prior() {
        warnings.push(
            "too few draws to fit a mixture, so the reference is the prior; raise `first_scans`, `rounds` or `chain_sets`"
                .to_owned(),
        );
    }
    let part = state.record.last_long_enough();
    for (beta, rejection) in part.beta.iter().zip(part.mean_rejection()) {
        if state.is_last_round() && rejection > SLOW_GAP {
            warnings.push(format!(
                "{:.0} % of swaps above beta = {:.3e} are rejected, which slows round trips; raise `max_temperatures`, or add rounds so that temperatures can adapt",
                100.0 * rejection, beta,
            ));
        }
    }
    let locals = &part.locals;
    let diverged: u64 = locals.iter().map(|local| local.diverged).sum();
    // A move along a surrogate that diverges is only rejected: slice updates remain.
    if state.is_last_round() && diverged > 0 && state.surrogate.is_none() {
        let moves: u64 = locals.iter().map(|local| local.moves).sum();
        let temperatures = locals.iter().filter(|local| local.diverged > 0).count();
        warnings.push(format!(
            "{diverged} of {moves} HMC transitions diverged, at {temperatures} temperatures: the posterior is locally narrower than the steps; raise `target_acceptance`, or smooth the likelihood",
        ));
    }
    warnings
}
