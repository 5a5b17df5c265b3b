//! One Metropolis step, uniform in a ball of the local ellipsoid's metric.

use super::{Chain, Fence};
use crate::error::Result;
use crate::nested::bound::draw_in_ball;
use crate::rng::Stream;

/// Proposes one step; the chain stays where it is if the step leaves the contour.
pub(super) fn step(chain: &mut Chain<'_>, rng: &mut Stream) -> Result<()> {
    draw_in_ball(rng, &mut chain.ball);
    chain
        .bound
        .metric(chain.label)
        .stretch(&chain.ball, &mut chain.direction);
    match chain.look(chain.setting.scale, Fence::Region(chain.label))? {
        Some(ln_l) => {
            chain.accept(ln_l);
            chain.motion.local.grown += 1;
        }
        None => chain.motion.local.shrunk += 1,
    }
    Ok(())
}
