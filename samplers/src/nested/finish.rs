//! From the points of a run to its result.

use super::checks;
use super::checks::MORE_DRAWS;
use super::evidence::DeadPoints;
use super::results::{Errors, Results, draws, ess};
use super::state::{Context, State};
use crate::error::Result;
use crate::output::{Method, Run, Status};
use crate::rng::STREAM_VERSION;

/// Builds the result. The live points count as dead in the order of their likelihoods.
pub(super) fn finish(context: &Context<'_>, state: &State, status: Status) -> Result<Run> {
    let points = state.points();
    let theta = points.physical(context.target);
    let results = Results::of(DeadPoints::of(&points), |history, weighted| {
        Errors::of(history, weighted, context.settings, context.seed)
    });
    let draws = draws(&results.history, &results.weighted, context.target, &theta)?;
    let ess = ess(&draws);
    let mut checks = checks::checks(context, state, &results.measured(), &ess);
    checks.extend(ess.checks(context.settings.min_ess(), MORE_DRAWS));
    let mut warnings = Vec::new();
    if state.tuning.steps > context.first_steps() {
        warnings.push(format!(
            "steps per new point were raised from {} to {} because new points depended on their seeds; set `steps = {}` in the next run",
            context.first_steps(),
            state.tuning.steps,
            state.tuning.steps
        ));
    }
    let prior = context.target.prior();
    Ok(Run {
        method: Method::Nested,
        status,
        seed: context.seed,
        stream_version: STREAM_VERSION,
        names: prior.names().to_vec(),
        units: prior.units().to_vec(),
        derived_names: context.target.derived_names(),
        draws,
        evidence: results.evidence(),
        ess,
        cost: state.cost.clone(),
        history: results.run_history(state.ranks.fractions()),
        checks,
        warnings,
        surrogate: state.learner.any().cloned(),
    })
}
