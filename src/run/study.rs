//! A study: tracks and mocks, their fits, a population. Idempotent: what has finished with the same inputs is read
//! back, what was interrupted is continued.

use super::{Existing, Watch, fit, population};
use crate::config::{FitConfig, StudyConfig};
use crate::data::{ObservedTrack, mocks};
use crate::error::{Error, Result};
use crate::inference::Sampler;
use crate::params::StreamPrior;
use crate::posterior::Summary;
use oblate_samplers::output::Status;
use std::path::{Path, PathBuf};

/// One piece of a study that is done.
#[derive(Clone, Debug)]
pub struct Piece {
    /// Its run folder.
    pub folder: PathBuf,
    /// Which track, or `population`.
    pub name: String,
    /// Which sampler.
    pub sampler: Sampler,
    /// Its numbers.
    pub summary: Summary,
}

/// What a study has done.
#[derive(Clone, Debug, Default)]
pub struct Outcome {
    /// Fits of tracks.
    pub tracks: Vec<Piece>,
    /// Fits of mocks.
    pub mocks: Vec<Piece>,
    /// Populations of the mocks.
    pub populations: Vec<Piece>,
    /// Fraction of prior draws that made mocks.
    pub acceptance: Option<f64>,
    /// Whether it was interrupted: the rest waits for the same command.
    pub interrupted: bool,
}

/// Runs a study. `files_from` is the folder that track files are relative to; `watch_of` makes the watch of one piece,
/// by its label.
///
/// # Errors
/// What mocks, fits and populations refuse.
pub fn study(
    config: &StudyConfig,
    files_from: &Path,
    command: &str,
    watched: &mut dyn FnMut(&str, &mut dyn FnMut(&mut Watch<'_>) -> Result<()>) -> Result<()>,
) -> Result<Outcome> {
    let mut outcome = Outcome::default();
    std::fs::create_dir_all(&config.out).map_err(|source| Error::Io {
        path: config.out.clone(),
        source,
        remedy: "choose an `out` whose parent is writable",
    })?;
    if let Some(tracks) = &config.tracks {
        // Read all before any work, so that a bad file is known at once.
        let read: Vec<ObservedTrack> = tracks
            .files
            .iter()
            .map(|f| ObservedTrack::read(&files_from.join(f)))
            .collect::<Result<_>>()?;
        for track in &read {
            for sampler in &tracks.samplers {
                let done = one_fit(
                    track,
                    &tracks.fit,
                    *sampler,
                    &config.out.join("fits"),
                    command,
                    watched,
                )?;
                match done {
                    Some(piece) => outcome.tracks.push(piece),
                    None => {
                        return Ok(Outcome {
                            interrupted: true,
                            ..outcome
                        });
                    }
                }
            }
        }
    }
    if let Some(study) = &config.mocks {
        let prior = StreamPrior::new(&study.fit.prior)?;
        let found = mocks(&prior, &study.mock, study.count, study.seed)?;
        outcome.acceptance = Some(found.acceptance());
        let folder = config.out.join("mocks");
        for mock in &found.mocks {
            for sampler in &study.samplers {
                match one_fit(&mock.track, &study.fit, *sampler, &folder, command, watched)? {
                    Some(piece) => outcome.mocks.push(piece),
                    None => {
                        return Ok(Outcome {
                            interrupted: true,
                            ..outcome
                        });
                    }
                }
            }
        }
    }
    if let Some(study) = &config.population {
        // One fit per stream: those of the first sampler that the mocks were fitted with.
        let first = outcome.mocks.first().map(|p| p.sampler);
        let fits: Vec<PathBuf> = outcome
            .mocks
            .iter()
            .filter(|p| Some(p.sampler) == first)
            .map(|p| p.folder.clone())
            .collect();
        for sampler in &study.samplers {
            let mut settings = study.settings.clone();
            settings.sampling.sampler = *sampler;
            let folder = config.out.join(format!("population_{}", sampler.name()));
            let mut done = None;
            watched(&format!("population {}", sampler.name()), &mut |watch| {
                // A study reports what has not converged instead of stopping there.
                done = Some(population(
                    &fits,
                    &settings,
                    &folder,
                    Existing::Resume,
                    true,
                    command,
                    watch,
                )?);
                Ok(())
            })?;
            match done {
                Some((run, summary)) if run.status != Status::Interrupted => {
                    outcome.populations.push(Piece {
                        folder,
                        name: "population".to_owned(),
                        sampler: *sampler,
                        summary,
                    })
                }
                _ => {
                    return Ok(Outcome {
                        interrupted: true,
                        ..outcome
                    });
                }
            }
        }
    }
    Ok(outcome)
}

/// One fit into `under/<track>_<sampler>`; `None` if it was interrupted.
fn one_fit(
    track: &ObservedTrack,
    config: &FitConfig,
    sampler: Sampler,
    under: &Path,
    command: &str,
    watched: &mut dyn FnMut(&str, &mut dyn FnMut(&mut Watch<'_>) -> Result<()>) -> Result<()>,
) -> Result<Option<Piece>> {
    let mut config = config.clone();
    config.sampling.sampler = sampler;
    let folder = under.join(format!("{}_{}", track.name, sampler.name()));
    let mut done = None;
    watched(
        &format!("{} {}", track.name, sampler.name()),
        &mut |watch| {
            done = Some(fit(
                track,
                &config,
                &folder,
                Existing::Resume,
                command,
                watch,
            )?);
            Ok(())
        },
    )?;
    Ok(done
        .filter(|(run, _)| run.status != Status::Interrupted)
        .map(|(_, summary)| Piece {
            folder,
            name: track.name.clone(),
            sampler,
            summary,
        }))
}
