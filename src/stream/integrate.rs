//! Integration of particles from their release to today: in SIMD lanes, and one by one on any number type.

use super::lane_groups::{Group, Interleaved, Pair, StepSchedules};
use super::model::Model;
use super::particles::Columns;
use super::progenitor_solution::ProgenitorSolution;
use super::step_schedules::Planner;
use crate::error::Rejection;
use crate::orbit::{FinalParticle, StepSchedule, advance};
use crate::potential::{Halo, Plummer};
use crate::scalar::{Isa, Kernel, Level, Real, compile_kernel};

/// The integration of some lane groups.
pub struct IntegrateKernel<'a, H: Halo> {
    pub(super) model: &'a Model,
    pub(super) solution: &'a ProgenitorSolution<f64, H>,
    pub(super) groups: &'a [Group],
    pub(super) schedules: &'a mut StepSchedules,
    pub(super) out: Columns<'a>,
}

impl<H: Halo> Kernel for IntegrateKernel<'_, H> {
    type Output = f64;

    /// Integrates every group. Returns the number of ambiguous windings, NaN if any state is not finite.
    #[inline(always)]
    fn run<I: Isa>(self) -> f64 {
        let Self {
            model,
            solution,
            groups,
            schedules,
            mut out,
        } = self;
        let host = H::broadcast::<Interleaved<I>>(&solution.host);
        let progenitor = Plummer::<Interleaved<I>>::broadcast(&solution.progenitor);
        let mut planner = Planner::new(model, solution, schedules);
        let mut ambiguous_windings = 0.0;
        for pair in Pair::all(&model.steps, groups) {
            let release_frame = pair.release_frames::<I, H>(solution);
            let (start, turns) = release_frame.release(pair.position(), pair.velocity());
            let particle = advance(&host, &progenitor, &planner.schedules(&pair), start, turns);
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
    /// is tested against.
    ///
    /// # Errors
    /// [`Rejection::BadParticle`] if a state is not finite.
    pub fn integrate_one_by_one<S: Real, H: Halo>(
        &self,
        solution: &ProgenitorSolution<S, H>,
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
