//! From the end of the way to a result, and whether to believe it.

use super::{Level, Way};
use crate::diagnostics::{effective_kinds, size_of_mean, sums_by_group};
use crate::error::Result;
use crate::output::{Check, Cost, Draws, Ess, Evidence, History, Method, Origin, Run, Status};
use crate::rng::STREAM_VERSION;

/// The result of a way that has been walked to its end.
pub(super) fn assemble(way: &Way<'_>, parent: &Run) -> Result<Run> {
    let state = &way.state;
    let prior = way.target.prior();
    let draws = draws(way)?;
    let evidence = evidence(way, &draws, parent);
    let ess = effective_sizes(&draws, way);
    let checks = checks(parent, &evidence, &ess);
    Ok(Run {
        method: Method::Bridge,
        status: Status::Complete,
        seed: way.seed,
        stream_version: STREAM_VERSION,
        names: prior.names().to_vec(),
        units: prior.units().to_vec(),
        derived_names: way.target.derived_names(),
        draws,
        evidence,
        ess,
        cost: Cost {
            calls: way.state.tally.calls,
            gradients: way.state.tally.gradients,
            cpu_seconds: state.time.cpu_seconds,
            wall_seconds: state.time.wall_seconds,
            rejected: way.state.tally.rejected.clone(),
        },
        history: History::Bridge {
            share: column(&way.state.levels, |l| l.share),
            ln_ratio: column(&way.state.levels, |l| l.ln_ratio),
            ancestors: column(&way.state.levels, |l| l.ancestors),
            echo: column(&way.state.levels, |l| l.echo),
        },
        checks,
        warnings: Vec::new(),
    })
}

fn column(levels: &[Level], of: impl Fn(&Level) -> f64) -> Vec<f64> {
    levels.iter().map(of).collect()
}

fn draws(way: &Way<'_>) -> Result<Draws> {
    let ln_weight = -(way.state.members.len() as f64).ln();
    let mut draws = Draws::of(way.target);
    let mut theta = vec![0.0; way.target.dim()];
    for member in &way.state.members {
        way.target.prior().theta_from_z(&member.z, &mut theta);
        let origin = Origin {
            chain: 0,
            cluster: member.lineage,
        };
        draws.push(way.target, &theta, member.both.fine, ln_weight, origin)?;
    }
    Ok(draws)
}

fn evidence(way: &Way<'_>, draws: &Draws, parent: &Run) -> Evidence {
    let ln_z = parent.evidence.ln_z + way.state.ln_ratio;
    let parts = [
        ("parent", parent.evidence.error),
        ("weights", of_ancestry(way)),
        ("shares", of_shares(draws, &parent.draws)),
    ];
    let members = way.state.members.len() as f64;
    let mean = way.state.members.iter().map(|m| m.both.fine).sum::<f64>() / members;
    Evidence {
        ln_z,
        error: parts.iter().map(|(_, e)| e * e).sum::<f64>().sqrt(),
        error_parts: parts.map(|(name, e)| (name.to_owned(), e)).into(),
        estimates: [("parent".to_owned(), parent.evidence.ln_z)].into(),
        information: mean - ln_z,
    }
}

/// Error of the mean weights, by how many members have an ancestor in common beyond what taking them anew without weights would
/// make of it (Lee & Whiteley 2018).
fn of_ancestry(way: &Way<'_>) -> f64 {
    let members = way.state.members.len() as f64;
    let alike = 1.0 / effective_kinds(way.state.members.iter().map(|m| m.ancestor));
    let times = 1.0 + way.state.levels.len() as f64;
    let unlike = (members / (members - 1.0)).powf(times) * (1.0 - alike);
    (1.0 - unlike).max(0.0).sqrt()
}

/// What the way has moved between the parent's lineages, of each of which the parent knows its share to about a factor: the
/// parent's own error does not see it.
fn of_shares(draws: &Draws, parent: &Draws) -> f64 {
    if parent.cluster.iter().all(|g| *g == parent.cluster[0]) {
        // Independent draws: the weights' own error says it all.
        return 0.0;
    }
    let shares = |draws: &Draws| sums_by_group(&draws.cluster, draws.weights().into_iter());
    // A lineage without a member is not among the last ones here.
    let (here, there) = (shares(draws), shares(parent));
    let here = here.into_iter().chain(std::iter::repeat(0.0));
    let moved = there
        .into_iter()
        .zip(here)
        .map(|(there, here)| here - there);
    moved.map(|m| m * m).sum::<f64>().sqrt()
}

/// Effective sizes of means by the scatter of lineages.
fn effective_sizes(draws: &Draws, way: &Way<'_>) -> Ess {
    let weights = draws.weights();
    // A parameter whose groups agree by chance is not known better than by every draw.
    let most = draws.len() as f64;
    let bulk: Vec<f64> = (0..draws.dim)
        .map(|k| size_of_mean(&draws.column(k), &weights, &draws.cluster).min(most))
        .collect();
    let kish = effective_kinds(way.state.members.iter().map(|m| m.ancestor));
    Ess {
        kish,
        quoted: bulk.iter().copied().fold(kish, f64::min),
        bulk,
        ..Ess::default()
    }
}

fn checks(parent: &Run, evidence: &Evidence, ess: &Ess) -> Vec<Check> {
    let failed = parent.checks.iter().filter(|g| !g.pass).count();
    vec![
        Check::at_most(
            "parent-checks",
            failed as f64,
            0.0,
            "checks that the coarse run failed; what it does not know is not known here: mend that run first",
        ),
        Check::at_least(
            "ancestors-left",
            ess.kish,
            100.0,
            "draws of the coarse run that the result descends from, in effect; if too few, raise `members` or `sweeps`, or take a coarse likelihood nearer to the fine one",
        ),
        Check::at_most(
            "refinement-error",
            (evidence.error_parts["weights"].powi(2) + evidence.error_parts["shares"].powi(2))
                .sqrt(),
            0.5,
            "error in nats that the way adds to ln Z; if too large, raise `members`, or take a coarse likelihood nearer to the fine one",
        ),
    ]
}
