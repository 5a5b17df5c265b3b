//! The particles of a stream today, on one thread or many.

use super::compiled::CompiledHost;
use super::integrate::IntegrateKernel;
use super::lane_groups::StepSchedules;
use super::model::Model;
use super::particles::Particles;
use super::progenitor_solution::ProgenitorSolution;
use super::settings::StepRule;
use super::step_sizes::StepSizes;
use super::system::System;
use crate::error::{Error, Rejection, Result, Tally};
use crate::potential::Host;
use crate::scalar::Level;
use rayon::prelude::*;
use std::ops::Range;

impl Model {
    /// The particles of a stream today from a [`System`] with any kind of halo, on the threads of the present rayon pool.
    ///
    /// # Errors
    /// [`Error::NoTrack`] with the cause if there is no stream.
    pub fn stream_of<H: CompiledHost>(&self, system: &System<f64, H>) -> Result<Particles> {
        let mut particles = Particles::default();
        self.progenitor_solution(system)
            .and_then(|solution| self.integrate_in_parallel(&solution, &mut particles))
            .map_err(Error::NoTrack)?;
        Ok(particles)
    }

    /// Integrates every particle to today, in lanes, for the best instruction set of this CPU. The buffers of `schedules` and `out` are
    /// reused: no allocation after the first call.
    ///
    /// # Errors
    /// [`Rejection::BadParticle`] if a state is not finite.
    pub fn integrate<H: CompiledHost>(
        &self,
        solution: &ProgenitorSolution<f64, H>,
        schedules: &mut StepSchedules,
        out: &mut Particles,
    ) -> std::result::Result<(), Rejection> {
        self.integrate_at(Level::best(), solution, schedules, out)
    }

    /// As [`integrate`](Self::integrate), for a chosen instruction set, so that tests can compare them.
    ///
    /// # Errors
    /// As [`integrate`](Self::integrate).
    pub fn integrate_at<H: CompiledHost>(
        &self,
        level: Level,
        solution: &ProgenitorSolution<f64, H>,
        schedules: &mut StepSchedules,
        out: &mut Particles,
    ) -> std::result::Result<(), Rejection> {
        let (columns, step_sizes) = out.columns(self.table.len());
        step_sizes.reset(self.pairs.len(), self.max_steps());
        let forward = IntegrateKernel {
            model: self,
            solution,
            bundles: &self.bundles,
            schedules,
            step_sizes,
            out: columns,
        };
        let ambiguous_windings = (H::kernels().integrate)(forward, level);
        out.neighbourhood = self.table.neighbourhood.clone();
        out.set_weights(&solution.releases, self.table.per_release_time);
        out.tally = tally(solution, ambiguous_windings)?;
        Ok(())
    }

    /// As [`integrate`](Self::integrate), on the threads of the present rayon pool and with new buffers. The result has the same bits.
    ///
    /// # Errors
    /// As [`integrate`](Self::integrate).
    pub fn integrate_in_parallel<H: CompiledHost>(
        &self,
        solution: &ProgenitorSolution<f64, H>,
        out: &mut Particles,
    ) -> std::result::Result<(), Rejection> {
        // More chunks than threads, because some take longer.
        let count = 4 * rayon::current_num_threads();
        let per_chunk = self.bundles.len().div_ceil(count);
        let (mut left, step_sizes) = out.columns(self.table.len());
        step_sizes.reset(self.pairs.len(), 0);
        let mut chunks = Vec::with_capacity(count);
        for bundles in self.bundles.chunks(per_chunk) {
            let end = bundles.last().map_or(0, |bundle| {
                let last = &self.lane_groups[bundle.end - 1];
                last.first + last.len
            });
            let (columns, rest) = left.split(end);
            chunks.push((bundles, columns));
            left = rest;
        }
        let integrated: Vec<(f64, StepSizes)> = chunks
            .into_par_iter()
            .map(|(bundles, out)| {
                let mut step_sizes = StepSizes::default();
                let forward = IntegrateKernel {
                    model: self,
                    solution,
                    bundles,
                    schedules: &mut StepSchedules::default(),
                    step_sizes: &mut step_sizes,
                    out,
                };
                let ambiguous_windings = (H::kernels().integrate)(forward, Level::best());
                (ambiguous_windings, step_sizes)
            })
            .collect();
        let mut ambiguous_windings = 0.0;
        for (count, of_chunk) in &integrated {
            ambiguous_windings += count;
            step_sizes.append(of_chunk);
        }
        out.neighbourhood = self.table.neighbourhood.clone();
        out.set_weights(&solution.releases, self.table.per_release_time);
        out.tally = tally(solution, ambiguous_windings)?;
        Ok(())
    }
}

impl Model {
    /// Largest number of adaptive steps that can be recorded for all bundles; 0 if the steps are equal.
    fn max_steps(&self) -> usize {
        match self.settings.step_rule {
            StepRule::Uniform => 0,
            StepRule::Adaptive => {
                let steps =
                    |bundle: &Range<usize>| self.steps[self.lane_groups[bundle.start].release_time];
                let shortest =
                    self.bundles.iter().map(steps).sum::<usize>() << self.settings.max_halvings;
                shortest + self.bundles.len()
            }
        }
    }
}

/// The approximations of a stream with this number of ambiguous windings, which is NaN if a particle is not finite.
///
/// # Errors
/// [`Rejection::BadParticle`] if the number is not finite.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a count below particles times steps"
)]
fn tally<H: Host>(
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
