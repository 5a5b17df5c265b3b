//! From the state of a run to its result.

use super::checks::{CheckInputs, checks};
use super::evidence::Estimate;
use super::record::PosteriorDraws;
use super::schedule::communication_barrier;
use super::state::State;
use crate::diagnostics::{bulk_ess, mode_agreement, r_hat, tail_ess, two_means};
use crate::error::Result;
use crate::output::{Check, Draws, Ess, Evidence, History, Method, Origin, Run, Status};
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
        checks,
    } = assess(state, &cold, target.dim());
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
    })
}

/// Results and checks of the round in progress.
struct Assessment {
    estimate: Estimate,
    ess: Ess,
    /// Step of each temperature.
    steps: Vec<f64>,
    checks: Vec<Check>,
}

fn assess(state: &State, cold: &PosteriorDraws, dim: usize) -> Assessment {
    let estimate = state.evidence();
    let (ess, worst_r_hat) = effective_sizes(state, cold, dim);
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
        ess: &ess,
        worst_r_hat,
        mode_agreement: modes(cold, dim),
        slices: state.slices(),
    });
    Assessment {
        estimate,
        ess,
        steps,
        checks,
    }
}

/// Whether the round in progress passes all checks.
pub(super) fn passes(state: &State, dim: usize) -> bool {
    let cold = state.record.cold();
    assess(state, &cold, dim)
        .checks
        .iter()
        .all(|check| check.pass)
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

/// Design effect of clusters: the variance of their means over that expected from the effective sample sizes of their
/// chain sets, as the mean over all parameters, at least 1. The mean is over all parameters because few clusters give a
/// noisy estimate for each. Chain sets that started from the same SMC sampler have its errors in common.
fn design_effect(columns: &[Vec<Vec<f64>>], bulk: &[f64], clusters: usize) -> f64 {
    let excess = columns.iter().zip(bulk).map(|(chain_sets, bulk)| {
        let of_cluster = |cluster: usize| -> Vec<f64> {
            let own = chain_sets.iter().skip(cluster).step_by(clusters);
            own.flatten().copied().collect()
        };
        let mean = |x: &[f64]| x.iter().sum::<f64>() / x.len() as f64;
        let scatter = |x: &[f64]| {
            let centre = mean(x);
            x.iter().map(|x| (x - centre).powi(2)).sum::<f64>() / (x.len() as f64 - 1.0)
        };
        let means: Vec<f64> = (0..clusters).map(|f| mean(&of_cluster(f))).collect();
        scatter(&means) * bulk / (clusters as f64 * scatter(&chain_sets.concat()))
    });
    let mean = excess.sum::<f64>() / columns.len() as f64;
    if mean.is_finite() { mean.max(1.0) } else { 1.0 }
}

/// Effective sizes and R-hat per parameter (of its coordinate `z`: ranks do not change under a monotone map), and the
/// largest R-hat of all, ln L included.
fn effective_sizes(state: &State, cold: &PosteriorDraws, dim: usize) -> (Ess, f64) {
    let chain_sets = cold.positions.len();
    let mut ess = Ess {
        kish: (chain_sets * state.record.scans()) as f64,
        ..Ess::default()
    };
    let columns: Vec<Vec<Vec<f64>>> = (0..dim)
        .map(|j| {
            let of = |rows: &Vec<f64>| rows.iter().skip(j).step_by(dim).copied().collect();
            cold.positions.iter().map(of).collect()
        })
        .collect();
    for chain_sets in &columns {
        let squares: Vec<Vec<f64>> = chain_sets
            .iter()
            .map(|column| column.iter().map(|z| z * z).collect())
            .collect();
        let chains = slices(chain_sets);
        ess.bulk.push(bulk_ess(&chains));
        ess.tail.push(tail_ess(&chains));
        ess.r_hat.push(r_hat(&chains).max(r_hat(&slices(&squares))));
    }
    if state.clusters() < chain_sets {
        let design_effect = design_effect(&columns, &ess.bulk, state.clusters());
        for size in ess.bulk.iter_mut().chain(&mut ess.tail) {
            *size /= design_effect;
        }
    }
    ess.quoted = ess
        .bulk
        .iter()
        .chain(&ess.tail)
        .copied()
        .fold(f64::INFINITY, f64::min);
    let of_ln_l = r_hat(&slices(&cold.ln_likelihood));
    let worst = ess.r_hat.iter().copied().fold(of_ln_l, f64::max);
    (ess, worst)
}

fn slices(chains: &[Vec<f64>]) -> Vec<&[f64]> {
    chains.iter().map(Vec::as_slice).collect()
}

/// p-value that all chain sets give the two modes the same weights.
fn modes(cold: &PosteriorDraws, dim: usize) -> f64 {
    let scans = cold.ln_likelihood.first().map_or(0, Vec::len);
    let labels = two_means(&cold.positions.concat(), dim);
    let labels: Vec<&[bool]> = labels.chunks_exact(scans.max(1)).collect();
    mode_agreement(&labels, &slices(&cold.ln_likelihood))
}

fn history(state: &State, step_size: Vec<f64>, trace: Vec<Vec<f64>>) -> History {
    let record = &state.record;
    let extension = record.last_long_enough();
    let temperatures = extension.beta.len();
    let (mean, variance) = (0..temperatures)
        .map(|temperature| extension.traces.moments(temperature))
        .unzip();
    let rejection = extension.mean_rejection();
    History::Tempered {
        beta: extension.beta.clone(),
        mean_ln_likelihood: mean,
        variance_ln_likelihood: variance,
        communication_barrier: communication_barrier(&rejection),
        swap_rejection: rejection,
        acceptance: extension
            .locals
            .iter()
            .map(|l| l.mean_acceptance())
            .collect(),
        step_size,
        mean_leapfrogs: extension
            .locals
            .iter()
            .map(|l| l.leapfrogs as f64 / l.moves.max(1) as f64)
            .collect(),
        divergences: extension.locals.iter().map(|l| l.diverged).collect(),
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
    if state.mixture_due() && state.reference.is_prior() {
        warnings.push(
            "too few draws to fit a mixture, so the reference is the prior; raise `first_scans`, `rounds` or `chain_sets`"
                .to_owned(),
        );
    }
    let extension = state.record.last_long_enough();
    for (beta, rejection) in extension.beta.iter().zip(extension.mean_rejection()) {
        if state.is_last_round() && rejection > SLOW_GAP {
            warnings.push(format!(
                "{:.0} % of swaps above beta = {:.3e} are rejected, which slows round trips; raise `max_temperatures`, or add rounds so that temperatures can adapt",
                100.0 * rejection, beta,
            ));
        }
    }
    let locals = &extension.locals;
    let diverged: u64 = locals.iter().map(|local| local.diverged).sum();
    if state.is_last_round() && diverged > 0 {
        let moves: u64 = locals.iter().map(|local| local.moves).sum();
        let temperatures = locals.iter().filter(|local| local.diverged > 0).count();
        warnings.push(format!(
            "{diverged} of {moves} HMC transitions diverged, at {temperatures} temperatures: the posterior is locally narrower than the steps; raise `target_acceptance`, or smooth the likelihood",
        ));
    }
    warnings
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Domain, standard_normal, stream};

    /// 32 chain sets of 10 independent draws in each of 13 parameters, with this standard deviation of the part that
    /// the chain sets of each of four clusters have in common.
    fn columns(common: f64) -> Vec<Vec<Vec<f64>>> {
        let mut rng = stream(3, Domain::Test, 0, 0);
        (0..13)
            .map(|_| {
                let shared: Vec<f64> = (0..4).map(|_| common * standard_normal(&mut rng)).collect();
                let chain_set = |k: usize, rng: &mut _| -> Vec<f64> {
                    (0..10)
                        .map(|_| shared[k % 4] + standard_normal(rng))
                        .collect()
                };
                (0..32).map(|k| chain_set(k, &mut rng)).collect()
            })
            .collect()
    }

    #[test]
    fn what_chain_sets_of_a_cluster_have_in_common_makes_their_draws_fewer() {
        // Variance of a cluster's mean: 1 / 80 of its own draws, and the common part. 39 degrees of freedom in all: a
        // standard error of 23 %.
        let alone = design_effect(&columns(0.0), &[320.0; 13], 4);
        assert!((1.0..1.7).contains(&alone), "{alone}");
        let shared = design_effect(&columns(0.5), &[320.0; 13], 4);
        // The draws' own variance is 1.25 with it.
        let exact = (0.25 + 1.0 / 80.0) * 80.0 / 1.25;
        assert!((shared / exact - 1.0).abs() < 0.7, "{shared} {exact}");
    }
}
