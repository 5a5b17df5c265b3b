//! Independent draws: from the prior, or from the bound.

use super::{Motion, Newborn, Setting};
use crate::error::{Error, Result};
use crate::nested::likelihood::Likelihood;
use crate::rng::{Stream, unit_open};

/// Likelihood calls for one point before the bound is given up.
const MAX_CALLS: u64 = 1_000_000;

/// Draws until one is above the contour.
pub(super) fn draw(setting: &Setting<'_>, rng: &mut Stream) -> Result<Newborn> {
    let dim = setting.target.dim();
    let mut likelihood = Likelihood::new(setting.target);
    let mut ball = vec![0.0; dim];
    let mut u = vec![0.0; dim];
    while likelihood.tally.calls < MAX_CALLS {
        match setting.bound {
            None => u.iter_mut().for_each(|u| *u = unit_open(rng)),
            Some(bound) => {
                if !bound.draw(rng, &mut ball, &mut u) || !u.iter().all(|u| *u > 0.0 && *u < 1.0) {
                    continue;
                }
            }
        }
        let ln_l = likelihood.at(&u)?;
        if ln_l > setting.contour {
            return Ok(Newborn {
                u,
                ln_l,
                tally: likelihood.tally,
                motion: Motion {
                    moved: true,
                    ..Motion::default()
                },
            });
        }
    }
    Err(Error::Stuck {
        what: "independent draws from the bound never exceed the contour",
        tries: MAX_CALLS,
        remedy: "use the kernel `random-slice`, which does not depend on how tight the bound is",
    })
}
