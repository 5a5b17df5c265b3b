//! Independent draws: from the prior, or from the ellipsoids.

use super::chain::{ChainContext, Motion, NewPoint};
use crate::error::{Error, Result};
use crate::nested::bound::Bound;
use crate::nested::likelihood::{Likelihood, draw_prior};
use crate::rng::RandomStream;
use crate::surrogate::Examples;

/// Maximum number of likelihood calls, and of draws, for one point.
const MAX_CALLS: u64 = 100_000;
const MAX_DRAWS: u64 = 1_000_000;

/// Draws, from the prior or from `bound`, until one is above the likelihood bound.
pub(super) fn draw(
    context: &ChainContext<'_>,
    bound: Option<&Bound>,
    rng: &mut RandomStream,
) -> Result<NewPoint> {
    let dim = context.target.dim();
    let mut likelihood = Likelihood::new(context.target);
    let mut ball = vec![0.0; dim];
    let mut u = vec![0.0; dim];
    for _ in 0..MAX_DRAWS {
        match bound {
            None => draw_prior(rng, &mut u),
            Some(bound) => {
                let ours =
                    bound.draw(rng, &mut ball, &mut u) && u.iter().all(|u| *u > 0.0 && *u < 1.0);
                if !ours {
                    continue;
                }
            }
        }
        let ln_l = likelihood.at(&u)?;
        if ln_l > context.contour {
            return Ok(NewPoint {
                u,
                ln_l,
                calls: likelihood.calls,
                examples: Examples::default(),
                motion: Motion {
                    moved: true,
                    ..Motion::default()
                },
            });
        }
        if likelihood.calls.values >= MAX_CALLS {
            break;
        }
    }
    Err(Error::LooseBound {
        calls: likelihood.calls.values,
    })
}
