//! The fits of a study in their order, each with its folder.

use super::inputs::StudyInputs;
use crate::config::{StreamsOf, StudyConfig, read};
use crate::data::ObservedTrack;
use crate::error::{Error, Result};
use crate::inference::{FitSettings, Sampler};
use crate::posterior::Summary;
use crate::run::fit::read_fit;
use crate::run::folder::RunFolder;
use crate::run::names::file_name;
use crate::run::session::goes_on;
use oblate_samplers::output::Status;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// One fit of a study.
#[derive(Clone, Debug)]
pub(super) struct PlannedFit {
    /// From 1, in the order of the study.
    pub number: usize,
    pub group: StreamsOf,
    pub track: ObservedTrack,
    pub settings: FitSettings,
    pub folder: PathBuf,
}

impl PlannedFit {
    /// The track and the sampler, for messages.
    pub fn name(&self) -> String {
        format!("{} {}", self.track.name, self.sampler().name())
    }

    pub fn sampler(&self) -> Sampler {
        self.settings.sampling.sampler
    }

    /// Whether its folder holds a result, of whatever settings.
    pub fn is_finished(&self) -> bool {
        RunFolder::open(&self.folder).is_ok_and(|folder| folder.finished())
    }

    /// Whether its folder holds a result that would not be sampled further: it ended by its stopping rule, and has converged or may not go on
    /// under these settings.
    pub fn is_settled(&self) -> bool {
        let settled = || -> Result<bool> {
            let folder = RunFolder::open(&self.folder)?;
            let summary = Summary::read(&folder.summary())?;
            let before = read(&folder.config())?;
            let (converged, method) = (summary.converged, summary.method);
            Ok(summary.status == Status::Complete
                && !goes_on(&self.settings, &before, converged, method))
        };
        settled().unwrap_or(false)
    }

    /// Reads back the result in its folder, also one that would be sampled further.
    ///
    /// # Errors
    /// As of [`read_fit`].
    pub fn read_back(&self) -> Result<Summary> {
        read_fit(&self.track, &self.settings, &self.folder)
    }
}

/// The fits of a study: of each track by each sampler, then of each mock.
///
/// # Errors
/// [`Error::Name`] for a track whose name is empty or too long; [`Error::SameName`] for two of the same name.
pub(super) fn planned_fits(config: &StudyConfig, inputs: &StudyInputs) -> Result<Vec<PlannedFit>> {
    let mut fits = Vec::new();
    let mut add =
        |group, tracks: &[ObservedTrack], settings: &FitSettings, samplers: &[Sampler]| {
            let under = config.out.join(match group {
                StreamsOf::Tracks => "fits",
                StreamsOf::Mocks => "mocks",
            });
            let mut taken = BTreeMap::new();
            for (i, track) in tracks.iter().enumerate() {
                for sampler in samplers {
                    let folder = file_name(&track.name, &format!("_{}", sampler.name()))?;
                    // Apart also where upper and lower case are the same.
                    let other = taken.insert(folder.to_lowercase(), i);
                    if let Some(other) = other.filter(|other| *other != i) {
                        return Err(Error::SameName {
                            name: track.name.clone(),
                            other: tracks[other].name.clone(),
                        });
                    }
                    fits.push(PlannedFit {
                        number: fits.len() + 1,
                        group,
                        track: track.clone(),
                        settings: settings.with_sampler(*sampler),
                        folder: under.join(folder),
                    });
                }
            }
            Ok(())
        };
    if let Some(study) = &config.tracks {
        add(
            StreamsOf::Tracks,
            &inputs.tracks,
            &study.fit,
            &study.samplers,
        )
        .map_err(|e| e.within("tracks"))?;
    }
    if let Some(study) = &config.mocks {
        add(StreamsOf::Mocks, &inputs.mocks, &study.fit, &study.samplers)
            .map_err(|e| e.within("mocks"))?;
    }
    Ok(fits)
}
