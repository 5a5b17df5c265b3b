//! Slice updates along differences of live points near the chain, alternating with random directions of the local ellipsoid (ter
//! Braak 2006; Goodman & Weare 2010 for the use of the other half).
//!
//! Live points lie along whatever the region above the likelihood bound extends along, ridges within one ellipsoid as well as
//! other modes, and their differences point along it.
//!
//! # Why the prior above the contour stays invariant
//!
//! 1. Survivors are draws from the prior above the contour, and all relatives of a seed are in its own half, because a
//!    point is of its seed's lineage. Hold the other half fixed, with everything made of it: the metrics and the pairs to
//!    choose from. The seed is still a draw from the prior above the contour. It is enough that every step keeps that law for
//!    any fixed other half. Were the seed's own half used, pairs would favour places away from the seed, as a metric
//!    fitted to the seeds does ([`Bound::for_steps`](crate::nested::bound::Bound::for_steps)).
//! 2. Which kind of slice comes next, the scale of the pair's cell and the width in units of the pair's distance are drawn
//!    without a look at the chain's present state. The pair is of the cell where the chain is, and the slice does not leave
//!    that cell ([`DifferencePool`](crate::difference_pool::DifferencePool)), so that it keeps the uniform law on what of the cell is
//!    above the contour (Neal 2003). At the largest scale all space is one cell: a slice may end in another mode.
//! 3. A slice update in the local metric leaves the uniform distribution in each metric region invariant, hence everywhere,
//!    however much of it is in each: after a move between regions, the next such update only has to use the region of the present
//!    state.
//! 4. If the target has an exact symmetry whose orbits can be aligned, the two points are first moved along it to the invariant
//!    level of the chain's present state. Their distribution then depends on the present state through its level alone, which is
//!    constant on the line: the reverse move has the same distribution. Steps across orbits need not follow the curvature of the
//!    orbit, and the position along it is redrawn at the end.
//!
//! So a new point has the right law and does not depend on the other half. It resembles its own seed until enough slice
//! updates have been made, which the scatter of lineages measures and the checks limit; and two points drawn in one
//! iteration, each with the seed of the other in its pool, are dependent as far as their chains depend on their seeds.

use super::chain::{Chain, Partition, cube_from_normal};
use super::slice;
use crate::error::Result;
use crate::rng::{Stream, unit_open};
use crate::target::Symmetry;

/// Fraction of the slices along differences. The others reach what differences of few points do not span.
const DIFFERENCE_FRACTION: f64 = 0.5;

/// Moves the chain along the difference of two points of the other half near it, or along a random direction of its
/// ellipsoid.
pub(super) fn step(chain: &mut Chain<'_>, rng: &mut Stream) -> Result<()> {
    let orbit = Symmetry::first_orbit(chain.context.target.symmetries());
    if unit_open(rng) >= DIFFERENCE_FRACTION {
        return slice::step(chain, rng);
    }
    let from = chain.normals();
    let Some(pair) = chain.others.pick(&from, orbit, rng) else {
        return slice::step(chain, rng);
    };
    let mut apart = false;
    let [a, b] = chain.others.ends(&pair, &from, orbit).map(|z| {
        let mut u = vec![0.0; z.len()];
        cube_from_normal(&z, &mut u);
        u
    });
    for (v, (a, b)) in chain.direction.iter_mut().zip(a.iter().zip(&b)) {
        *v = a - b;
        apart |= v.abs() > 0.0;
    }
    // Points that coincide give no direction, from wherever in the cell the chain is.
    if !apart {
        return Ok(());
    }
    let counts = slice::along(chain, chain.context.stride, Partition::Cell(pair), rng)?;
    chain.motion.differences.add(counts);
    chain.label = chain.bound.label(&chain.x);
    Ok(())
}
