//! The stream generator, and everything in it that no parameter enters.

use super::lane_groups::{Group, groups, pairs};
use super::progenitor_solution::{ProgenitorSolution, SolutionMemory};
use super::settings::{ModelSettings, StepRule};
use super::system::System;
use crate::error::{Rejection, Result};
use crate::orbit::HermiteWeights;
use crate::potential::Halo;
use crate::scalar::Real;
use crate::spray::ReleaseTable;
use std::ops::Range;

/// A stream generator with its table of releases: made once, used for every point of a fit.
#[derive(Clone, Debug)]
pub struct Model {
    pub(super) settings: ModelSettings,
    pub(super) table: ReleaseTable,
    pub(super) groups: Vec<Group>,
    /// The groups that are integrated together.
    pub(super) pairs: Vec<Range<usize>>,
    /// Steps of the particles of each release time; of adaptive ones, if all are as long as possible.
    pub(super) steps: Vec<usize>,
    /// Interpolation weights of the progenitor's position at every force evaluation, one more than steps for each release time; none if
    /// the steps are adaptive.
    pub(super) path: Vec<HermiteWeights>,
    /// Index of the first weights of each release time.
    pub(super) path_starts: Vec<usize>,
}

impl Model {
    /// Makes the table and everything else that no parameter enters.
    ///
    /// # Errors
    /// Those of [`ModelSettings::check`] and [`ReleaseTable::new`]; [`Error::TooMuchMemory`](crate::Error::TooMuchMemory) by the estimate
    /// of [`ModelSettings::memory`] for one thread.
    pub fn new(settings: &ModelSettings) -> Result<Self> {
        settings.check()?;
        settings.memory(1).check()?;
        let table = ReleaseTable::new(&settings.releases)?;
        Ok(Self::of(*settings, table))
    }

    /// The same model with twice as many steps of particles and orbit, to see what the steps are good for. They may be more than
    /// [`ModelSettings::check`] allows a user.
    #[must_use]
    pub fn with_twice_the_steps(&self) -> Self {
        let settings = ModelSettings {
            steps: 2 * self.settings.steps,
            step_phase: 0.5 * self.settings.step_phase,
            orbit_steps: 2 * self.settings.orbit_steps,
            ..self.settings
        };
        Self::of(settings, self.table.clone())
    }

    /// With checked settings, and their table.
    fn of(settings: ModelSettings, table: ReleaseTable) -> Self {
        let groups = groups(&table);
        let steps: Vec<usize> = table
            .taus
            .iter()
            .map(|tau| settings.steps_per.of(settings.steps, *tau))
            .collect();
        let mut path = Vec::new();
        let mut path_starts = Vec::new();
        let equal = settings.step_rule == StepRule::Uniform;
        for (tau, steps) in table.taus.iter().zip(&steps).filter(|_| equal) {
            path_starts.push(path.len());
            path.extend((0..=*steps).map(|j| {
                // The last one is today, whatever the rounding of the fractions.
                let left = 1.0 - j as f64 / *steps as f64;
                HermiteWeights::at(tau * left, settings.orbit_steps)
            }));
        }
        Self {
            settings,
            table,
            pairs: pairs(&groups, &steps),
            groups,
            steps,
            path,
            path_starts,
        }
    }

    /// Its settings.
    #[must_use]
    pub fn settings(&self) -> &ModelSettings {
        &self.settings
    }

    /// Mean number of steps of a particle; of adaptive ones, if all are as long as possible.
    #[must_use]
    pub fn mean_steps(&self) -> f64 {
        self.steps.iter().sum::<usize>() as f64 / self.steps.len() as f64
    }

    /// Its table of releases.
    #[must_use]
    pub fn table(&self) -> &ReleaseTable {
        &self.table
    }

    /// The progenitor's orbit and the release frames.
    ///
    /// # Errors
    /// [`Rejection::BadParameter`] or [`Rejection::BadOrbit`] where there is no finite orbit, [`Rejection::UnresolvedOrbit`]
    /// where the steps are too long for it.
    pub fn progenitor_solution<S: Real, H: Halo>(
        &self,
        system: &System<S, H>,
    ) -> std::result::Result<ProgenitorSolution<S, H>, Rejection> {
        self.progenitor_solution_reusing(system, None)
    }

    /// As [`progenitor_solution`](Self::progenitor_solution), in the memory of an earlier one: no allocation.
    ///
    /// # Errors
    /// As [`progenitor_solution`](Self::progenitor_solution).
    pub fn progenitor_solution_reusing<S: Real, H: Halo>(
        &self,
        system: &System<S, H>,
        memory: Option<SolutionMemory<S>>,
    ) -> std::result::Result<ProgenitorSolution<S, H>, Rejection> {
        ProgenitorSolution::new(system, &self.settings, &self.table, memory)
    }
}
