//! Host, progenitor and table of releases in, present-day particles out: the conductor, no physics of its own.
//!
//! Two stages. [`Setup`] is cold: the dense orbit and one [`Launch`] per epoch, on any [`Real`]. The particles are hot:
//! [`Model::particles`] carries them one by one on any number type (the reference), [`Model::carry`] does it in SIMD lanes
//! for the CPU at hand, and [`Model::pull_back`] is the exact derivative of the lanes' path.

mod backward;
mod cold;
mod forward;
mod pair;
mod setup;

pub use backward::{Counted, REGULAR, Workspace};
pub use forward::Arrivals;
pub use pair::{Flights, Group};
pub use setup::{Galaxy, Launch, Setup};

use crate::error::{Error, Rejection, Result};
use crate::orbit::{Arrival, Flight, OrbitMethod, Placement, advance};
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
    /// Shorter where the progenitor's orbit turns faster, see [`Clock`](crate::orbit::Clock).
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
    pub steps_per_turn: usize,
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
            steps_per_turn: 6,
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
    path: Vec<Placement>,
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
        let groups = pair::groups(&table);
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
                Placement::at(tau * left, settings.orbit_steps)
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
    fn path_of(&self, epoch: usize) -> &[Placement] {
        let start = self.path_starts[epoch];
        &self.path[start..=start + self.steps[epoch]]
    }

    /// Writes the course of one epoch's particles.
    #[inline(always)]
    fn plan<S: Real>(&self, epoch: usize, setup: &Setup<S>, flight: &mut Flight<S>) {
        let (tau, steps) = (self.table.taus[epoch], self.steps[epoch]);
        flight.path.clear();
        let Some(clock) = &setup.clock else {
            for place in self.path_of(epoch) {
                flight.path.push(setup.orbit.position(place));
            }
            let step = setup.age_gyr * (-tau / steps as f64);
            flight.drift_gyr.clear();
            flight.drift_gyr.resize(steps, step);
            flight.set_kicks();
            return;
        };
        clock.moments(tau, steps, &mut flight.moments);
        flight.places.clear();
        flight.drift_gyr.clear();
        let mut before = flight.moments[0];
        for (j, moment) in flight.moments.iter().enumerate() {
            let (row, place) = setup.orbit.position_at(*moment);
            flight.path.push(row);
            flight.places.push(place);
            if j > 0 {
                let nodes = (moment.node - before.node) as f64;
                let intervals = moment.share - before.share + nodes;
                flight.drift_gyr.push(intervals * setup.orbit.spacing_gyr);
                before = *moment;
            }
        }
        flight.set_kicks();
    }

    /// The cold stage.
    ///
    /// # Errors
    /// [`Rejection::BadParameter`] or [`Rejection::BadOrbit`] where there is no finite orbit, [`Rejection::UnresolvedOrbit`]
    /// where the steps are too long for it.
    pub fn setup<S: Real>(&self, galaxy: &Galaxy<S>) -> std::result::Result<Setup<S>, Rejection> {
        self.setup_reusing(galaxy, None)
    }

    /// As [`setup`](Self::setup), in the memory of an earlier one: no allocation.
    ///
    /// # Errors
    /// As [`setup`](Self::setup).
    pub fn setup_reusing<S: Real>(
        &self,
        galaxy: &Galaxy<S>,
        spare: Option<Setup<S>>,
    ) -> std::result::Result<Setup<S>, Rejection> {
        Setup::new(galaxy, &self.settings, &self.table, spare)
    }

    /// Every particle today, one by one, in the order of the table, on any number type: the reference that the fast path
    /// is tested against.
    ///
    /// # Errors
    /// [`Rejection::BadParticle`] if a state is not finite.
    pub fn particles<S: Real>(
        &self,
        setup: &Setup<S>,
    ) -> std::result::Result<Vec<Arrival<S>>, Rejection> {
        let mut arrivals = Vec::with_capacity(self.table.len());
        let mut flight = Flight::default();
        for (epoch, launch) in setup.launches.iter().enumerate() {
            self.plan(epoch, setup, &mut flight);
            let first = epoch * self.table.per_epoch;
            for particle in &self.table.particles[first..first + self.table.per_epoch] {
                let (start, turns) = launch.release(
                    particle.kick.position.map(S::from_f64),
                    particle.kick.velocity.map(S::from_f64),
                );
                let arrival = advance(&setup.host, &setup.sphere, &flight, start, turns);
                if !(arrival.state.x.norm2() + arrival.state.v.norm2())
                    .re()
                    .is_finite()
                {
                    return Err(Rejection::BadParticle);
                }
                arrivals.push(arrival);
            }
        }
        Ok(arrivals)
    }
}
