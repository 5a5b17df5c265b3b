//! One slice along a random direction of the local ellipsoid: step out from a random offset, then shrink (Neal 2003).

use super::Chain;
use crate::error::{Error, Result};
use crate::nested::bound::draw_direction;
use crate::rng::{Stream, unit_open};

/// Steps outward, or inward, of one slice.
const MAX_STEPS: u64 = 1000;

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
    let mut steps = 0;
    while chain.look(left)?.is_some() {
        left -= width;
        steps = checked(steps + 1)?;
    }
    while chain.look(right)?.is_some() {
        right += width;
        steps = checked(steps + 1)?;
    }
    chain.motion.grown += steps;
    steps = 0;
    loop {
        let t = left + (right - left) * unit_open(rng);
        if let Some(ln_l) = chain.look(t)? {
            chain.accept(ln_l);
            chain.motion.shrunk += steps;
            return Ok(());
        }
        if t < 0.0 {
            left = t;
        } else {
            right = t;
        }
        steps = checked(steps + 1)?;
    }
}

fn checked(steps: u64) -> Result<u64> {
    if steps < MAX_STEPS {
        Ok(steps)
    } else {
        Err(Error::Stuck {
            what: "a slice found no end",
            tries: steps,
            remedy: "check that the likelihood gives the same number each time at the same point",
        })
    }
}
