//! The run folder: its files, what is written when, how a folder that exists is treated, and reading a finished run back.

use super::log::Log;
use super::versions::Versions;
use crate::data::ObservedTrack;
use crate::error::{Error, Result};
use crate::inference::Fit;
use crate::posterior::{Summary, run_from_parts, zarr};
use oblate_samplers::Run;
use oblate_samplers::files::{TEMPORARY, write_atomically};
use oblate_samplers::output::{Method, Status};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// The file that is written last: a folder that has it holds a result.
pub const SUMMARY_FILE: &str = "summary.json";

const VERSIONS: &str = "versions.json";

/// A folder of one run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RunFolder {
    path: PathBuf,
}

/// How to treat a run folder that exists already.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum IfExists {
    /// It is an error.
    Refuse,
    /// It is replaced.
    Replace,
    /// A run with the same inputs is continued, or read back if it has finished.
    Resume,
}

/// What [`RunFolder::prepare`] finds or makes.
pub(super) enum RunState<Unfinished> {
    /// A run with the same inputs that ended by its stopping rule.
    Finished(Box<StoredRun>),
    /// A run to begin or to continue.
    Unfinished(Unfinished),
}

/// A run read back from its folder.
#[derive(Clone, Debug)]
pub struct StoredRun {
    /// The folder's name.
    pub name: String,
    /// Its `summary.json`.
    pub summary: Summary,
    /// The sampler's result, equal to the original in every bit.
    pub run: Run,
    /// `config.toml` as text.
    pub config: String,
}

impl From<Box<StoredRun>> for Fit {
    fn from(stored: Box<StoredRun>) -> Self {
        Self {
            run: stored.run,
            summary: stored.summary,
        }
    }
}

fn io(path: &Path, remedy: &'static str) -> impl FnOnce(std::io::Error) -> Error {
    let path = path.to_path_buf();
    move |source| Error::Io {
        path,
        source,
        remedy,
    }
}

impl RunFolder {
    /// Makes the folder of a run ready to be worked in.
    ///
    /// # Errors
    /// [`Error::Exists`] if there is one that must not be replaced; [`Error::OtherInputs`] if it is to be resumed and was made from other
    /// inputs; [`Error::Io`] or [`Error::Syntax`] if its files cannot be made, read or understood.
    pub(super) fn prepare(
        path: &Path,
        if_exists: IfExists,
        versions: &Versions,
    ) -> Result<RunState<Self>> {
        if if_exists != IfExists::Resume || Self::is_unstarted(path) {
            let folder = Self::create(path, if_exists == IfExists::Replace)?;
            return Ok(RunState::Unfinished(folder));
        }
        let folder = Self::open(path)?;
        if folder.read_versions()?.input_hash != versions.input_hash {
            return Err(Error::OtherInputs {
                path: path.to_path_buf(),
            });
        }
        if folder.finished() {
            let stored = folder.read()?;
            if stored.run.status == Status::Complete {
                return Ok(RunState::Finished(Box::new(stored)));
            }
        }
        Ok(RunState::Unfinished(folder))
    }

    /// Whether there is nothing at this path, or only files of a run that was killed before it had written its settings.
    #[must_use]
    pub fn is_unstarted(path: &Path) -> bool {
        let Ok(entries) = std::fs::read_dir(path) else {
            return !path.exists();
        };
        let leftover = |entry: std::io::Result<std::fs::DirEntry>| {
            entry.is_ok_and(|entry| {
                let name = entry.file_name();
                name == VERSIONS || name.to_string_lossy().starts_with(TEMPORARY)
            })
        };
        entries.into_iter().all(leftover)
    }

    /// Makes a new folder. With `force`, a run folder that exists is removed first; a folder of anything else never is.
    ///
    /// # Errors
    /// [`Error::Exists`] if something is there and `force` is false, or it is no run folder; [`Error::FolderInUse`] if a run works in it;
    /// [`Error::Io`] if the folder cannot be made.
    pub fn create(path: &Path, force: bool) -> Result<Self> {
        const REMEDY: &str = "choose a folder whose parent is writable";
        let folder = Self {
            path: path.to_path_buf(),
        };
        if !Self::is_unstarted(path) {
            // Only a run folder is removed, so that a mistyped path does no harm.
            let ours = folder.config().is_file() && folder.versions().is_file();
            if !(force && ours) {
                return Err(Error::Exists {
                    path: path.to_path_buf(),
                });
            }
            // The lock of the log fails if another run works here.
            drop(folder.log()?);
            std::fs::remove_dir_all(path).map_err(io(path, REMEDY))?;
        }
        std::fs::create_dir_all(path).map_err(io(path, REMEDY))?;
        Ok(folder)
    }

    /// Opens a run folder, finished or not.
    ///
    /// # Errors
    /// [`Error::Io`] if it has no `config.toml`.
    pub fn open(path: &Path) -> Result<Self> {
        let folder = Self {
            path: path.to_path_buf(),
        };
        std::fs::metadata(folder.config()).map_err(io(
            &folder.config(),
            "give a run folder, as fits and populations make them",
        ))?;
        Ok(folder)
    }

    /// The folder.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Path of the settings.
    #[must_use]
    pub fn config(&self) -> PathBuf {
        self.path.join("config.toml")
    }

    /// Path of the versions.
    #[must_use]
    pub fn versions(&self) -> PathBuf {
        self.path.join(VERSIONS)
    }

    /// Reads the versions.
    ///
    /// # Errors
    /// [`Error::Io`] or [`Error::Syntax`] if `versions.json` cannot be read or understood.
    pub fn read_versions(&self) -> Result<Versions> {
        let path = self.versions();
        let text = std::fs::read_to_string(&path)
            .map_err(io(&path, "restore the run folder from a copy"))?;
        serde_json::from_str(&text).map_err(|e| Error::Syntax {
            path,
            line: Some(e.line()),
            message: format!("not a version file ({e})"),
            remedy: "restore the run folder from a copy, or begin the run again",
        })
    }

    /// Path of the summary.
    #[must_use]
    pub fn summary(&self) -> PathBuf {
        self.path.join(SUMMARY_FILE)
    }

    /// Path of the track that was fitted; a population has none.
    #[must_use]
    pub fn track(&self) -> PathBuf {
        self.path.join("track.ecsv")
    }

    /// Reads the track that was fitted.
    ///
    /// # Errors
    /// [`Error::NotAFit`] if there is none; as of [`ObservedTrack::read`].
    pub fn read_track(&self) -> Result<ObservedTrack> {
        if !self.track().is_file() {
            return Err(Error::NotAFit {
                path: self.path.clone(),
            });
        }
        ObservedTrack::read(&self.track())
    }

    /// Path of the draws.
    #[must_use]
    pub fn posterior(&self) -> PathBuf {
        self.path.join("posterior.zarr")
    }

    /// Path of the checkpoint.
    #[must_use]
    pub fn checkpoint(&self) -> PathBuf {
        self.path.join("checkpoint")
    }

    /// Path of the run folder of the coarse fit that came first.
    #[must_use]
    pub fn coarse(&self) -> PathBuf {
        self.path.join("coarse")
    }

    /// Path of a figure, an SVG file.
    #[must_use]
    pub fn figure(&self, name: &str) -> PathBuf {
        self.path.join(format!("{name}.svg"))
    }

    /// The log, open for appending.
    ///
    /// # Errors
    /// [`Error::FolderInUse`] if another run has it open; [`Error::Io`] if it cannot be opened.
    pub fn log(&self) -> Result<Log> {
        Log::append_to(&self.path.join("log.jsonl"))
    }

    /// Whether the run has written its summary, its last file.
    #[must_use]
    pub fn finished(&self) -> bool {
        self.summary().is_file()
    }

    /// Writes `config.toml` and `versions.json` before the work starts.
    ///
    /// # Errors
    /// [`Error::Sampler`] with the file's name if one cannot be written.
    pub fn begin(&self, config_toml: &str, versions: &Versions) -> Result<()> {
        self.json(&self.versions(), versions)?;
        write_atomically(&self.config(), config_toml.as_bytes())?;
        Ok(())
    }

    /// Writes the draws, then the summary, so that a folder with a summary is complete, then removes the checkpoint. The checkpoint stays
    /// if the run can be continued: because its time was up, or because it is a tempered one that has not converged.
    ///
    /// # Errors
    /// As of [`zarr::write`]; [`Error::Sampler`] or [`Error::Io`] if the summary cannot be written or the checkpoint
    /// not removed.
    pub fn finish(&self, run: &Run, summary: &Summary, beside: zarr::Extras<'_>) -> Result<()> {
        zarr::write(&self.posterior(), run, beside)?;
        self.json(&self.summary(), summary)?;
        if run.status != Status::Complete || (run.method == Method::PtHmc && !run.converged()) {
            return Ok(());
        }
        let checkpoint = self.checkpoint();
        for path in [
            oblate_samplers::checkpoint::previous(&checkpoint),
            checkpoint,
        ] {
            if path.exists() {
                std::fs::remove_file(&path)
                    .map_err(io(&path, "remove it by hand; the run itself is complete"))?;
            }
        }
        Ok(())
    }

    /// Reads a finished run back.
    ///
    /// # Errors
    /// [`Error::Io`] if the run has not finished or a file is missing; [`Error::Syntax`] with the line if
    /// `summary.json` cannot be understood; [`Error::MixedFolder`] if its parts do not belong together.
    pub fn read(&self) -> Result<StoredRun> {
        let text = std::fs::read_to_string(self.summary())
            .map_err(io(&self.summary(), "finish the run first"))?;
        let summary: Summary = serde_json::from_str(&text).map_err(|e| Error::Syntax {
            path: self.summary(),
            line: Some(e.line()),
            message: format!("not a summary ({e})"),
            remedy: "restore the file, or fit again with this version of oblate",
        })?;
        let run = run_from_parts(&summary, zarr::read(&self.posterior())?)?;
        let config = std::fs::read_to_string(self.config())
            .map_err(io(&self.config(), "restore the run folder from a copy"))?;
        Ok(StoredRun {
            name: self
                .path
                .file_name()
                .map_or_else(String::new, |n| n.to_string_lossy().into_owned()),
            summary,
            run,
            config,
        })
    }

    fn json(&self, path: &Path, value: &impl Serialize) -> Result<()> {
        let mut text = serde_json::to_vec_pretty(value)
            .map_err(|e| io(path, "report this as a bug")(std::io::Error::other(e)))?;
        text.push(b'\n');
        write_atomically(path, &text)?;
        Ok(())
    }
}
