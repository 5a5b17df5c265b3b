//! How particles stand for the stream around them: by themselves, or, linked, by spots on a line.

use crate::scalar::Scalar;
use std::ops::Range;

/// Spots of a linked particle. More hardly make a likelihood smoother, and each is binned.
const SPOTS: usize = 4;

/// A particle is spread over this many bin widths to each side, at most, and over this share of its radius inwards and outwards:
/// partners may be far from each other, where what is between them is no line.
const REACH_BINS: f64 = 1.5;
const REACH_RADII: f64 = 0.3;

/// A run of particles, and how each of them stands for the stream: in spots of the same weight, one in all, evenly spread on the
/// line to its partner and as far to the other side.
#[derive(Clone, Debug)]
pub struct Stretch {
    /// Their numbers.
    pub particles: Range<usize>,
    /// How much further on each one's partner is.
    to: isize,
    /// Number of spots.
    pub spots: usize,
}

impl Stretch {
    /// How some of `len` particles stand for the stream, if each one's partner is `links` further on, and that of the last ones as
    /// much before them, or if they have none, 0.
    pub fn all(some: Range<usize>, len: usize, links: usize) -> [Self; 2] {
        let last = len.saturating_sub(links);
        let within = |from: usize, to: usize| some.start.max(from)..some.end.min(to);
        let spots = if links == 0 { 1 } else { SPOTS };
        let to = links.cast_signed();
        [(within(0, last), to), (within(last, len), -to)].map(|(particles, to)| Self {
            particles,
            to,
            spots,
        })
    }

    /// The number of a particle's partner: its own, if it has none.
    #[inline(always)]
    pub fn partner(&self, i: usize) -> usize {
        i.wrapping_add_signed(self.to)
    }

    /// The numbers of the particles and of their partners, and of those between them.
    pub fn with_partners(&self) -> Range<usize> {
        let Range { start, end } = self.particles;
        if self.particles.is_empty() {
            return start..start;
        }
        start.min(self.partner(start))..end.max(self.partner(end))
    }

    /// The weight of each spot.
    #[inline(always)]
    pub fn weight(&self) -> f64 {
        1.0 / self.spots as f64
    }

    /// How far spot number `k` is on the way: from -1 to 1.
    #[inline(always)]
    pub fn share(&self, k: usize) -> f64 {
        (2 * k + 1) as f64 * self.weight() - 1.0
    }

    /// Spot number `k` of a particle here, spread along a way.
    #[inline(always)]
    pub fn spot<S: Scalar>(&self, here: Spot<S>, way: Way<S>, k: usize) -> Spot<S> {
        if self.spots == 1 {
            return here;
        }
        let share = self.share(k);
        let r = here.r + way.out * share;
        Spot {
            position: here.position + way.across * share,
            r,
            r2: r * r,
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
    /// The way to another one.
    #[inline(always)]
    pub fn way(self, other: Self) -> Way<S> {
        Way {
            across: other.position - self.position,
            out: other.r - self.r,
        }
    }
}

/// A way on the sky: along angles, in bin widths, and outwards.
#[derive(Clone, Copy, Debug)]
pub struct Way<S> {
    pub across: S,
    pub out: S,
}

impl<S: Scalar> Way<S> {
    /// As much of it as a particle at radius `r` is spread over: all of a short one, and smoothly less of a longer one.
    #[inline(always)]
    pub fn limited(self, r: S) -> Self {
        let across = self.across * (1.0 / REACH_BINS);
        let out = self.out / (r * REACH_RADII);
        let share = S::one() / (S::one() + across * across + out * out).sqrt();
        Self {
            across: self.across * share,
            out: self.out * share,
        }
    }
}
