//! How particles stand for the stream between them: by themselves, or, on strands, by lines.

use crate::scalar::Scalar;
use std::ops::Range;

/// Spots on the line from a particle to the next of its strand. Four leave the likelihood a quarter rougher, more hardly make it
/// smoother.
const SPOTS: usize = 8;

/// A run of particles, and how each of them stands for the stream: in some spots on the way to another one, each of the same
/// weight. Every particle has a weight of one in all: on a strand it is spread over half the way to its neighbours, and the
/// first and the last keep what has no neighbour.
#[derive(Clone, Debug)]
pub struct Stretch {
    /// Their numbers.
    pub particles: Range<usize>,
    /// How much further on the other one is.
    pub to: usize,
    /// Number of spots, evenly spread over the way there.
    pub spots: usize,
    /// Weight of each.
    pub weight: f64,
}

impl Stretch {
    /// How some of `len` particles stand for the stream, if the next one of each one's strand is `strands` further on, or if there
    /// are no strands, 0.
    pub fn all(some: Range<usize>, len: usize, strands: usize) -> [Self; 3] {
        let within = |from: usize, to: usize| some.start.max(from)..some.end.min(to);
        let alone = |particles, weight| Self {
            particles,
            to: 0,
            spots: 1,
            weight,
        };
        if strands == 0 {
            return [alone(some, 1.0), alone(0..0, 0.0), alone(0..0, 0.0)];
        }
        let last = len.saturating_sub(strands);
        let lines = Self {
            particles: within(0, last),
            to: strands,
            spots: SPOTS,
            weight: 1.0 / SPOTS as f64,
        };
        [
            lines,
            alone(within(0, strands), 0.5),
            alone(within(last, len), 0.5),
        ]
    }

    /// How far spot number `k` is on the way.
    #[inline(always)]
    pub fn share(&self, k: usize) -> f64 {
        (k as f64 + 0.5) / self.spots as f64
    }

    /// Spot number `k` of a particle here, whose way leads there.
    #[inline(always)]
    pub fn spot<S: Scalar>(&self, here: Spot<S>, there: Spot<S>, k: usize) -> Spot<S> {
        if self.to == 0 {
            here
        } else {
            here.towards(there, self.share(k))
        }
    }
}

/// A spot on the sky: its angle in bin widths from the progenitor, its radius, and the square of that.
#[derive(Clone, Copy, Debug)]
pub struct Spot<S> {
    pub position: S,
    pub r: S,
    pub r2: S,
}

impl<S: Scalar> Spot<S> {
    /// A share of the way to another one.
    #[inline(always)]
    fn towards(self, other: Self, share: f64) -> Self {
        let r = self.r + (other.r - self.r) * share;
        Self {
            position: self.position + (other.position - self.position) * share,
            r,
            r2: r * r,
        }
    }
}
