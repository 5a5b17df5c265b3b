//! The inputs of a study, read and checked before its first fit, so that faults are found at once.

use super::monitor::Monitored;
use super::population;
use crate::config::StudyConfig;
use crate::data::{Mocks, ObservedTrack, ReadOptions, mocks_with};
use crate::error::{Error, Result, TrackFault};
use crate::inference::{FitPlan, FitSettings, Sampler};
use crate::params::StreamPrior;
use crate::population::QPosterior;
use std::path::Path;

/// The streams of a study.
#[derive(Default)]
pub(super) struct StudyInputs {
    /// Tracks from files.
    pub tracks: Vec<ObservedTrack>,
    /// Tracks of mocks.
    pub mocks: Vec<ObservedTrack>,
    /// Fraction of prior draws that met the criteria of a mock.
    pub acceptance: Option<f64>,
}

impl StudyInputs {
    /// Reads the tracks, makes the mocks and checks the settings of all runs. Track files are relative to `files_from`.
    ///
    /// # Errors
    /// [`Error::Io`] or [`Error::TrackFile`] for a track that cannot be read; [`Error::InTable`] for a setting out of its range and for
    /// too few mocks.
    pub fn new(
        config: &StudyConfig,
        files_from: &Path,
        monitored: &mut Monitored<'_>,
    ) -> Result<Self> {
        let mut inputs = Self::default();
        let mut support = None;
        if let Some(study) = &config.population {
            some(&study.samplers).map_err(|e| e.within("population"))?;
            if config.mocks.is_none() {
                return Err(Error::Setting {
                    key: "mocks".to_owned(),
                    value: "{}".to_owned(),
                    remedy: "add a table `[mocks]`: the population is that of the mocks".to_owned(),
                }
                .within("population"));
            }
            for sampler in &study.samplers {
                let mut settings = study.settings.clone();
                settings.sampling.sampler = *sampler;
                for family in study.families() {
                    settings.family.name = family;
                    population::check(&settings).map_err(|e| e.within("population.settings"))?;
                }
            }
            support = Some(study.settings.family.support());
        }
        if let Some(study) = &config.tracks {
            some(&study.samplers).map_err(|e| e.within("tracks"))?;
            for file in &study.files {
                let path = files_from.join(file);
                let mut track = ObservedTrack::read(&path);
                // Only a track without errors takes the assumed one.
                if let Err(Error::TrackFile {
                    fault: TrackFault::NoErrors,
                    ..
                }) = track
                {
                    let options = ReadOptions {
                        assumed_error: study.assume_error,
                        ..ReadOptions::default()
                    };
                    track = ObservedTrack::read_with(&path, &options);
                }
                inputs.tracks.push(track?);
            }
            for track in &inputs.tracks {
                check(track, &study.fit, &study.samplers).map_err(|e| e.within("tracks.fit"))?;
            }
        }
        if let Some(study) = &config.mocks {
            some(&study.samplers).map_err(|e| e.within("mocks"))?;
            let prior = StreamPrior::new(&study.fit.prior).map_err(|e| e.within("mocks.fit"))?;
            if let Some(support) = support {
                QPosterior::check_prior(prior.q_prior(), support).map_err(|fault| {
                    let name = "mocks".to_owned();
                    Error::Posterior { name, fault }.within("mocks.fit")
                })?;
            }
            monitored("mocks", &mut |monitor| {
                let advanced = &mut |found: &Mocks| {
                    let (done, of) = (found.mocks.len() as u64, study.count as u64);
                    monitor.advanced(done, of);
                };
                let found = mocks_with(&prior, &study.mock, study.count, study.seed, advanced)
                    .map_err(|e| e.within("mocks.mock"))?;
                inputs.acceptance = Some(found.acceptance());
                inputs.mocks = found.mocks.into_iter().map(|mock| mock.track).collect();
                Ok(())
            })?;
            // All have one bin width, the only property of a track that settings may not suit.
            if let Some(track) = inputs.mocks.first() {
                check(track, &study.fit, &study.samplers).map_err(|e| e.within("mocks.fit"))?;
            }
        }
        Ok(inputs)
    }
}

/// Refuses a list without a sampler.
fn some(samplers: &[Sampler]) -> Result<()> {
    if samplers.is_empty() {
        return Err(Error::Setting {
            key: "samplers".to_owned(),
            value: "[]".to_owned(),
            remedy: "name `nested`, `pt-hmc` or both".to_owned(),
        });
    }
    Ok(())
}

/// Checks the settings of the fits of a track by some samplers.
fn check(track: &ObservedTrack, settings: &FitSettings, samplers: &[Sampler]) -> Result<()> {
    for sampler in samplers {
        FitPlan::of_settings(track, &settings.with_sampler(*sampler))?;
    }
    Ok(())
}
