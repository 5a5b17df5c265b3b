//! Slice updates along differences of live points near the chain, alternating with random directions of the local ellipsoid (ter
//! Braak 2006; Goodman & Weare 2010 for the use of the other half).
//!
//! Live points lie where the region above the likelihood bound extends, along ridges within one ellipsoid as well as in
//! other modes, and their differences point along it.
//!
//! # Why the prior above the likelihood bound stays invariant
//!
//! 1. The surviving points are draws of the prior above the bound, and all descendants of a seed are in its own half,
//!    because a point has the lineage of its seed. Hold the other half fixed, with everything computed from it: the
//!    metrics and the pairs. The seed is still a draw of the prior above the bound, so it is enough that every step
//!    leaves that distribution invariant for any fixed other half. If the pairs depended on the seed's own half, they
//!    would be biased away from the seed, as a metric fitted to the seeds is
//!    ([`Bound::for_steps`](crate::nested::bound::Bound::for_steps)).
//! 2. The kind of the next slice update, the scale of the pair's cell and the width in units of the pair's distance are
//!    drawn independently of the chain's present state. The pair is from the chain's cell, and the update does not
//!    leave that cell ([`DifferencePool`](crate::difference_pool::DifferencePool)), so that it leaves the uniform
//!    distribution on the part of the cell above the bound invariant (Neal 2003). At the largest scale the whole space
//!    is one cell: an update may end in another mode.
//! 3. A slice update in the local metric leaves the uniform distribution in each metric region invariant, hence everywhere,
//!    however much of it is in each: after a move between regions, the next such update only has to use the region of the present
//!    state.
//! 4. If the target has an exact symmetry whose orbits can be aligned, the two points are first moved along it to the invariant
//!    level of the chain's present state, and pairs that cannot have it are drawn again. Their distribution then depends on the present state through its cell
//!    and its level, which is constant on the line: the reverse move has the same distribution. If no pair can have the level the chain stays. Steps across orbits need not follow the curvature of the
//!    orbit, and the position along it is redrawn at the end.
//!
//! So a new point has the right distribution and is independent of the other half. It is correlated with its own seed
//! until enough slice updates have been made; the scatter of lineages measures this, and the checks limit it. Two
//! points of one iteration, each with the seed of the other in its pool, are correlated as far as their chains still
//! depend on their seeds.

use super::chain::{Chain, Partition, cube_from_normal};
use super::slice;
use crate::difference_pool::Pair;
use crate::error::Result;
use crate::rng::{RandomStream, unit_open};
use crate::target::Symmetry;

/// Fraction of the slice updates along differences. The others reach what differences of few points do not span.
const DIFFERENCE_FRACTION: f64 = 0.5;

/// Moves the chain along the difference of two points of the other half near it, or along a random direction of its
/// ellipsoid.
pub(super) fn step(chain: &mut Chain<'_>, rng: &mut RandomStream) -> Result<()> {
    let orbit = Symmetry::first_orbit(chain.context.target.symmetries());
    if unit_open(rng) >= DIFFERENCE_FRACTION {
        return slice::step(chain, rng);
    }
    let from = chain.normals();
    if !chain.others.has_pairs() {
        return slice::step(chain, rng);
    }
    let Some(Pair { ends, cell }) = chain.others.pick(&from, orbit, rng) else {
        return Ok(());
    };
    let mut differ = false;
    let [a, b] = ends.map(|z| {
        let mut u = vec![0.0; z.len()];
        cube_from_normal(&z, &mut u);
        u
    });
    for (v, (a, b)) in chain.direction.iter_mut().zip(a.iter().zip(&b)) {
        *v = a - b;
        differ |= v.abs() > 0.0;
    }
    // Points that coincide give no direction, from wherever in the cell the chain is.
    if !differ {
        return Ok(());
    }
    let counts = slice::along(chain, chain.context.stride, Partition::Cell(cell), rng)?;
    chain.motion.differences.add(counts);
    chain.label = chain.bound.label(&chain.x);
    Ok(())
}
