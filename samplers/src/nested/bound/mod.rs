//! What encloses the live points: as many ellipsoids as they ask for, each of which is also the local metric of the
//! step kernels.

mod ellipsoid;
mod split;

pub(super) use ellipsoid::{Ellipsoid, draw_direction, draw_in_ball};

use super::live::Points;
use super::settings::BoundKind;
use crate::rng::{Domain, Stream, below, stream, unit_open};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Bootstraps of the decomposition behind the enlargement for independent draws.
const BOOTSTRAPS: u64 = 20;

/// Volume factor of the ellipsoids for kernels that walk: there they are only a metric.
const STEP_ENLARGEMENT: f64 = 1.25;

/// A set of ellipsoids.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Bound {
    /// One ellipsoid around all points.
    whole: Ellipsoid,
    /// The decomposition; empty where the whole is as good.
    parts: Vec<Ellipsoid>,
}

impl Bound {
    /// A bound for kernels that walk. `None` if the points are too few or all alike.
    pub fn for_steps(points: &Points, kind: BoundKind) -> Option<Self> {
        let rows: Vec<usize> = (0..points.len()).collect();
        let mut bound = Self::fit(points, &rows, kind)?;
        bound.enlarge(STEP_ENLARGEMENT.powf(1.0 / points.dim() as f64));
        Some(bound)
    }

    /// A bound to draw from: enlarged until, in every bootstrap of the whole decomposition, it holds the points left
    /// out. `None` as for [`for_steps`](Self::for_steps).
    pub fn for_draws(points: &Points, kind: BoundKind, seed: u64, fit: u64) -> Option<Self> {
        let count = points.len();
        let rows: Vec<usize> = (0..count).collect();
        let mut bound = Self::fit(points, &rows, kind)?;
        let reach: Vec<f64> = (0..BOOTSTRAPS)
            .into_par_iter()
            .map(|b| {
                let mut rng = stream(seed, Domain::NestedBound, fit, b);
                let mut drawn = vec![false; count];
                let mut sample = Vec::with_capacity(count);
                for _ in 0..count {
                    let i = below(&mut rng, count);
                    drawn[i] = true;
                    sample.push(i);
                }
                let Some(partial) = Self::fit(points, &sample, kind) else {
                    return 1.0;
                };
                (0..count)
                    .filter(|&i| !drawn[i])
                    .map(|i| partial.distance(points.row(i)))
                    .fold(1.0, f64::max)
            })
            .collect();
        bound.enlarge(reach.into_iter().fold(1.0, f64::max));
        Some(bound)
    }

    fn fit(points: &Points, rows: &[usize], kind: BoundKind) -> Option<Self> {
        if kind == BoundKind::Cube {
            return Some(Self::cube(points.dim()));
        }
        if rows.len() < 2 * points.dim() {
            return None;
        }
        let whole = Ellipsoid::fit(points, rows)?;
        let mut parts = Vec::new();
        if kind == BoundKind::MultiEllipsoid {
            parts = split::split(points, rows, whole.clone());
            if parts.len() == 1 {
                parts.clear();
            }
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

    fn enlarge(&mut self, factor: f64) {
        self.whole.enlarge(factor);
        self.parts.iter_mut().for_each(|e| e.enlarge(factor));
    }

    /// The ellipsoids to draw from.
    fn pieces(&self) -> &[Ellipsoid] {
        if self.parts.is_empty() {
            std::slice::from_ref(&self.whole)
        } else {
            &self.parts
        }
    }

    /// Distance to the nearest ellipsoid in its own units: at most 1 inside.
    fn distance(&self, x: &[f64]) -> f64 {
        self.pieces()
            .iter()
            .map(|e| e.distance(x))
            .fold(f64::INFINITY, f64::min)
    }

    /// The metric region of `x`: the first ellipsoid that holds it, or the whole.
    ///
    /// A step law must not depend on where in a region the step starts. So the region of a point is fixed by the
    /// point alone, and a chain treats other regions as outside (samplers: metric rule); that is exactly invariant.
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

    /// A uniform draw from the union of the ellipsoids; false: drawn from an overlap and thinned out, try again.
    pub fn draw(&self, rng: &mut Stream, ball: &mut [f64], out: &mut [f64]) -> bool {
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

#[cfg(test)]
mod tests;
