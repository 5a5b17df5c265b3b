//! A study: tracks and mocks, their fits, and a population. It can be repeated: runs that have finished with the same inputs are read
//! back, and interrupted ones are continued.

use super::contents::remove_leftovers;
use super::fit::fit;
use super::folder::RunFolder;
use super::locked::IfExists;
use super::monitor::{Monitor, Monitored};
use super::names::file_name;
use super::population::population;
use super::session::Destination;
use super::study_inputs::StudyInputs;
use crate::config::StudyConfig;
use crate::data::ObservedTrack;
use crate::error::{Error, OutputFault, Result};
use crate::inference::{Fit, FitSettings, Sampler};
use crate::posterior::Summary;
use crate::report::is_page;
use oblate_samplers::output::Status;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// A finished run of a study.
#[derive(Clone, Debug)]
pub struct StudyRun {
    /// Its run folder.
    pub folder: PathBuf,
    /// The name of the track, `population`, or `population_FAMILY`.
    pub name: String,
    /// The sampler.
    pub sampler: Sampler,
    /// Its summary.
    pub summary: Summary,
}

/// The finished runs of a study.
#[derive(Clone, Debug, Default)]
pub struct StudyResult {
    /// Fits of tracks.
    pub tracks: Vec<StudyRun>,
    /// Fits of mocks.
    pub mocks: Vec<StudyRun>,
    /// Populations of the mocks.
    pub populations: Vec<StudyRun>,
    /// Fraction of prior draws that met the criteria of a mock.
    pub acceptance: Option<f64>,
    /// Whether the study was interrupted; the same command continues it.
    pub interrupted: bool,
}

impl StudyResult {
    /// All runs: tracks, mocks, populations.
    pub fn runs(&self) -> impl Iterator<Item = &StudyRun> {
        self.tracks
            .iter()
            .chain(&self.mocks)
            .chain(&self.populations)
    }
}

/// Runs a study. Track files are relative to `files_from`; `monitored` does the work of one run under a monitor of the
/// caller.
///
/// # Errors
/// Before the first fit: [`Error::OutputPath`] for an empty `out` or one with a `report.html` that is not a report;
/// [`Error::Io`] or [`Error::TrackFile`] for a track that cannot be read; [`Error::Name`] for one whose name is empty
/// or too long; [`Error::SameName`] for two of the same name; [`Error::InTable`] for settings out of their range, in
/// whichever table they are. Later [`Error::Exists`], [`Error::OutputPath`], [`Error::OtherInputs`],
/// [`Error::FolderInUse`] or [`Error::Io`] for a run folder, and [`Error::Sampler`] if a sampler fails.
pub fn study(
    config: &StudyConfig,
    files_from: &Path,
    command: &str,
    monitored: &mut Monitored<'_>,
) -> Result<StudyResult> {
    config.check()?;
    RunFolder::at(&config.out)?;
    check_report(&report_path(&config.out))?;
    let inputs = StudyInputs::new(config, files_from, monitored)?;
    if let Some(tracks) = &config.tracks {
        apart(&inputs.tracks, &tracks.samplers).map_err(|e| e.within("tracks"))?;
    }
    let mut result = StudyResult {
        acceptance: inputs.acceptance,
        ..StudyResult::default()
    };
    std::fs::create_dir_all(&config.out).map_err(|source| Error::Io {
        path: config.out.clone(),
        source,
        remedy: "choose an `out` whose parent is writable",
    })?;
    remove_leftovers(&config.out);
    let mut runner = Runner {
        command,
        monitored,
        number: 0,
        of: number_of_runs(config, &inputs),
    };
    if let Some(tracks) = &config.tracks {
        let under = config.out.join("fits");
        for track in &inputs.tracks {
            for sampler in &tracks.samplers {
                match runner.fit(track, &tracks.fit, *sampler, &under)? {
                    Some(run) => result.tracks.push(run),
                    None => return Ok(result.interrupted()),
                }
            }
        }
    }
    if let Some(study) = &config.mocks {
        let under = config.out.join("mocks");
        for track in &inputs.mocks {
            for sampler in &study.samplers {
                match runner.fit(track, &study.fit, *sampler, &under)? {
                    Some(run) => result.mocks.push(run),
                    None => return Ok(result.interrupted()),
                }
            }
        }
    }
    if let Some(study) = &config.population {
        // One fit of each stream: by the first of the samplers that the mocks were fitted with.
        let first = result.mocks.first().map(|run| run.sampler);
        let fits: Vec<PathBuf> = result
            .mocks
            .iter()
            .filter(|run| Some(run.sampler) == first)
            .map(|run| run.folder.clone())
            .collect();
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
                let folder = config.out.join(format!("{name}_{}", sampler.name()));
                // A study reports unconverged fits at its end instead of stopping at them.
                let run = runner.run(&name, *sampler, folder, |destination, monitor| {
                    population(&fits, &settings, true, destination, monitor)
                })?;
                match run {
                    Some(run) => result.populations.push(run),
                    None => return Ok(result.interrupted()),
                }
            }
        }
    }
    Ok(result)
}

impl StudyResult {
    fn interrupted(self) -> Self {
        Self {
            interrupted: true,
            ..self
        }
    }
}

/// Where a study has its report.
#[must_use]
pub fn report_path(out: &Path) -> PathBuf {
    out.join("report.html")
}

/// Checks that the report can be written: there is nothing, or an earlier one.
fn check_report(path: &Path) -> Result<()> {
    let fault = match std::fs::symlink_metadata(path) {
        Err(_) => return Ok(()),
        Ok(found) if !found.is_file() => true,
        Ok(_) => {
            let mut head = Vec::new();
            let file = File::open(path).and_then(|file| file.take(1 << 10).read_to_end(&mut head));
            file.is_err() || !is_page(&head)
        }
    };
    if fault {
        return Err(Error::OutputPath {
            path: path.to_path_buf(),
            fault: OutputFault::NotAReport,
        });
    }
    Ok(())
}

/// The name of the run folder of a track.
fn folder_name(track: &ObservedTrack, sampler: Sampler) -> Result<String> {
    file_name(&track.name, &format!("_{}", sampler.name()))
}

/// Checks that each track has a run folder of its own, also where upper and lower case are the same.
fn apart(tracks: &[ObservedTrack], samplers: &[Sampler]) -> Result<()> {
    let mut taken = BTreeMap::new();
    for (i, track) in tracks.iter().enumerate() {
        for sampler in samplers {
            let folder = folder_name(track, *sampler)?.to_lowercase();
            if let Some(other) = taken.insert(folder, i).filter(|other| *other != i) {
                return Err(Error::SameName {
                    name: track.name.clone(),
                    other: tracks[other].name.clone(),
                });
            }
        }
    }
    Ok(())
}

/// How many runs a study has.
fn number_of_runs(config: &StudyConfig, inputs: &StudyInputs) -> usize {
    let tracks = config.tracks.as_ref().map_or(0, |s| s.samplers.len());
    let mocks = config.mocks.as_ref().map_or(0, |s| s.samplers.len());
    let populations = config.population.as_ref();
    let populations = populations.map_or(0, |s| s.samplers.len() * s.families().len());
    tracks * inputs.tracks.len() + mocks * inputs.mocks.len() + populations
}

/// Does the runs of a study, one after the other.
struct Runner<'a, 'b> {
    command: &'a str,
    monitored: &'a mut Monitored<'b>,
    /// Number of the present run, from 1.
    number: usize,
    /// How many there are.
    of: usize,
}

impl Runner<'_, '_> {
    /// One fit into `under/<track>_<sampler>`; `None` if it was interrupted.
    fn fit(
        &mut self,
        track: &ObservedTrack,
        settings: &FitSettings,
        sampler: Sampler,
        under: &Path,
    ) -> Result<Option<StudyRun>> {
        let settings = settings.with_sampler(sampler);
        let folder = under.join(folder_name(track, sampler)?);
        self.run(&track.name, sampler, folder, |destination, monitor| {
            fit(track, &settings, destination, monitor)
        })
    }

    /// One run; `None` if it was interrupted.
    fn run(
        &mut self,
        name: &str,
        sampler: Sampler,
        folder: PathBuf,
        work: impl Fn(Destination<'_>, &mut Monitor<'_>) -> Result<Fit>,
    ) -> Result<Option<StudyRun>> {
        let destination = Destination {
            folder: &folder,
            if_exists: IfExists::Resume,
            command: self.command,
        };
        let mut done = None;
        self.number += 1;
        let label = format!(
            "run {} of {}, {name} {}",
            self.number,
            self.of,
            sampler.name()
        );
        (self.monitored)(&label, &mut |monitor| {
            done = Some(work(destination, monitor)?);
            Ok(())
        })?;
        Ok(done
            .filter(|fit| fit.run.status != Status::Interrupted)
            .map(|fit| StudyRun {
                folder,
                name: name.to_owned(),
                sampler,
                summary: fit.summary,
            }))
    }
}
