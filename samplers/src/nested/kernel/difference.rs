//! Slices along differences of live points, between slices along random directions of the local ellipsoid (ter Braak
//! 2006, as the directions of slices; Goodman & Weare 2010 for the use of the other half).
//!
//! Live points lie along whatever the region above the contour extends along, ridges within one ellipsoid and other
//! modes among it, and their differences point there.
//!
//! # Why the prior above the contour stays invariant
//!
//! 1. Survivors are independent draws from the prior above the contour, and threads know nothing of where their points
//!    are. Hold the half that the seed is *not* in fixed, with everything made of it: the metrics and the pairs to choose
//!    from. The seed is still a draw from the prior above the contour. It is enough that every step keeps that law for
//!    any fixed other half. Had the seed's own half a say, the pair would lean to where the seed is not, as a metric
//!    fitted to the seeds does ([`Bound::for_steps`](crate::nested::bound::Bound::for_steps)).
//! 2. Which kind of slice comes next, which pair, and the width in units of the pair's distance are drawn without a look
//!    at the chain's present state. A slice along a line whose direction and width have a fixed law keeps the uniform law
//!    on the whole region above the contour (Neal 2003), so no metric region confines it. It may end in another one, as
//!    of another mode.
//! 3. A slice in the local metric keeps the uniform law in each metric region by itself, hence on all of them together,
//!    however much of it is in each: a move between regions needs no more than that the next such slice goes by
//!    the region where the chain then is. (A pair's direction may not be bent by the local metric for the same reason:
//!    its law would then depend on the state.)
//!
//! So a new point has the right law and owes nothing to the other half. It does resemble its own seed until enough slices
//! have been made, which the gates watch; and two points born in one batch, each with the other's seed among its pairs,
//! share what their chains have not forgotten.

use super::{Chain, slice};
use crate::error::Result;
use crate::rng::{Stream, below, unit_open};

/// Share of the slices along differences. The others reach what differences of few points do not span.
const SHARE: f64 = 0.5;

/// Moves the chain along the difference of two points of the other half, or along a random direction of its ellipsoid.
pub(super) fn step(chain: &mut Chain<'_>, rng: &mut Stream) -> Result<()> {
    if unit_open(rng) < SHARE && point_along_a_difference(chain, rng) {
        let pace = slice::along(chain, chain.setting.stride, None, rng)?;
        chain.motion.differences.add(pace);
        chain.label = chain.bound.label(&chain.x);
        Ok(())
    } else {
        slice::step(chain, rng)
    }
}

/// Makes the difference of two points of the other half the direction. False if there are no two, or if they coincide:
/// neither depends on the chain.
fn point_along_a_difference(chain: &mut Chain<'_>, rng: &mut Stream) -> bool {
    let count = chain.others.len();
    if count < 2 {
        return false;
    }
    let first = below(rng, count);
    let second = (first + 1 + below(rng, count - 1)) % count;
    let ends = [first, second].map(|i| chain.kept.row(chain.others[i]));
    let mut apart = false;
    for (v, (a, b)) in chain.direction.iter_mut().zip(ends[0].iter().zip(ends[1])) {
        *v = a - b;
        apart |= v.abs() > 0.0;
    }
    apart
}
