//! The moves of one state along a surrogate of ln L: one of each length, each accepted by ln L itself.

use super::record::Local;
use crate::error::Result;
use crate::hmc::{self, Evaluator, LocalSampler, Plan, Point};
use crate::rng::RandomStream;

/// Moves `point`, at the inverse temperature `beta` of an annealing path, along the density that `along` follows, once by each plan, and notes in `local` how; `visit` is
/// called with the point after each move.
///
/// # Errors
/// As of [`hmc::surrogate_move`].
#[allow(
    clippy::too_many_arguments,
    reason = "those of a move, its record and a visitor"
)]
pub(super) fn surrogate_moves(
    evaluator: &mut Evaluator<'_>,
    along: &mut LocalSampler<'_, '_>,
    beta: f64,
    plans: &[Plan],
    point: &mut Point,
    rng: &mut RandomStream,
    local: &mut Local,
    mut visit: impl FnMut(&Point),
) -> Result<()> {
    for plan in plans {
        let values = |z: &[f64]| Ok((evaluator.value(z)?, evaluator.ln_over_prior(z)));
        let (moved, acceptance) = hmc::surrogate_move(values, along, beta, plan, point, rng)?;
        local.note(&moved);
        local.surrogate_acceptance += acceptance;
        visit(point);
    }
    Ok(())
}
