//! One slice along a random direction of the local ellipsoid: step out from a random offset, then shrink (Neal 2003).

use super::Chain;
use crate::error::{Error, Result};
use crate::nested::bound::draw_direction;
use crate::rng::{Stream, below, unit_open};

/// Most steps outward of one slice, both ways together. Dealt to the two sides at random beforehand, a limit leaves
/// the slice exact (Neal's `m`); a width this much too small is doubled from one batch to the next.
const MAX_OUTWARD: usize = 200;

/// Most steps inward: far more than it takes to shrink an interval to nothing.
const MAX_INWARD: u64 = 2000;

/// Moves the chain to a new point of the line.
pub(super) fn step(chain: &mut Chain<'_>, rng: &mut Stream) -> Result<()> {
    draw_direction(rng, &mut chain.ball);
    chain
        .bound
        .metric(chain.label)
        .stretch(&chain.ball, &mut chain.direction);
    let width = chain.setting.scale;
    let mut left = -width * unit_open(rng);
    let mut right = left + width;
    let leftward = below(rng, MAX_OUTWARD);
    for _ in 0..leftward {
        if chain.look(left)?.is_none() {
            break;
        }
        left -= width;
        chain.motion.grown += 1;
    }
    for _ in leftward..MAX_OUTWARD - 1 {
        if chain.look(right)?.is_none() {
            break;
        }
        right += width;
        chain.motion.grown += 1;
    }
    for _ in 0..MAX_INWARD {
        let t = left + (right - left) * unit_open(rng);
        if let Some(ln_l) = chain.look(t)? {
            chain.accept(ln_l);
            return Ok(());
        }
        chain.motion.shrunk += 1;
        if t < 0.0 {
            left = t;
        } else {
            right = t;
        }
    }
    Err(Error::Stuck {
        what: "a slice shrank to nothing",
        tries: MAX_INWARD,
        remedy: "check that the likelihood gives the same number each time at the same point",
    })
}
