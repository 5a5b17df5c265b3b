//! Angular bins with hard or soft edges, one interface (physics.md 6).
//!
//! Angles are the particles' own, unwrapped, counted from the progenitor; leading is positive. Bin b covers
//! [b, b + 1) widths. Particles stand for themselves, or, linked, are spread along the way to their partners.

use super::segment::{Segment, SegmentRun, SkyPoint};
use crate::orbit::FinalParticle;
use crate::scalar::{
    Dual, Isa, Kernel, LANES, LaneArray, Lanes, Level, Real, Scalar, angle, compile_kernel,
    gradient_of, smooth_step, variable,
};
use crate::stream::Particles;
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

/// Sums over some particles, in memory that is used again: weight, r and r^2 of a bin beside each other, and two more bins at
/// each end for what lies outside. Neighbouring particles are often of one bin, and the second would have to wait for the first: so
/// there are two sets of bins that take turns.
#[derive(Clone, Debug, Default)]
pub struct PartialSums {
    bins: Vec<[f64; 4]>,
    /// Positions, radii and their squares of the particles: each is needed twice, for itself and as a partner.
    points: [Vec<f64>; 3],
}

impl PartialSums {
    fn reset(&mut self, len: usize) {
        self.bins.clear();
        self.bins.resize(2 * (len + 4), [0.0; 4]);
    }

    /// Eight particles from one of those that are here, or as many as there are.
    #[inline(always)]
    fn sky_point<I: Isa>(&self, first: usize) -> SkyPoint<Lanes<I, 1>> {
        let [position, r, r2] = &self.points;
        SkyPoint {
            position: Lanes::load(&eight(&position[first..])),
            r: Lanes::load(&eight(&r[first..])),
            r2: Lanes::load(&eight(&r2[first..])),
        }
    }

    /// Adds a weight at a spot beside the edge under bin number `edge`, -1 to one more than there are; `turn` chooses the set.
    #[inline(always)]
    fn add(&mut self, turn: usize, edge: f64, above: f64, r: f64, r2: f64, weight: f64) {
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "edges are between -1 and the number of bins and 1"
        )]
        let row = (edge + 1.0) as usize + (turn % 2) * (self.bins.len() / 2);
        let (above, sky_point) = (above * weight, [1.0, r, r2, 0.0]);
        for (bin, share) in self.bins[row..row + 2]
            .iter_mut()
            .zip([weight - above, above])
        {
            for (sum, value) in bin.iter_mut().zip(sky_point) {
                *sum += share * value;
            }
        }
    }

    /// Adds these to the sums of all particles.
    fn add_to(&self, sums: &mut Sums<f64>) {
        let (even, odd) = self.bins.split_at(self.bins.len() / 2);
        let bins = even.iter().zip(odd).skip(2);
        let columns = sums.weight.iter_mut().zip(&mut sums.r).zip(&mut sums.r2);
        for ((even, odd), ((weight, r), r2)) in bins.zip(columns) {
            *weight += even[0] + odd[0];
            *r += even[1] + odd[1];
            *r2 += even[2] + odd[2];
        }
    }
}

impl<S: Scalar> Sums<S> {
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
    fn sky_point<S: Scalar>(&self, x: S, y: S, turns: S) -> SkyPoint<S> {
        let r2 = x * x + y * y;
        SkyPoint {
            position: (angle(y, x) + turns * TAU) * self.per_radian(),
            r: r2.sqrt(),
            r2,
        }
    }

    /// Where a particle at a position belongs.
    #[inline(always)]
    fn place<S: Scalar>(&self, position: S) -> Placed<S> {
        let edge = position.round_ties_even();
        let above = match self.edges {
            BinEdges::Hard => S::select(position.lt(edge), S::zero(), S::one()),
            BinEdges::Soft { half_width_deg } => {
                let half = half_width_deg / self.width_deg;
                smooth_step((position - edge + half) * (0.5 / half))
            }
        };
        Placed { edge, above }
    }

    /// Index of the bin above an edge: -1 or one more than there are bins where that is far outside.
    #[inline(always)]
    fn row<S: Scalar>(&self, edge: S) -> S {
        let (lo, hi) = (-S::one(), S::one() * (self.len as f64 + 1.0));
        let row = edge - self.first as f64;
        let row = S::select(row.lt(hi), row, hi);
        S::select(lo.lt(row), row, lo)
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

    /// Bins the particles of the reference path; each one's partner is `links` further on, 0 if there are none.
    pub fn sum_final_particles<S: Real>(
        &self,
        particles: &[FinalParticle<S>],
        neighbour_offset: usize,
        sums: &mut Sums<S>,
    ) {
        sums.reset(self.len);
        let sky_point = |i: usize| {
            let FinalParticle { state, turns, .. } = &particles[i];
            self.sky_point(state.x.x, state.x.y, *turns)
        };
        for run in SegmentRun::all(0..particles.len(), particles.len(), neighbour_offset) {
            for i in run.particles.clone() {
                let here = sky_point(i);
                let segment = here.segment(sky_point(run.partner(i))).limited(here.r);
                for k in 0..run.points {
                    let SkyPoint { position, r, r2 } = run.sky_point(here, segment, k);
                    let Placed { edge, above } = self.place(position);
                    self.add(edge.re(), above, [r, r2], run.weight(), sums);
                }
            }
        }
    }

    /// Bins the particles of the fast path, some thousand at a time; `part` is memory for that.
    pub fn sum(&self, particles: &Particles, sums: &mut Sums<f64>, part: &mut PartialSums) {
        self.sum_at(Level::best(), particles, sums, part);
    }

    /// As [`sum`](Self::sum), at a chosen level: how the levels are tested against each other.
    pub fn sum_at(
        &self,
        level: Level,
        particles: &Particles,
        sums: &mut Sums<f64>,
        part: &mut PartialSums,
    ) {
        sums.reset(self.len);
        for first in (0..particles.len()).step_by(AT_A_TIME) {
            self.sum_some(level, particles, first, part);
            part.add_to(sums);
        }
    }

    /// As [`sum`](Self::sum), over the threads of the present rayon pool. The same bits.
    pub fn sum_in_parallel(&self, particles: &Particles, sums: &mut Sums<f64>) {
        sums.reset(self.len);
        let firsts = (0..particles.len().div_ceil(AT_A_TIME)).into_par_iter();
        let parts: Vec<PartialSums> = firsts
            .map(|k| {
                let mut part = PartialSums::default();
                self.sum_some(Level::best(), particles, k * AT_A_TIME, &mut part);
                part
            })
            .collect();
        parts.iter().for_each(|part| part.add_to(sums));
    }

    /// Bins the [`AT_A_TIME`] particles from number `first` on, or as many as there are.
    fn sum_some(&self, level: Level, particles: &Particles, first: usize, sums: &mut PartialSums) {
        let len = particles.len();
        let some = first..len.min(first + AT_A_TIME);
        sums.reset(self.len);
        for run in SegmentRun::all(some, len, particles.neighbour_offset) {
            let grid = self;
            let binning = BinKernel {
                grid,
                particles,
                run,
                sums,
            };
            binning.dispatch(level);
        }
    }

    /// Reverse mode of [`sum`](Self::sum): turns derivatives with respect to the sums into derivatives with respect to
    /// the particles' sky positions.
    pub fn vjp(
        &self,
        particles: &Particles,
        by: &Sums<f64>,
        x_bar: &mut Vec<f64>,
        y_bar: &mut Vec<f64>,
    ) {
        let len = particles.len();
        let points: Vec<SkyPoint<f64>> = (0..len)
            .map(|i| self.sky_point(particles.x[i], particles.y[i], particles.turns[i]))
            .collect();
        // With respect to positions and radii first.
        let (position_bar, r_bar) = (&mut *x_bar, &mut *y_bar);
        for column in [&mut *position_bar, &mut *r_bar] {
            column.clear();
            column.resize(len, 0.0);
        }
        for run in SegmentRun::all(0..len, len, particles.neighbour_offset) {
            for i in run.particles.clone() {
                let (here, other) = (points[i], run.partner(i));
                let segment = here.segment(points[other]);
                let ours = Segment {
                    d_phi: variable::<3>(segment.d_phi, 0),
                    out: variable(segment.out, 1),
                }
                .limited(variable(here.r, 2));
                let along = Segment {
                    d_phi: ours.d_phi.re,
                    out: ours.out.re,
                };
                // What the spots say of the particle's own place, and of the way that they are on.
                let (mut point_bar, mut segment_bar) = ([0.0; 2], [0.0; 2]);
                for k in 0..run.points {
                    let quadrature_bar = self.point_vjp(run.sky_point(here, along, k), by);
                    for (d, by) in quadrature_bar.into_iter().enumerate() {
                        point_bar[d] += run.weight() * by;
                        segment_bar[d] += run.weight() * run.share(k) * by;
                    }
                }
                let through_way = ours.d_phi * segment_bar[0] + ours.out * segment_bar[1];
                let [d_phi_bar, d_r_bar, own_r_bar] = gradient_of(&through_way);
                position_bar[i] += point_bar[0] - d_phi_bar;
                r_bar[i] += point_bar[1] - d_r_bar + own_r_bar;
                position_bar[other] += d_phi_bar;
                r_bar[other] += d_r_bar;
            }
        }
        for (i, sky_point) in points.iter().enumerate() {
            let (angle_bar, r_bar) = (x_bar[i] * self.per_radian(), y_bar[i]);
            let (x, y, r) = (particles.x[i], particles.y[i], sky_point.r);
            x_bar[i] = r_bar * x / r - angle_bar * y / sky_point.r2;
            y_bar[i] = r_bar * y / r + angle_bar * x / sky_point.r2;
        }
    }

    /// Derivatives with respect to the position and the radius of a spot of weight one.
    fn point_vjp(&self, SkyPoint { position, r, r2 }: SkyPoint<f64>, by: &Sums<f64>) -> [f64; 2] {
        let Placed { edge, above } = self.place::<Dual<1>>(variable(position, 0));
        let [slope] = gradient_of(&above);
        let shares = [(1.0 - above.re, -slope), (above.re, slope)];
        let (mut position_bar, mut r_bar) = (0.0, 0.0);
        for (i, (weight, slope)) in self.beside(edge.re).into_iter().zip(shares) {
            if let Some(i) = i {
                r_bar += weight * (by.r[i] + 2.0 * r * by.r2[i]);
                position_bar += slope * (by.weight[i] + by.r[i] * r + by.r2[i] * r2);
            }
        }
        [position_bar, r_bar]
    }
}

/// Adds particles to sums: where they belong is found in lanes, and added one by one.
struct BinKernel<'a> {
    grid: &'a BinGrid,
    particles: &'a Particles,
    run: SegmentRun,
    sums: &'a mut PartialSums,
}

/// The next eight numbers of a column, or as many as there are.
#[inline(always)]
fn eight(column: &[f64]) -> LaneArray<1> {
    let mut eights = [0.0; LANES];
    match column.first_chunk() {
        Some(whole) => eights = *whole,
        None => eights[..column.len()].copy_from_slice(column),
    }
    LaneArray([eights])
}

impl Kernel for BinKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let Self {
            grid,
            particles,
            run,
            sums,
        } = self;
        let (both, weight) = (run.with_partners(), run.weight());
        for column in &mut sums.points {
            column.resize(both.len().next_multiple_of(LANES), 0.0);
        }
        for first in (0..both.len()).step_by(LANES) {
            let next = both.start + first..both.end;
            let x = Lanes::<I, 1>::load(&eight(&particles.x[next.clone()]));
            let y = Lanes::load(&eight(&particles.y[next.clone()]));
            let turns = Lanes::load(&eight(&particles.turns[next]));
            let SkyPoint { position, r, r2 } = grid.sky_point(x, y, turns);
            let numbers = [position.store(), r.store(), r2.store()];
            for (column, numbers) in sums.points.iter_mut().zip(numbers) {
                column[first..first + LANES].copy_from_slice(&numbers.0[0]);
            }
        }
        for first in run.particles.clone().step_by(LANES) {
            let n = LANES.min(run.particles.end - first);
            let here = sums.sky_point::<I>(first - both.start);
            let there = sums.sky_point(run.partner(first) - both.start);
            let segment = here.segment(there).limited(here.r);
            for k in 0..run.points {
                let SkyPoint { position, r, r2 } = run.sky_point(here, segment, k);
                let Placed { edge, above } = grid.place(position);
                let (edge, above) = (grid.row(edge).store().0[0], above.store().0[0]);
                let (r, r2) = (r.store().0[0], r2.store().0[0]);
                for i in 0..n {
                    sums.add(i, edge[i], above[i], r[i], r2[i], weight);
                }
            }
        }
    }
}

compile_kernel!(BinKernel);

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
    /// The track of particles, every bin with a weight of at least `min_n`.
    #[must_use]
    pub fn of(particles: &Particles, width_deg: f64, edges: BinEdges, min_n: f64) -> Self {
        let bin_of = |i: usize| {
            #[allow(
                clippy::cast_possible_truncation,
                reason = "a finite angle is below 2^51 bins"
            )]
            let bin = (particles.angle(i).to_degrees() / width_deg).floor() as i64;
            bin
        };
        let numbers = (0..particles.len()).map(bin_of);
        let (lo, hi) = numbers.fold((i64::MAX, i64::MIN), |(lo, hi), b| (lo.min(b), hi.max(b)));
        if lo > hi {
            return Self {
                width_deg,
                bins: Vec::new(),
            };
        }
        // More at each end: a particle is spread over two bins at most, and a soft edge shares it outwards.
        let first = lo - 3;
        let len = usize::try_from(hi - lo + 7).unwrap_or(0);
        let grid = BinGrid {
            width_deg,
            first,
            len,
            edges,
        };
        let mut sums = Sums::default();
        grid.sum(particles, &mut sums, &mut PartialSums::default());
        let bins = (0..len)
            .filter(|&i| sums.weight[i] > 0.0 && sums.weight[i] >= min_n)
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
