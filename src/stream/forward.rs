//! The particles of a stream today, on one thread or many.

use super::compiled::CompiledHalo;
use super::integrate::IntegrateKernel;
use super::lane_groups::{StepSchedules, UNROLL};
use super::model::Model;
use super::particles::Particles;
use super::progenitor_solution::ProgenitorSolution;
use super::system::System;
use crate::error::{Error, Rejection, Result, Tally};
use crate::potential::Halo;
use crate::scalar::Level;
use rayon::prelude::*;

impl Model {
    /// The particles of a stream today, over the threads of the present rayon pool: of a [`System`] with any kind of halo, or of 13
    /// parameters with the default range of q.
    ///
    /// # Errors
    /// [`Error::NoTrack`] with the cause if these parameters have no stream.
    pub fn stream<H: CompiledHalo>(&self, system: impl Into<System<f64, H>>) -> Result<Particles> {
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
    pub fn integrate<H: CompiledHalo>(
        &self,
        solution: &ProgenitorSolution<f64, H>,
        schedules: &mut StepSchedules,
        out: &mut Particles,
    ) -> std::result::Result<(), Rejection> {
        self.integrate_at(Level::best(), solution, schedules, out)
    }

    /// As [`integrate`](Self::integrate), at a chosen level: how the levels are tested against each other.
    ///
    /// # Errors
    /// As [`integrate`](Self::integrate).
    pub fn integrate_at<H: CompiledHalo>(
        &self,
        level: Level,
        solution: &ProgenitorSolution<f64, H>,
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
        let ambiguous_windings = (H::kernels().integrate)(forward, level);
        out.neighbour_offset = self.table.neighbour_offset;
        out.tally = tally(solution, ambiguous_windings)?;
        Ok(())
    }

    /// As [`integrate`](Self::integrate), over the threads of the present rayon pool and with buffers of its own. The same bits.
    ///
    /// # Errors
    /// As [`integrate`](Self::integrate).
    pub fn integrate_in_parallel<H: CompiledHalo>(
        &self,
        solution: &ProgenitorSolution<f64, H>,
        out: &mut Particles,
    ) -> std::result::Result<(), Rejection> {
        // More parts than threads, because some may take longer; whole pairs of groups, because those are integrated together.
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
                (H::kernels().integrate)(forward, Level::best())
            })
            .collect();
        out.neighbour_offset = self.table.neighbour_offset;
        out.tally = tally(solution, ambiguous_windings.iter().sum())?;
        Ok(())
    }
}

/// The approximations of a stream with this many ambiguous windings; NaN if a particle is not finite.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a count below particles times steps"
)]
fn tally<H: Halo>(
    solution: &ProgenitorSolution<f64, H>,
    ambiguous_windings: f64,
) -> std::result::Result<Tally, Rejection> {
    if !ambiguous_windings.is_finite() {
        return Err(Rejection::BadParticle);
    }
    let mut tally = solution.tally;
    tally.ambiguous_windings += ambiguous_windings as u64;
    Ok(tally)
}
