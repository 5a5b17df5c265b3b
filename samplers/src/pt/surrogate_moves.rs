//! The moves of one state along a surrogate of ln L: one of each length, each accepted by ln L itself.

use super::record::Local;
use crate::error::Result;
use crate::hmc::{Evaluator, LocalSampler, MoveLength, Point, surrogate_move};
use crate::rng::RandomStream;

/// Moves `point`, at the inverse temperature `beta` of an annealing path, along the density that `along` follows, by steps of so many metric units and once of each length, and notes in `local` how; `visit` is
/// called with the point after each move.
///
/// # Errors
/// As of [`surrogate_move`].
#[allow(
    clippy::too_many_arguments,
    reason = "those of a move, its record and a visitor"
)]
pub(super) fn surrogate_moves(
    evaluator: &mut Evaluator<'_>,
    along: &mut LocalSampler<'_, '_>,
    beta: f64,
    step: f64,
    lengths: &[MoveLength],
    point: &mut Point,
    rng: &mut RandomStream,
    local: &mut Local,
    mut visit: impl FnMut(&Point),
) -> Result<()> {
    for length in lengths {
        let values = |z: &[f64]| Ok((evaluator.value(z)?, evaluator.ln_over_prior(z)));
        let (moved, acceptance) = surrogate_move(values, along, beta, step, *length, point, rng)?;
        local.note(&moved);
        local.surrogate_acceptance += acceptance;
        visit(point);
    }
    Ok(())
}
