//! Involutions declared by the target, in standard-normal coordinates, with a Metropolis test on the cube.

use super::chain::{Chain, cube_from_normal};
use crate::error::Result;
use crate::rng::{RandomStream, unit_open};
use crate::target::{Involution, Symmetry};

/// Tries every declared involution with probability one half.
pub(super) fn try_all(chain: &mut Chain<'_>, rng: &mut RandomStream) -> Result<()> {
    for involution in Symmetry::involutions(chain.context.target.symmetries()) {
        if unit_open(rng) < 0.5 {
            try_one(chain, involution, rng)?;
        }
    }
    Ok(())
}

/// Accepts the image if it is above the likelihood bound and the Jacobian of the map on the cube, `|det dz'/dz| phi(z')
/// / phi(z)`, is larger than a uniform number. The image may be in another metric region.
fn try_one(
    chain: &mut Chain<'_>,
    involution: &dyn Involution,
    rng: &mut RandomStream,
) -> Result<()> {
    let z = chain.normals();
    let mut image = z.clone();
    let Some(ln_det) = involution.apply(&mut image) else {
        return Ok(());
    };
    let ln_prior = |z: &[f64]| -0.5 * z.iter().map(|z| z * z).sum::<f64>();
    let ln_jacobian = ln_det + ln_prior(&image) - ln_prior(&z);
    // Also rejects NaN; the uniform number is compared first because that costs no likelihood call.
    let passes = unit_open(rng).ln() < ln_jacobian;
    if !passes {
        return Ok(());
    }
    cube_from_normal(&image, &mut chain.trial);
    let ln_l = chain.likelihood.at(&chain.trial)?;
    if ln_l > chain.context.contour {
        chain.accept(ln_l);
        chain.label = chain.bound.label(&chain.x);
    }
    Ok(())
}
