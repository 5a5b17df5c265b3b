//! The step schedules of the release times (docs/physics.md, section 5).

use super::lane_groups::{Interleaved, LaneGroupPair, StepSchedules, UNROLL};
use super::model::Model;
use super::progenitor_solution::ProgenitorSolution;
use super::settings::StepRule;
use super::step_sizes::StepSizes;
use crate::orbit::{
    AdaptiveSteps, DRIFTS, HermiteWeights, InterleavedSchedules, KICKS, STAGES, StepSchedule,
    TIMES, length,
};
use crate::potential::Halo;
use crate::scalar::{Isa, Lanes, Real, Vec3};

impl Model {
    /// Hermite weights of the progenitor's position for the particles of one release time, if the steps are equal.
    #[inline(always)]
    fn uniform_hermite_weights(&self, release_time: usize) -> &[HermiteWeights] {
        let start = self.hermite_starts[release_time];
        &self.hermite_weights[start..=start + self.steps[release_time]]
    }

    /// Hermite weights of the progenitor's positions in a schedule that [`plan`](Self::plan) has written.
    #[inline(always)]
    pub(super) fn hermite_weights<'a>(
        &'a self,
        release_time: usize,
        schedule: &'a StepSchedule<f64>,
    ) -> &'a [HermiteWeights] {
        match self.settings.step_rule {
            StepRule::Uniform => self.uniform_hermite_weights(release_time),
            StepRule::Adaptive => &schedule.hermite_weights,
        }
    }

    /// Writes the step schedule of the particles of one release time, whose adaptive steps have these sizes. `step_sizes` is not used if the
    /// steps are equal.
    #[inline(always)]
    pub(super) fn plan<S: Real, H: Halo>(
        &self,
        release_time: usize,
        step_sizes: &[u8],
        solution: &ProgenitorSolution<S, H>,
        schedule: &mut StepSchedule<S>,
    ) {
        let (tau, steps) = (self.table.taus[release_time], self.steps[release_time]);
        let step = solution.age_gyr * (-tau / steps as f64);
        schedule.progenitor_positions.clear();
        schedule.drift_gyr.clear();
        if self.settings.step_rule == StepRule::Uniform {
            for weights in self.uniform_hermite_weights(release_time) {
                schedule
                    .progenitor_positions
                    .push(solution.orbit.position(weights));
            }
            schedule.drift_gyr.resize(steps, step);
            schedule.set_kicks();
            return;
        }
        schedule.hermite_weights.clear();
        schedule.kick_gyr.clear();
        let times = solution.orbit.times();
        let weights_at = |left: f64| HermiteWeights::at(tau * (left / steps as f64), times);
        let (mut left, mut kick_before) = (steps as f64, S::zero());
        schedule.hermite_weights.push(weights_at(left));
        for &number in step_sizes {
            let length = length(number, left);
            let h = step * length;
            schedule.kick_gyr.push(kick_before + h * KICKS[0]);
            for stage in 0..STAGES {
                schedule.drift_gyr.push(h * DRIFTS[stage]);
                if stage + 1 < STAGES {
                    schedule.kick_gyr.push(h * KICKS[stage + 1]);
                }
                schedule
                    .hermite_weights
                    .push(weights_at(left - TIMES[stage + 1] * length));
            }
            kick_before = h * KICKS[STAGES];
            left -= length;
        }
        schedule.kick_gyr.push(kick_before);
        for weights in &schedule.hermite_weights {
            schedule
                .progenitor_positions
                .push(solution.orbit.position(weights));
        }
    }
}

/// The adaptive steps of one pair of lane groups.
pub(super) struct PairSteps<'a, H: Halo> {
    solution: &'a ProgenitorSolution<f64, H>,
    step_sizes: &'a mut StepSizes,
    taus: [f64; UNROLL],
    steps: usize,
    max_phase: f64,
    max_halvings: u8,
}

impl<'a, H: Halo> PairSteps<'a, H> {
    #[inline(always)]
    pub fn new(
        model: &'a Model,
        solution: &'a ProgenitorSolution<f64, H>,
        pair: &LaneGroupPair<'_>,
        step_sizes: &'a mut StepSizes,
    ) -> Self {
        let [a, b] = pair.release_times();
        Self {
            solution,
            step_sizes,
            taus: [model.table.taus[a], model.table.taus[b]],
            steps: model.steps[a],
            max_phase: model.settings.step_phase,
            max_halvings: model.settings.max_halvings,
        }
    }

    /// The progenitor's positions for lane group `k` of the pair, at `N` times before today in its longest steps.
    #[inline(always)]
    fn positions<I: Isa, const N: usize>(&self, k: usize, left: [f64; N]) -> [[f64; 4]; N] {
        let mut taus = left;
        for j in 0..N {
            taus[j] = self.taus[k] * (left[j] / self.steps as f64);
        }
        self.solution.orbit.positions::<I, N>(taus)
    }

    /// The progenitor's positions at `N` times before today in the longest steps.
    #[inline(always)]
    fn progenitor<I: Isa, const N: usize>(&self, left: [f64; N]) -> [Vec3<Interleaved<I>>; N] {
        let [a, b] = self.taus;
        // The same release time: bits are compared, because floats must not be.
        let same = a.to_bits() == b.to_bits();
        let one = self.positions::<I, N>(0, left);
        let other = if same {
            one
        } else {
            self.positions::<I, N>(1, left)
        };
        let mut centres = [Vec3::zero(); N];
        for j in 0..N {
            let ([x, y, z, _], [x2, y2, z2, _]) = (one[j], other[j]);
            centres[j] = Lanes::interleave_vectors(Vec3::new(x, y, z), Vec3::new(x2, y2, z2));
        }
        centres
    }
}

impl<I: Isa, H: Halo> AdaptiveSteps<Interleaved<I>> for PairSteps<'_, H> {
    #[inline(always)]
    fn steps(&self) -> usize {
        self.steps
    }

    #[inline(always)]
    fn max_halvings(&self) -> u8 {
        self.max_halvings
    }

    #[inline(always)]
    fn max_phase(&self) -> f64 {
        self.max_phase
    }

    #[inline(always)]
    fn step_gyr(&self) -> Interleaved<I> {
        let (age, [a, b]) = (self.solution.age_gyr, self.taus);
        Lanes::interleave(
            age * (-a / self.steps as f64),
            age * (-b / self.steps as f64),
        )
    }

    #[inline(always)]
    fn progenitor_at(&self, left: f64) -> Vec3<Interleaved<I>> {
        let [centre] = self.progenitor::<I, 1>([left]);
        centre
    }

    #[inline(always)]
    fn progenitor_during(&self, left: f64, length: f64) -> [Vec3<Interleaved<I>>; STAGES] {
        let mut times = [left; STAGES];
        for stage in 0..STAGES {
            times[stage] = left - TIMES[stage + 1] * length;
        }
        self.progenitor::<I, STAGES>(times)
    }

    #[inline(always)]
    fn record(&mut self, number: u8) {
        self.step_sizes.push(number);
    }
}

/// Writes the step schedules of one pair after the other. Equal steps of the same release times are not written again.
pub(super) struct Planner<'a, H: Halo> {
    model: &'a Model,
    solution: &'a ProgenitorSolution<f64, H>,
    schedules: &'a mut StepSchedules,
    /// The release times whose schedules are in the buffers.
    planned: [usize; UNROLL],
}

impl<'a, H: Halo> Planner<'a, H> {
    /// `schedules` are buffers; their content is not used.
    #[inline]
    pub fn new(
        model: &'a Model,
        solution: &'a ProgenitorSolution<f64, H>,
        schedules: &'a mut StepSchedules,
    ) -> Self {
        Self {
            model,
            solution,
            schedules,
            planned: [usize::MAX; UNROLL],
        }
    }

    /// The step schedules of a pair whose adaptive steps have these sizes.
    #[inline(always)]
    pub fn schedules(
        &mut self,
        pair: &LaneGroupPair<'_>,
        step_sizes: &[u8],
    ) -> InterleavedSchedules<'_> {
        let [a, b] = pair.release_times();
        let [one, other] = &mut *self.schedules;
        let adaptive = self.model.settings.step_rule == StepRule::Adaptive;
        if adaptive || self.planned[0] != a {
            self.planned[0] = a;
            self.model.plan(a, step_sizes, self.solution, one);
        }
        if a == b {
            return InterleavedSchedules(one, one);
        }
        if adaptive || self.planned[1] != b {
            self.planned[1] = b;
            self.model.plan(b, step_sizes, self.solution, other);
        }
        InterleavedSchedules(one, other)
    }
}
