//! The hot stage in SIMD lanes.

use super::lane_groups::{Group, Interleaved, Pair, Planner, StepSchedules, UNROLL};
use super::{Model, ProgenitorSolution};
use crate::error::{Rejection, Tally};
use crate::orbit::{FinalParticle, State, advance};
use crate::potential::{FlattenedNfw, Plummer};
use crate::scalar::{Isa, Kernel, LaneArray, Level, angle, compile_kernel};
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Present-day particles, component by component, in the order of the table.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Particles {
    /// Sky x, kpc.
    pub x: Vec<f64>,
    /// Sky y, kpc.
    pub y: Vec<f64>,
    /// Towards the observer, kpc.
    pub z: Vec<f64>,
    /// Velocity, kpc/Gyr, x, y and z.
    pub v: [Vec<f64>; 3],
    /// Winding counts.
    pub turns: Vec<f64>,
    /// How much further on each particle's partner is; 0 if they have none.
    pub neighbour_offset: usize,
    /// What was unsafe on the way.
    pub tally: Tally,
}

impl Particles {
    /// Number of particles.
    #[must_use]
    pub fn len(&self) -> usize {
        self.x.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.x.is_empty()
    }

    /// Angle of particle number `i` on the sky in radians, its turns counted.
    #[must_use]
    pub fn angle(&self, i: usize) -> f64 {
        angle(self.y[i], self.x[i]) + TAU * self.turns[i]
    }

    /// All columns at the length `n`, to be written.
    fn columns(&mut self, n: usize) -> Columns<'_> {
        let [vx, vy, vz] = &mut self.v;
        let columns = [
            &mut self.x,
            &mut self.y,
            &mut self.z,
            vx,
            vy,
            vz,
            &mut self.turns,
        ];
        Columns {
            first: 0,
            columns: columns.map(|column| {
                column.resize(n, 0.0);
                column.as_mut_slice()
            }),
        }
    }
}

/// A part of the columns of [`Particles`].
struct Columns<'a> {
    /// Number of its first particle.
    first: usize,
    /// x, y, z, the velocity and the turns.
    columns: [&'a mut [f64]; 7],
}

impl<'a> Columns<'a> {
    /// The parts before and from particle number `at`.
    fn split(self, at: usize) -> (Self, Self) {
        let first = self.first;
        let [x, y, z, vx, vy, vz, turns] = self.columns.map(|c| c.split_at_mut(at - first));
        let before = Self {
            first,
            columns: [x.0, y.0, z.0, vx.0, vy.0, vz.0, turns.0],
        };
        let after = Self {
            first: at,
            columns: [x.1, y.1, z.1, vx.1, vy.1, vz.1, turns.1],
        };
        (before, after)
    }

    /// Stores the lanes of a pair. Returns their unsafe turns, NaN if any state is not finite.
    #[inline(always)]
    fn store<I: Isa>(&mut self, pair: &Pair<'_>, particle: &FinalParticle<Interleaved<I>>) -> f64 {
        let State { x, v } = particle.state;
        // Zero for finite states, NaN otherwise.
        let lost = ((x.norm2() + v.norm2()) * 0.0).sum();
        let values = [
            x.x.store(),
            x.y.store(),
            x.z.store(),
            v.x.store(),
            v.y.store(),
            v.z.store(),
            particle.turns.store(),
        ];
        lost + self.copy(pair, &values, &particle.ambiguous_windings.store())
    }

    /// As [`store`](Self::store), of lanes in memory.
    #[inline(never)]
    fn copy(
        &mut self,
        pair: &Pair<'_>,
        values: &[LaneArray<UNROLL>; 7],
        ambiguous_windings: &LaneArray<UNROLL>,
    ) -> f64 {
        let mut sum = 0.0;
        for (k, len) in pair
            .lens
            .into_iter()
            .enumerate()
            .filter(|(_, len)| *len > 0)
        {
            sum += ambiguous_windings.0[k][..len].iter().sum::<f64>();
            let from = pair.groups[k].first - self.first;
            for (column, values) in self.columns.iter_mut().zip(values) {
                column[from..from + len].copy_from_slice(&values.0[k][..len]);
            }
        }
        sum
    }
}

struct IntegrateKernel<'a> {
    model: &'a Model,
    solution: &'a ProgenitorSolution<f64>,
    groups: &'a [Group],
    schedules: &'a mut StepSchedules,
    out: Columns<'a>,
}

impl Kernel for IntegrateKernel<'_> {
    type Output = f64;

    /// Carries every group; returns the number of unsafe turns, NaN if any state is not finite.
    #[inline(always)]
    fn run<I: Isa>(self) -> f64 {
        let Self {
            model,
            solution,
            groups,
            schedules,
            mut out,
        } = self;
        let host = FlattenedNfw::<Interleaved<I>>::broadcast(&solution.host);
        let progenitor = Plummer::<Interleaved<I>>::broadcast(&solution.progenitor);
        let mut planner = Planner::new(model, solution, schedules);
        let mut ambiguous_windings = 0.0;
        for pair in Pair::all(model, groups) {
            let release_frame = pair.release_frames::<I>(solution);
            let (start, turns) = release_frame.release(pair.position(), pair.velocity());
            let particle = advance(&host, &progenitor, &planner.schedules(&pair), start, turns);
            ambiguous_windings += out.store(&pair, &particle);
        }
        ambiguous_windings
    }
}

compile_kernel!(IntegrateKernel);

impl Model {
    /// Every particle today, in lanes, at the best level of this CPU. Buffers are reused: no allocation after the first
    /// call.
    ///
    /// # Errors
    /// [`Rejection::BadParticle`] if a state is not finite.
    pub fn integrate(
        &self,
        solution: &ProgenitorSolution<f64>,
        schedules: &mut StepSchedules,
        out: &mut Particles,
    ) -> Result<(), Rejection> {
        self.integrate_at(Level::best(), solution, schedules, out)
    }

    /// As [`integrate`](Self::integrate), at a chosen level: how the levels are tested against each other.
    ///
    /// # Errors
    /// As [`integrate`](Self::integrate).
    pub fn integrate_at(
        &self,
        level: Level,
        solution: &ProgenitorSolution<f64>,
        schedules: &mut StepSchedules,
        out: &mut Particles,
    ) -> Result<(), Rejection> {
        let forward = IntegrateKernel {
            model: self,
            solution,
            groups: &self.groups,
            schedules,
            out: out.columns(self.table.len()),
        };
        let ambiguous_windings = forward.dispatch(level);
        out.neighbour_offset = self.table.neighbour_offset;
        out.tally = tally(solution, ambiguous_windings)?;
        Ok(())
    }

    /// As [`integrate`](Self::integrate), over the threads of the present rayon pool and with buffers of its own. The same bits.
    ///
    /// # Errors
    /// As [`integrate`](Self::integrate).
    pub fn integrate_in_parallel(
        &self,
        solution: &ProgenitorSolution<f64>,
        out: &mut Particles,
    ) -> Result<(), Rejection> {
        // More parts than threads, as one may be late; whole pairs of groups, as those fly together.
        let parts = 4 * rayon::current_num_threads();
        let per_part = self.groups.len().div_ceil(parts).next_multiple_of(UNROLL);
        let mut left = out.columns(self.table.len());
        let mut work = Vec::with_capacity(parts);
        for groups in self.groups.chunks(per_part) {
            let end = groups.last().map_or(0, |group| group.first + group.len);
            let (part, rest) = left.split(end);
            work.push((groups, part));
            left = rest;
        }
        let ambiguous_windings: Vec<f64> = work
            .into_par_iter()
            .map(|(groups, out)| {
                let forward = IntegrateKernel {
                    model: self,
                    solution,
                    groups,
                    schedules: &mut StepSchedules::default(),
                    out,
                };
                forward.dispatch(Level::best())
            })
            .collect();
        out.neighbour_offset = self.table.neighbour_offset;
        out.tally = tally(solution, ambiguous_windings.iter().sum())?;
        Ok(())
    }
}

/// What was unsafe, with this many unsafe turns; NaN stands for a particle that is lost.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a count below particles times steps"
)]
fn tally(solution: &ProgenitorSolution<f64>, ambiguous_windings: f64) -> Result<Tally, Rejection> {
    if !ambiguous_windings.is_finite() {
        return Err(Rejection::BadParticle);
    }
    let mut tally = solution.tally;
    tally.ambiguous_windings += ambiguous_windings as u64;
    Ok(tally)
}
