//! A move without a gradient: one slice of a line through the present point (Neal 2003; hit and run).
//!
//! Where a likelihood is rough at the scale of a leapfrog step (a stream of a thousand particles is), no step is short
//! enough for a Hamiltonian path, but a slice finds the width that is left by itself, and costs values alone.

use super::{Evaluator, Metric, Point, inside, jump, refresh};
use crate::error::Result;
use crate::rng::{Stream, below, standard_normal, unit_open};
use crate::target::{Orbit, Symmetry};
use serde::{Deserialize, Serialize};

/// Width of a slice's first interval in units of its direction: twice as wide as a Gaussian's own slice, since an
/// interval too wide costs one call more and one too narrow cannot grow.
const WIDTH: f64 = 2.0;

/// Most calls of one slice; its interval has then shrunk to nothing, and the point stays.
const MAX_CALLS: usize = 100;

/// Share of directions that are differences of the pool's points, if it has two for each dimension.
const DIFFERENCES: f64 = 0.75;

/// Share of those between points brought level first, where the target has an orbit that can.
const ALIGNED: f64 = 0.75;

/// Points of an earlier round, whose differences point along the posterior's own ridges and from mode to mode (ter Braak
/// 2006). It does not change while a chain uses it, and so the law of a direction is the same from wherever a slice
/// starts: the move is exact whatever the points are.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Pool(Vec<f64>);

impl Pool {
    /// A pool of rows of coordinates, one after the other.
    #[must_use]
    pub fn new(rows: Vec<f64>) -> Self {
        Self(rows)
    }

    /// A direction as long as a typical draw: a difference of two of the pool's points, or a random one in `metric`.
    ///
    /// If the target has an exact symmetry, the two points may first be moved along it until they are level with the
    /// present one. The law of the direction then depends on the present point, but by its level alone, which a line along
    /// the direction keeps: the way back has the same law.
    fn direction(
        &self,
        metric: &Metric,
        orbit: Option<&dyn Orbit>,
        at: &[f64],
        rng: &mut Stream,
        out: &mut [f64],
    ) {
        let dim = out.len();
        let rows = self.0.len() / dim;
        if rows >= 2 * dim && unit_open(rng) < DIFFERENCES {
            let i = below(rng, rows);
            let j = (i + 1 + below(rng, rows - 1)) % rows;
            let row = |i: usize| self.0[i * dim..(i + 1) * dim].to_vec();
            let (mut a, mut b) = (row(i), row(j));
            if let Some(orbit) = orbit
                && unit_open(rng) < ALIGNED
                && !(orbit.align(&mut a, at) && orbit.align(&mut b, at))
            {
                // Both as they were, or the level of one alone would be that of the present point.
                (a, b) = (row(i), row(j));
            }
            for ((v, a), b) in out.iter_mut().zip(&a).zip(&b) {
                *v = (a - b) * std::f64::consts::FRAC_1_SQRT_2;
            }
        } else {
            let normals: Vec<f64> = (0..dim).map(|_| standard_normal(rng)).collect();
            metric.velocity(&normals, out);
        }
    }
}

/// Moves `at` to a draw from a slice of `N(z; 0, I) L(z)^beta` on a line through it: a level under the present density,
/// an interval about the point at a random offset, then draws from it, which shrinks to each draw that lies below the
/// level. The gradient at the new point is unknown.
///
/// # Errors
/// [`Error::Fatal`](crate::Error::Fatal) or [`Error::Infinite`](crate::Error::Infinite) from the target.
pub fn slice(
    evaluator: &mut Evaluator<'_>,
    beta: f64,
    metric: &Metric,
    pool: &Pool,
    at: &mut Point,
    rng: &mut Stream,
) -> Result<()> {
    let orbit = Symmetry::first_orbit(evaluator.target().symmetries());
    let mut direction = vec![0.0; at.z.len()];
    pool.direction(metric, orbit, &at.z, rng, &mut direction);
    let ln_density = |z: &[f64], l: f64| beta * l - 0.5 * z.iter().map(|z| z * z).sum::<f64>();
    let level = ln_density(&at.z, at.ln_likelihood) + unit_open(rng).ln();
    let mut left = -WIDTH * unit_open(rng);
    let mut right = left + WIDTH;
    let mut trial = at.z.clone();
    for _ in 0..MAX_CALLS {
        let t = left + (right - left) * unit_open(rng);
        for ((o, z), v) in trial.iter_mut().zip(&at.z).zip(&direction) {
            *o = z + t * v;
        }
        // The prior alone can refuse a draw: no call then.
        if inside(evaluator.target().walls(), &trial) {
            let l = evaluator.value(&trial)?;
            if ln_density(&trial, l) > level {
                at.z = trial;
                at.ln_likelihood = l;
                at.has_gradient = false;
                return Ok(());
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

/// The target's declared moves, orbits redrawn and involutions tried with probability 1/2, and this many slices, each
/// after a redraw along the orbits.
///
/// # Errors
/// As [`slice()`].
pub fn explore_by_slices(
    evaluator: &mut Evaluator<'_>,
    beta: f64,
    metric: &Metric,
    pool: &Pool,
    slices: usize,
    at: &mut Point,
    rng: &mut Stream,
) -> Result<()> {
    for symmetry in evaluator.target().symmetries() {
        if let Symmetry::Involution(map) = symmetry
            && unit_open(rng) < 0.5
        {
            jump(evaluator, map.as_ref(), beta, at, rng)?;
        }
    }
    redraw(evaluator, at, rng);
    for _ in 0..slices {
        slice(evaluator, beta, metric, pool, at, rng)?;
        redraw(evaluator, at, rng);
    }
    Ok(())
}

/// The position along every orbit, afresh.
fn redraw(evaluator: &Evaluator<'_>, at: &mut Point, rng: &mut Stream) {
    for symmetry in evaluator.target().symmetries() {
        if let Symmetry::Orbit(orbit) = symmetry {
            refresh(evaluator, orbit.as_ref(), at, rng);
        }
    }
}
