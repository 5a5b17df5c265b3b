//! Angular bins with hard or soft edges, one interface (physics.md 6).
//!
//! Angles are the particles' own, unwrapped, counted from the progenitor; leading is positive. Bin b covers
//! [b, b + 1) widths. Particles stand for themselves, or, on strands, for the lines to the next one and the last.

use super::stretch::{Spot, Stretch};
use crate::orbit::{Arrival, Kernel, Level, dispatch};
use crate::scalar::{
    Dual, Eights, Isa, LANES, Lanes, Real, Scalar, angle, gradient_of, smooth_step, variable,
};
use crate::stream::Arrivals;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, TAU};

/// How a particle near an edge is shared between the two bins.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BinEdges {
    /// Not at all: it belongs to the bin it is in (the paper). The track then jumps as particles cross edges.
    Hard,
    /// By a C2 smooth step of this half-width in degrees; the shares add up to 1. Below half a bin.
    Soft {
        /// Half-width of each edge in degrees.
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

/// A run of equally wide bins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BinGrid {
    /// Width in degrees.
    pub width_deg: f64,
    /// Number of the first bin: it begins at `first * width_deg` from the progenitor.
    pub first: i64,
    /// Number of bins.
    pub len: usize,
    /// Their edges.
    pub edges: BinEdges,
}

/// Sums over the particles of each bin: weight, weight times radius, weight times radius squared.
#[derive(Clone, Debug, PartialEq)]
pub struct Sums<S> {
    /// Total weight: the number of particles, with shared ones counted in parts.
    pub weight: Vec<S>,
    /// Sum of r, kpc.
    pub r: Vec<S>,
    /// Sum of r^2, kpc^2.
    pub r2: Vec<S>,
}

impl<S> Default for Sums<S> {
    fn default() -> Self {
        Self {
            weight: Vec::new(),
            r: Vec::new(),
            r2: Vec::new(),
        }
    }
}

/// Particles that are binned together: sums over all particles are sums of theirs, whoever makes them.
const AT_A_TIME: usize = 1_024;

impl<S: Scalar> Sums<S> {
    /// Adds the sums of others.
    fn add(&mut self, other: &Self) {
        for (sums, others) in [
            (&mut self.weight, &other.weight),
            (&mut self.r, &other.r),
            (&mut self.r2, &other.r2),
        ] {
            for (sum, other) in sums.iter_mut().zip(others) {
                *sum += *other;
            }
        }
    }

    /// Empty bins; reuses the buffers.
    pub fn reset(&mut self, len: usize) {
        for column in [&mut self.weight, &mut self.r, &mut self.r2] {
            column.clear();
            column.resize(len, S::zero());
        }
    }
}

/// A particle beside the edge that is nearest to it.
struct Placed<S> {
    /// The edge: number of the bin above it.
    edge: S,
    /// Its share of the bin above; the rest is of the bin below.
    above: S,
}

impl BinGrid {
    /// Bin widths per radian.
    fn per_radian(&self) -> f64 {
        180.0 / (PI * self.width_deg)
    }

    /// Where a particle is on the sky.
    #[inline(always)]
    fn spot<S: Scalar>(&self, x: S, y: S, turns: S) -> Spot<S> {
        let r2 = x * x + y * y;
        Spot {
            position: (angle(y, x) + turns * TAU) * self.per_radian(),
            r: r2.sqrt(),
            r2,
        }
    }

    /// Where a particle at a position belongs.
    #[inline(always)]
    fn place<S: Scalar>(&self, position: S) -> Placed<S> {
        let edge = position.nearest();
        let above = match self.edges {
            BinEdges::Hard => S::select(position.lt(edge), S::zero(), S::one()),
            BinEdges::Soft { half_width_deg } => {
                let half = half_width_deg / self.width_deg;
                smooth_step((position - edge + half) * (0.5 / half))
            }
        };
        Placed { edge, above }
    }

    /// Index of the bin below an edge and of that above it.
    #[inline(always)]
    fn beside(&self, edge: f64) -> [Option<usize>; 2] {
        #[allow(
            clippy::cast_possible_truncation,
            reason = "a finite angle is below 2^51 bins"
        )]
        let above = edge as i64 - self.first;
        [above - 1, above].map(|i| usize::try_from(i).ok().filter(|i| *i < self.len))
    }

    /// Adds a weight at a spot beside an edge.
    #[inline(always)]
    fn add<S: Scalar>(
        &self,
        edge: f64,
        above: S,
        [r, r2]: [S; 2],
        weight: f64,
        sums: &mut Sums<S>,
    ) {
        for (i, share) in self.beside(edge).into_iter().zip([S::one() - above, above]) {
            if let Some(i) = i {
                let weight = share * weight;
                sums.weight[i] += weight;
                sums.r[i] += weight * r;
                sums.r2[i] += weight * r2;
            }
        }
    }

    /// Bins the particles of the reference path; the next one of each one's strand is `strands` further on, 0 if there are none.
    pub fn sum_arrivals<S: Real>(
        &self,
        arrivals: &[Arrival<S>],
        strands: usize,
        sums: &mut Sums<S>,
    ) {
        sums.reset(self.len);
        let spot = |i: usize| {
            let Arrival { state, turns, .. } = &arrivals[i];
            self.spot(state.x.x, state.x.y, *turns)
        };
        for stretch in Stretch::all(0..arrivals.len(), arrivals.len(), strands) {
            for i in stretch.particles.clone() {
                let (here, there) = (spot(i), spot(i + stretch.to));
                for k in 0..stretch.spots {
                    let Spot { position, r, r2 } = stretch.spot(here, there, k);
                    let Placed { edge, above } = self.place(position);
                    self.add(edge.re(), above, [r, r2], stretch.weight, sums);
                }
            }
        }
    }

    /// Bins the particles of the fast path, some thousand at a time; `part` is memory for that.
    pub fn sum(&self, arrivals: &Arrivals, sums: &mut Sums<f64>, part: &mut Sums<f64>) {
        self.sum_at(Level::best(), arrivals, sums, part);
    }

    /// As [`sum`](Self::sum), at a chosen level: how the levels are tested against each other.
    pub fn sum_at(
        &self,
        level: Level,
        arrivals: &Arrivals,
        sums: &mut Sums<f64>,
        part: &mut Sums<f64>,
    ) {
        sums.reset(self.len);
        for first in (0..arrivals.len()).step_by(AT_A_TIME) {
            self.sum_some(level, arrivals, first, part);
            sums.add(part);
        }
    }

    /// As [`sum`](Self::sum), over the threads of the present rayon pool. The same bits.
    pub fn sum_in_parallel(&self, arrivals: &Arrivals, sums: &mut Sums<f64>) {
        sums.reset(self.len);
        let firsts = (0..arrivals.len().div_ceil(AT_A_TIME)).into_par_iter();
        let parts: Vec<Sums<f64>> = firsts
            .map(|k| {
                let mut part = Sums::default();
                self.sum_some(Level::best(), arrivals, k * AT_A_TIME, &mut part);
                part
            })
            .collect();
        parts.iter().for_each(|part| sums.add(part));
    }

    /// Bins the [`AT_A_TIME`] particles from number `first` on, or as many as there are.
    fn sum_some(&self, level: Level, arrivals: &Arrivals, first: usize, sums: &mut Sums<f64>) {
        let len = arrivals.len();
        let some = first..len.min(first + AT_A_TIME);
        sums.reset(self.len);
        for stretch in Stretch::all(some, len, arrivals.strands) {
            let grid = self;
            dispatch(
                level,
                Binning {
                    grid,
                    arrivals,
                    stretch,
                    sums,
                },
            );
        }
    }

    /// Reverse mode of [`sum`](Self::sum): turns derivatives with respect to the sums into derivatives with respect to
    /// the particles' sky positions.
    pub fn pull_back(
        &self,
        arrivals: &Arrivals,
        by: &Sums<f64>,
        by_x: &mut Vec<f64>,
        by_y: &mut Vec<f64>,
    ) {
        let len = arrivals.len();
        let spots: Vec<Spot<f64>> = (0..len)
            .map(|i| self.spot(arrivals.x[i], arrivals.y[i], arrivals.turns[i]))
            .collect();
        // With respect to positions and radii first.
        let (by_position, by_r) = (&mut *by_x, &mut *by_y);
        for column in [&mut *by_position, &mut *by_r] {
            column.clear();
            column.resize(len, 0.0);
        }
        for stretch in Stretch::all(0..len, len, arrivals.strands) {
            for i in stretch.particles.clone() {
                let other = i + stretch.to;
                for k in 0..stretch.spots {
                    let share = stretch.share(k);
                    let spot = stretch.spot(spots[i], spots[other], k);
                    let [by_its_position, by_its_r] = self.pull_back_spot(spot, by);
                    for (j, weight) in [(i, 1.0 - share), (other, share)] {
                        by_position[j] += weight * stretch.weight * by_its_position;
                        by_r[j] += weight * stretch.weight * by_its_r;
                    }
                }
            }
        }
        for (i, spot) in spots.iter().enumerate() {
            let (by_angle, by_r) = (by_x[i] * self.per_radian(), by_y[i]);
            let (x, y, r) = (arrivals.x[i], arrivals.y[i], spot.r);
            by_x[i] = by_r * x / r - by_angle * y / spot.r2;
            by_y[i] = by_r * y / r + by_angle * x / spot.r2;
        }
    }

    /// Derivatives with respect to the position and the radius of a spot of weight one.
    fn pull_back_spot(&self, Spot { position, r, r2 }: Spot<f64>, by: &Sums<f64>) -> [f64; 2] {
        let Placed { edge, above } = self.place::<Dual<1>>(variable(position, 0));
        let [slope] = gradient_of(&above);
        let shares = [(1.0 - above.re, -slope), (above.re, slope)];
        let (mut by_position, mut by_r) = (0.0, 0.0);
        for (i, (weight, slope)) in self.beside(edge.re).into_iter().zip(shares) {
            if let Some(i) = i {
                by_r += weight * (by.r[i] + 2.0 * r * by.r2[i]);
                by_position += slope * (by.weight[i] + by.r[i] * r + by.r2[i] * r2);
            }
        }
        [by_position, by_r]
    }
}

/// Adds particles to sums: where they belong is found in lanes, and added one by one.
struct Binning<'a> {
    grid: &'a BinGrid,
    arrivals: &'a Arrivals,
    stretch: Stretch,
    sums: &'a mut Sums<f64>,
}

/// The spots of `n` particles from number `first` on.
#[inline(always)]
fn spots<I: Isa>(grid: &BinGrid, arrivals: &Arrivals, first: usize, n: usize) -> Spot<Lanes<I, 1>> {
    let column = |column: &[f64]| {
        let mut eights = Eights([[0.0; LANES]]);
        eights.0[0][..n].copy_from_slice(&column[first..first + n]);
        eights
    };
    let (x, y, turns) = (
        column(&arrivals.x),
        column(&arrivals.y),
        column(&arrivals.turns),
    );
    grid.spot(Lanes::load(&x), Lanes::load(&y), Lanes::load(&turns))
}

impl Kernel for Binning<'_> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let Self {
            grid,
            arrivals,
            stretch,
            sums,
        } = self;
        for first in stretch.particles.clone().step_by(LANES) {
            let n = LANES.min(stretch.particles.end - first);
            let here = spots::<I>(grid, arrivals, first, n);
            let there = if stretch.to == 0 {
                here
            } else {
                spots(grid, arrivals, first + stretch.to, n)
            };
            for k in 0..stretch.spots {
                let Spot { position, r, r2 } = stretch.spot(here, there, k);
                let Placed { edge, above } = grid.place(position);
                let [edge, above, r, r2] = [edge, above, r, r2].map(|v| v.store().0[0]);
                for i in 0..n {
                    grid.add(edge[i], above[i], [r[i], r2[i]], stretch.weight, sums);
                }
            }
        }
    }
}

/// One bin of a track.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrackBin {
    /// Number of the bin: it covers [bin, bin + 1) widths.
    pub bin: i64,
    /// Middle of the bin, degrees from the progenitor.
    pub phi_deg: f64,
    /// Mean projected radius, kpc.
    pub r_kpc: f64,
    /// Standard error of the mean for independent particles, kpc.
    pub r_err_kpc: f64,
    /// Total weight.
    pub n: f64,
}

/// A whole track: the bins with particles in them, in order.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Track {
    /// Bin width in degrees.
    pub width_deg: f64,
    /// The bins.
    pub bins: Vec<TrackBin>,
}

impl Track {
    /// The track of particles, every bin with a weight of at least `least_n`.
    #[must_use]
    pub fn of(arrivals: &Arrivals, width_deg: f64, edges: BinEdges, least_n: f64) -> Self {
        let bin_of = |i: usize| {
            #[allow(
                clippy::cast_possible_truncation,
                reason = "a finite angle is below 2^51 bins"
            )]
            let bin = (arrivals.angle(i).to_degrees() / width_deg).floor() as i64;
            bin
        };
        let numbers = (0..arrivals.len()).map(bin_of);
        let (lo, hi) = numbers.fold((i64::MAX, i64::MIN), |(lo, hi), b| (lo.min(b), hi.max(b)));
        if lo > hi {
            return Self {
                width_deg,
                bins: Vec::new(),
            };
        }
        // One more at each end: a soft edge shares its particles outwards.
        let first = lo - 1;
        let len = usize::try_from(hi - lo + 3).unwrap_or(0);
        let grid = BinGrid {
            width_deg,
            first,
            len,
            edges,
        };
        let mut sums = Sums::default();
        grid.sum(arrivals, &mut sums, &mut Sums::default());
        let bins = (0..len)
            .filter(|&i| sums.weight[i] > 0.0 && sums.weight[i] >= least_n)
            .map(|i| {
                let n = sums.weight[i];
                let mean = sums.r[i] / n;
                let variance = (sums.r2[i] / n - mean * mean).max(0.0);
                #[allow(
                    clippy::cast_possible_wrap,
                    reason = "an index below the number of bins"
                )]
                let bin = first + i as i64;
                TrackBin {
                    bin,
                    phi_deg: (bin as f64 + 0.5) * width_deg,
                    r_kpc: mean,
                    r_err_kpc: (variance / n).sqrt(),
                    n,
                }
            })
            .collect();
        Self { width_deg, bins }
    }
}
