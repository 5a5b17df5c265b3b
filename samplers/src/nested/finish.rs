//! From the points of a run to its result.

use super::checks;
use super::evidence::DeadPoints;
use super::live::Points;
use super::reckoning::{Errors, Reckoning};
use super::state::{Job, State};
use crate::error::Result;
use crate::output::{Cost, Method, Run, Status};
use crate::rng::STREAM_VERSION;

/// Builds the result. The live points count as dead in the order of their likelihoods.
pub(super) fn finish(
    job: &Job<'_>,
    state: &State,
    status: Status,
    mut warnings: Vec<String>,
) -> Result<Run> {
    let points = state.points();
    let theta = physical(job, &points);
    let reckoning = Reckoning::of(
        DeadPoints::of(&points),
        &theta,
        points.dim(),
        |history, weighted| Errors::of(history, weighted, job.settings, job.seed),
    );
    let draws = reckoning.draws(job.target, &theta)?;
    let ess = reckoning.ess(&draws);
    let checks = checks::judge(job, state, &reckoning.measured(ess.kish));
    if state.tuning.steps > job.first_steps() {
        warnings.push(format!(
            "steps per new point were raised from {} to {} because new points resembled their seeds; start the next run with `steps = {}`",
            job.first_steps(),
            state.tuning.steps,
            state.tuning.steps
        ));
    }
    let prior = job.target.prior();
    Ok(Run {
        method: Method::Nested,
        status,
        seed: job.seed,
        stream_version: STREAM_VERSION,
        names: prior.names().to_vec(),
        units: prior.units().to_vec(),
        derived_names: job.target.derived_names(),
        draws,
        evidence: reckoning.evidence(),
        ess,
        cost: Cost {
            calls: state.calls,
            gradients: state.gradients,
            cpu_seconds: state.time.cpu_seconds,
            wall_seconds: state.time.wall_seconds,
            rejected: state.rejected.clone(),
        },
        history: reckoning.run_history(state.ranks.fractions()),
        checks,
        warnings,
    })
}

/// Physical parameters of all points, row-major.
fn physical(job: &Job<'_>, points: &Points) -> Vec<f64> {
    let dim = points.dim();
    let mut theta = vec![0.0; dim * points.len()];
    for (i, row) in theta.chunks_exact_mut(dim).enumerate() {
        job.target.prior().theta_from_u(points.row(i), row);
    }
    theta
}
