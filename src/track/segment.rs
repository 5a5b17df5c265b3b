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
pub struct SegmentRun {
    /// Their numbers.
    pub particles: Range<usize>,
    /// How much further on each one's partner is.
    to: isize,
    /// Number of spots.
    pub points: usize,
}

impl SegmentRun {
    /// How some of `len` particles stand for the stream, if each one's partner is `links` further on, and that of the last ones as
    /// much before them, or if they have none, 0.
    pub fn all(some: Range<usize>, len: usize, neighbour_offset: usize) -> [Self; 2] {
        let last = len.saturating_sub(neighbour_offset);
        let within = |from: usize, to: usize| some.start.max(from)..some.end.min(to);
        let points = if neighbour_offset == 0 { 1 } else { SPOTS };
        let to = neighbour_offset.cast_signed();
        [(within(0, last), to), (within(last, len), -to)].map(|(particles, to)| Self {
            particles,
            to,
            points,
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
        1.0 / self.points as f64
    }

    /// How far spot number `k` is on the way: from -1 to 1.
    #[inline(always)]
    pub fn share(&self, k: usize) -> f64 {
        (2 * k + 1) as f64 * self.weight() - 1.0
    }

    /// Point number `k` of a particle here, spread along a way.
    #[inline(always)]
    pub fn sky_point<S: Scalar>(
        &self,
        here: SkyPoint<S>,
        segment: Segment<S>,
        k: usize,
    ) -> SkyPoint<S> {
        if self.points == 1 {
            return here;
        }
        let share = self.share(k);
        let r = here.r + segment.out * share;
        SkyPoint {
            position: here.position + segment.d_phi * share,
            r,
            r2: r * r,
        }
    }
}

/// A spot on the sky: its angle in bin widths from the progenitor, its radius, and the square of that.
#[derive(Clone, Copy, Debug)]
pub struct SkyPoint<S> {
    pub position: S,
    pub r: S,
    pub r2: S,
}

impl<S: Scalar> SkyPoint<S> {
    /// The way to another one.
    #[inline(always)]
    pub fn segment(self, other: Self) -> Segment<S> {
        Segment {
            d_phi: other.position - self.position,
            out: other.r - self.r,
        }
    }
}

/// A way on the sky: along angles, in bin widths, and outwards.
#[derive(Clone, Copy, Debug)]
pub struct Segment<S> {
    pub d_phi: S,
    pub out: S,
}

impl<S: Scalar> Segment<S> {
    /// As much of it as a particle at radius `r` is spread over: all of a short one, and smoothly less of a longer one.
    #[inline(always)]
    pub fn limited(self, r: S) -> Self {
        let d_phi = self.d_phi * (1.0 / REACH_BINS);
        let out = self.out / (r * REACH_RADII);
        let share = S::one() / (S::one() + d_phi * d_phi + out * out).sqrt();
        Self {
            d_phi: self.d_phi * share,
            out: self.out * share,
        }
    }
}
