//! One slice update: an interval at a random offset along a line is extended outwards, then shrunk (Neal 2003). And its
//! simplest line: a random direction of the local ellipsoid.

use super::chain::{Chain, Partition, StepCounts};
use crate::error::{Error, Result};
use crate::nested::bound::draw_direction;
use crate::rng::{RandomStream, below, unit_open};

/// Maximum number of steps outwards of one slice update, both sides together. Divided between the two sides at random
/// beforehand, the limit leaves the update exact (Neal's `m`); a width that is too small by this factor is doubled from
/// one iteration to the next.
const MAX_OUTWARD: usize = 200;

/// Maximum number of steps inwards: far more than it takes to shrink an interval to rounding.
const MAX_INWARD: u64 = 2000;

/// Moves the chain along a random direction of its ellipsoid, inside its metric region.
pub(super) fn step(chain: &mut Chain<'_>, rng: &mut RandomStream) -> Result<()> {
    draw_direction(rng, &mut chain.ball);
    chain
        .bound
        .metric(chain.label)
        .stretch(&chain.ball, &mut chain.direction);
    let partition = Partition::Region(chain.label);
    let counts = along(chain, chain.context.scale, partition, rng)?;
    chain.motion.local.add(counts);
    Ok(())
}

/// Moves the chain to a new point of the line through it along `direction`, of whose length `width` is a multiple; the
/// partition is not left.
pub(super) fn along(
    chain: &mut Chain<'_>,
    width: f64,
    partition: Partition,
    rng: &mut RandomStream,
) -> Result<StepCounts> {
    let mut counts = StepCounts::default();
    let mut left = -width * unit_open(rng);
    let mut right = left + width;
    let leftward = below(rng, MAX_OUTWARD);
    for _ in 0..leftward {
        if chain.try_trial(left, partition)?.is_none() {
            break;
        }
        left -= width;
        counts.grown += 1;
    }
    for _ in leftward..MAX_OUTWARD - 1 {
        if chain.try_trial(right, partition)?.is_none() {
            break;
        }
        right += width;
        counts.grown += 1;
    }
    for _ in 0..MAX_INWARD {
        let t = left + (right - left) * unit_open(rng);
        if let Some(ln_l) = chain.try_trial(t, partition)? {
            chain.accept(ln_l);
            return Ok(counts);
        }
        counts.shrunk += 1;
        if t < 0.0 {
            left = t;
        } else {
            right = t;
        }
    }
    Err(Error::EmptySlice { tries: MAX_INWARD })
}
