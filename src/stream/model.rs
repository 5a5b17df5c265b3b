//! The model of a stream: everything that does not depend on the parameters.

use super::lane_groups::{LaneGroup, UNROLL, bundles, lane_groups, split};
use super::progenitor_solution::{ProgenitorSolution, SolutionMemory};
use super::settings::{ModelSettings, StepRule};
use super::system::System;
use crate::error::{Rejection, Result};
use crate::orbit::{HermiteWeights, NodeTimes};
use crate::potential::Host;
use crate::scalar::Real;
use crate::spray::ReleaseTable;
use std::ops::Range;

/// The model of a stream with its table of releases: made once, used at every point of a fit.
#[derive(Clone, Debug)]
pub struct Model {
    pub(super) settings: ModelSettings,
    pub(super) table: ReleaseTable,
    pub(super) lane_groups: Vec<LaneGroup>,
    /// The lane groups that are integrated together, as ranges.
    pub(super) bundles: Vec<Range<usize>>,
    /// The bundles in pairs of lane groups, as ranges: those whose derivatives are computed together, in double precision.
    pub(super) pairs: Vec<Range<usize>>,
    /// Number of steps of the particles of each release time; of adaptive steps, if all are as long as possible.
    pub(super) steps: Vec<usize>,
    /// Hermite weights of the progenitor's position at every force evaluation, one more than steps for each release time; empty if the
    /// steps are adaptive.
    pub(super) hermite_weights: Vec<HermiteWeights>,
    /// Index of the first weights of each release time.
    pub(super) hermite_starts: Vec<usize>,
}

impl Model {
    /// Makes the table of releases and what follows from it and the settings.
    ///
    /// # Errors
    /// Those of [`ModelSettings::check`] and [`ReleaseTable::new`]; [`Error::TooMuchMemory`](crate::Error::TooMuchMemory) by the estimate
    /// of [`ModelSettings::memory`] for one thread.
    pub fn new(settings: &ModelSettings) -> Result<Self> {
        settings.check()?;
        settings.memory(1).check()?;
        let table = ReleaseTable::new(&settings.releases)?;
        Ok(Self::from_table(*settings, table))
    }

    /// The same model with twice as many steps of particles and orbit, for an estimate of the error by the steps. Their number may exceed
    /// the limit of [`ModelSettings::check`].
    #[must_use]
    pub fn with_twice_the_steps(&self) -> Self {
        let settings = ModelSettings {
            steps: 2 * self.settings.steps,
            step_phase: 0.5 * self.settings.step_phase,
            orbit_steps: 2 * self.settings.orbit_steps,
            ..self.settings
        };
        Self::from_table(settings, self.table.clone())
    }

    /// The model of checked settings with their table.
    fn from_table(settings: ModelSettings, table: ReleaseTable) -> Self {
        let lane_groups = lane_groups(&table);
        let steps: Vec<usize> = table
            .taus
            .iter()
            .map(|tau| settings.steps_per.number_of_steps(settings.steps, *tau))
            .collect();
        let mut hermite_weights = Vec::new();
        let mut hermite_starts = Vec::new();
        let equal = settings.step_rule == StepRule::Uniform;
        let times = NodeTimes::uniform(settings.orbit_steps);
        for (tau, steps) in table.taus.iter().zip(&steps).filter(|_| equal) {
            hermite_starts.push(hermite_weights.len());
            hermite_weights.extend((0..=*steps).map(|j| {
                // A fraction of the whole, so that the last one is exactly 0: today.
                let left = 1.0 - j as f64 / *steps as f64;
                HermiteWeights::at(tau * left, &times)
            }));
        }
        let together = settings.groups_together();
        let bundles = bundles(&lane_groups, &steps, together);
        let pairs = |bundle: &Range<usize>| split(bundle.clone(), UNROLL);
        Self {
            settings,
            table,
            pairs: bundles.iter().flat_map(pairs).collect(),
            bundles,
            lane_groups,
            steps,
            hermite_weights,
            hermite_starts,
        }
    }

    /// The settings.
    #[must_use]
    pub fn settings(&self) -> &ModelSettings {
        &self.settings
    }

    /// Mean number of steps of a particle; of adaptive steps, if all are as long as possible.
    #[must_use]
    pub fn mean_steps(&self) -> f64 {
        self.steps.iter().sum::<usize>() as f64 / self.steps.len() as f64
    }

    /// The table of releases.
    #[must_use]
    pub fn table(&self) -> &ReleaseTable {
        &self.table
    }

    /// The progenitor's orbit and the release frames.
    ///
    /// # Errors
    /// [`Rejection::BadParameter`] if a parameter is not finite, or a mass, scale radius or the age is not positive;
    /// [`Rejection::BadOrbit`] if the orbit is not finite; [`Rejection::UnresolvedOrbit`] if it needs more steps than the settings allow.
    pub fn progenitor_solution<S: Real, H: Host>(
        &self,
        system: &System<S, H>,
    ) -> std::result::Result<ProgenitorSolution<S, H>, Rejection> {
        self.progenitor_solution_reusing(system, None)
    }

    /// As [`progenitor_solution`](Self::progenitor_solution), in the memory of an earlier one: no allocation.
    ///
    /// # Errors
    /// As [`progenitor_solution`](Self::progenitor_solution).
    pub fn progenitor_solution_reusing<S: Real, H: Host>(
        &self,
        system: &System<S, H>,
        memory: Option<SolutionMemory<S>>,
    ) -> std::result::Result<ProgenitorSolution<S, H>, Rejection> {
        ProgenitorSolution::new(system, &self.settings, &self.table, memory)
    }
}
