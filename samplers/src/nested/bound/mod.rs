//! Ellipsoids that enclose the live points; each is also the local metric of the step kernels.

mod ellipsoid;
mod split;

pub(super) use ellipsoid::{Ellipsoid, draw_direction};

use super::live::Points;
use crate::rng::{Domain, RandomStream, below, stream, unit_open};
use crate::valid::Valid;
use serde::{Deserialize, Serialize};

/// Bootstraps behind the enlargement for independent draws.
const BOOTSTRAPS: usize = 20;

/// Maximum enlargement of an axis for independent draws. A new point of a cluster of 2 d or more lies within this
/// multiple of the fitted extent with a probability near 1 (Hotelling's T^2). A bootstrap with a larger enlargement has
/// left out most of a small cluster, or one of two distant groups between which the ellipsoid extends anyway.
const MAX_REACH: f64 = 3.0;

/// Enlargement of every axis for step kernels, where ellipsoids assign a metric to each region: points that did not
/// take part in the fit should lie inside as well.
const STEP_ENLARGEMENT: f64 = 1.5;

/// A set of ellipsoids.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Bound {
    /// One ellipsoid around all points.
    whole: Ellipsoid,
    /// The decomposition; empty where one ellipsoid around all points is as good.
    parts: Vec<Ellipsoid>,
}

impl Bound {
    /// Ellipsoids for step kernels: the first for chains from points of even lineages, the second for odd ones, each fitted to
    /// the points of the other half. A half with too few points, or all alike, gives the cube's metric.
    ///
    /// A metric fitted to the points that the chains start from is correlated with them and biases ln Z by the order of
    /// d H / n; fitted to the other half it does not.
    pub fn for_steps(points: &Points) -> Vec<Self> {
        let [even, odd] = points.halves();
        [odd, even]
            .iter()
            .map(|rows| {
                let fit = &mut |rows: &[usize]| {
                    let mut ellipsoid = Ellipsoid::fit(points, rows)?;
                    ellipsoid.enlarge(STEP_ENLARGEMENT);
                    Some(ellipsoid)
                };
                Self::assemble(points, rows, fit).unwrap_or_else(|| Self::cube(points.dim()))
            })
            .collect()
    }

    /// Ellipsoids to draw from: each is enlarged until, in each bootstrap of its points, the one fitted to the points taken
    /// contains those left out. Splits are compared by the enlarged volumes, so that two distant clusters, one of them small, do
    /// not share an ellipsoid that the bootstrap would enlarge. `None` if the points are too few or all alike.
    pub fn for_draws(points: &Points, seed: u64, number: u64) -> Option<Self> {
        let mut rng = stream(seed, Domain::NestedBound, 0, number);
        let all: Vec<usize> = (0..points.len()).collect();
        Self::assemble(points, &all, &mut |rows| {
            let mut ellipsoid = Ellipsoid::fit(points, rows)?;
            let farthest = (0..BOOTSTRAPS)
                .map(|_| reach(points, rows, &mut rng))
                .fold(1.0, f64::max);
            ellipsoid.enlarge(farthest.min(MAX_REACH));
            Some(ellipsoid)
        })
    }

    fn assemble(points: &Points, rows: &[usize], fit: &mut split::Fit<'_>) -> Option<Self> {
        if rows.len() < 2 * points.dim() {
            return None;
        }
        let whole = fit(rows)?;
        let mut parts = split::split(points, rows, whole.clone(), fit);
        if parts.len() == 1 {
            parts.clear();
        }
        Some(Self { whole, parts })
    }

    /// The metric of the cube itself.
    pub fn cube(dim: usize) -> Self {
        Self {
            whole: Ellipsoid::around_cube(dim),
            parts: Vec::new(),
        }
    }

    /// Checks a bound that was read from a file.
    pub fn check(&self, dim: usize) -> Valid {
        self.whole.check(dim)?;
        self.parts.iter().try_for_each(|part| part.check(dim))
    }

    /// The ellipsoids to draw from.
    fn pieces(&self) -> &[Ellipsoid] {
        if self.parts.is_empty() {
            std::slice::from_ref(&self.whole)
        } else {
            &self.parts
        }
    }

    /// The metric region of `x`: the first ellipsoid that contains it, or the one around all points.
    ///
    /// The proposal of a step must not depend on where in a region it starts. So the region of a point is fixed by the point
    /// alone, and a chain treats other regions as outside; this leaves the uniform distribution invariant.
    pub fn label(&self, x: &[f64]) -> usize {
        self.parts
            .iter()
            .position(|e| e.contains(x))
            .unwrap_or(self.parts.len())
    }

    /// Whether `x` has this label; usually cheaper than [`label`](Self::label).
    pub fn has_label(&self, x: &[f64], label: usize) -> bool {
        match self.parts.get(label) {
            Some(own) => own.contains(x) && !self.parts[..label].iter().any(|e| e.contains(x)),
            None => !self.parts.iter().any(|e| e.contains(x)),
        }
    }

    /// The ellipsoid whose axes are the metric of a label.
    pub fn metric(&self, label: usize) -> &Ellipsoid {
        self.parts.get(label).unwrap_or(&self.whole)
    }

    /// Log of the geometric mean axis of the metric at `x`: the unit of a step length there.
    pub fn ln_unit(&self, x: &[f64]) -> f64 {
        self.metric(self.label(x)).ln_volume / x.len() as f64
    }

    /// A uniform draw from the union of the ellipsoids; false: drawn from an overlap and thinned out, try again.
    pub fn draw(&self, rng: &mut RandomStream, ball: &mut [f64], out: &mut [f64]) -> bool {
        let pieces = self.pieces();
        let largest = pieces
            .iter()
            .map(|e| e.ln_volume)
            .fold(f64::NEG_INFINITY, f64::max);
        let volume = |e: &Ellipsoid| (e.ln_volume - largest).exp();
        let total: f64 = pieces.iter().map(volume).sum();
        let mut left = unit_open(rng) * total;
        let mut chosen = &pieces[0];
        for e in pieces {
            chosen = e;
            left -= volume(e);
            if left < 0.0 {
                break;
            }
        }
        chosen.draw(rng, ball, out);
        if pieces.len() == 1 {
            return true;
        }
        let holders = pieces.iter().filter(|e| e.contains(out)).count();
        holders <= 1 || unit_open(rng) * (holders as f64) < 1.0
    }
}

/// The farthest of the points that a resampling of `rows` leaves out, from the ellipsoid of those that it takes. 1 if
/// it takes fewer different ones than an ellipsoid needs, d + 1, and so has no information on the rest.
fn reach(points: &Points, rows: &[usize], rng: &mut RandomStream) -> f64 {
    let mut taken = vec![false; rows.len()];
    let sample: Vec<usize> = (0..rows.len())
        .map(|_| {
            let i = below(rng, rows.len());
            taken[i] = true;
            rows[i]
        })
        .collect();
    if taken.iter().filter(|t| **t).count() <= points.dim() {
        return 1.0;
    }
    let Some(partial) = Ellipsoid::fit(points, &sample) else {
        return 1.0;
    };
    rows.iter()
        .zip(&taken)
        .filter(|(_, taken)| !**taken)
        .map(|(&i, _)| partial.distance(points.row(i)))
        .fold(1.0, f64::max)
}

#[cfg(test)]
pub(super) mod tests;
