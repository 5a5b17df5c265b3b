//! The moves of one state along a surrogate of ln L: one of each number of leapfrog steps, each accepted by ln L itself.

use super::record::Local;
use crate::error::Result;
use crate::hmc::{self, Evaluator, LocalSampler, Plan, Point};
use crate::rng::RandomStream;

/// Moves `point`, at the inverse temperature `beta` of an annealing path, along the density that `along` follows, by trajectories of these numbers of leapfrog steps, and notes in `local` how; `visit` is
/// called with the point after each move.
///
/// # Errors
/// As of [`hmc::surrogate_move`].
#[allow(
    clippy::too_many_arguments,
    reason = "those of a move, its record, the lengths of trajectories and a visitor"
)]
pub(super) fn surrogate_moves(
    evaluator: &mut Evaluator<'_>,
    along: &mut LocalSampler<'_, '_>,
    beta: f64,
    plan: &Plan,
    point: &mut Point,
    rng: &mut RandomStream,
    local: &mut Local,
    leapfrogs: &[usize],
    mut visit: impl FnMut(&Point),
) -> Result<()> {
    for &leapfrogs in leapfrogs {
        let values = |z: &[f64]| Ok((evaluator.value(z)?, evaluator.ln_over_prior(z)));
        let plan = plan.of_leapfrogs(leapfrogs);
        let (moved, acceptance) = hmc::surrogate_move(values, along, beta, &plan, point, rng)?;
        local.note(&moved);
        local.surrogate_acceptance += acceptance;
        visit(point);
    }
    Ok(())
}
