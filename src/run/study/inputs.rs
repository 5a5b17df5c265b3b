//! The inputs of a study, read and checked before its first fit, so that faults are found at once.

use super::watch::Watcher;
use crate::config::{StreamsOf, StudyConfig, each_once};
use crate::data::{Mocks, ObservedTrack, ReadOptions, mocks_with};
use crate::error::{Error, Result, TrackFault};
use crate::inference::{FitPlan, FitSettings, Sampler};
use crate::params::StreamPrior;
use crate::population::QPosterior;
use crate::run::population;
use std::path::{Path, PathBuf};

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
    pub fn new(config: &StudyConfig, files_from: &Path, watcher: &dyn Watcher) -> Result<Self> {
        let mut inputs = Self::default();
        let mut support = None;
        if let Some(study) = &config.population {
            check_samplers(&study.samplers).map_err(|e| e.within("population"))?;
            let (table, there) = match streams_of(config) {
                StreamsOf::Tracks => ("tracks", config.tracks.is_some()),
                StreamsOf::Mocks => ("mocks", config.mocks.is_some()),
            };
            if !there {
                return Err(Error::Setting {
                    key: "of".to_owned(),
                    value: format!("{table:?}"),
                    remedy: format!("add a table `[{table}]`: the population is of its streams"),
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
        // The posterior of q of each stream needs a prior of q, before the first fit.
        let check_q = |group, name: &str, settings: &FitSettings| {
            let prior = StreamPrior::new(&settings.prior)?;
            match support.filter(|_| streams_of(config) == group) {
                None => Ok(prior),
                Some(support) => QPosterior::check_prior(prior.q_prior(), support)
                    .map(|_| prior)
                    .map_err(|fault| Error::Posterior {
                        name: name.to_owned(),
                        fault,
                    }),
            }
        };
        if let Some(study) = &config.tracks {
            check_samplers(&study.samplers).map_err(|e| e.within("tracks"))?;
            check_q(StreamsOf::Tracks, "tracks", &study.fit).map_err(|e| e.within("tracks.fit"))?;
            for path in track_files(&study.files, files_from)? {
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
            check_samplers(&study.samplers).map_err(|e| e.within("mocks"))?;
            let prior = check_q(StreamsOf::Mocks, "mocks", &study.fit)
                .map_err(|e| e.within("mocks.fit"))?;
            watcher.monitored("mocks", &mut |monitor| {
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

/// Whose population a study infers.
pub(super) fn streams_of(config: &StudyConfig) -> StreamsOf {
    let given = config.population.as_ref().and_then(|study| study.of);
    given.unwrap_or(if config.mocks.is_some() {
        StreamsOf::Mocks
    } else {
        StreamsOf::Tracks
    })
}

/// The files, and in place of a folder its tracks in the order of their names.
fn track_files(given: &[PathBuf], files_from: &Path) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for path in given.iter().map(|path| files_from.join(path)) {
        if !path.is_dir() {
            files.push(path);
            continue;
        }
        let mut inside = read_folder(&path).map_err(Error::io(
            &path,
            "check that the folder of tracks is readable",
        ))?;
        inside.retain(|file| is_track_file(file));
        inside.sort();
        if inside.is_empty() {
            return Err(Error::Setting {
                key: "files".to_owned(),
                value: path.display().to_string(),
                remedy: "name a folder with tracks, files that end in `.ecsv` or `.csv`".to_owned(),
            }
            .within("tracks"));
        }
        files.extend(inside);
    }
    Ok(files)
}

fn read_folder(path: &Path) -> std::io::Result<Vec<PathBuf>> {
    let entries = std::fs::read_dir(path)?;
    entries
        .map(|entry| entry.map(|entry| entry.path()))
        .collect()
}

fn is_track_file(path: &Path) -> bool {
    let ending = path.extension().and_then(|ending| ending.to_str());
    ending.is_some_and(|e| e.eq_ignore_ascii_case("ecsv") || e.eq_ignore_ascii_case("csv"))
        && path.is_file()
}

/// Refuses a list without a sampler, or with one of them twice.
fn check_samplers(samplers: &[Sampler]) -> Result<()> {
    if samplers.is_empty() {
        return Err(Error::Setting {
            key: "samplers".to_owned(),
            value: "[]".to_owned(),
            remedy: "name `nested`, `pt-hmc` or both".to_owned(),
        });
    }
    each_once("samplers", samplers, |sampler| sampler.name().to_owned())
}

/// Checks the settings of the fits of a track by some samplers.
fn check(track: &ObservedTrack, settings: &FitSettings, samplers: &[Sampler]) -> Result<()> {
    for sampler in samplers {
        FitPlan::of_settings(track, &settings.with_sampler(*sampler))?;
    }
    Ok(())
}
