//! The populations of a study: by each family and each sampler.

use super::result::StudyRun;
use super::watch::{Watcher, watched};
use crate::config::{PopulationConfig, StudyConfig, read};
use crate::error::{Error, Result};
use crate::inference::Sampler;
use crate::run::folder::RunFolder;
use crate::run::locked::IfExists;
use crate::run::population::{PopulationFits, population};
use crate::run::session::Destination;
use oblate_samplers::rng::{Domain, below, stream};
use std::path::PathBuf;

/// The folder of the populations of subsets.
const SUBSETS: &str = "subsets";

/// The end of the name of a population for which all streams were kept.
const WITHOUT_SELECTION: &str = "_without_selection";

/// Substreams within [`Domain::Post`] of the choice of subsets, by their size.
const SUBSET_TASK: u64 = 0x7375_6273_0000_0000;

/// A population with its folder.
#[derive(Clone, Debug)]
pub(super) struct PlannedPopulation {
    pub name: String,
    pub sampler: Sampler,
    settings: PopulationConfig,
    folder: PathBuf,
    /// The size and the number of the subset of the streams; none: all.
    subset: Option<(usize, usize)>,
}

/// The populations in their order; none if the study has none.
pub(super) fn planned_populations(config: &StudyConfig) -> Vec<PlannedPopulation> {
    let mut planned = Vec::new();
    let Some(study) = &config.population else {
        return planned;
    };
    // With a selection what ignoring it does is shown, too.
    let selections = match &study.settings.selection {
        Some(_) => vec![
            ("", study.settings.selection.clone()),
            (WITHOUT_SELECTION, None),
        ],
        None => vec![("", None)],
    };
    for (suffix, selection) in selections {
        for family in study.families() {
            // The one family of a study without a list needs no name.
            let family_name = if study.families.is_empty() {
                String::new()
            } else {
                format!("_{}", family.name())
            };
            let name = format!("population{family_name}{suffix}");
            for sampler in &study.samplers {
                let mut settings = study.settings.clone();
                settings.family.name = family;
                settings.sampling.sampler = *sampler;
                settings.selection = selection.clone();
                planned.push(PlannedPopulation {
                    folder: config.out.join(format!("{name}_{}", sampler.name())),
                    name: name.clone(),
                    sampler: *sampler,
                    settings,
                    subset: None,
                });
            }
        }
    }
    planned
}

/// The populations of subsets of the streams, of which there are so many, each after its number of streams: by the first family and the first
/// sampler.
pub(super) fn planned_subsets(
    config: &StudyConfig,
    streams: usize,
) -> Vec<(usize, PlannedPopulation)> {
    let subsets = config.population.as_ref().and_then(|p| p.subsets.as_ref());
    let first = planned_populations(config).into_iter().next();
    let (Some(subsets), Some(first)) = (subsets, first) else {
        return Vec::new();
    };
    let sizes = subsets.sizes.iter().filter(|size| **size < streams);
    let planned = |size: usize, number: usize| PlannedPopulation {
        name: format!("{size} streams, subset {number}"),
        folder: config.out.join(SUBSETS).join(format!("{size}_{number}")),
        subset: Some((size, number)),
        ..first.clone()
    };
    sizes
        .flat_map(|size| (1..=subsets.repeats).map(|number| (*size, planned(*size, number))))
        .collect()
}

/// Random members of a subset, in their order.
fn members(folders: &[PathBuf], seed: u64, (size, number): (usize, usize)) -> Vec<PathBuf> {
    let mut rng = stream(seed, Domain::Post, SUBSET_TASK + size as u64, number as u64);
    let mut places: Vec<usize> = (0..folders.len()).collect();
    for taken in 0..size {
        let other = taken + below(&mut rng, places.len() - taken);
        places.swap(taken, other);
    }
    places.truncate(size);
    places.sort_unstable();
    places.into_iter().map(|i| folders[i].clone()).collect()
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
        let chosen = match self.subset {
            Some(subset) => members(folders, self.settings.seed, subset),
            None => folders.to_vec(),
        };
        let fits = PopulationFits {
            folders: &chosen,
            missing,
            // A study reports unconverged fits at its end instead of stopping at them.
            allow_unconverged: true,
        };
        let label = format!("{} {}", self.name, self.sampler.name());
        let sampled = |if_exists| {
            let destination = Destination {
                folder: &self.folder,
                if_exists,
                command,
            };
            watched(watcher, &label, &mut |monitor| {
                population(&fits, &self.settings, destination, monitor)
            })
        };
        let done = match sampled(IfExists::Resume) {
            // Its streams have been fitted further since.
            Err(Error::OtherInputs { .. }) if self.has_these_settings()? => {
                sampled(IfExists::Replace)?
            }
            other => other?,
        };
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
