//! The populations of a study: by each family and each sampler.

use super::result::StudyRun;
use super::watch::Watcher;
use crate::config::{PopulationConfig, StudyConfig, read};
use crate::error::{Error, Result};
use crate::inference::{Fit, Sampler};
use crate::run::folder::RunFolder;
use crate::run::locked::IfExists;
use crate::run::population::{PopulationFits, population};
use crate::run::session::Destination;
use oblate_samplers::output::Status;
use std::path::PathBuf;

/// A population with its folder.
#[derive(Clone, Debug)]
pub(super) struct PlannedPopulation {
    pub name: String,
    pub sampler: Sampler,
    settings: PopulationConfig,
    folder: PathBuf,
}

/// The populations in their order; none if the study has none.
pub(super) fn planned_populations(config: &StudyConfig) -> Vec<PlannedPopulation> {
    let mut planned = Vec::new();
    let Some(study) = &config.population else {
        return planned;
    };
    for family in study.families() {
        // The one family of a study without a list needs no name.
        let name = if study.families.is_empty() {
            "population".to_owned()
        } else {
            format!("population_{}", family.name())
        };
        for sampler in &study.samplers {
            let mut settings = study.settings.clone();
            settings.family.name = family;
            settings.sampling.sampler = *sampler;
            planned.push(PlannedPopulation {
                folder: config.out.join(format!("{name}_{}", sampler.name())),
                name: name.clone(),
                sampler: *sampler,
                settings,
            });
        }
    }
    planned
}

impl PlannedPopulation {
    /// Samples the population of the fits in these folders, or reads it back; `None` if it was interrupted.
    ///
    /// # Errors
    /// As of [`population`].
    pub fn sample(
        self,
        folders: &[PathBuf],
        missing: &[String],
        command: &str,
        watcher: &dyn Watcher,
    ) -> Result<Option<StudyRun>> {
        let fits = PopulationFits {
            folders,
            missing,
            // A study reports unconverged fits at its end instead of stopping at them.
            allow_unconverged: true,
        };
        let label = format!("{} {}", self.name, self.sampler.name());
        let sampled = |if_exists| {
            let mut done = None;
            let destination = Destination {
                folder: &self.folder,
                if_exists,
                command,
            };
            watcher.monitored(&label, &mut |monitor| {
                done = Some(population(&fits, &self.settings, destination, monitor)?);
                Ok(())
            })?;
            Ok(done)
        };
        let done = match sampled(IfExists::Resume) {
            // Its streams have been fitted further since.
            Err(Error::OtherInputs { .. }) if self.has_these_settings()? => {
                sampled(IfExists::Replace)?
            }
            other => other?,
        };
        let done = done.filter(|fit: &Fit| fit.run.status != Status::Interrupted);
        Ok(done.map(|fit| StudyRun {
            folder: self.folder,
            name: self.name,
            sampler: self.sampler,
            summary: fit.summary,
        }))
    }

    /// Whether the population in the folder has the settings of this one.
    fn has_these_settings(&self) -> Result<bool> {
        let stored: PopulationConfig = read(&RunFolder::open(&self.folder)?.config())?;
        Ok(stored == self.settings)
    }
}
