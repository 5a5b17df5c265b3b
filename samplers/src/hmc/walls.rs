//! Walls of the prior: half-spaces that a trajectory is reflected by, exactly.

use super::Metric;
use crate::target::HalfSpace;

/// More reflections than this within one drift, and the move is given up: a corner with no way out in floating point.
const MAX_REFLECTIONS: usize = 1000;

/// Whether `z` is on the inner side of all walls.
#[must_use]
pub fn inside(walls: &[HalfSpace], z: &[f64]) -> bool {
    walls.iter().all(|wall| dot(&wall.normal, z) >= wall.offset)
}

pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// One wall in a metric: the mirror acts on whitened momenta.
pub(super) struct Mirror<'a> {
    wall: &'a HalfSpace,
    /// `L' a`, the normal seen by whitened momenta.
    normal: Vec<f64>,
    /// `L L' a`, the direction in which the velocity changes.
    push: Vec<f64>,
    /// `|L' a|^2`.
    square: f64,
}

impl<'a> Mirror<'a> {
    pub(super) fn new(wall: &'a HalfSpace, metric: &Metric) -> Self {
        let dim = wall.normal.len();
        let (mut normal, mut push) = (vec![0.0; dim], vec![0.0; dim]);
        metric.whiten_force(&wall.normal, &mut normal);
        metric.velocity(&normal, &mut push);
        Self {
            wall,
            square: dot(&normal, &normal),
            normal,
            push,
        }
    }

    /// Time until the wall is hit at this velocity; infinite if it is not ahead.
    fn time(&self, z: &[f64], velocity: &[f64]) -> f64 {
        let approach = -dot(&self.wall.normal, velocity);
        if approach > 0.0 {
            // A point that rounding has left a hair outside hits at once.
            ((dot(&self.wall.normal, z) - self.wall.offset) / approach).max(0.0)
        } else {
            f64::INFINITY
        }
    }

    fn reflect(&self, momentum: &mut [f64], velocity: &mut [f64]) {
        let factor = 2.0 * dot(&self.normal, momentum) / self.square;
        for (r, n) in momentum.iter_mut().zip(&self.normal) {
            *r -= factor * n;
        }
        for (v, p) in velocity.iter_mut().zip(&self.push) {
            *v -= factor * p;
        }
    }
}

/// Moves `z` along `velocity` for `time`, mirrored by walls: volume-preserving and reversible. False if a corner did
/// not let go.
pub(super) fn drift(
    z: &mut [f64],
    momentum: &mut [f64],
    velocity: &mut [f64],
    mut time: f64,
    mirrors: &[Mirror<'_>],
) -> bool {
    for _ in 0..MAX_REFLECTIONS {
        let mut next: Option<(&Mirror<'_>, f64)> = None;
        for mirror in mirrors {
            let at = mirror.time(z, velocity);
            if at < next.map_or(time, |(_, t)| t) {
                next = Some((mirror, at));
            }
        }
        let leg = next.map_or(time, |(_, t)| t);
        for (z, v) in z.iter_mut().zip(velocity.iter()) {
            *z += leg * v;
        }
        let Some((mirror, at)) = next else {
            return true;
        };
        time -= at;
        mirror.reflect(momentum, velocity);
    }
    false
}
