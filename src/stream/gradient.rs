//! The gradient of a function of the particles with respect to the system, in two stages (docs/physics.md, section 8).
//!
//! Reverse mode is cheap for one function of many numbers: one likelihood of all particles. Forward mode is cheap for many functions of
//! few numbers: the nodes of an orbit and the release frames, of the few numbers of a [`System`]. So the derivatives with respect to the
//! [`ProgenitorSolution`] are computed in reverse mode, and multiplied by the derivatives of the solution, which are computed on dual
//! numbers.

use super::compiled::CompiledHost;
use super::cotangents::WeightCotangents;
use super::integrate_vjp::{ObservedCotangents, ReleaseTimeChunk, VjpKernel};
use super::lane_groups::{StepSchedules, release_times_per_chunk};
use super::model::Model;
use super::particles::Particles;
use super::progenitor_solution::ProgenitorSolution;
use super::progenitor_solution_vjp::SolutionVjpKernel;
use super::system::{SYSTEM_LEN, System};
use super::threads::Threads;
use crate::potential::Host;
use crate::scalar::Level;
use rayon::prelude::*;

/// Whether the derivatives of chaotic particles count.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Adjoint {
    /// All count: the exact derivative of the discrete model.
    Exact,
    /// The derivative of a particle is zero if, integrated backwards from today, the derivative with respect to its position exceeds
    /// [`MAX_STRETCH`] times that with respect to its final position. A particle that passes a centre several times in steps too long for
    /// it is chaotic: its effect on the mean of a bin is small, but its derivative can exceed the sum of all others by ten orders of
    /// magnitude, and does not predict the effect of a finite step.
    Truncated,
}

/// Largest ratio of the two derivatives of a regular particle: tides stretch by tens within the age of a stream, eccentric orbits by
/// hundreds.
pub const MAX_STRETCH: f64 = 1_000.0;

/// Buffers of an integration and its gradient, reused from call to call.
#[derive(Clone, Debug, Default)]
pub struct Workspace {
    /// Step schedules of the integration.
    pub schedules: StepSchedules,
    /// The particles today.
    pub particles: Particles,
    /// Derivative of the result with respect to each particle's sky x, per kpc.
    pub x_bar: Vec<f64>,
    /// With respect to each particle's sky y, per kpc.
    pub y_bar: Vec<f64>,
    /// With respect to each particle's velocity along z, per kpc/Gyr; empty if the result does not depend on velocities.
    pub vz_bar: Vec<f64>,
    /// With respect to each particle's weight; empty if all are 1.
    pub weight_bar: Vec<f64>,
    /// With respect to the mean of the squares of the weights.
    pub mean_square_weight_bar: f64,
    weights_bar: WeightCotangents,
    chunks: Vec<ReleaseTimeChunk>,
}

impl Model {
    /// The gradient, with respect to the [vector](System::to_vector) of a system and per unit of each of its numbers, of a result whose
    /// derivatives with respect to the particles' sky positions, line-of-sight velocities and weights are `work.x_bar`, `work.y_bar`,
    /// `work.vz_bar`, `work.weight_bar` and `work.mean_square_weight_bar`. `solution` must be the one of this system, and `work.particles` the result of [`integrate`](Self::integrate) for it. The gradient has the same bits for any
    /// [`Threads`].
    pub fn vjp<H: CompiledHost>(
        &self,
        system: &System<f64, H>,
        solution: &ProgenitorSolution<f64, H>,
        adjoint: Adjoint,
        threads: Threads,
        work: &mut Workspace,
    ) -> [f64; SYSTEM_LEN] {
        self.prepare(solution, work);
        let Workspace {
            particles,
            x_bar,
            y_bar,
            vz_bar,
            weight_bar,
            mean_square_weight_bar,
            weights_bar,
            chunks,
            ..
        } = work;
        weights_bar.mean_square = *mean_square_weight_bar;
        weights_bar.of_release_times.clear();
        let of_release_time = |bars: &[f64]| bars.iter().sum::<f64>();
        (weights_bar.of_release_times)
            .extend((weight_bar.chunks(self.table.per_release_time)).map(of_release_time));
        let today = ObservedCotangents {
            particles,
            x_bar,
            y_bar,
            vz_bar,
        };
        let max_stretch2 = match adjoint {
            Adjoint::Exact => f64::INFINITY,
            Adjoint::Truncated => MAX_STRETCH * MAX_STRETCH,
        };
        let integrate_back = |chunk: &mut ReleaseTimeChunk| {
            let kernel = VjpKernel {
                model: self,
                solution,
                today: &today,
                max_stretch2,
                chunk,
            };
            (H::kernels().integrate_vjp)(kernel, Level::best());
        };
        match threads {
            Threads::One => chunks.iter_mut().for_each(integrate_back),
            Threads::All => chunks.par_iter_mut().for_each(integrate_back),
        }
        let [
            ReleaseTimeChunk {
                cotangents: solution_bar,
                ..
            },
            others @ ..,
        ] = chunks.as_mut_slice()
        else {
            return [0.0; SYSTEM_LEN];
        };
        for chunk in others {
            solution_bar.append(&mut chunk.cotangents);
        }
        let kernel = SolutionVjpKernel {
            model: self,
            system,
            times: solution.orbit.times(),
            solution_bar,
            weights_bar,
        };
        (H::kernels().progenitor_solution_vjp)(kernel, Level::best())
    }

    /// Divides the release times into chunks and sets their derivatives to zero.
    fn prepare<H: Host>(&self, solution: &ProgenitorSolution<f64, H>, work: &mut Workspace) {
        let release_times = self.table.taus.len();
        let per_chunk = release_times_per_chunk(release_times);
        let first_pair = |release_time: usize| {
            self.pairs
                .partition_point(|pair| self.lane_groups[pair.start].release_time < release_time)
        };
        work.chunks
            .resize_with(release_times.div_ceil(per_chunk), ReleaseTimeChunk::default);
        for (k, chunk) in work.chunks.iter_mut().enumerate() {
            let range = k * per_chunk..release_times.min((k + 1) * per_chunk);
            chunk.cotangents.reset(&range, solution.orbit.nodes.len());
            chunk.pairs = first_pair(range.start)..first_pair(range.end);
        }
    }
}
