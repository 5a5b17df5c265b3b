//! Host, progenitor and table of releases in, present-day particles out: the conductor, no physics of its own.
//!
//! Two stages. [`ProgenitorSolution`] is cold: the dense orbit and one [`ReleaseFrame`] per epoch, on any [`Real`]. The particles are hot:
//! [`Model::integrate_one_by_one`] carries them one by one on any number type (the reference), [`Model::integrate`] does it in SIMD lanes
//! for the CPU at hand, and [`Model::vjp`] is the exact derivative of the lanes' path.

mod lane_groups;
mod particles;
mod particles_vjp;
mod progenitor_solution;
mod progenitor_solution_vjp;

pub use lane_groups::{Group, StepSchedules};
pub use particles::Particles;
pub use particles_vjp::{Adjoint, MAX_STRETCH, Workspace};
pub use progenitor_solution::{ProgenitorSolution, ReleaseFrame, System};

use crate::error::{Error, Rejection, Result};
use crate::orbit::{FinalParticle, HermiteWeights, OrbitMethod, StepSchedule, advance};
use crate::scalar::Real;
use crate::spray::{ReleaseTable, TableSettings};
use serde::{Deserialize, Serialize};

/// Threads that one stream may use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Threads {
    /// The caller's: where many streams are made side by side.
    One,
    /// All of the present rayon pool: for one stream that somebody waits for.
    All,
}

/// How a particle's steps are spread over its time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StepRule {
    /// Equal steps: the paper.
    #[default]
    Uniform,
    /// Shorter where the progenitor's orbit turns faster, see [`AdaptiveGrid`](crate::orbit::AdaptiveGrid).
    Dynamical,
}

/// Whose steps are counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StepsPer {
    /// Every particle takes the same number of steps, longer ones the older it is: the paper.
    Particle,
    /// A particle of the stream's age takes this number of steps, others in proportion to their time in flight: the same
    /// error for about half of the steps. Particles fill the lanes where an epoch has 16 of them or more.
    #[default]
    Age,
}

impl StepsPer {
    /// The number of steps of a particle released at the time `tau` in [-1, 0).
    fn of(self, steps: usize, tau: f64) -> usize {
        match self {
            Self::Particle => steps,
            #[allow(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "at most `steps`, at least 0"
            )]
            Self::Age => ((-tau * steps as f64).ceil() as usize).clamp(1, steps),
        }
    }
}

/// How a stream is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ModelSettings {
    /// The releases.
    pub releases: TableSettings,
    /// Leapfrog steps.
    pub steps: usize,
    /// Whose steps these are.
    pub steps_per: StepsPer,
    /// How they are spread over its time.
    pub step_rule: StepRule,
    /// How the progenitor is carried.
    pub orbit: OrbitMethod,
    /// Steps of the progenitor's orbit.
    pub orbit_steps: usize,
    /// Fewest leapfrog steps per turn where the progenitor's orbit turns fastest (a circular orbit there, 2 pi / omega); a
    /// galaxy with fewer is rejected. With six the energy of a plunging orbit still holds to 1e-4; with two or three its
    /// particles are scattered by their steps alone, and a track is an accident of rounding. 0: none is rejected.
    pub min_steps_per_orbit: usize,
}

impl Default for ModelSettings {
    fn default() -> Self {
        Self {
            releases: TableSettings::default(),
            steps: 120,
            steps_per: StepsPer::default(),
            step_rule: StepRule::default(),
            orbit: OrbitMethod::default(),
            orbit_steps: 192,
            min_steps_per_orbit: 6,
        }
    }
}

/// A stream generator with its table of releases: made once, used for every point of a fit.
#[derive(Clone, Debug)]
pub struct Model {
    settings: ModelSettings,
    table: ReleaseTable,
    groups: Vec<Group>,
    /// Steps of the particles of each epoch.
    steps: Vec<usize>,
    /// Placements of the progenitor at every force evaluation, one more than steps in each epoch.
    path: Vec<HermiteWeights>,
    /// Where each epoch's begin.
    path_starts: Vec<usize>,
}

impl Model {
    /// Makes the table and everything else that no parameter enters.
    ///
    /// # Errors
    /// [`Error::Setting`] for steps of zero, and what [`ReleaseTable::new`] refuses.
    pub fn new(settings: &ModelSettings) -> Result<Self> {
        for (key, value) in [
            ("steps", settings.steps),
            ("orbit_steps", settings.orbit_steps),
        ] {
            if value == 0 {
                return Err(Error::Setting {
                    key: key.to_owned(),
                    value: "0".to_owned(),
                    remedy: "give at least 1".to_owned(),
                });
            }
        }
        let table = ReleaseTable::new(&settings.releases)?;
        let groups = lane_groups::groups(&table);
        let steps: Vec<usize> = table
            .taus
            .iter()
            .map(|tau| settings.steps_per.of(settings.steps, *tau))
            .collect();
        let mut path = Vec::new();
        let mut path_starts = Vec::with_capacity(steps.len());
        for (tau, steps) in table.taus.iter().zip(&steps) {
            path_starts.push(path.len());
            path.extend((0..=*steps).map(|j| {
                // The last one is today, whatever the rounding of the fractions.
                let left = 1.0 - j as f64 / *steps as f64;
                HermiteWeights::at(tau * left, settings.orbit_steps)
            }));
        }
        Ok(Self {
            settings: *settings,
            table,
            groups,
            steps,
            path,
            path_starts,
        })
    }

    /// Its settings.
    #[must_use]
    pub fn settings(&self) -> &ModelSettings {
        &self.settings
    }

    /// Its table of releases.
    #[must_use]
    pub fn table(&self) -> &ReleaseTable {
        &self.table
    }

    /// Placements of the progenitor during the flight of one epoch.
    #[inline(always)]
    fn path_of(&self, release_time: usize) -> &[HermiteWeights] {
        let start = self.path_starts[release_time];
        &self.path[start..=start + self.steps[release_time]]
    }

    /// Writes the course of one epoch's particles.
    #[inline(always)]
    fn plan<S: Real>(
        &self,
        release_time: usize,
        solution: &ProgenitorSolution<S>,
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

    /// The cold stage.
    ///
    /// # Errors
    /// [`Rejection::BadParameter`] or [`Rejection::BadOrbit`] where there is no finite orbit, [`Rejection::UnresolvedOrbit`]
    /// where the steps are too long for it.
    pub fn progenitor_solution<S: Real>(
        &self,
        system: &System<S>,
    ) -> std::result::Result<ProgenitorSolution<S>, Rejection> {
        self.progenitor_solution_reusing(system, None)
    }

    /// As [`progenitor_solution`](Self::progenitor_solution), in the memory of an earlier one: no allocation.
    ///
    /// # Errors
    /// As [`progenitor_solution`](Self::progenitor_solution).
    pub fn progenitor_solution_reusing<S: Real>(
        &self,
        system: &System<S>,
        spare: Option<ProgenitorSolution<S>>,
    ) -> std::result::Result<ProgenitorSolution<S>, Rejection> {
        ProgenitorSolution::new(system, &self.settings, &self.table, spare)
    }

    /// Every particle today, one by one, in the order of the table, on any number type: the reference that the fast path
    /// is tested against.
    ///
    /// # Errors
    /// [`Rejection::BadParticle`] if a state is not finite.
    pub fn integrate_one_by_one<S: Real>(
        &self,
        solution: &ProgenitorSolution<S>,
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
