//! A study: tracks and mocks, their fits, and a population. It can be repeated: runs that have finished with the same inputs are read
//! back, and interrupted ones are continued.

mod fits;
mod inputs;
mod pilot;
mod plan;
mod populations;
mod result;
mod slurm;
mod watch;

pub use pilot::Cost;
pub use result::{FailedRun, StudyResult, StudyRun, StudySubset};
pub use watch::{FitsSoFar, Watcher};

use crate::config::{StreamsOf, StudyConfig};
use crate::error::{Error, OutputFault, Result};
use crate::inference::Sampler;
use crate::report::is_page;
use fits::{Outcome, all_fits, is_of_the_sampler, one_fit};
use inputs::{StudyInputs, streams_of};
use oblate_samplers::limits::in_range;
use plan::{PlannedFit, planned_fits};
use populations::{PlannedPopulation, planned_populations, planned_subsets};
use slurm::Slurm;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use super::contents::remove_leftovers;
use super::folder::RunFolder;
use super::session::is_no_run;

/// Who does the fits of a study.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Executor<'a> {
    /// This process: as many fits at once as there are threads.
    Local,
    /// Slurm: array jobs of one fit each.
    Slurm {
        /// A shell command that does the fit whose number is in the variable `FIT`.
        task: &'a str,
    },
}

/// A study whose inputs are read and checked.
pub struct Study<'a> {
    config: &'a StudyConfig,
    fits: Vec<PlannedFit>,
    acceptance: Option<f64>,
}

impl<'a> Study<'a> {
    /// Reads the tracks, makes the mocks, and checks the settings of all runs. Track files are relative to `files_from`.
    ///
    /// # Errors
    /// [`Error::OutputPath`] for an empty `out` or one with a `report.html` that is not a report;
    /// [`Error::Io`] or [`Error::TrackFile`] for a track that cannot be read; [`Error::Name`] for one whose name is empty
    /// or too long; [`Error::SameName`] for two of the same name; [`Error::InTable`] for settings out of their range, in
    /// whichever table they are.
    pub fn new(config: &'a StudyConfig, files_from: &Path, watcher: &dyn Watcher) -> Result<Self> {
        config.check()?;
        RunFolder::at(&config.out)?;
        is_no_run(&config.out)?;
        check_report(&report_path(&config.out))?;
        let inputs = StudyInputs::new(config, files_from, watcher)?;
        let fits = planned_fits(config, &inputs)?;
        std::fs::create_dir_all(&config.out).map_err(Error::io(
            &config.out,
            "choose an `out` whose parent is writable",
        ))?;
        Ok(Self {
            config,
            fits,
            acceptance: inputs.acceptance,
        })
    }

    /// What the fits that will be sampled cost, from a pilot of some seconds: those that have no result or go on from one. `None` if there are
    /// none.
    ///
    /// # Errors
    /// As of [`Speed::of_fit`](crate::inference::Speed::of_fit); [`Error::Sampler`] after an interrupt.
    pub fn cost(&self, watcher: &dyn Watcher) -> Result<Option<Cost>> {
        let unfinished: Vec<_> = self.fits.iter().filter(|fit| !fit.is_settled()).collect();
        pilot::pilot(&unfinished, &|| watcher.interrupted())
    }

    /// Does the fits that have no result or go on from one, and the populations. `command` is the command line for the summaries.
    ///
    /// # Errors
    /// [`Error::Exists`], [`Error::OutputPath`], [`Error::OtherInputs`],
    /// [`Error::FolderInUse`] or [`Error::Io`] for a run folder; [`Error::Command`] for a command of Slurm that fails. The errors
    /// of one track, sampler or population are in the result.
    pub fn run(
        &self,
        executor: Executor<'_>,
        command: &str,
        watcher: &dyn Watcher,
    ) -> Result<StudyResult> {
        remove_leftovers(&self.config.out);
        let outcomes = match executor {
            Executor::Local => all_fits(&self.fits, command, watcher)?,
            Executor::Slurm { task } => {
                let slurm = Slurm::new(&self.config.slurm, &self.config.out, task)?;
                slurm.all_fits(&self.fits, command, watcher)?
            }
        };
        let mut result = self.result(self.fits.iter().zip(outcomes));
        if !result.interrupted {
            self.sample_populations(&mut result, command, watcher)?;
        }
        Ok(result)
    }

    /// Samples the populations of the streams that have a fit: by the first of their samplers.
    fn sample_populations(
        &self,
        result: &mut StudyResult,
        command: &str,
        watcher: &dyn Watcher,
    ) -> Result<()> {
        let group = streams_of(self.config);
        let first = self.fits.iter().find(|fit| fit.group == group);
        let Some(sampler) = first.map(PlannedFit::sampler) else {
            return Ok(());
        };
        let runs = match group {
            StreamsOf::Tracks => &result.tracks,
            StreamsOf::Mocks => &result.mocks,
        };
        let runs = runs.iter().filter(|run| run.sampler == sampler);
        let folders: Vec<PathBuf> = runs.map(|run| run.folder.clone()).collect();
        let failed = result.failed.iter();
        let missing: Vec<String> = failed
            .filter(|run| run.of == Some(group) && run.sampler == sampler)
            .map(FailedRun::to_string)
            .collect();
        let sample = |planned: PlannedPopulation, result: &mut StudyResult| {
            let (name, sampler) = (planned.name.clone(), planned.sampler);
            let done = match planned.sample(&folders, &missing, command, watcher) {
                Err(error) if is_of_the_population(&error) => {
                    let failed = failed_population(name, sampler, error.to_string());
                    result.failed.push(failed);
                    return Ok(None);
                }
                other => other?,
            };
            result.interrupted = done.is_none();
            Ok::<_, Error>(done)
        };
        for planned in planned_populations(self.config) {
            if folders.is_empty() {
                let reason = "no fit of its streams has a result".to_owned();
                let failed = failed_population(planned.name, planned.sampler, reason);
                result.failed.push(failed);
                continue;
            }
            let done = sample(planned, result)?;
            result.populations.extend(done);
            if result.interrupted {
                return Ok(());
            }
        }
        for (streams, planned) in planned_subsets(self.config, folders.len()) {
            let done = sample(planned, result)?;
            let subset = done.map(|run| StudySubset { streams, run });
            result.subsets.extend(subset);
            if result.interrupted {
                return Ok(());
            }
        }
        Ok(())
    }

    /// Does the fit of this number, from 1, and nothing else.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for a number that no fit has; as of [`run`](Self::run).
    pub fn run_fit(
        &self,
        number: usize,
        command: &str,
        watcher: &dyn Watcher,
    ) -> Result<StudyResult> {
        in_range("fit", number, 1..=self.fits.len())?;
        let fit = &self.fits[number - 1];
        let outcome = one_fit(fit, self.fits.len(), command, watcher)?;
        Ok(self.result(std::iter::once((fit, outcome))))
    }

    fn result<'b>(&self, ended: impl Iterator<Item = (&'b PlannedFit, Outcome)>) -> StudyResult {
        let mut result = StudyResult {
            acceptance: self.acceptance,
            ..StudyResult::default()
        };
        for (fit, outcome) in ended {
            match outcome {
                Outcome::Done(summary) => {
                    let runs = match fit.group {
                        StreamsOf::Tracks => &mut result.tracks,
                        StreamsOf::Mocks => &mut result.mocks,
                    };
                    runs.push(StudyRun {
                        folder: fit.folder.clone(),
                        name: fit.track.name.clone(),
                        sampler: fit.sampler(),
                        summary: *summary,
                    });
                }
                Outcome::Failed(reason) => result.failed.push(FailedRun {
                    of: Some(fit.group),
                    name: fit.track.name.clone(),
                    sampler: fit.sampler(),
                    reason,
                }),
                Outcome::Interrupted => result.interrupted = true,
            }
        }
        result
    }
}

fn failed_population(name: String, sampler: Sampler, reason: String) -> FailedRun {
    FailedRun {
        of: None,
        name,
        sampler,
        reason,
    }
}

/// Whether an error is that of one population or of the posterior of one of its streams, so that others can succeed.
fn is_of_the_population(error: &Error) -> bool {
    matches!(error, Error::Posterior { .. }) || is_of_the_sampler(error)
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
