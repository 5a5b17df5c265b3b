//! From the final particles of a bridge to its result and checks.

use super::batch::{self, Batch};
use super::particle::Particle;
use super::state::{Bridge, Level};
use crate::diagnostics::{effective_kinds, sums_by_group};
use crate::error::Result;
use crate::output::{Check, Draws, Ess, Evidence, History, MIN_ESS, Method, Origin, Run, Status};
use crate::rng::STREAM_VERSION;

/// Name of the check that the coarse run has passed its own.
pub const COARSE_RUN_CHECKS: &str = "coarse-run-checks";

/// Name of the check of the error that a bridge adds to ln Z.
pub const BRIDGE_ERROR: &str = "bridge-error";

/// The result of a finished bridge.
pub(super) fn assemble(bridge: &Bridge<'_>) -> Result<Run> {
    let (state, parent) = (&bridge.state, bridge.parent);
    let prior = bridge.target.prior();
    let clusters = clusters(&parent.draws);
    let draws = draws(bridge, &clusters)?;
    let evidence = evidence(bridge, &draws, &clusters);
    let ess = effective_sizes(&draws, bridge);
    let checks = checks(parent, &evidence, &ess);
    Ok(Run {
        method: Method::Bridge,
        status: Status::Complete,
        seed: bridge.seed,
        stream_version: STREAM_VERSION,
        names: prior.names().to_vec(),
        units: prior.units().to_vec(),
        derived_names: bridge.target.derived_names(),
        draws,
        evidence,
        ess,
        cost: state.cost.clone(),
        history: History::Bridge {
            fraction: column(&state.levels, |l| l.fraction),
            ln_ratio: column(&state.levels, |l| l.ln_ratio),
            ancestors: column(&state.levels, |l| l.ancestors),
            correlation: column(&state.levels, |l| l.correlation),
        },
        checks,
        warnings: Vec::new(),
        surrogate: state.surrogate.clone(),
    })
}

fn column(levels: &[Level], of: impl Fn(&Level) -> f64) -> Vec<f64> {
    levels.iter().map(of).collect()
}

/// The effective sample size at the fine likelihood; none before its MCMC steps are done.
pub(super) fn ess(bridge: &Bridge<'_>) -> Result<Option<f64>> {
    if bridge.further_mcmc_steps().is_none() {
        return Ok(None);
    }
    let draws = draws(bridge, &clusters(&bridge.parent.draws))?;
    Ok(Some(effective_sizes(&draws, bridge).quoted))
}

/// Whether the bridge is at its end, with this effective sample size: at the fine likelihood, with draws enough, or with as many batches and further
/// MCMC steps as it may make.
pub(super) fn enough(bridge: &Bridge<'_>, ess: Option<f64>) -> bool {
    // Nothing makes good what a coarse run that has not converged may have missed.
    let most = bridge.settings.further_mcmc_steps;
    let last = |further: usize| {
        further >= most && !bridge.may_have_another_batch() || !bridge.parent.converged()
    };
    bridge.further_mcmc_steps().is_some_and(last) || ess.is_some_and(|ess| ess >= MIN_ESS)
}

/// Blocks of successive draws into which each chain of a parent is divided. They must be longer than a chain stays in one place, and
/// more than a few, so that their scatter is known.
const BLOCKS: usize = 32;

/// The cluster of dependent draws of each row of a parent: its lineage in a nested run; of Markov chains a block of successive draws (batch
/// means).
fn clusters(parent: &Draws) -> Vec<u32> {
    let chains = parent.chains();
    if chains.len() < 2 {
        return parent.cluster.clone();
    }
    let mut clusters = vec![0; parent.len()];
    for (chain, rows) in chains.iter().enumerate() {
        for (place, &row) in rows.iter().enumerate() {
            let block = chain * BLOCKS + place * BLOCKS / rows.len();
            clusters[row] = u32::try_from(block).unwrap_or(u32::MAX);
        }
    }
    clusters
}

/// ln Z minus that of the coarse run: at the fine likelihood by all batches, before by the present one at its exponent.
pub(super) fn ln_ratio(bridge: &Bridge<'_>) -> f64 {
    if bridge.further_mcmc_steps().is_some() {
        batch::ln_ratio(&bridge.state.all_batches())
    } else {
        bridge.state.ln_ratio
    }
}

/// The particles of each batch with its own numbers and its fraction of the whole weight; at the fine likelihood.
fn by_batch<'b>(bridge: &'b Bridge<'_>) -> Vec<(&'b [Particle], Batch, f64)> {
    let batches = bridge.state.all_batches();
    let mut rest = bridge.state.particles.as_slice();
    let shares = batch::shares(&batches);
    let both = batches.into_iter().zip(shares);
    both.map(|(batch, share)| {
        let (own, others) = rest.split_at(batch.particles);
        rest = others;
        (own, batch, share)
    })
    .collect()
}

fn draws(bridge: &Bridge<'_>, clusters: &[u32]) -> Result<Draws> {
    let mut draws = Draws::of(bridge.target);
    let mut theta = vec![0.0; bridge.target.dim()];
    let by_batch = by_batch(bridge).into_iter();
    let particles = by_batch.flat_map(|(own, batch, share)| {
        let ln_weight = share.ln() - (batch.particles as f64).ln();
        own.iter().map(move |particle| (particle, ln_weight))
    });
    for (particle, ln_weight) in particles {
        bridge.target.prior().theta_from_z(&particle.z, &mut theta);
        let origin = Origin {
            chain: 0,
            cluster: clusters[particle.eve],
        };
        draws.push(bridge.target, &theta, particle.both.fine, ln_weight, origin)?;
    }
    Ok(draws)
}

fn evidence(bridge: &Bridge<'_>, draws: &Draws, clusters: &[u32]) -> Evidence {
    let parent = bridge.parent;
    let ln_z = parent.evidence.ln_z + ln_ratio(bridge);
    let parts = [
        ("parent", parent.evidence.error),
        ("weights", coalescence_error(bridge)),
        (
            "lineage-weights",
            cluster_weight_error(draws, &parent.draws, clusters),
        ),
    ];
    let weighted = draws.ln_likelihood.iter().zip(draws.weights());
    let mean: f64 = weighted.map(|(l, w)| l * w).sum();
    Evidence {
        ln_z,
        error: parts.iter().map(|(_, e)| e * e).sum::<f64>().sqrt(),
        error_parts: parts.map(|(name, e)| (name.to_owned(), e)).into(),
        estimates: [("parent".to_owned(), parent.evidence.ln_z)].into(),
        information: mean - ln_z,
    }
}

/// Error of the mean weights by excess coalescence: how many pairs of particles of a batch have a common ancestor beyond what
/// resampling without weights would make (Lee & Whiteley 2018).
fn coalescence_error(bridge: &Bridge<'_>) -> f64 {
    let variance = |(own, batch, share): (&[Particle], Batch, f64)| {
        let particles = batch.particles as f64;
        let times = 1.0 + batch.levels as f64;
        let unlike = (particles / (particles - 1.0)).powf(times) * (1.0 - alike(own));
        share * share * (1.0 - unlike).max(0.0)
    };
    let variances = by_batch(bridge).into_iter().map(variance);
    variances.sum::<f64>().sqrt()
}

/// Fraction of the pairs of particles that have a common ancestor.
fn alike(particles: &[Particle]) -> f64 {
    1.0 / effective_kinds(particles.iter().map(|particle| particle.eve))
}

/// Error of ln Z from the weights that the bridge has moved between clusters of the parent's draws: in the parent the weight of
/// each is uncertain by about a factor, and the error of the parent does not include these changes.
fn cluster_weight_error(draws: &Draws, parent: &Draws, clusters: &[u32]) -> f64 {
    if clusters.iter().all(|g| *g == clusters[0]) {
        // Independent draws: the error of the weights is the whole error.
        return 0.0;
    }
    let here = sums_by_group(&draws.cluster, draws.weights().into_iter());
    let there = sums_by_group(clusters, parent.weights().into_iter());
    // Clusters at the end of the list that have no particle are missing here.
    let here = here.into_iter().chain(std::iter::repeat(0.0));
    let moved = there
        .into_iter()
        .zip(here)
        .map(|(there, here)| here - there);
    moved.map(|m| m * m).sum::<f64>().sqrt()
}

/// Effective sizes of the result, by the scatter of clusters of the parent's draws: it has the error of the parent, that of the resampling,
/// and what the MCMC steps have made good of it. Kish's is the number of ancestors.
fn effective_sizes(draws: &Draws, bridge: &Bridge<'_>) -> Ess {
    let (bulk, tail) = draws.clustered_ess();
    // Batches may have ancestors in common.
    let eves = bridge.state.particles.iter();
    let eves: Vec<u32> = eves
        .map(|particle| u32::try_from(particle.eve).unwrap_or(u32::MAX))
        .collect();
    let shares = sums_by_group(&eves, draws.weights().into_iter());
    let alike: f64 = shares.iter().map(|share| share * share).sum();
    Ess {
        kish: 1.0 / alike,
        quoted: Ess::smallest(&bulk, &tail),
        bulk,
        tail,
        ..Ess::default()
    }
}

fn checks(parent: &Run, evidence: &Evidence, ess: &Ess) -> Vec<Check> {
    // A run that was stopped before its end may have passed the checks that it has so far.
    let unfinished = usize::from(parent.status != Status::Complete);
    let failed = parent.checks.iter().filter(|g| !g.pass).count() + unfinished;
    let mut checks = vec![
        Check::at_most(
            COARSE_RUN_CHECKS,
            failed as f64,
            0.0,
            "convergence checks that the coarse run failed, and one more if it was stopped before its end; a bridge cannot find what the coarse run has missed: make that run converge first",
        ),
        Check::at_most(
            BRIDGE_ERROR,
            (evidence.error_parts["weights"].powi(2)
                + evidence.error_parts["lineage-weights"].powi(2))
            .sqrt(),
            0.5,
            "error in nats that the bridge adds to ln Z; if too large, give more `smc_particles`, or use a coarse likelihood closer to the fine one",
        ),
    ];
    checks.extend(ess.checks(
        MIN_ESS,
        "allow more `max_batches`, give more `smc_particles`, or use a coarse likelihood closer to the fine one",
    ));
    checks
}
