//! The step schedules of the release times: where the progenitor is at each force evaluation, and how long the steps are.

use super::lane_groups::{Pair, StepSchedules, UNROLL};
use super::model::Model;
use super::progenitor_solution::ProgenitorSolution;
use crate::orbit::{HermiteWeights, InterleavedSchedules, StepSchedule};
use crate::potential::Halo;
use crate::scalar::Real;

impl Model {
    /// Interpolation weights of the progenitor's position for the particles of one release time.
    #[inline(always)]
    pub(super) fn path_of(&self, release_time: usize) -> &[HermiteWeights] {
        let start = self.path_starts[release_time];
        &self.path[start..=start + self.steps[release_time]]
    }

    /// Writes the step schedule of the particles of one release time.
    #[inline(always)]
    pub(super) fn plan<S: Real, H: Halo>(
        &self,
        release_time: usize,
        solution: &ProgenitorSolution<S, H>,
        schedule: &mut StepSchedule<S>,
    ) {
        let (tau, steps) = (self.table.taus[release_time], self.steps[release_time]);
        schedule.path.clear();
        let Some(grid) = &solution.grid else {
            for place in self.path_of(release_time) {
                schedule.path.push(solution.orbit.position(place));
            }
            let step = solution.age_gyr * (-tau / steps as f64);
            schedule.drift_gyr.clear();
            schedule.drift_gyr.resize(steps, step);
            schedule.set_kicks();
            return;
        };
        grid.orbit_times(tau, steps, &mut schedule.orbit_times);
        schedule.places.clear();
        schedule.drift_gyr.clear();
        let mut before = schedule.orbit_times[0];
        for (j, orbit_time) in schedule.orbit_times.iter().enumerate() {
            let (row, place) = solution.orbit.position_at(*orbit_time);
            schedule.path.push(row);
            schedule.places.push(place);
            if j > 0 {
                let nodes = (orbit_time.node - before.node) as f64;
                let intervals = orbit_time.share - before.share + nodes;
                schedule
                    .drift_gyr
                    .push(intervals * solution.orbit.spacing_gyr);
                before = *orbit_time;
            }
        }
        schedule.set_kicks();
    }
}

/// Writes the step schedules of one pair after the other, those of each release time once.
pub(super) struct Planner<'a, H: Halo> {
    model: &'a Model,
    solution: &'a ProgenitorSolution<f64, H>,
    schedules: &'a mut StepSchedules,
    /// The release times whose schedules are in the buffers.
    planned: [usize; UNROLL],
}

impl<'a, H: Halo> Planner<'a, H> {
    /// In the buffers of an earlier one; their content does not matter.
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

    /// The step schedules of a pair.
    #[inline(always)]
    pub fn schedules(&mut self, pair: &Pair<'_>) -> InterleavedSchedules<'_> {
        let [a, b] = pair.release_times();
        let [one, other] = &mut *self.schedules;
        if self.planned[0] != a {
            self.planned[0] = a;
            self.model.plan(a, self.solution, one);
        }
        if a == b {
            return InterleavedSchedules(one, one);
        }
        if self.planned[1] != b {
            self.planned[1] = b;
            self.model.plan(b, self.solution, other);
        }
        InterleavedSchedules(one, other)
    }
}
