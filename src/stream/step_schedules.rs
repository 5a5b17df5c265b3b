//! The step schedules of the release times (docs/physics.md, section 5).

use super::lane_groups::{Bundle, Interleaved, StepSchedules};
use super::model::Model;
use super::progenitor_solution::ProgenitorSolution;
use super::settings::StepRule;
use super::step_sizes::StepSizes;
use crate::orbit::{
    AdaptiveSteps, DRIFTS, HermiteWeights, InterleavedSchedules, KICKS, MAX_TOGETHER, STAGES,
    StepMethod, StepSchedule, TIMES, length,
};
use crate::potential::Host;
use crate::scalar::{Isa, Lanes, Real, Scalar, Vec3, Vectors};
use std::marker::PhantomData;

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
    pub(super) fn plan<S: Real, H: Host>(
        &self,
        release_time: usize,
        step_sizes: &[u8],
        solution: &ProgenitorSolution<S, H>,
        schedule: &mut StepSchedule<S>,
    ) {
        let (tau, steps) = (self.table.taus[release_time], self.steps[release_time]);
        let step = solution.age_gyr * (-tau / steps as f64);
        schedule.progenitor_positions.clear();
        schedule.mass_fractions.clear();
        schedule.drift_gyr.clear();
        if self.settings.step_rule == StepRule::Uniform {
            schedule.method = StepMethod::Leapfrog;
            for weights in self.uniform_hermite_weights(release_time) {
                schedule
                    .progenitor_positions
                    .push(solution.orbit.position(weights));
            }
            schedule.drift_gyr.resize(steps, step);
            schedule.set_kicks();
            if solution.mass_loss.law.is_some() {
                for j in 0..=steps {
                    let tau = tau * ((steps - j) as f64 / steps as f64);
                    schedule.mass_fractions.push(solution.mass_fraction(tau));
                }
            }
            return;
        }
        schedule.method = StepMethod::FourthOrder;
        schedule.hermite_weights.clear();
        schedule.kick_gyr.clear();
        let times = solution.orbit.times();
        let tau_at = |left: f64| tau * (left / steps as f64);
        let weights_at = |left: f64| HermiteWeights::at(tau_at(left), times);
        let (mut left, mut kick_before) = (steps as f64, S::zero());
        schedule.hermite_weights.push(weights_at(left));
        let loses_mass = solution.mass_loss.law.is_some();
        if loses_mass {
            let fraction = solution.mass_fraction(tau_at(left));
            schedule.mass_fractions.push(fraction);
        }
        for &number in step_sizes {
            let length = length(number, left);
            let h = step * length;
            schedule.kick_gyr.push(kick_before + h * KICKS[0]);
            for stage in 0..STAGES {
                schedule.drift_gyr.push(h * DRIFTS[stage]);
                if stage + 1 < STAGES {
                    schedule.kick_gyr.push(h * KICKS[stage + 1]);
                }
                let left = left - TIMES[stage + 1] * length;
                schedule.hermite_weights.push(weights_at(left));
                if loses_mass {
                    let fraction = solution.mass_fraction(tau_at(left));
                    schedule.mass_fractions.push(fraction);
                }
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

/// The adaptive steps of one bundle of lane groups.
pub(super) struct BundleSteps<'a, I: Isa, H: Host> {
    solution: &'a ProgenitorSolution<f64, H>,
    step_sizes: &'a mut StepSizes,
    taus: [f64; MAX_TOGETHER],
    /// Whether each lane group has the release time of the one before it.
    repeated: [bool; MAX_TOGETHER],
    /// Whether all have the same.
    alike: bool,
    steps: usize,
    max_phase: f64,
    max_halvings: u8,
    isa: PhantomData<I>,
}

impl<'a, I: Isa, H: Host> BundleSteps<'a, I, H> {
    #[inline(always)]
    pub fn new(
        model: &'a Model,
        solution: &'a ProgenitorSolution<f64, H>,
        bundle: &Bundle<'_>,
        step_sizes: &'a mut StepSizes,
    ) -> Self {
        let [a, b, c, d] = bundle.release_times();
        let taus = &model.table.taus;
        Self {
            solution,
            step_sizes,
            taus: [taus[a], taus[b], taus[c], taus[d]],
            repeated: [false, b == a, c == b, d == c],
            alike: b == a && c == a && d == a,
            steps: model.steps[a],
            max_phase: model.settings.step_phase,
            max_halvings: model.settings.max_halvings,
            isa: PhantomData,
        }
    }

    /// The progenitor's positions for lane group `k` of the bundle, at `N` times before today in its longest steps.
    #[inline(always)]
    fn positions<const N: usize>(&self, k: usize, left: [f64; N]) -> [[f64; 4]; N] {
        let mut taus = left;
        for j in 0..N {
            taus[j] = self.taus[k] * (left[j] / self.steps as f64);
        }
        self.solution.orbit.positions::<I, N>(taus)
    }

    /// The progenitor's positions at `N` times before today in the longest steps, in lanes of `V`.
    #[inline(always)]
    fn progenitor<V: Vectors, const N: usize>(&self, left: [f64; N]) -> [Vec3<Interleaved<V>>; N] {
        let first = self.positions(0, left);
        let mut centres = [Vec3::zero(); N];
        if self.alike {
            for j in 0..N {
                let [x, y, z, _] = first[j];
                centres[j] = Vec3::from_f64(Vec3::new(x, y, z));
            }
            return centres;
        }
        let mut positions = [first; MAX_TOGETHER];
        for k in 1..Interleaved::<V>::GROUPS {
            positions[k] = if self.repeated[k] {
                positions[k - 1]
            } else {
                self.positions(k, left)
            };
        }
        for j in 0..N {
            let mut of_groups = [Vec3::zero(); MAX_TOGETHER];
            for k in 0..Interleaved::<V>::GROUPS {
                let [x, y, z, _] = positions[k][j];
                of_groups[k] = Vec3::new(x, y, z);
            }
            centres[j] = Lanes::splat_vectors(&of_groups);
        }
        centres
    }
}

impl<I: Isa, V: Vectors, H: Host> AdaptiveSteps<Interleaved<V>> for BundleSteps<'_, I, H> {
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
    fn step_gyr(&self) -> Interleaved<V> {
        let mut steps = [0.0; MAX_TOGETHER];
        for k in 0..Interleaved::<V>::GROUPS {
            steps[k] = self.solution.age_gyr * (-self.taus[k] / self.steps as f64);
        }
        Lanes::splat_groups(&steps)
    }

    #[inline(always)]
    fn progenitor_at(&self, left: f64) -> Vec3<Interleaved<V>> {
        let [centre] = self.progenitor::<V, 1>([left]);
        centre
    }

    #[inline(always)]
    fn progenitor_during(&self, left: f64, length: f64) -> [Vec3<Interleaved<V>>; STAGES] {
        let mut times = [left; STAGES];
        for stage in 0..STAGES {
            times[stage] = left - TIMES[stage + 1] * length;
        }
        self.progenitor::<V, STAGES>(times)
    }

    #[inline(always)]
    fn mass_fraction(&self, left: f64) -> Interleaved<V> {
        if !H::IS_GALAXY {
            return Interleaved::<V>::one();
        }
        let mut fractions = [0.0; MAX_TOGETHER];
        for k in 0..Interleaved::<V>::GROUPS {
            let tau = self.taus[k] * (left / self.steps as f64);
            fractions[k] = self.solution.mass_fraction(tau).value;
        }
        Lanes::splat_groups(&fractions)
    }

    #[inline(always)]
    fn record(&mut self, number: u8) {
        self.step_sizes.push(number);
    }
}

/// Writes the step schedules of one bundle after the other. Equal steps of the same release times are not written again.
pub(super) struct Planner<'a, H: Host> {
    model: &'a Model,
    solution: &'a ProgenitorSolution<f64, H>,
    schedules: &'a mut StepSchedules,
    /// The release times whose schedules are in the buffers.
    planned: [usize; MAX_TOGETHER],
}

impl<'a, H: Host> Planner<'a, H> {
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
            planned: [usize::MAX; MAX_TOGETHER],
        }
    }

    /// The step schedules of a bundle whose adaptive steps have these sizes.
    #[inline(always)]
    pub fn schedules<V: Vectors, const K: usize>(
        &mut self,
        bundle: &Bundle<'_>,
        step_sizes: &[u8],
    ) -> InterleavedSchedules<'_, H> {
        let adaptive = self.model.settings.step_rule == StepRule::Adaptive;
        let release_times = bundle.release_times();
        // The buffer of each lane group: that of the one before it if it has the same release time.
        let mut buffers = [0; MAX_TOGETHER];
        for k in 0..Lanes::<V, K>::GROUPS {
            let release_time = release_times[k];
            if k > 0 && release_time == release_times[k - 1] {
                buffers[k] = buffers[k - 1];
                continue;
            }
            buffers[k] = k;
            if adaptive || self.planned[k] != release_time {
                self.planned[k] = release_time;
                self.model.plan(
                    release_time,
                    step_sizes,
                    self.solution,
                    &mut self.schedules[k],
                );
            }
        }
        let [a, b, c, d] = buffers;
        let schedules = &*self.schedules;
        InterleavedSchedules(
            [&schedules[a], &schedules[b], &schedules[c], &schedules[d]],
            PhantomData,
        )
    }
}
