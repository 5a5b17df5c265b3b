//! One run in its folder, from beginning to end: the common part of fits, bridges, mergers and populations.

use super::folder::{RunFolder, StoredRun};
use super::locked::{Beginning, IfExists, LockedFolder, RunState};
use super::monitor::Monitor;
use super::versions::{Versions, marked};
use crate::config::{parse, to_toml};
use crate::data::ObservedTrack;
use crate::error::{Error, OutputFault, Result};
use crate::inference::{Fit, FitSettings, StreamTarget, prior_draws, summarize};
use crate::posterior::{Summary, zarr};
use oblate_samplers::control::CheckpointPlan;
use oblate_samplers::output::{Method, Status};
use oblate_samplers::{Control, Event, Run, Target};
use std::path::{Component, Path, PathBuf};

/// Number of prior draws that are kept with those of the posterior.
const PRIOR_DRAWS: usize = 2_000;

/// Where a run is written.
#[derive(Clone, Copy, Debug)]
pub struct Destination<'a> {
    /// The run folder.
    pub folder: &'a Path,
    /// How to treat it if it exists.
    pub if_exists: IfExists,
    /// The command line, for the summary.
    pub command: &'a str,
}

impl Destination<'_> {
    /// Checks that the folder neither is, nor is in, nor holds one of the runs that are read for this one: with
    /// [`Replace`](IfExists::Replace) they would be removed.
    ///
    /// # Errors
    /// [`Error::OutputIsInput`] if it does.
    pub(super) fn is_apart_from(&self, inputs: &[PathBuf]) -> Result<()> {
        let Some(out) = real_path(self.folder) else {
            return Ok(());
        };
        let mut inputs = (inputs.iter()).filter_map(|path| std::fs::canonicalize(path).ok());
        if inputs.any(|input| input.starts_with(&out) || out.starts_with(&input)) {
            return Err(Error::OutputIsInput {
                path: self.folder.to_path_buf(),
            });
        }
        Ok(())
    }

    /// Checks that none of the run folders that it will hold is there already, if that is an error: before the first run, not after it.
    ///
    /// # Errors
    /// [`Error::Exists`] with the first one that is there.
    pub(super) fn may_hold(&self, folders: &[PathBuf]) -> Result<()> {
        let refused = self.if_exists == IfExists::Refuse;
        let mut there = folders.iter().filter(|path| RunFolder::open(path).is_ok());
        match there.next().filter(|_| refused) {
            Some(path) => Err(Error::Exists { path: path.clone() }),
            None => Ok(()),
        }
    }

    /// Checks that the folder, which will hold run folders, is none itself.
    ///
    /// # Errors
    /// [`Error::OutputPath`] if it is one; [`Error::Io`] if it cannot be read.
    pub(super) fn is_no_run(&self) -> Result<()> {
        is_no_run(self.folder)
    }
}

/// Checks that a folder which will hold run folders is none itself.
///
/// # Errors
/// [`Error::OutputPath`] if it is one; [`Error::Io`] if it cannot be read.
pub(super) fn is_no_run(path: &Path) -> Result<()> {
    let is_run = marked(path).map_err(Error::io(path, "check that the folder is readable"))?;
    if is_run {
        return Err(Error::OutputPath {
            path: path.to_path_buf(),
            fault: OutputFault::RunFolder,
        });
    }
    Ok(())
}

/// The path without links, also of what does not exist yet: that of its nearest ancestor that exists, and the rest. `None` if no ancestor
/// can be read.
fn real_path(path: &Path) -> Option<PathBuf> {
    let path = std::path::absolute(path).ok()?;
    let (existing, mut real) = path
        .ancestors()
        .find_map(|ancestor| Some((ancestor, std::fs::canonicalize(ancestor).ok()?)))?;
    for part in path.strip_prefix(existing).ok()?.components() {
        // A folder that is not there yet is no link, so that its parent is the one above it.
        match part {
            Component::ParentDir => {
                real.pop();
            }
            part => real.push(part),
        }
    }
    Some(real)
}

/// Whether a fit that ended by its stopping rule under the settings `before` is sampled further under these.
pub(super) fn goes_on(
    settings: &FitSettings,
    before: &FitSettings,
    converged: bool,
    method: Method,
) -> bool {
    !converged && settings.may_go_on(before, method)
}

/// The versions of a fit. `inputs` are those beside the settings.
///
/// # Errors
/// [`Error::Setting`](crate::Error::Setting) for settings that TOML cannot hold.
pub(super) fn versions_of_fit(settings: &FitSettings, inputs: &[&[u8]]) -> Result<Versions> {
    let key = to_toml(&settings.without_extensions())?;
    let mut all = vec![key.as_bytes()];
    all.extend(inputs);
    Ok(Versions::new(&all))
}

/// A run whose folder is prepared and locked by this process.
pub(super) struct RunSession<'a> {
    folder: LockedFolder,
    destination: Destination<'a>,
    beginning: Beginning<'a>,
}

impl<'a> RunSession<'a> {
    /// Prepares the folder and writes the settings into it. `inputs` are the bytes that determine the result.
    ///
    /// # Errors
    /// As of [`LockedFolder::prepare`] and [`LockedFolder::begin`].
    pub fn begin(
        destination: Destination<'a>,
        config_toml: String,
        inputs: &[&[u8]],
    ) -> Result<RunState<Self>> {
        let beginning = Beginning {
            config_toml,
            versions: Versions::new(inputs),
            track: None,
        };
        Self::begin_unless(destination, beginning, &|_| Ok(false))
    }

    /// As [`begin`](Self::begin), for a fit of a track. `inputs` are those beside the settings. A finished fit that may go on
    /// ([`FitSettings::may_go_on`]) is unfinished again.
    ///
    /// # Errors
    /// As of [`begin`](Self::begin); [`Error::Setting`](crate::Error::Setting) for settings that TOML cannot hold.
    pub fn begin_fit(
        destination: Destination<'a>,
        track: &'a ObservedTrack,
        settings: &FitSettings,
        inputs: &[&[u8]],
    ) -> Result<RunState<Self>> {
        let beginning = Beginning {
            config_toml: to_toml(settings)?,
            versions: versions_of_fit(settings, inputs)?,
            track: Some(track),
        };
        Self::begin_unless(destination, beginning, &|stored| {
            let before = parse(&stored.config, destination.folder)?;
            let (converged, method) = (stored.run.converged(), stored.run.method);
            Ok(goes_on(settings, &before, converged, method))
        })
    }

    fn begin_unless(
        destination: Destination<'a>,
        beginning: Beginning<'a>,
        goes_on: &dyn Fn(&StoredRun) -> Result<bool>,
    ) -> Result<RunState<Self>> {
        let (path, if_exists) = (destination.folder, destination.if_exists);
        let folder = match LockedFolder::prepare(path, if_exists, &beginning.versions, goes_on)? {
            RunState::Finished(stored) => return Ok(RunState::Finished(stored)),
            RunState::Unfinished(folder) => folder,
        };
        folder.begin(&beginning)?;
        Ok(RunState::Unfinished(Self {
            folder,
            destination,
            beginning,
        }))
    }

    /// The folder.
    pub fn folder(&self) -> &RunFolder {
        self.folder.folder()
    }

    /// Where the run is written.
    pub fn destination(&self) -> Destination<'a> {
        self.destination
    }

    /// Works and writes the result. An interrupted run leaves its checkpoint and no new result.
    ///
    /// # Errors
    /// Those of `work`; [`Error::Unwritten`](crate::Error::Unwritten) if the result cannot be written.
    pub fn complete(
        &self,
        target: &dyn Target,
        track: Option<&ObservedTrack>,
        monitor: &mut Monitor<'_>,
        work: impl FnOnce(&mut Control<'_>) -> Result<Run>,
        summarize: impl FnOnce(&Run, &mut Monitor<'_>, &str, &str) -> Summary,
    ) -> Result<Fit> {
        let run = self.work(monitor, work)?;
        let hash = &self.beginning.versions.input_hash;
        let summary = summarize(&run, monitor, self.destination.command, hash);
        self.finish(target, track, run, summary)
    }

    /// Writes the result of a run that was not interrupted.
    fn finish(
        &self,
        target: &dyn Target,
        track: Option<&ObservedTrack>,
        run: Run,
        mut summary: Summary,
    ) -> Result<Fit> {
        if run.status != Status::Interrupted {
            let prior = prior_draws(target, PRIOR_DRAWS, run.seed);
            let extras = zarr::Extras {
                track,
                prior: Some(&prior),
                density: Some(target.prior()),
            };
            let written = self.folder.finish(&run, summary, extras, &self.beginning);
            summary = written.map_err(|source| Error::Unwritten {
                source: Box::new(source),
            })?;
        }
        Ok(Fit { run, summary })
    }

    /// As [`complete`](Self::complete), for a fit of a track. `stage` is told when the error of the model is measured, after the work.
    ///
    /// # Errors
    /// As of [`complete`](Self::complete); [`Error::Sampler`](crate::Error::Sampler) if it is interrupted while the error of the model is
    /// measured: resumed, it goes on from the end of its work.
    pub fn complete_fit(
        &self,
        target: &StreamTarget,
        track: &ObservedTrack,
        monitor: &mut Monitor<'_>,
        stage: impl FnOnce(&mut Monitor<'_>),
        work: impl FnOnce(&mut Control<'_>) -> Result<Run>,
    ) -> Result<Fit> {
        let run = self.work(monitor, work)?;
        if run.status != Status::Interrupted {
            stage(monitor);
        }
        let (command, hash) = (
            self.destination.command,
            &self.beginning.versions.input_hash,
        );
        let advanced = &mut |done, of| monitor.advanced(done, of);
        let summary = summarize(target, track, &run, command, hash, advanced)?;
        self.finish(target, Some(track), run, summary)
    }

    /// Runs a sampler under a monitor, with checkpoints in the folder and events in its log.
    fn work(
        &self,
        monitor: &mut Monitor<'_>,
        work: impl FnOnce(&mut Control<'_>) -> Result<Run>,
    ) -> Result<Run> {
        let (interrupt, max_wall) = (monitor.interrupt.clone(), monitor.max_wall);
        let plan = CheckpointPlan {
            path: self.folder().checkpoint(),
            every: monitor.checkpoint_every,
            resume: self.destination.if_exists == IfExists::Resume,
            config_hash: u64::from_str_radix(&self.beginning.versions.input_hash, 16).unwrap_or(0),
        };
        let log = self.folder.log();
        if !log.locked() {
            let message = "this file system has no locks: let no other run work in the same folder";
            let message = message.to_owned();
            // A `Break` is ignored here; the observer can stop the run at the next event.
            let _ = monitor.observer.event(&Event::Warning { message });
        }
        let mut observer = monitor.with_log(log);
        let mut control = Control::new(&mut observer);
        control.interrupt = interrupt;
        control.budget.max_wall = max_wall;
        control.checkpoint = Some(plan);
        work(&mut control)
    }
}
