//! Integration of particles from their release to today: in SIMD lanes, and one by one on any number type.

use super::lane_groups::{Bundle, Interleaved, StepSchedules, UNROLL};
use super::model::Model;
use super::particles::Columns;
use super::progenitor_solution::ProgenitorSolution;
use super::settings::{ModelSettings, Precision, StepRule};
use super::step_schedules::{BundleSteps, Planner};
use super::step_sizes::StepSizes;
use crate::error::Rejection;
use crate::orbit::{FinalParticle, MAX_TOGETHER, StepSchedule, advance, advance_adaptively};
use crate::potential::{Host, Plummer};
use crate::scalar::{Isa, Kernel, Lanes, Level, Real, Vectors, compile_kernel};
use std::ops::Range;

/// The integration of some bundles of lane groups.
pub struct IntegrateKernel<'a, H: Host> {
    pub(super) model: &'a Model,
    pub(super) solution: &'a ProgenitorSolution<f64, H>,
    pub(super) bundles: &'a [Range<usize>],
    pub(super) schedules: &'a mut StepSchedules,
    pub(super) step_sizes: &'a mut StepSizes,
    pub(super) out: Columns<'a>,
}

impl<H: Host> Kernel for IntegrateKernel<'_, H> {
    type Output = f64;

    /// Integrates every bundle. Returns the number of ambiguous windings, NaN if any state is not finite.
    #[inline(always)]
    fn run<I: Isa>(self) -> f64 {
        let ModelSettings {
            precision,
            step_rule,
            ..
        } = self.model.settings;
        match (precision, step_rule) {
            (Precision::Double, StepRule::Uniform) => self.uniformly::<I, MAX_TOGETHER>(),
            (Precision::Single, StepRule::Uniform) => self.uniformly::<I::Singles, UNROLL>(),
            (Precision::Double, StepRule::Adaptive) => self.adaptively::<I, I>(),
            (Precision::Single, StepRule::Adaptive) => self.adaptively::<I, I::Singles>(),
        }
    }
}

impl<H: Host> IntegrateKernel<'_, H> {
    /// As [`run`](Self::run), by equal steps in `K` vectors of `V`.
    #[inline(always)]
    fn uniformly<V: Vectors, const K: usize>(self) -> f64 {
        let (model, solution, mut out) = (self.model, self.solution, self.out);
        let host = H::broadcast::<Lanes<V, K>>(&solution.host);
        let progenitor = Plummer::<Lanes<V, K>>::broadcast(&solution.progenitor);
        let mut planner = Planner::new(model, solution, self.schedules);
        let mut ambiguous_windings = 0.0;
        for range in self.bundles {
            let bundle = Bundle::new(&model.lane_groups, range);
            let release_frame = bundle.release_frames::<V, K, H>(solution);
            let (start, winding_number) =
                release_frame.release(bundle.position(), bundle.velocity());
            let schedules = planner.schedules::<V, K>(&bundle, &[]);
            let particle = advance(&host, &progenitor, &schedules, start, winding_number);
            ambiguous_windings += out.store(&bundle, &particle);
        }
        ambiguous_windings
    }

    /// As [`run`](Self::run), by adaptive steps in two vectors of `V`.
    #[inline(always)]
    fn adaptively<I: Isa, V: Vectors>(self) -> f64 {
        let (model, solution, mut out) = (self.model, self.solution, self.out);
        let host = H::broadcast::<Interleaved<V>>(&solution.host);
        let progenitor = Plummer::<Interleaved<V>>::broadcast(&solution.progenitor);
        let mut ambiguous_windings = 0.0;
        for range in self.bundles {
            let bundle = Bundle::new(&model.lane_groups, range);
            let release_frame = bundle.release_frames::<V, UNROLL, H>(solution);
            let (start, winding_number) =
                release_frame.release(bundle.position(), bundle.velocity());
            let mut steps = BundleSteps::<I, H>::new(model, solution, &bundle, self.step_sizes);
            let particle =
                advance_adaptively(&host, &progenitor, &mut steps, start, winding_number);
            self.step_sizes.finish(range.len().div_ceil(UNROLL));
            ambiguous_windings += out.store(&bundle, &particle);
        }
        ambiguous_windings
    }
}

compile_kernel!(IntegrateKernel<H: crate::potential::Host>);

/// Runs the kernel for an instruction set.
pub(super) fn integrate<H: Host>(kernel: IntegrateKernel<'_, H>, level: Level) -> f64 {
    kernel.dispatch(level)
}

impl Model {
    /// Every particle today, one by one, in the order of the table, on any number type: the reference for
    /// [`integrate`](Self::integrate), which has recorded the adaptive steps in `step_sizes`.
    ///
    /// # Errors
    /// [`Rejection::BadParticle`] if a state is not finite.
    pub fn integrate_one_by_one<S: Real, H: Host>(
        &self,
        solution: &ProgenitorSolution<S, H>,
        step_sizes: &StepSizes,
    ) -> std::result::Result<Vec<FinalParticle<S>>, Rejection> {
        let mut particles = Vec::with_capacity(self.table.len());
        let mut schedule = StepSchedule::default();
        for (pair, range) in self.pairs.iter().enumerate() {
            for lane_group in &self.lane_groups[range.clone()] {
                self.plan(
                    lane_group.release_time,
                    step_sizes.of_pair(pair),
                    solution,
                    &mut schedule,
                );
                let release_frame = &solution.releases.frames[lane_group.release_time];
                for release in
                    &self.table.releases[lane_group.first..lane_group.first + lane_group.len]
                {
                    let (start, winding_number) = release_frame.release(
                        release.offset.position.map(S::from_f64),
                        release.offset.velocity.map(S::from_f64),
                    );
                    let particle = advance(
                        &solution.host,
                        &solution.progenitor,
                        &schedule,
                        start,
                        winding_number,
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
        }
        Ok(particles)
    }
}
