//! The run folder for readers: its files, and a finished run read back from them.

use super::contents::{
    CHECKPOINT_FILE, COARSE_FOLDER, CONFIG_FILE, DENSITY_FILE, LOG_FILE, POSTERIOR_FOLDER,
    RESULT_FOLDER, STREAMS_FILE, SUMMARY_FILE, TRACK_FILE,
};
use super::versions::{FOLDER_FORMAT, MAX_VERSIONS_BYTES, VERSIONS_FILE, Versions};
use crate::config::parse;
use crate::data::ObservedTrack;
use crate::error::{Error, OutputFault, Result};
use crate::inference::{Fit, FitSettings};
use crate::posterior::{Summary, assemble_run, zarr};
use crate::report::FigureFormat;
use oblate_samplers::{Run, read};
use std::fs;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// Largest size of the settings.
const MAX_BYTES: u64 = 1 << 20;

/// A folder of one run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RunFolder {
    path: PathBuf,
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

impl StoredRun {
    /// The settings of a fit in this folder; `None` of a population.
    ///
    /// # Errors
    /// [`Error::Syntax`] if its settings cannot be read.
    pub fn fit_settings(&self, folder: &RunFolder) -> Result<Option<FitSettings>> {
        // A population has no track.
        let is_fit = folder.track().is_file();
        let settings = is_fit.then(|| parse::<FitSettings>(&self.config, &folder.config()));
        settings.transpose()
    }
}

/// Names of runs that are shown together: those of their folders, or the whole path where two folders have the same name.
#[must_use]
pub fn distinct_names(folders: &[PathBuf], runs: &[&StoredRun]) -> Vec<String> {
    let name = |(run, path): (&&StoredRun, &PathBuf)| {
        let namesakes = runs.iter().filter(|other| other.name == run.name);
        if namesakes.count() > 1 {
            path.display().to_string()
        } else {
            run.name.clone()
        }
    };
    runs.iter().zip(folders).map(name).collect()
}

impl From<Box<StoredRun>> for Fit {
    fn from(stored: Box<StoredRun>) -> Self {
        Self {
            run: stored.run,
            summary: stored.summary,
        }
    }
}

impl RunFolder {
    /// The folder at a path, whether or not there is one.
    ///
    /// # Errors
    /// [`Error::OutputPath`] for an empty path, which would be the working directory.
    pub(super) fn at(path: &Path) -> Result<Self> {
        // Without a slash at the end, so that a link is seen as one.
        let path: PathBuf = path.components().collect();
        if path.as_os_str().is_empty() {
            let fault = OutputFault::Empty;
            return Err(Error::OutputPath { path, fault });
        }
        Ok(Self { path })
    }

    /// Opens a run folder, finished or not.
    ///
    /// # Errors
    /// [`Error::Io`] if it has no `config.toml`.
    pub fn open(path: &Path) -> Result<Self> {
        let folder = Self::at(path)?;
        fs::metadata(folder.config()).map_err(Error::io(
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
        self.piece(CONFIG_FILE)
    }

    /// Path of the versions.
    #[must_use]
    pub fn versions(&self) -> PathBuf {
        self.piece(VERSIONS_FILE)
    }

    /// Path of the summary.
    #[must_use]
    pub fn summary(&self) -> PathBuf {
        self.piece(SUMMARY_FILE)
    }

    /// Path of the draws.
    #[must_use]
    pub fn posterior(&self) -> PathBuf {
        self.piece(POSTERIOR_FOLDER)
    }

    /// Path of a piece of the result. A result is replaced in one step, the renaming of its folder; the pieces are then
    /// moved from there to their paths. As long as a piece is in that folder, it is the one that belongs to the others.
    fn piece(&self, name: &str) -> PathBuf {
        let moving = self.path.join(RESULT_FOLDER).join(name);
        if moving.exists() {
            return moving;
        }
        self.path.join(name)
    }

    /// Path of the track that was fitted; a population has none.
    #[must_use]
    pub fn track(&self) -> PathBuf {
        self.path.join(TRACK_FILE)
    }

    /// Path of the checkpoint.
    #[must_use]
    pub fn checkpoint(&self) -> PathBuf {
        self.path.join(CHECKPOINT_FILE)
    }

    /// Path of the log.
    #[must_use]
    pub fn log(&self) -> PathBuf {
        self.path.join(LOG_FILE)
    }

    /// Path of the run folder of the coarse fit that came first.
    #[must_use]
    pub fn coarse(&self) -> PathBuf {
        self.path.join(COARSE_FOLDER)
    }

    /// Path of the table of a population's density of q.
    #[must_use]
    pub fn density(&self) -> PathBuf {
        self.path.join(DENSITY_FILE)
    }

    /// Path of the table of a population's streams.
    #[must_use]
    pub fn streams(&self) -> PathBuf {
        self.path.join(STREAMS_FILE)
    }

    /// Path of a figure.
    #[must_use]
    pub fn figure(&self, name: &str, format: FigureFormat) -> PathBuf {
        self.path.join(format!("{name}.{}", format.name()))
    }

    /// Reads the versions.
    ///
    /// # Errors
    /// [`Error::Io`] or [`Error::Syntax`] if `versions.json` cannot be read or understood.
    pub fn read_versions(&self) -> Result<Versions> {
        let path = self.versions();
        let text = read::text(&path, MAX_VERSIONS_BYTES)
            .map_err(Error::io(&path, "restore the run folder from a copy"))?;
        let not_understood = |line: Option<usize>, message: String| Error::Syntax {
            path: path.clone(),
            line,
            message,
            remedy: "restore the run folder from a copy, or begin the run again",
        };
        let versions: Versions = serde_json::from_str(&text)
            .map_err(|e| not_understood(Some(e.line()), format!("not a version file ({e})")))?;
        if versions.format != FOLDER_FORMAT {
            let message = format!(
                "format {} of run folders, and this version of oblate has {FOLDER_FORMAT}",
                versions.format
            );
            return Err(not_understood(None, message));
        }
        Ok(versions)
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

    /// Whether the run has written a result.
    #[must_use]
    pub fn finished(&self) -> bool {
        self.summary().is_file()
    }

    /// Reads a finished run back.
    ///
    /// # Errors
    /// [`Error::Io`] if the run has not finished or a file is missing; [`Error::Syntax`] with the line if
    /// `summary.json` cannot be understood; [`Error::Checksum`] if the draws are damaged or of another run; [`Error::Array`] if an
    /// array cannot be read; [`Error::InFile`] if the parts do not belong together.
    pub fn read(&self) -> Result<StoredRun> {
        loop {
            let before = self.state();
            let read = self.read_once();
            // Otherwise a run has replaced its result meanwhile, and the files read were not all of one.
            if self.state() == before {
                return read;
            }
        }
    }

    /// Where the pieces of the result are, which files they are, and when they were written.
    fn state(&self) -> [(PathBuf, Option<(u64, SystemTime)>); 3] {
        [self.summary(), self.posterior(), self.config()].map(|path| {
            let found = fs::metadata(&path).and_then(|m| Ok((number(&m), m.modified()?)));
            (path, found.ok())
        })
    }

    fn read_once(&self) -> Result<StoredRun> {
        let summary = Summary::read(&self.summary())?;
        let path = self.posterior();
        let remedy = "restore the run folder from a whole copy, or run again";
        let entries = zarr::entries(&path).map_err(Error::io(&path, remedy))?;
        let agrees = match &summary.posterior {
            Some(checksum) => checksum
                .agrees(&path, &entries)
                .map_err(Error::io(&path, remedy))?,
            None => false,
        };
        if !agrees {
            return Err(Error::Checksum { path });
        }
        let run = assemble_run(&summary, zarr::read(&path)?).map_err(|e| Error::InFile {
            path: self.path.clone(),
            line: None,
            source: Box::new(e),
        })?;
        let config = self.config();
        let config = read::text(&config, MAX_BYTES)
            .map_err(Error::io(&config, "restore the run folder from a copy"))?;
        Ok(StoredRun {
            name: self.name(),
            summary,
            run,
            config,
        })
    }

    /// The folder's name, also of `.` and `..`.
    fn name(&self) -> String {
        let own = self.path.file_name().map(ToOwned::to_owned);
        let real = || {
            fs::canonicalize(&self.path)
                .ok()?
                .file_name()
                .map(ToOwned::to_owned)
        };
        own.or_else(real)
            .map_or_else(String::new, |name| name.to_string_lossy().into_owned())
    }
}

/// The number of a file on its file system; zero where there is none.
fn number(file: &fs::Metadata) -> u64 {
    #[cfg(unix)]
    {
        std::os::unix::fs::MetadataExt::ino(file)
    }
    #[cfg(not(unix))]
    {
        let _ = file;
        0
    }
}
