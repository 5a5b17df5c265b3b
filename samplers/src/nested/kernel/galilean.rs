//! Short Galilean trajectories: straight moves in the metric of the local ellipsoid, reflected off the contour at the gradient of ln L (Betancourt
//! 2011; Skilling 2012, Galilean Monte Carlo).
//!
//! # Why the prior above the contour stays invariant
//!
//! The metric is that of the other half, as for all chains ([`difference`](super::difference)). A Galilean trajectory begins with a velocity w
//! of length 1, all directions alike, in the coordinates where the ellipsoid of the metric region is a ball, and a time s of one
//! move, both drawn without a look at where the chain is; the number of moves is fixed. Inside is what is in that metric region,
//! in the cube and above the contour. A move takes (x, w), x inside, to the first of these whose place is inside:
//!
//! 1. straight on: (y, w) with y = x + s w;
//! 2. reflected: (y + s w', w'), where w' is w mirrored at the gradient of ln L at y;
//! 3. turned round: (x, -w).
//!
//! A move and then the flip of w is its own inverse. From (y, -w) the way straight on is back to x, which is inside. From
//! (y + s w', -w') it is to y, which is not, and the mirror there, which knows y alone, makes -w of -w': the place reflected is x
//! again. From (x, w), to which the flip brings what has turned round, it is to turn round once more. Shifts and mirrors keep the
//! volume of places and velocities, and mirrors the length of w. So every move keeps the uniform law on places inside times that of
//! directions, any fixed number of moves does, and there is nothing to accept or to refuse at the end.
//!
//! It matters that the mirror stands at y, outside, and not at x or where the line crosses the contour: on the way back it is not
//! found there again. And that what cannot be reflected turns round: were it to wait with its velocity kept, two states would
//! lead to one, and places near the edge would have too much. Beyond an edge of the cube or of the metric region, and at
//! rejected points, there is no mirror, and the chain turns round at once.

use super::chain::{Chain, Partition};
use crate::error::Result;
use crate::nested::bound::draw_direction;
use crate::nested::live::REJECTED;
use crate::rng::{Stream, unit_open};

/// Moves of one Galilean trajectory: the second depends on where the first has led, on, off a mirror or back from an edge.
/// More moves with one velocity forget a start less than as many with fresh ones, and those after turning round go back.
const MOVES: usize = 2;

/// Sends the chain on a Galilean trajectory inside its metric region.
pub(super) fn step(chain: &mut Chain<'_>, rng: &mut Stream) -> Result<()> {
    draw_direction(rng, &mut chain.ball);
    // Now and then short, or a chain in a narrow corner would never leave it.
    let time = 2.0 * unit_open(rng) * chain.context.scale;
    for _ in 0..MOVES {
        if !advance(chain, time)? {
            chain.ball.iter_mut().for_each(|w| *w = -*w);
        }
    }
    Ok(())
}

/// Moves on, straight or reflected, with the velocity in `ball`. False: neither is inside, and nothing has changed.
pub(super) fn advance(chain: &mut Chain<'_>, time: f64) -> Result<bool> {
    let partition = Partition::Region(chain.label);
    let metric = chain.bound.metric(chain.label);
    metric.stretch(&chain.ball, &mut chain.direction);
    let ln_l = if chain.set_trial(time, partition) {
        chain.likelihood.at(&chain.trial)?
    } else {
        REJECTED
    };
    if ln_l > chain.context.contour {
        chain.accept(ln_l);
        chain.motion.local.grown += 1;
        return Ok(true);
    }
    chain.motion.local.shrunk += 1;
    if ln_l <= REJECTED {
        return Ok(false);
    }
    let Some(mirrored) = mirrored(chain)? else {
        return Ok(false);
    };
    // Over the mirror in all: x + s w + s w'.
    let path: Vec<f64> = chain
        .ball
        .iter()
        .zip(&mirrored)
        .map(|(w, m)| w + m)
        .collect();
    metric.stretch(&path, &mut chain.direction);
    let Some(ln_l) = chain.try_trial(time, partition)? else {
        return Ok(false);
    };
    chain.accept(ln_l);
    chain.ball = mirrored;
    Ok(true)
}

/// The velocity in `ball`, mirrored at the gradient of ln L at `trial`; `None` if there is none.
fn mirrored(chain: &mut Chain<'_>) -> Result<Option<Vec<f64>>> {
    let dim = chain.ball.len();
    let (mut gradient, mut normal) = (vec![0.0; dim], vec![0.0; dim]);
    if !chain.likelihood.gradient_at(&chain.trial, &mut gradient)? {
        return Ok(None);
    }
    let metric = chain.bound.metric(chain.label);
    metric.whiten_covector(&gradient, &mut normal);
    let square: f64 = normal.iter().map(|n| n * n).sum();
    if !(square > 0.0 && square.is_finite()) {
        return Ok(None);
    }
    let along: f64 = normal.iter().zip(&chain.ball).map(|(n, w)| n * w).sum();
    let factor = 2.0 * along / square;
    let both = chain.ball.iter().zip(&normal);
    Ok(Some(both.map(|(w, n)| w - factor * n).collect()))
}
