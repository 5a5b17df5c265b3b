//! One Metropolis step in the local ellipsoid's metric: in any direction, of any length up to the longest.
//!
//! In many dimensions nearly all points of a ball are at its surface. Where the region is thin, a step of that length is never
//! accepted, so shorter steps are proposed as well.

use super::chain::{Chain, Partition};
use crate::error::Result;
use crate::nested::bound::draw_direction;
use crate::rng::{RandomStream, unit_open};

/// Proposes one step; the chain stays where it is if the step ends below the bound.
pub(super) fn step(chain: &mut Chain<'_>, rng: &mut RandomStream) -> Result<()> {
    draw_direction(rng, &mut chain.ball);
    let length = unit_open(rng);
    chain.ball.iter_mut().for_each(|w| *w *= length);
    chain
        .bound
        .metric(chain.label)
        .stretch(&chain.ball, &mut chain.direction);
    match chain.try_trial(chain.context.scale, Partition::Region(chain.label))? {
        Some(ln_l) => {
            chain.accept(ln_l);
            chain.motion.local.grown += 1;
        }
        None => chain.motion.local.shrunk += 1,
    }
    Ok(())
}
