//! Slices along differences of live points, between slices along random directions of the local ellipsoid (ter Braak
//! 2006, as the directions of slices; Goodman & Weare 2010 for the use of the other half).
//!
//! Live points lie along whatever the region above the contour extends along, ridges within one ellipsoid and other
//! modes among it, and their differences point there.
//!
//! # Why the prior above the contour stays invariant
//!
//! 1. Survivors are independent draws from the prior above the contour, and threads know nothing of where their points
//!    are. Hold the half that the seed is *not* in fixed, with everything made of it: the metrics and the pairs to choose
//!    from. The seed is still a draw from the prior above the contour. It is enough that every step keeps that law for
//!    any fixed other half. Had the seed's own half a say, the pair would lean to where the seed is not, as a metric
//!    fitted to the seeds does ([`Bound::for_steps`](crate::nested::bound::Bound::for_steps)).
//! 2. Which kind of slice comes next, which pair, and the width in units of the pair's distance are drawn without a look
//!    at the chain's present state. A slice along a line whose direction and width have a fixed law keeps the uniform law
//!    on the whole region above the contour (Neal 2003), so no metric region confines it. It may end in another one, as
//!    of another mode.
//! 3. A slice in the local metric keeps the uniform law in each metric region by itself, hence on all of them together,
//!    however much of it is in each: a move between regions needs no more than that the next such slice goes by
//!    the region where the chain then is. (A pair's direction may not be bent by the local metric for the same reason:
//!    its law would then depend on the state.)
//!
//! 4. If the target has an exact symmetry whose orbits can be aligned, most pairs are first moved along it until they are
//!    level with the chain's present point. Their law then depends on the present state, but by its level alone, which is
//!    a coordinate that both ends of the pair share and so every point of the line keeps: the way back has the same law.
//!    Steps across orbits no longer have to follow the bends of the orbit, and the way along it is redrawn at the end.
//!
//! So a new point has the right law and owes nothing to the other half. It does resemble its own seed until enough slices
//! have been made, which the gates watch; and two points born in one batch, each with the other's seed among its pairs,
//! share what their chains have not forgotten.

use super::{Chain, cube_from_normal, slice};
use crate::error::Result;
use crate::normal;
use crate::rng::{Stream, below, unit_open};
use crate::target::Symmetry;

/// Share of the slices along differences. The others reach what differences of few points do not span.
const SHARE: f64 = 0.5;

/// Share of pairs that are aligned, where the target has an orbit that can.
const ALIGNED: f64 = 0.75;

/// Moves the chain along the difference of two points of the other half, or along a random direction of its ellipsoid.
pub(super) fn step(chain: &mut Chain<'_>, rng: &mut Stream) -> Result<()> {
    if unit_open(rng) < SHARE && point_along_a_difference(chain, rng) {
        let pace = slice::along(chain, chain.setting.stride, None, rng)?;
        chain.motion.differences.add(pace);
        chain.label = chain.bound.label(&chain.x);
        Ok(())
    } else {
        slice::step(chain, rng)
    }
}

/// Makes the difference of two points of the other half the direction. False if there are no two, or if they coincide:
/// neither depends on the chain.
fn point_along_a_difference(chain: &mut Chain<'_>, rng: &mut Stream) -> bool {
    let count = chain.others.len();
    if count < 2 {
        return false;
    }
    let first = below(rng, count);
    let second = (first + 1 + below(rng, count - 1)) % count;
    let ends = [first, second].map(|i| chain.kept.row(chain.others[i]));
    let aligned = align(chain, ends, rng);
    let (a, b) = match &aligned {
        Some([a, b]) => (a.as_slice(), b.as_slice()),
        None => (ends[0], ends[1]),
    };
    let mut apart = false;
    for (v, (a, b)) in chain.direction.iter_mut().zip(a.iter().zip(b)) {
        *v = a - b;
        apart |= v.abs() > 0.0;
    }
    apart
}

/// Both points, level with the chain's present one; `None` if this pair is not to be aligned or cannot be.
fn align(chain: &Chain<'_>, ends: [&[f64]; 2], rng: &mut Stream) -> Option<[Vec<f64>; 2]> {
    let orbit = Symmetry::first_orbit(chain.setting.target.symmetries())?;
    if unit_open(rng) > ALIGNED {
        return None;
    }
    let normals = |u: &[f64]| -> Vec<f64> { u.iter().map(|u| normal::quantile(*u)).collect() };
    let to = normals(&chain.x);
    let [mut a, mut b] = ends.map(normals);
    if !(orbit.align(&mut a, &to) && orbit.align(&mut b, &to)) {
        return None;
    }
    Some([a, b].map(|z| {
        let mut u = vec![0.0; z.len()];
        cube_from_normal(&z, &mut u);
        u
    }))
}
