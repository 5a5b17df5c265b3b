//! Slice updates along a line through the present point (Neal 2003; hit and run): they need no gradient.
//!
//! Where a likelihood is rough at the scale of a leapfrog step (that of a stream of a thousand particles is), HMC
//! transitions are rejected at any step size. A slice update finds its width by itself, and needs values only.

use super::point::ln_density;
use super::{Evaluator, Metric, Point, refresh};
use crate::difference_pool::{DifferencePool, Pair, PairCell};
use crate::error::Result;
use crate::rng::{RandomStream, standard_normal, unit_open};
use crate::target::{Orbit, Symmetry};

/// Width of the first interval in units of the direction: twice that of a Gaussian's own slice, since an interval too wide
/// costs one call more and one too narrow cannot grow.
const WIDTH: f64 = 2.0;

/// Maximum number of calls of one slice update; then the interval is empty to rounding, and the point stays.
const MAX_CALLS: usize = 100;

/// Fraction of directions that are differences of the pool's points, if it has two for each dimension.
const DIFFERENCE_FRACTION: f64 = 0.75;

/// The line of a slice update.
enum Line {
    /// Along a pair of the pool's points, within its cell.
    Pair(PairCell),
    /// In a random direction of the metric.
    Random,
    /// No pair has the level of the present point: there is no move.
    None,
}

/// A direction about as long as the slice: the difference of two of the pool's points near `at`, or a random one in `metric`.
fn direction(
    pool: &DifferencePool,
    metric: &Metric,
    orbit: Option<&dyn Orbit>,
    at: &[f64],
    rng: &mut RandomStream,
    out: &mut [f64],
) -> Line {
    let dim = out.len();
    if pool.len() >= 2 * dim && unit_open(rng) < DIFFERENCE_FRACTION {
        let Some(Pair { ends: [a, b], cell }) = pool.pick(at, orbit, rng) else {
            return Line::None;
        };
        for ((v, a), b) in out.iter_mut().zip(&a).zip(&b) {
            *v = a - b;
        }
        return Line::Pair(cell);
    }
    let normals: Vec<f64> = (0..dim).map(|_| standard_normal(rng)).collect();
    metric.velocity(&normals, out);
    Line::Random
}

/// One slice update: moves `at` to a draw from a slice of the density at `beta` on a line through it: a level under the present
/// density,
/// an interval about the point at a random offset, then draws from it, which shrinks to each draw that lies below the
/// level. Along a pair of the pool's points it stays in the pair's cell ([`DifferencePool`]); the pool does not change while a
/// chain uses it. The gradient at the new point is unknown.
///
/// # Errors
/// [`Error::Fatal`](crate::Error::Fatal) or [`Error::Infinite`](crate::Error::Infinite) from the target.
pub fn slice(
    evaluator: &mut Evaluator<'_>,
    beta: f64,
    metric: &Metric,
    pool: &DifferencePool,
    at: &mut Point,
    rng: &mut RandomStream,
) -> Result<()> {
    let orbit = Symmetry::first_orbit(evaluator.target().symmetries());
    let mut along = vec![0.0; at.z.len()];
    let cell = match direction(pool, metric, orbit, &at.z, rng, &mut along) {
        Line::Pair(cell) => Some(cell),
        Line::Random => None,
        Line::None => return Ok(()),
    };
    let level = at.ln_density(beta) + unit_open(rng).ln();
    let bound = evaluator.target().ln_likelihood_bound();
    let mut left = -WIDTH * unit_open(rng);
    let mut right = left + WIDTH;
    let mut trial = at.z.clone();
    for _ in 0..MAX_CALLS {
        let t = left + (right - left) * unit_open(rng);
        for ((o, z), v) in trial.iter_mut().zip(&at.z).zip(&along) {
            *o = z + t * v;
        }
        // Draws outside the pair's cell, or where the known bound of ln L is too low, need no call.
        let held = cell.is_none_or(|cell| pool.holds(cell, &trial, orbit));
        if held {
            let ln_over_prior = evaluator.ln_over_prior(&trial);
            if bound.is_none_or(|most| ln_density(beta, &trial, most, ln_over_prior) > level) {
                let l = evaluator.value(&trial)?;
                if ln_density(beta, &trial, l, ln_over_prior) > level {
                    at.z = trial;
                    at.ln_likelihood = l;
                    at.ln_over_prior = ln_over_prior;
                    at.has_gradient = false;
                    return Ok(());
                }
            }
        }
        if t < 0.0 {
            left = t;
        } else {
            right = t;
        }
    }
    Ok(())
}

/// A redraw along the target's orbits, then `slices` slice updates, each followed by another redraw; `visit` is called with
/// the point after each.
///
/// # Errors
/// As [`slice()`].
#[allow(
    clippy::too_many_arguments,
    reason = "those of a slice update, their number and a visitor"
)]
pub fn slice_updates(
    evaluator: &mut Evaluator<'_>,
    beta: f64,
    metric: &Metric,
    pool: &DifferencePool,
    slices: usize,
    at: &mut Point,
    rng: &mut RandomStream,
    mut visit: impl FnMut(&Point),
) -> Result<()> {
    redraw(evaluator, beta, at, rng);
    for _ in 0..slices {
        slice(evaluator, beta, metric, pool, at, rng)?;
        redraw(evaluator, beta, at, rng);
        visit(at);
    }
    Ok(())
}

/// Redraws the position along every orbit.
fn redraw(evaluator: &mut Evaluator<'_>, beta: f64, at: &mut Point, rng: &mut RandomStream) {
    for symmetry in evaluator.target().symmetries() {
        if let Symmetry::Orbit(orbit) = symmetry {
            refresh(evaluator, orbit.as_ref(), beta, at, rng);
        }
    }
}
