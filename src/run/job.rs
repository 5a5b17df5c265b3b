//! A fit, or what follows one, from its inputs to its folder: the steps that all of them share.

use super::fit::{Existing, close, watched};
use super::{Opened, RunFolder, StoredRun, Versions, Watch, open_or_create};
use crate::config::{FitConfig, read, text};
use crate::data::ObservedTrack;
use crate::error::Result;
use crate::inference::StreamTarget;
use crate::posterior::Summary;
use oblate_samplers::output::Status;
use oblate_samplers::{Control, Run};
use std::path::Path;

/// Where a result goes, and how.
pub(super) struct Job<'a> {
    /// The run folder.
    pub out: &'a Path,
    /// What to do if it is there.
    pub existing: Existing,
    /// The command line.
    pub command: &'a str,
}

/// A job whose folder is ready.
pub(super) enum Begun {
    /// It has finished already, with the same inputs.
    Finished(Box<Run>, Box<Summary>),
    /// It waits for work.
    Waiting(Begin),
}

/// A folder that waits for its result.
pub(super) struct Begin {
    pub folder: RunFolder,
    versions: Versions,
    config_toml: String,
}

impl Job<'_> {
    /// Works on a target into the folder. `inputs` are all that decides the result beside the settings; a folder that has
    /// finished with the same ones is read back under [`Existing::Resume`].
    ///
    /// # Errors
    /// What the settings, the folder, the files and the work refuse.
    pub fn run(
        &self,
        target: &StreamTarget,
        track: &ObservedTrack,
        config: &FitConfig,
        inputs: &[&[u8]],
        watch: &mut Watch<'_>,
        work: impl FnOnce(&mut Control<'_>) -> Result<Run>,
    ) -> Result<(Run, Summary)> {
        match self.begin(track, config, inputs)? {
            Begun::Finished(run, summary) => Ok((*run, *summary)),
            Begun::Waiting(begin) => self.work(&begin, target, track, watch, work),
        }
    }

    /// Makes the folder ready. One that has finished is, too, if its run may go on now ([`FitConfig::goes_on`]).
    ///
    /// # Errors
    /// What the settings, the folder and the files refuse.
    pub fn begin(
        &self,
        track: &ObservedTrack,
        config: &FitConfig,
        inputs: &[&[u8]],
    ) -> Result<Begun> {
        let drawing = text(&config.drawing())?;
        let mut all = vec![drawing.as_bytes()];
        all.extend(inputs);
        let versions = Versions::of(&all);
        let config_toml = text(config)?;
        let folder = match open_or_create(self.out, self.existing, &versions)? {
            Opened::Finished(run, summary) => {
                let folder = RunFolder::open(self.out)?;
                if run.converged() || !config.goes_on(&read(&folder.config())?) {
                    return Ok(Begun::Finished(run, summary));
                }
                folder
            }
            Opened::Folder(folder) => {
                folder.begin(&config_toml, &versions)?;
                track.write(&folder.track())?;
                folder
            }
        };
        Ok(Begun::Waiting(Begin {
            folder,
            versions,
            config_toml,
        }))
    }

    /// Fills it.
    ///
    /// # Errors
    /// What the files and the work refuse.
    pub fn work(
        &self,
        begin: &Begin,
        target: &StreamTarget,
        track: &ObservedTrack,
        watch: &mut Watch<'_>,
        work: impl FnOnce(&mut Control<'_>) -> Result<Run>,
    ) -> Result<(Run, Summary)> {
        let Begin {
            folder,
            versions,
            config_toml,
        } = begin;
        let run = watched(folder, versions, watch, self.existing, work)?;
        let summary = close(folder, target, track, &run, versions, self.command)?;
        if run.status != Status::Interrupted {
            // Until now those of a run that goes on were what its last result is by.
            folder.begin(config_toml, versions)?;
        }
        Ok((run, summary))
    }
}

/// A finished fit with what it was a fit of.
pub(super) struct Fit {
    pub stored: StoredRun,
    pub track: ObservedTrack,
    pub config: FitConfig,
}

impl Fit {
    /// Reads a run folder.
    ///
    /// # Errors
    /// What the folder refuses; [`Error::Mismatch`](crate::error::Error::Mismatch) if it is not a fit.
    pub fn read(path: &Path) -> Result<Self> {
        let folder = RunFolder::open(path)?;
        let stored = folder.read()?;
        Ok(Self {
            track: folder.read_track()?,
            config: read(&folder.config())?,
            stored,
        })
    }
}
