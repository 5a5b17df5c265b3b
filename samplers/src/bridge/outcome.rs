//! From the final particles of a bridge to its result and checks.

use super::state::{Bridge, Level};
use crate::diagnostics::{effective_kinds, size_of_mean, sums_by_group};
use crate::error::Result;
use crate::output::{Check, Draws, Ess, Evidence, History, Method, Origin, Run, Status};
use crate::rng::STREAM_VERSION;

/// The result of a finished bridge.
pub(super) fn assemble(bridge: &Bridge<'_>, parent: &Run) -> Result<Run> {
    let state = &bridge.state;
    let prior = bridge.target.prior();
    let draws = draws(bridge)?;
    let evidence = evidence(bridge, &draws, parent);
    let ess = effective_sizes(&draws, bridge, parent);
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
            fraction: column(&bridge.state.levels, |l| l.fraction),
            ln_ratio: column(&bridge.state.levels, |l| l.ln_ratio),
            ancestors: column(&bridge.state.levels, |l| l.ancestors),
            correlation: column(&bridge.state.levels, |l| l.correlation),
        },
        checks,
        warnings: Vec::new(),
    })
}

fn column(levels: &[Level], of: impl Fn(&Level) -> f64) -> Vec<f64> {
    levels.iter().map(of).collect()
}

fn draws(bridge: &Bridge<'_>) -> Result<Draws> {
    let ln_weight = -(bridge.state.particles.len() as f64).ln();
    let mut draws = Draws::of(bridge.target);
    let mut theta = vec![0.0; bridge.target.dim()];
    for particle in &bridge.state.particles {
        bridge.target.prior().theta_from_z(&particle.z, &mut theta);
        let origin = Origin {
            chain: 0,
            cluster: particle.lineage,
        };
        draws.push(bridge.target, &theta, particle.both.fine, ln_weight, origin)?;
    }
    Ok(draws)
}

fn evidence(bridge: &Bridge<'_>, draws: &Draws, parent: &Run) -> Evidence {
    let ln_z = parent.evidence.ln_z + bridge.state.ln_ratio;
    let parts = [
        ("parent", parent.evidence.error),
        ("weights", coalescence_error(bridge)),
        (
            "lineage-weights",
            lineage_weight_error(draws, &parent.draws),
        ),
    ];
    let particles = bridge.state.particles.len() as f64;
    let mean = bridge
        .state
        .particles
        .iter()
        .map(|m| m.both.fine)
        .sum::<f64>()
        / particles;
    Evidence {
        ln_z,
        error: parts.iter().map(|(_, e)| e * e).sum::<f64>().sqrt(),
        error_parts: parts.map(|(name, e)| (name.to_owned(), e)).into(),
        estimates: [("parent".to_owned(), parent.evidence.ln_z)].into(),
        information: mean - ln_z,
    }
}

/// Error of the mean weights by excess coalescence: how many pairs of particles have a common ancestor beyond what
/// resampling without weights would make (Lee & Whiteley 2018).
fn coalescence_error(bridge: &Bridge<'_>) -> f64 {
    let particles = bridge.state.particles.len() as f64;
    let alike = 1.0 / effective_kinds(bridge.state.particles.iter().map(|m| m.eve));
    let times = 1.0 + bridge.state.levels.len() as f64;
    let unlike = (particles / (particles - 1.0)).powf(times) * (1.0 - alike);
    (1.0 - unlike).max(0.0).sqrt()
}

/// Error of ln Z from the weights that the bridge has moved between lineages of the parent: in the parent the weight of
/// each is uncertain by about a factor, and the error of the parent does not include these changes.
fn lineage_weight_error(draws: &Draws, parent: &Draws) -> f64 {
    if parent.cluster.iter().all(|g| *g == parent.cluster[0]) {
        // Independent draws: the error of the weights is the whole error.
        return 0.0;
    }
    let weights = |draws: &Draws| sums_by_group(&draws.cluster, draws.weights().into_iter());
    // Lineages at the end of the list that have no particle are missing here.
    let (here, there) = (weights(draws), weights(parent));
    let here = here.into_iter().chain(std::iter::repeat(0.0));
    let moved = there
        .into_iter()
        .zip(here)
        .map(|(there, here)| here - there);
    moved.map(|m| m * m).sum::<f64>().sqrt()
}

/// Effective sizes of the result. The variance of a mean is that of the parent's draws and that of the resampling, which
/// leaves a number of ancestors: 1 / ESS = 1 / ESS of the parent + 1 / ancestors. For nested parents both are in the scatter of
/// lineages (design effect); the few clusters of a tempered parent have too noisy a scatter.
fn effective_sizes(draws: &Draws, bridge: &Bridge<'_>, parent: &Run) -> Ess {
    // An effective size is at most the number of draws, also if lineages agree by coincidence.
    let most = draws.len() as f64;
    let kish = effective_kinds(bridge.state.particles.iter().map(|m| m.eve));
    let resampled = |sizes: &[f64]| -> Vec<f64> {
        let both = sizes.iter().map(|size| 1.0 / (1.0 / size + 1.0 / kish));
        both.collect()
    };
    let (bulk, tail) = if parent.method == Method::PtHmc {
        (resampled(&parent.ess.bulk), resampled(&parent.ess.tail))
    } else {
        let weights = draws.weights();
        let size = |k| size_of_mean(&draws.column(k), &weights, &draws.cluster).min(most);
        ((0..draws.dim).map(size).collect(), Vec::new())
    };
    Ess {
        kish,
        quoted: bulk.iter().chain(&tail).copied().fold(kish, f64::min),
        bulk,
        tail,
        ..Ess::default()
    }
}

fn checks(parent: &Run, evidence: &Evidence, ess: &Ess) -> Vec<Check> {
    let failed = parent.checks.iter().filter(|g| !g.pass).count();
    vec![
        Check::at_most(
            "coarse-run-checks",
            failed as f64,
            0.0,
            "convergence checks that the coarse run failed; a bridge cannot find what the coarse run has missed: make that run converge first",
        ),
        Check::at_least(
            "effective-sample-size",
            ess.quoted,
            100.0,
            "smallest effective sample size over parameters, of the coarse run and of the resampling together; if too small, raise `smc_particles`, continue the coarse run, or use a coarse likelihood closer to the fine one",
        ),
        Check::at_most(
            "bridge-error",
            (evidence.error_parts["weights"].powi(2)
                + evidence.error_parts["lineage-weights"].powi(2))
            .sqrt(),
            0.5,
            "error in nats that the bridge adds to ln Z; if too large, raise `smc_particles`, or use a coarse likelihood closer to the fine one",
        ),
    ]
}
