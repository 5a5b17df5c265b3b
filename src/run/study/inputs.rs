//! The inputs of a study, read and checked before its first fit, so that faults are found at once.

use super::watch::Watcher;
use crate::config::{StreamsOf, StudyConfig, StudyMocks, StudyPopulation, StudyTracks, each_once};
use crate::data::{AssumedError, Mocks, ObservedTrack, ReadOptions, mocks_with};
use crate::error::{Error, PosteriorFault, Result, TrackFault};
use crate::inference::{FitPlan, FitSettings, Sampler};
use crate::params::StreamPrior;
use crate::population::QPosterior;
use crate::run::population;
use crate::run::population_fits::is_one_track;
use oblate_samplers::Error as SamplerError;
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
    /// too few mocks; [`Error::Sampler`] if the search for mocks is interrupted.
    pub fn new(config: &StudyConfig, files_from: &Path, watcher: &dyn Watcher) -> Result<Self> {
        let mut inputs = Self::default();
        let population = config.population.as_ref();
        let support = population.map(|study| check_population(study, config));
        let support = support.transpose()?;
        let support_of = |group| support.filter(|_| streams_of(config) == group);
        if let Some(study) = &config.tracks {
            inputs.read_tracks(study, files_from, support_of(StreamsOf::Tracks))?;
        }
        if let Some(study) = &config.mocks {
            inputs.make_mocks(study, watcher, support_of(StreamsOf::Mocks))?;
        }
        Ok(inputs)
    }

    /// Reads the tracks and checks the settings of their fits. `support` is that of the population, if it is theirs.
    fn read_tracks(
        &mut self,
        study: &StudyTracks,
        files_from: &Path,
        support: Option<(f64, f64)>,
    ) -> Result<()> {
        check_samplers(&study.samplers).map_err(|e| e.within("tracks"))?;
        checked_prior("tracks", &study.fit, support).map_err(|e| e.within("tracks.fit"))?;
        for path in track_files(&study.files, files_from)? {
            self.tracks.push(read_track(&path, study.assume_error)?);
        }
        if support.is_some() {
            refuse_repeated(&self.tracks).map_err(|e| e.within("tracks"))?;
        }
        for track in &self.tracks {
            check(track, &study.fit, &study.samplers).map_err(|e| e.within("tracks.fit"))?;
        }
        Ok(())
    }

    /// Makes the mocks and checks the settings of their fits. `support` is that of the population, if it is theirs.
    fn make_mocks(
        &mut self,
        study: &StudyMocks,
        watcher: &dyn Watcher,
        support: Option<(f64, f64)>,
    ) -> Result<()> {
        check_samplers(&study.samplers).map_err(|e| e.within("mocks"))?;
        let prior =
            checked_prior("mocks", &study.fit, support).map_err(|e| e.within("mocks.fit"))?;
        watcher.monitored("mocks", &mut |monitor| {
            let advanced = &mut |found: &Mocks| {
                let (done, of) = (found.mocks.len() as u64, study.count as u64);
                monitor.advanced(done, of)
            };
            let found = mocks_with(&prior, &study.mock, study.count, study.seed, advanced)
                .map_err(|error| match error {
                    // It is no fault of the settings.
                    Error::Sampler(SamplerError::Interrupted) => error,
                    other => other.within("mocks.mock"),
                })?;
            self.acceptance = Some(found.acceptance());
            self.mocks = found.mocks.into_iter().map(|mock| mock.track).collect();
            Ok(())
        })?;
        // All have one bin width, the only property of a track that settings may not suit.
        if let Some(track) = self.mocks.first() {
            check(track, &study.fit, &study.samplers).map_err(|e| e.within("mocks.fit"))?;
        }
        Ok(())
    }
}

/// Checks the settings of the population: with each of its samplers and families, and that the study has its streams. Returns the support of
/// its families.
fn check_population(study: &StudyPopulation, config: &StudyConfig) -> Result<(f64, f64)> {
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
    Ok(study.settings.family.support())
}

/// Refuses tracks of a population of which two are the same.
fn refuse_repeated(tracks: &[ObservedTrack]) -> Result<()> {
    for (i, track) in tracks.iter().enumerate() {
        if let Some(other) = tracks[..i].iter().find(|other| is_one_track(track, other)) {
            return Err(Error::Posterior {
                name: track.name.clone(),
                fault: PosteriorFault::SameTrack {
                    other: other.name.clone(),
                },
            });
        }
    }
    Ok(())
}

/// Reads a track. Only one without errors takes the assumed one.
fn read_track(path: &Path, assumed_error: Option<AssumedError>) -> Result<ObservedTrack> {
    match ObservedTrack::read(path) {
        Err(Error::TrackFile {
            fault: TrackFault::NoErrors,
            ..
        }) => {
            let options = ReadOptions {
                assumed_error,
                ..ReadOptions::default()
            };
            ObservedTrack::read_with(path, &options)
        }
        read => read,
    }
}

/// The prior of some fits. If they are fits of a population, the posterior of q of each needs a prior of q that is known on its support.
fn checked_prior(
    name: &str,
    settings: &FitSettings,
    support: Option<(f64, f64)>,
) -> Result<StreamPrior> {
    let prior = StreamPrior::new(&settings.prior)?;
    if let Some(support) = support {
        let checked = QPosterior::check_prior(prior.q_prior(), support);
        checked.map_err(|fault| Error::Posterior {
            name: name.to_owned(),
            fault,
        })?;
    }
    Ok(prior)
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

/// The files, and in place of a folder its tracks in the order of their names. Refuses an empty list and a folder without tracks.
fn track_files(given: &[PathBuf], files_from: &Path) -> Result<Vec<PathBuf>> {
    if given.is_empty() {
        return Err(Error::Setting {
            key: "files".to_owned(),
            value: "[]".to_owned(),
            remedy: "name track files or folders of them, or leave the table out".to_owned(),
        }
        .within("tracks"));
    }
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
