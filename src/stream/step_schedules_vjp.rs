//! Reverse mode of the step schedules: from derivatives with respect to the steps of one release time to derivatives with respect to
//! the orbit's nodes, the age and the adaptive grid.

use super::cotangents::Cotangents;
use super::model::Model;
use super::progenitor_solution::ProgenitorSolution;
use crate::orbit::{StepCotangent, StepSchedule, add_weighted};
use crate::potential::Halo;

impl Cotangents {
    /// Adds the derivatives with respect to the step schedule of one release time to those with respect to the orbit's nodes, the age and,
    /// if the schedule follows an adaptive grid, its phases.
    pub(super) fn add_schedule<H: Halo>(
        &mut self,
        model: &Model,
        solution: &ProgenitorSolution<f64, H>,
        release_time: usize,
        schedule: &StepSchedule<f64>,
        schedule_bar: &[StepCotangent<f64>],
    ) {
        let places = if solution.grid.is_some() {
            &schedule.places
        } else {
            model.path_of(release_time)
        };
        let steps = schedule_bar.len();
        for j in 0..steps {
            add_weighted(&mut self.nodes, &places[j], schedule_bar[j].progenitor);
        }
        // A drift length enters the drift itself and half of the kicks at both of its ends; the kick today moves no position.
        let drift_bar = |j: usize| {
            let next = if j + 1 < steps {
                schedule_bar[j + 1].kick
            } else {
                0.0
            };
            schedule_bar[j].drift / schedule.drift_gyr[j] + 0.5 * (schedule_bar[j].kick + next)
        };
        let mut sum = 0.0;
        for j in 0..steps {
            sum += drift_bar(j) * schedule.drift_gyr[j];
        }
        self.shared.age_gyr += sum / solution.age_gyr;
        if let Some(grid) = &solution.grid {
            let times_bar = &mut self.times;
            times_bar.clear();
            times_bar.resize(steps + 1, 0.0);
            for j in 0..steps {
                let by = drift_bar(j) * solution.age_gyr;
                times_bar[j + 1] += by;
                times_bar[j] += schedule_bar[j]
                    .progenitor
                    .dot(solution.orbit.slope(schedule.orbit_times[j]))
                    - by;
            }
            grid.times_vjp(&schedule.orbit_times, times_bar, &mut self.phases);
        }
    }
}
