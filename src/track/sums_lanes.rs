//! Sums over the particles of each bin, in SIMD lanes and over threads.

use super::grid::{BinGrid, Placed};
use super::segment::{SegmentRun, SkyPoint};
use super::sums::Sums;
use crate::scalar::{Isa, Kernel, LANES, LaneArray, Lanes, Level, compile_kernel};
use crate::stream::Particles;
use rayon::prelude::*;

/// Number of particles that are binned together. Sums over all particles are sums of these sums, so the bits do not depend on the
/// number of threads.
const AT_A_TIME: usize = 1_024;

/// Largest number of bins of all sums that are made at once: 256 MB.
const MAX_BINS_AT_ONCE: usize = 1 << 22;

/// Sums over some particles, in memory that is used again: weight, r and r^2 of a bin beside each other, and two more bins at
/// each end for what lies outside. Neighbouring particles often fall in one bin, and the second addition would wait for the first: so
/// particles are added to two sets of bins in turn.
#[derive(Clone, Debug, Default)]
pub struct PartialSums {
    bins: Vec<[f64; 4]>,
    /// Positions, radii and their squares of the particles: each is used twice, for the particle and as a neighbour.
    points: [Vec<f64>; 3],
}

impl PartialSums {
    fn reset(&mut self, len: usize) {
        self.bins.clear();
        self.bins.resize(2 * (len + 4), [0.0; 4]);
    }

    /// Eight particles from number `first` on, or as many as there are.
    #[inline(always)]
    fn sky_point<I: Isa>(&self, first: usize) -> SkyPoint<Lanes<I, 1>> {
        let [position, r, r2] = &self.points;
        SkyPoint {
            position: Lanes::load(&eight(&position[first..])),
            r: Lanes::load(&eight(&r[first..])),
            r2: Lanes::load(&eight(&r2[first..])),
        }
    }

    /// Adds a weight at a quadrature point beside the lower edge of bin number `edge`, which is -1 to the number of bins plus 1; `turn`
    /// chooses the set of bins.
    #[inline(always)]
    fn add(&mut self, turn: usize, edge: f64, above: f64, r: f64, r2: f64, weight: f64) {
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "edges are between -1 and the number of bins and 1"
        )]
        let row = (edge + 1.0) as usize + (turn % 2) * (self.bins.len() / 2);
        let (above, sky_point) = (above * weight, [1.0, r, r2, 0.0]);
        let weights = [weight - above, above];
        for k in 0..2 {
            let bin = &mut self.bins[row + k];
            for c in 0..4 {
                bin[c] += weights[k] * sky_point[c];
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

impl BinGrid {
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
        // Some parts at a time, so that memory does not grow with the number of particles.
        let fitting = MAX_BINS_AT_ONCE / (self.len + 1);
        let count = (4 * rayon::current_num_threads()).min(fitting.max(1));
        let mut parts = vec![PartialSums::default(); count];
        let at_once = parts.len() * AT_A_TIME;
        for first in (0..particles.len()).step_by(at_once) {
            let firsts = (first..particles.len().min(first + at_once)).step_by(AT_A_TIME);
            let firsts: Vec<usize> = firsts.collect();
            let some = &mut parts[..firsts.len()];
            some.par_iter_mut().zip(firsts).for_each(|(part, first)| {
                self.sum_some(Level::best(), particles, first, part);
            });
            some.iter().for_each(|part| part.add_to(sums));
        }
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
}

/// Adds particles to sums: their bins are computed in lanes, and they are added one by one.
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
        let (both, weight) = (run.with_neighbours(), run.weight());
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
            let there = sums.sky_point(run.neighbour(first) - both.start);
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
