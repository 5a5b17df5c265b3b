//! Particles as samples of the stream around them: each as a point, or smeared along the segment to a neighbour in release space
//! (docs/physics.md, section 6).

use crate::scalar::Scalar;
use std::ops::Range;

/// Quadrature points of a segment. More of them make the likelihood hardly smoother, and each must be binned.
const POINTS: usize = 4;

/// Largest half-length of a segment in bin widths, and as a fraction of the radius: neighbours in release space may be far from each
/// other on the sky, and the stream between them is then no straight line.
const REACH_BINS: f64 = 1.5;
const REACH_RADII: f64 = 0.3;

/// A run of particles, each smeared into quadrature points of equal weight, whose sum is 1. The points are evenly spaced on the segment
/// to its neighbour and as far to the other side.
#[derive(Clone, Debug)]
pub struct SegmentRun {
    /// Their numbers.
    pub particles: Range<usize>,
    /// Index of each one's neighbour minus its own.
    to: isize,
    /// Number of quadrature points.
    pub points: usize,
}

impl SegmentRun {
    /// The runs of some of `len` particles. The neighbour of each is `neighbour_offset` after it, that of the last ones as much before
    /// them; with an offset of 0 particles have no neighbours and are points.
    #[inline]
    pub fn all(some: Range<usize>, len: usize, neighbour_offset: usize) -> [Self; 2] {
        let last = len.saturating_sub(neighbour_offset);
        let within = |from: usize, to: usize| some.start.max(from)..some.end.min(to);
        let points = if neighbour_offset == 0 { 1 } else { POINTS };
        let to = neighbour_offset.cast_signed();
        [(within(0, last), to), (within(last, len), -to)].map(|(particles, to)| Self {
            particles,
            to,
            points,
        })
    }

    /// The number of a particle's neighbour: its own, if it has none.
    #[inline(always)]
    pub fn neighbour(&self, i: usize) -> usize {
        i.wrapping_add_signed(self.to)
    }

    /// The numbers of the particles and of their neighbours, and of those between them.
    #[inline]
    pub fn with_neighbours(&self) -> Range<usize> {
        let Range { start, end } = self.particles;
        if self.particles.is_empty() {
            return start..start;
        }
        start.min(self.neighbour(start))..end.max(self.neighbour(end))
    }

    /// The weight of each quadrature point.
    #[inline(always)]
    pub fn weight(&self) -> f64 {
        1.0 / self.points as f64
    }

    /// Where quadrature point number `k` is on the segment: from -1 to 1, 0 at the particle.
    #[inline(always)]
    pub fn fraction(&self, k: usize) -> f64 {
        (2 * k + 1) as f64 * self.weight() - 1.0
    }

    /// Quadrature point number `k` of a particle that is smeared along a segment.
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
        let fraction = self.fraction(k);
        let r = here.r + segment.d_r * fraction;
        SkyPoint {
            position: here.position + segment.d_phi * fraction,
            r,
            r2: r * r,
        }
    }
}

/// A point on the sky: its angle in bin widths from the progenitor, its radius in kpc, and the square of the radius.
#[derive(Clone, Copy, Debug)]
pub struct SkyPoint<S> {
    pub position: S,
    pub r: S,
    pub r2: S,
}

impl<S: Scalar> SkyPoint<S> {
    /// The segment to another point.
    #[inline(always)]
    pub fn segment(self, other: Self) -> Segment<S> {
        Segment {
            d_phi: other.position - self.position,
            d_r: other.r - self.r,
        }
    }
}

/// A segment on the sky: differences of angle, in bin widths, and of radius, in kpc.
#[derive(Clone, Copy, Debug)]
pub struct Segment<S> {
    pub d_phi: S,
    pub d_r: S,
}

impl<S: Scalar> Segment<S> {
    /// The part of it that a particle at radius `r` is smeared over: all of a short segment, and smoothly less of a longer one.
    #[inline(always)]
    pub fn limited(self, r: S) -> Self {
        let d_phi = self.d_phi * (1.0 / REACH_BINS);
        let d_r = self.d_r / (r * REACH_RADII);
        let factor = S::one() / (S::one() + d_phi * d_phi + d_r * d_r).sqrt();
        Self {
            d_phi: self.d_phi * factor,
            d_r: self.d_r * factor,
        }
    }
}
