//! One run in its folder, from beginning to end: what fits, bridges, mergers and populations share.

use super::folder::{IfExists, RunFolder, RunState};
use super::monitor::Monitor;
use super::versions::Versions;
use crate::config::{read, to_toml};
use crate::data::ObservedTrack;
use crate::error::Result;
use crate::inference::{Fit, FitSettings, StreamTarget, prior_draws, summarize};
use crate::posterior::{Summary, zarr};
use oblate_samplers::control::CheckpointPlan;
use oblate_samplers::output::Status;
use oblate_samplers::{Control, Run, Target};
use std::path::Path;

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

/// A run whose folder is ready.
pub(super) struct RunSession<'a> {
    folder: RunFolder,
    destination: Destination<'a>,
    versions: Versions,
    config_toml: String,
}

impl<'a> RunSession<'a> {
    /// Makes the folder ready and writes the settings into it. `inputs` are the bytes that determine the result.
    ///
    /// # Errors
    /// As of [`RunFolder::prepare`].
    pub fn begin(
        destination: Destination<'a>,
        config_toml: String,
        inputs: &[&[u8]],
    ) -> Result<RunState<Self>> {
        let versions = Versions::new(inputs);
        let folder = match RunFolder::prepare(destination.folder, destination.if_exists, &versions)?
        {
            RunState::Finished(stored) => return Ok(RunState::Finished(stored)),
            RunState::Unfinished(folder) => folder,
        };
        folder.begin(&config_toml, &versions)?;
        Ok(RunState::Unfinished(Self {
            folder,
            destination,
            versions,
            config_toml,
        }))
    }

    /// As [`begin`](Self::begin), for a fit of a track. `inputs` are those beside the settings. A finished fit that may be extended
    /// ([`FitSettings::may_extend`]) is unfinished again.
    ///
    /// # Errors
    /// As of [`RunFolder::prepare`]; [`Error::Setting`](crate::Error::Setting) for settings that TOML cannot hold.
    pub fn begin_fit(
        destination: Destination<'a>,
        track: &ObservedTrack,
        settings: &FitSettings,
        inputs: &[&[u8]],
    ) -> Result<RunState<Self>> {
        let key = to_toml(&settings.without_extensions())?;
        let mut all = vec![key.as_bytes()];
        all.extend(inputs);
        let config_toml = to_toml(settings)?;
        match Self::begin(destination, config_toml.clone(), &all)? {
            RunState::Finished(stored) => {
                let folder = RunFolder::open(destination.folder)?;
                if stored.run.converged() || !settings.may_extend(&read(&folder.config())?) {
                    return Ok(RunState::Finished(stored));
                }
                Ok(RunState::Unfinished(Self {
                    folder,
                    destination,
                    versions: Versions::new(&all),
                    config_toml,
                }))
            }
            RunState::Unfinished(session) => {
                track.write(&session.folder.track())?;
                Ok(RunState::Unfinished(session))
            }
        }
    }

    /// The folder.
    pub fn folder(&self) -> &RunFolder {
        &self.folder
    }

    /// Where the run is written.
    pub fn destination(&self) -> Destination<'a> {
        self.destination
    }

    /// Works and writes the result. An interrupted run leaves its checkpoint and no summary.
    ///
    /// # Errors
    /// Those of `work`; [`Error::Io`](crate::Error::Io) or [`Error::Sampler`](crate::Error::Sampler) if a file cannot be written.
    pub fn complete(
        &self,
        target: &dyn Target,
        track: Option<&ObservedTrack>,
        monitor: &mut Monitor<'_>,
        work: impl FnOnce(&mut Control<'_>) -> Result<Run>,
        summarize: impl FnOnce(&Run, &str, &str) -> Summary,
    ) -> Result<Fit> {
        let run = self.work(monitor, work)?;
        let summary = summarize(&run, self.destination.command, &self.versions.input_hash);
        if run.status != Status::Interrupted {
            let prior = prior_draws(target, PRIOR_DRAWS, run.seed);
            let beside = zarr::Extras {
                track,
                prior: Some(&prior),
            };
            self.folder.finish(&run, &summary, beside)?;
            // Until here the settings of an extended run were those of its last result.
            self.folder.begin(&self.config_toml, &self.versions)?;
        }
        Ok(Fit { run, summary })
    }

    /// As [`complete`](Self::complete), for a fit of a track.
    ///
    /// # Errors
    /// As of [`complete`](Self::complete).
    pub fn complete_fit(
        &self,
        target: &StreamTarget,
        track: &ObservedTrack,
        monitor: &mut Monitor<'_>,
        work: impl FnOnce(&mut Control<'_>) -> Result<Run>,
    ) -> Result<Fit> {
        self.complete(target, Some(track), monitor, work, |run, command, hash| {
            summarize(target, track, run, command, hash)
        })
    }

    /// Runs a sampler under a monitor, with checkpoints in the folder and events in its log.
    fn work(
        &self,
        monitor: &mut Monitor<'_>,
        work: impl FnOnce(&mut Control<'_>) -> Result<Run>,
    ) -> Result<Run> {
        let (interrupt, max_wall) = (monitor.interrupt.clone(), monitor.max_wall);
        let plan = CheckpointPlan {
            path: self.folder.checkpoint(),
            every: monitor.checkpoint_every,
            resume: self.destination.if_exists == IfExists::Resume,
            config_hash: u64::from_str_radix(&self.versions.input_hash, 16).unwrap_or(0),
        };
        let mut observer = monitor.with_log(self.folder.log()?);
        let mut control = Control::new(&mut observer);
        control.interrupt = interrupt;
        control.budget.max_wall = max_wall;
        control.checkpoint = Some(plan);
        work(&mut control)
    }
}
