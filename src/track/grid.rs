//! The grid of angular bins, with hard or soft edges (docs/physics.md, section 6).
//!
//! Angles are counted from the progenitor and unwrapped; the leading tail is at positive angles. Bin b covers [b, b + 1) bin widths from the
//! lower edge of bin 0, which is at the progenitor unless the grid has an offset.

use super::smear::Sky;
use crate::error::Result;
use crate::scalar::{Scalar, angle, smooth_step};
use oblate_samplers::limits::in_range;
use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, TAU};
use std::ops::RangeInclusive;

/// Range of the width of a bin, degrees. Three bins of the largest width cover 360 degrees; a stream has no structure as narrow as the
/// smallest.
pub const BIN_WIDTHS_DEG: RangeInclusive<f64> = 0.1..=120.0;

/// Range of phi at the centre of a bin, degrees: twenty turns to each side. Observed streams have one or two.
pub const ANGLES_DEG: RangeInclusive<f64> = -7_200.0..=7_200.0;

/// Smallest half-width of a soft edge, degrees.
const MIN_EDGE_DEG: f64 = 1e-9;

/// How the weight of a particle near an edge is divided between the two bins (docs/physics.md, section 6).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BinEdges {
    /// A particle belongs to the bin that it is in, as in Chemaly et al. (2026): a track is discontinuous where a particle crosses an edge.
    Hard,
    /// The weights change by a smooth step with continuous second derivatives, and add up to 1.
    Soft {
        /// Half-width of each edge in degrees, at most half of a bin.
        half_width_deg: f64,
    },
}

impl Default for BinEdges {
    fn default() -> Self {
        Self::Soft {
            half_width_deg: 2.0,
        }
    }
}

impl BinEdges {
    /// Checks the half-width of soft edges in bins of `width_deg` degrees: 1e-9 degrees to half of a bin.
    ///
    /// # Errors
    /// [`Error::OutOfRange`](crate::Error::OutOfRange) under the name `key`.
    pub fn check(&self, key: &str, width_deg: f64) -> Result<()> {
        if let Self::Soft { half_width_deg } = *self {
            in_range(key, half_width_deg, MIN_EDGE_DEG..=0.5 * width_deg)?;
        }
        Ok(())
    }
}

/// Consecutive bins of equal width.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BinGrid {
    /// Width in degrees.
    pub width_deg: f64,
    /// Angle from the progenitor to the lower edge of bin 0, degrees.
    pub offset_deg: f64,
    /// Number of the first bin: it begins at `offset_deg + first * width_deg` from the progenitor.
    pub first: i64,
    /// Number of bins.
    pub len: usize,
    /// The edges of the bins.
    pub edges: BinEdges,
}

/// The edge nearest to a particle, and the particle's weight in the bin above it.
pub(super) struct NearestEdge<S> {
    /// The edge: number of the bin above it.
    pub edge: S,
    /// Weight in the bin above; the rest is in the bin below.
    pub above: S,
}

/// A particle on the sky: phi in bin widths from the lower edge of bin 0, and its direction and radius.
#[derive(Clone, Copy, Debug)]
pub(super) struct SkyPoint<S> {
    pub position: S,
    pub sky: Sky<S>,
}

/// Smallest radius on the sky, kpc, so that a particle in front of the centre has a direction.
const TINY_R: f64 = 1e-9;

impl BinGrid {
    /// Bin widths per radian.
    #[inline]
    pub(super) fn per_radian(&self) -> f64 {
        180.0 / (PI * self.width_deg)
    }

    /// Lower edge of bin 0 in bin widths.
    #[inline(always)]
    pub(super) fn offset(&self) -> f64 {
        self.offset_deg / self.width_deg
    }

    /// phi at the centre of a bin, degrees.
    #[must_use]
    pub fn centre_deg(&self, bin: i64) -> f64 {
        (bin as f64 + 0.5) * self.width_deg + self.offset_deg
    }

    /// Half-width of an edge in radians, 0 for hard edges.
    #[inline(always)]
    pub(super) fn soft(&self) -> f64 {
        match self.edges {
            BinEdges::Hard => 0.0,
            BinEdges::Soft { half_width_deg } => half_width_deg.to_radians(),
        }
    }

    /// The particle at (`x`, `y`) kpc on the sky with this winding number; `offset` is that of the grid, in bin widths.
    #[inline(always)]
    pub(super) fn sky_point<S: Scalar>(
        &self,
        x: S,
        y: S,
        winding_number: S,
        offset: S,
    ) -> SkyPoint<S> {
        let r = (x * x + y * y).sqrt().max(S::from_f64(TINY_R));
        SkyPoint {
            position: (angle(y, x) + winding_number * TAU) * self.per_radian() - offset,
            sky: Sky::new(x, y, r),
        }
    }

    /// The edge nearest to a position, and the number of edges to each side of it that a kernel of this half-width in radians can reach.
    #[inline(always)]
    pub(super) fn edges_within(&self, position: f64, half_width: f64) -> (f64, i32) {
        #[allow(
            clippy::cast_possible_truncation,
            reason = "a kernel reaches a few bins"
        )]
        let reach = (half_width * self.per_radian() + 0.5) as i32;
        (position.round_ties_even(), reach)
    }

    /// The edge nearest to a position in bin widths.
    #[inline(always)]
    pub(super) fn nearest_edge<S: Scalar>(&self, position: S) -> NearestEdge<S> {
        let edge = position.round_ties_even();
        let above = match self.edges {
            BinEdges::Hard => S::select(position.lt(edge), S::zero(), S::one()),
            BinEdges::Soft { half_width_deg } => {
                let half = half_width_deg / self.width_deg;
                smooth_step((position - edge + half) * (0.5 / half))
            }
        };
        NearestEdge { edge, above }
    }

    /// The index of a bin counted from the first, if it is in the grid.
    #[inline(always)]
    fn index(&self, bin: i64) -> Option<usize> {
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "between 0 and the number of bins"
        )]
        (bin >= 0 && bin < self.len.cast_signed() as i64).then_some(bin as usize)
    }

    /// Index of the bin below an edge and of that above it.
    #[inline(always)]
    pub(super) fn bins_beside(&self, edge: f64) -> [Option<usize>; 2] {
        #[allow(
            clippy::cast_possible_truncation,
            reason = "a finite angle is below 2^51 bins"
        )]
        let above = edge as i64 - self.first;
        [self.index(above - 1), self.index(above)]
    }
}
