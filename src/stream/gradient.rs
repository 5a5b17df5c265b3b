//! The gradient of a function of the particles with respect to the system, in two stages.
//!
//! Reverse mode is cheap where many numbers give one: all particles, one likelihood. Forward mode is cheap where few numbers give many:
//! the 15 numbers of a [`System`], the nodes of an orbit and the release frames. So derivatives go backwards through the particles to
//! the [`ProgenitorSolution`], and are there multiplied by the derivatives of the solution, which are computed on dual numbers.

use super::compiled::CompiledHalo;
use super::integrate_vjp::{Ends, Part, VjpKernel};
use super::lane_groups::{StepSchedules, release_times_per_part};
use super::model::Model;
use super::particles::Particles;
use super::progenitor_solution::ProgenitorSolution;
use super::progenitor_solution_vjp::SolutionVjpKernel;
use super::system::{SYSTEM_LEN, System};
use super::threads::Threads;
use crate::potential::Halo;
use crate::scalar::Level;
use rayon::prelude::*;

/// How far back along a particle's trajectory a derivative is taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Adjoint {
    /// To the release: the exact derivative of the discrete model.
    Exact,
    /// Back to the time before which a change of the particle's position changes its final position by more than [`MAX_STRETCH`]
    /// times as much. A particle that passes a centre several times in steps too long for it is chaotic: its effect on the mean
    /// of a bin is small, but its derivative can exceed the sum of all others by ten orders of magnitude, and does not predict
    /// the effect of any finite step. Without it, the derivatives are a field that a sampler can follow.
    Truncated,
}

/// Largest stretch of a regular particle: tides stretch by tens within the age of a stream, eccentric orbits by hundreds.
pub const MAX_STRETCH: f64 = 1_000.0;

/// Buffers, reused from call to call.
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
    parts: Vec<Part>,
}

impl Model {
    /// The gradient, with respect to the [vector](System::to_vector) of a system, of a result whose derivatives with respect to the
    /// particles' sky positions are `work.x_bar` and `work.y_bar`. `solution` must be the one of this system, and `work.particles` what
    /// [`integrate`](Self::integrate) made of it. The same bits for any [`Threads`].
    pub fn vjp<H: CompiledHalo>(
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
            parts,
            ..
        } = work;
        let ends = Ends {
            particles,
            x_bar,
            y_bar,
        };
        let max_stretch2 = match adjoint {
            Adjoint::Exact => f64::INFINITY,
            Adjoint::Truncated => MAX_STRETCH * MAX_STRETCH,
        };
        let one = |part: &mut Part| {
            let kernel = VjpKernel {
                model: self,
                solution,
                ends: &ends,
                max_stretch2,
                part,
            };
            (H::kernels().integrate_vjp)(kernel, Level::best());
        };
        match threads {
            Threads::One => parts.iter_mut().for_each(one),
            Threads::All => parts.par_iter_mut().for_each(one),
        }
        let [
            Part {
                cotangents: total, ..
            },
            others @ ..,
        ] = parts.as_mut_slice()
        else {
            return [0.0; SYSTEM_LEN];
        };
        for part in others {
            total.append(&mut part.cotangents);
        }
        let kernel = SolutionVjpKernel {
            model: self,
            system,
            total,
        };
        (H::kernels().progenitor_solution_vjp)(kernel, Level::best())
    }

    /// Divides the release times into parts, whose derivatives are zero.
    fn prepare<H: Halo>(&self, solution: &ProgenitorSolution<f64, H>, work: &mut Workspace) {
        let release_times = self.table.taus.len();
        let per_part = release_times_per_part(release_times);
        let first_pair = |release_time: usize| {
            self.pairs
                .partition_point(|pair| self.groups[pair.start].release_time < release_time)
        };
        work.parts
            .resize_with(release_times.div_ceil(per_part), Part::default);
        for (k, part) in work.parts.iter_mut().enumerate() {
            let range = k * per_part..release_times.min((k + 1) * per_part);
            part.cotangents.reset(&range, solution.orbit.nodes.len());
            part.pairs = first_pair(range.start)..first_pair(range.end);
        }
    }
}
