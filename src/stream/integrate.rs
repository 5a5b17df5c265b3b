//! Integration of particles from their release to today: in SIMD lanes, and one by one on any number type.

use super::lane_groups::{Interleaved, Pair, StepSchedules};
use super::model::Model;
use super::particles::Columns;
use super::progenitor_solution::ProgenitorSolution;
use super::settings::StepRule;
use super::step_schedules::{PairSteps, Planner};
use super::step_sizes::StepSizes;
use crate::error::Rejection;
use crate::orbit::{FinalParticle, StepSchedule, advance, advance_adaptively};
use crate::potential::{Halo, Plummer};
use crate::scalar::{Isa, Kernel, Level, Real, compile_kernel};
use std::ops::Range;

/// The integration of some pairs of lane groups.
pub struct IntegrateKernel<'a, H: Halo> {
    pub(super) model: &'a Model,
    pub(super) solution: &'a ProgenitorSolution<f64, H>,
    pub(super) pairs: &'a [Range<usize>],
    pub(super) schedules: &'a mut StepSchedules,
    pub(super) step_sizes: &'a mut StepSizes,
    pub(super) out: Columns<'a>,
}

impl<H: Halo> Kernel for IntegrateKernel<'_, H> {
    type Output = f64;

    /// Integrates every pair. Returns the number of ambiguous windings, NaN if any state is not finite.
    #[inline(always)]
    fn run<I: Isa>(self) -> f64 {
        let Self {
            model,
            solution,
            pairs,
            schedules,
            step_sizes,
            mut out,
        } = self;
        let host = H::broadcast::<Interleaved<I>>(&solution.host);
        let progenitor = Plummer::<Interleaved<I>>::broadcast(&solution.progenitor);
        let mut planner = Planner::new(model, solution, schedules);
        let mut ambiguous_windings = 0.0;
        for range in pairs {
            let pair = Pair::of(&model.groups, range);
            let release_frame = pair.release_frames::<I, H>(solution);
            let (start, turns) = release_frame.release(pair.position(), pair.velocity());
            let particle = match model.settings.step_rule {
                StepRule::Uniform => advance(
                    &host,
                    &progenitor,
                    &planner.schedules(&pair, &[]),
                    start,
                    turns,
                ),
                StepRule::Adaptive => {
                    step_sizes.begin();
                    let mut steps = PairSteps::new(model, solution, &pair, step_sizes);
                    advance_adaptively(&host, &progenitor, &mut steps, start, turns)
                }
            };
            ambiguous_windings += out.store(&pair, &particle);
        }
        ambiguous_windings
    }
}

compile_kernel!(IntegrateKernel<H: crate::potential::Halo>);

/// Runs the kernel at a level.
pub(super) fn integrate<H: Halo>(kernel: IntegrateKernel<'_, H>, level: Level) -> f64 {
    kernel.dispatch(level)
}

impl Model {
    /// Every particle today, one by one, in the order of the table, on any number type: the reference that the fast path
    /// is tested against. Adaptive steps are those of `step_sizes`, which the fast path has recorded.
    ///
    /// # Errors
    /// [`Rejection::BadParticle`] if a state is not finite.
    pub fn integrate_one_by_one<S: Real, H: Halo>(
        &self,
        solution: &ProgenitorSolution<S, H>,
        step_sizes: &StepSizes,
    ) -> std::result::Result<Vec<FinalParticle<S>>, Rejection> {
        let mut particles = Vec::with_capacity(self.table.len());
        let mut schedule = StepSchedule::default();
        for (number, range) in self.pairs.iter().enumerate() {
            for group in &self.groups[range.clone()] {
                self.plan(
                    group.release_time,
                    step_sizes.of(number),
                    solution,
                    &mut schedule,
                );
                let release_frame = &solution.release_frames[group.release_time];
                for release in &self.table.releases[group.first..group.first + group.len] {
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
        }
        Ok(particles)
    }
}
