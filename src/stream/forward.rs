//! The particles of a stream today, on one thread or many.

use super::compiled::CompiledHalo;
use super::integrate::IntegrateKernel;
use super::lane_groups::StepSchedules;
use super::model::Model;
use super::particles::Particles;
use super::progenitor_solution::ProgenitorSolution;
use super::settings::StepRule;
use super::step_sizes::StepSizes;
use super::system::System;
use crate::error::{Error, Rejection, Result, Tally};
use crate::potential::Halo;
use crate::scalar::Level;
use rayon::prelude::*;
use std::ops::Range;

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
        let (columns, step_sizes) = out.columns(self.table.len());
        step_sizes.reset(self.pairs.len(), self.most_steps());
        let forward = IntegrateKernel {
            model: self,
            solution,
            pairs: &self.pairs,
            schedules,
            step_sizes,
            out: columns,
        };
        let ambiguous_windings = (H::kernels().integrate)(forward, level);
        out.neighbourhood = self.table.neighbourhood.clone();
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
        // More parts than threads, because some may take longer.
        let parts = 4 * rayon::current_num_threads();
        let per_part = self.pairs.len().div_ceil(parts);
        let (mut left, step_sizes) = out.columns(self.table.len());
        step_sizes.reset(self.pairs.len(), 0);
        let mut work = Vec::with_capacity(parts);
        for pairs in self.pairs.chunks(per_part) {
            let end = pairs.last().map_or(0, |pair| {
                let group = &self.groups[pair.end - 1];
                group.first + group.len
            });
            let (part, rest) = left.split(end);
            work.push((pairs, part));
            left = rest;
        }
        let parts: Vec<(f64, StepSizes)> = work
            .into_par_iter()
            .map(|(pairs, out)| {
                let mut step_sizes = StepSizes::default();
                let forward = IntegrateKernel {
                    model: self,
                    solution,
                    pairs,
                    schedules: &mut StepSchedules::default(),
                    step_sizes: &mut step_sizes,
                    out,
                };
                let ambiguous_windings = (H::kernels().integrate)(forward, Level::best());
                (ambiguous_windings, step_sizes)
            })
            .collect();
        let mut ambiguous_windings = 0.0;
        for (count, part) in &parts {
            ambiguous_windings += count;
            step_sizes.append(part);
        }
        out.neighbourhood = self.table.neighbourhood.clone();
        out.tally = tally(solution, ambiguous_windings)?;
        Ok(())
    }
}

impl Model {
    /// Number of adaptive steps of all pairs, if all are as short as possible; with equal steps, none are recorded.
    fn most_steps(&self) -> usize {
        match self.settings.step_rule {
            StepRule::Uniform => 0,
            StepRule::Adaptive => {
                let steps = |pair: &Range<usize>| self.steps[self.groups[pair.start].release_time];
                let shortest =
                    self.pairs.iter().map(steps).sum::<usize>() << self.settings.max_halvings;
                shortest + self.pairs.len()
            }
        }
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
