//! Galilean Monte Carlo: short trajectories of straight moves in the metric of the local ellipsoid, reflected at the
//! likelihood bound by the gradient of ln L (Betancourt 2011; Skilling 2012).
//!
//! # Why the prior above the likelihood bound stays invariant
//!
//! The metric is that of the other half, as for all chains ([`difference`](super::difference)). A trajectory begins
//! with a velocity w of length 1, uniform in direction in the coordinates where the ellipsoid of the metric region is a
//! ball, and with a time s per move, both drawn independently of the chain's state; the number of moves is fixed.
//! *Inside* means in that metric region, in the cube and above the likelihood bound. A move takes (x, w), x inside, to
//! the first of these whose position is inside:
//!
//! 1. straight: (y, w) with y = x + s w;
//! 2. reflected: (y + s w', w'), where w' is w reflected at the gradient of ln L at y;
//! 3. reversed: (x, -w).
//!
//! A move followed by a reversal of w is its own inverse. From (y, -w) the straight move leads back to x, which is
//! inside. From (y + s w', -w') it leads to y, which is not inside, and the reflection there, which depends on y alone,
//! turns -w' into -w: the reflected position is x again. From (x, w), the result of the third case, it is the third
//! case again. Translations and reflections preserve the volume of positions and velocities, and reflections the length
//! of w. So every move leaves the uniform distribution of positions inside and of directions invariant, so does any
//! fixed number of moves, and no acceptance test is needed at the end.
//!
//! The reflection must be taken at y, outside, and not at x or where the line crosses the bound, because the reverse
//! move would not find it there. And a state that cannot be reflected must reverse its velocity: if it kept the
//! velocity, two states would lead to one, and the density near the boundary would be too high. Beyond a face of the
//! cube or the metric region, and at rejected points, there is no reflection, and the velocity is reversed at once.

use super::chain::{Chain, Partition};
use crate::error::Result;
use crate::nested::bound::draw_direction;
use crate::nested::live::REJECTED;
use crate::rng::{RandomStream, unit_open};

/// Moves of one trajectory. More moves with one velocity decorrelate less than as many moves with new velocities, and
/// those after a reversal revisit positions.
const MOVES: usize = 2;

/// Moves the chain along one trajectory inside its metric region.
pub(super) fn step(chain: &mut Chain<'_>, rng: &mut RandomStream) -> Result<()> {
    draw_direction(rng, &mut chain.ball);
    // The time per move varies, because a chain in a narrow corner needs short ones.
    let time = 2.0 * unit_open(rng) * chain.context.scale;
    for _ in 0..MOVES {
        if !advance(chain, time)? {
            chain.ball.iter_mut().for_each(|w| *w = -*w);
        }
    }
    Ok(())
}

/// One move, straight or reflected, with the velocity in `ball`. False: neither is inside, and nothing has changed.
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
    // The reflected displacement: x + s w + s w'.
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

/// The velocity in `ball`, reflected at the gradient of ln L at `trial`; `None` if there is no gradient.
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
