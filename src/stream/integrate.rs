//! Integration of the particles from their release to today, in SIMD lanes.

use super::lane_groups::{Group, Interleaved, Pair, StepSchedules, UNROLL};
use super::model::Model;
use super::particles::{Columns, Particles};
use super::progenitor_solution::ProgenitorSolution;
use super::step_schedules::Planner;
use super::system::System;
use crate::error::{Error, Rejection, Result, Tally};
use crate::orbit::{FinalParticle, StepSchedule, advance};
use crate::potential::{FlattenedNfw, Plummer};
use crate::scalar::{Isa, Kernel, Level, Real, compile_kernel};
use rayon::prelude::*;

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
        for pair in Pair::all(&model.steps, groups) {
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
    /// The particles of a stream today, over the threads of the present rayon pool: of a [`System`], or of 13 parameters with the
    /// default range of q.
    ///
    /// # Errors
    /// [`Error::NoTrack`] with the cause if these parameters have no stream.
    pub fn stream(&self, system: impl Into<System<f64>>) -> Result<Particles> {
        let mut particles = Particles::default();
        self.progenitor_solution(&system.into())
            .and_then(|solution| self.integrate_in_parallel(&solution, &mut particles))
            .map_err(Error::NoTrack)?;
        Ok(particles)
    }

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
    ) -> std::result::Result<(), Rejection> {
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
    ) -> std::result::Result<(), Rejection> {
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
    ) -> std::result::Result<(), Rejection> {
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
fn tally(
    solution: &ProgenitorSolution<f64>,
    ambiguous_windings: f64,
) -> std::result::Result<Tally, Rejection> {
    if !ambiguous_windings.is_finite() {
        return Err(Rejection::BadParticle);
    }
    let mut tally = solution.tally;
    tally.ambiguous_windings += ambiguous_windings as u64;
    Ok(tally)
}

impl Model {
    /// Every particle today, one by one, in the order of the table, on any number type: the reference that the fast path
    /// is tested against.
    ///
    /// # Errors
    /// [`Rejection::BadParticle`] if a state is not finite.
    pub fn integrate_one_by_one<S: Real>(
        &self,
        solution: &ProgenitorSolution<S>,
    ) -> std::result::Result<Vec<FinalParticle<S>>, Rejection> {
        let mut particles = Vec::with_capacity(self.table.len());
        let mut schedule = StepSchedule::default();
        for (release_time, release_frame) in solution.release_frames.iter().enumerate() {
            self.plan(release_time, solution, &mut schedule);
            let first = release_time * self.table.per_release_time;
            for release in &self.table.releases[first..first + self.table.per_release_time] {
                let (start, turns) = release_frame.release(
                    release.offset.position.map(S::from_f64),
                    release.offset.velocity.map(S::from_f64),
                );
                let particle = advance(
                    &solution.host,
                    &solution.progenitor,
                    &schedule,
                    start,
                    turns,
                );
                if !(particle.state.x.norm2() + particle.state.v.norm2())
                    .re()
                    .is_finite()
                {
                    return Err(Rejection::BadParticle);
                }
                particles.push(particle);
            }
        }
        Ok(particles)
    }
}
