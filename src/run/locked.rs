//! The run folder for the one process that works in it: how an existing folder is treated, when files are written, and
//! how the work of a killed process is completed.

use super::contents::{
    CHECKPOINT_FILE, CONFIG_FILE, Contents, OLD_POSTERIOR_FOLDER, POSTERIOR_FOLDER, RESULT_FILES,
    RESULT_FOLDER, SUMMARY_FILE, TRACK_FILE, is_leftover, is_mount_point,
};
use super::folder::{RunFolder, StoredRun};
use super::log::Log;
use super::versions::{VERSIONS_FILE, Versions};
use crate::data::ObservedTrack;
use crate::error::{Error, OutputFault, Result};
use crate::posterior::{Summary, zarr};
use oblate_samplers::Run;
use oblate_samplers::bridge::COARSE_RUN_CHECKS;
use oblate_samplers::checkpoint;
use oblate_samplers::files::{TEMPORARY, folder_of, sync_folder, write_atomically};
use oblate_samplers::nested::check_names::{TARGET_ESS, TARGET_LN_Z_ERROR};
use oblate_samplers::output::{Method, Status};
use serde::Serialize;
use std::fs;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

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

/// What [`LockedFolder::prepare`] finds or makes.
pub(super) enum RunState<Unfinished> {
    /// A run with the same inputs that ended by its stopping rule.
    Finished(Box<StoredRun>),
    /// A run to begin or to continue.
    Unfinished(Unfinished),
}

/// A run folder that this process alone writes to: the log is locked as long as this value exists.
#[derive(Debug)]
pub struct LockedFolder {
    folder: RunFolder,
    log: Log,
}

/// What a run writes before it works.
#[derive(Clone, Debug)]
pub struct Beginning<'a> {
    /// `config.toml`.
    pub config_toml: String,
    /// `versions.json`.
    pub versions: Versions,
    /// `track.ecsv`; a population has none.
    pub track: Option<&'a ObservedTrack>,
}

const WRITABLE: &str = "check that the run folder exists, is writable and has space left";

impl LockedFolder {
    /// Prepares the folder of a run. A finished run with the same inputs is read back, unless it `goes_on`.
    ///
    /// # Errors
    /// As of [`create`](Self::create); [`Error::OtherInputs`] if the folder is to be resumed and was made from other inputs; [`Error::Io`] or
    /// [`Error::Syntax`] if its files cannot be made, read or understood.
    pub(super) fn prepare(
        path: &Path,
        if_exists: IfExists,
        versions: &Versions,
        goes_on: &dyn Fn(&StoredRun) -> Result<bool>,
    ) -> Result<RunState<Self>> {
        let folder = RunFolder::at(path)?;
        let contents = look(folder.path())?;
        if if_exists != IfExists::Resume || !contents.is_started() {
            let force = if_exists == IfExists::Replace;
            return Ok(RunState::Unfinished(Self::create(path, force)?));
        }
        let finished = || -> Result<Option<StoredRun>> {
            if folder.read_versions()?.input_hash != versions.input_hash {
                return Err(Error::OtherInputs {
                    path: path.to_path_buf(),
                });
            }
            if !folder.finished() {
                return Ok(None);
            }
            let stored = folder.read()?;
            let over = stored.run.status == Status::Complete && !goes_on(&stored)?;
            Ok(over.then_some(stored))
        };
        let found = finished()?;
        let tidy = |stored: &StoredRun| is_tidy(&contents, &stored.run);
        let log = match found {
            Some(stored) if tidy(&stored) => return Ok(RunState::Finished(Box::new(stored))),
            None => Log::append_to(&folder.log())?,
            // Left-over files do no harm where nothing can be written, or while another process works.
            Some(stored) => match Log::append_to(&folder.log()) {
                Ok(log) => log,
                Err(_) => return Ok(RunState::Finished(Box::new(stored))),
            },
        };
        let locked = Self {
            folder: folder.clone(),
            log,
        };
        locked.tidy()?;
        if let Some(stored) = finished()? {
            locked.remove_checkpoint_of(&stored.run)?;
            return Ok(RunState::Finished(Box::new(stored)));
        }
        // The draws will be replaced: what else is in their folder must not be lost with them.
        let draws = Contents::of(folder.path())?.part(|name| name == POSTERIOR_FOLDER);
        refuse(folder.path(), draws.fault())?;
        Ok(RunState::Unfinished(locked))
    }

    /// Makes a new folder, or takes an empty one. With `force`, the files of a run that is there are removed first, if there is nothing else.
    ///
    /// # Errors
    /// [`Error::Exists`] if a run is there and `force` is false; [`Error::OutputPath`] if there is anything that no run writes, or the folder
    /// must not be cleared; [`Error::FolderInUse`] if a run works in it; [`Error::Io`] if the folder cannot be made.
    pub fn create(path: &Path, force: bool) -> Result<Self> {
        let folder = RunFolder::at(path)?;
        // Before the lock, whose file is the first that is written; and again with it, because another process may have come first.
        admitted(folder.path(), force)?;
        make(folder.path())?;
        let log = Log::append_to(&folder.log())?;
        let old = admitted(folder.path(), force)?;
        let coarse = RunFolder::at(&folder.coarse())?;
        if old.is_started() && coarse.log().is_file() {
            // Another process may work in it alone.
            drop(Log::append_to(&coarse.log())?);
        }
        old.remove(folder.path())?;
        log.clear()?;
        Ok(Self { folder, log })
    }

    /// The folder.
    #[must_use]
    pub fn folder(&self) -> &RunFolder {
        &self.folder
    }

    /// The log.
    #[must_use]
    pub fn log(&self) -> &Log {
        &self.log
    }

    /// Writes what is known before the work starts, the marker first. Nothing where there is a result: its settings stay with it until
    /// it is replaced.
    ///
    /// # Errors
    /// [`Error::Sampler`] with the file's name if one cannot be written.
    pub fn begin(&self, beginning: &Beginning<'_>) -> Result<()> {
        if self.folder.finished() {
            return Ok(());
        }
        let path = self.folder.path();
        json(&path.join(VERSIONS_FILE), &beginning.versions)?;
        write_atomically(&path.join(CONFIG_FILE), beginning.config_toml.as_bytes())?;
        match beginning.track {
            Some(track) => track.write(&path.join(TRACK_FILE)),
            None => Ok(()),
        }
    }

    /// Writes the result, which replaces another one in one step: first all of it into a folder of its own, synced;
    /// this folder is then renamed, which is the step; then the pieces are moved to their paths. Last, the checkpoint
    /// is removed, unless the run can be continued. Returns the summary, with the checksum of the draws.
    ///
    /// # Errors
    /// As of [`zarr::write`]; [`Error::Sampler`] or [`Error::Io`] if another file cannot be written, or the checkpoint not removed.
    pub fn finish(
        &self,
        run: &Run,
        summary: Summary,
        extras: zarr::Extras<'_>,
        beginning: &Beginning<'_>,
    ) -> Result<Summary> {
        let path = self.folder.path();
        let fresh = temporary_folder(path).map_err(Error::io(path, WRITABLE))?;
        let draws = fresh.path().join(POSTERIOR_FOLDER);
        zarr::write(&draws, run, extras)?;
        let checksum = zarr::entries(&draws)
            .and_then(|entries| zarr::Checksum::of(&draws, &entries))
            .map_err(Error::io(&draws, WRITABLE))?;
        let summary = Summary {
            posterior: Some(checksum),
            ..summary
        };
        json(&fresh.path().join(VERSIONS_FILE), &beginning.versions)?;
        let config = fresh.path().join(CONFIG_FILE);
        write_atomically(&config, beginning.config_toml.as_bytes())?;
        json(&fresh.path().join(SUMMARY_FILE), &summary)?;
        let result = path.join(RESULT_FOLDER);
        fs::rename(fresh.path(), &result).map_err(Error::io(&result, WRITABLE))?;
        // It has another name now, under which it must not be removed.
        let _ = fresh.keep();
        sync_folder(path).map_err(Error::io(path, WRITABLE))?;
        self.place_result()?;
        self.remove_checkpoint_of(run)?;
        Ok(summary)
    }

    /// Completes the work of a killed process: pieces of a result are moved to their paths, and temporary files are
    /// removed.
    fn tidy(&self) -> Result<()> {
        let path = self.folder.path();
        if Contents::of(path)?.has(|name| name == RESULT_FOLDER) {
            self.place_result()?;
        }
        Contents::of(path)?.leftovers().remove(path)
    }

    /// Moves the pieces of the result to their paths. It can be killed at any time, and is then done again.
    fn place_result(&self) -> Result<()> {
        let path = self.folder.path();
        let result = path.join(RESULT_FOLDER);
        let rename = |from: &Path, to: &Path| match fs::rename(from, to) {
            Err(e) if e.kind() != ErrorKind::NotFound => Err(Error::io(to, WRITABLE)(e)),
            _ => Ok(()),
        };
        let (new, place) = (result.join(POSTERIOR_FOLDER), path.join(POSTERIOR_FOLDER));
        if new.exists() {
            // A folder cannot be renamed onto one with content: the old one is renamed first.
            rename(&place, &result.join(OLD_POSTERIOR_FOLDER))?;
            rename(&new, &place)?;
        }
        for file in RESULT_FILES {
            rename(&result.join(file), &path.join(file))?;
        }
        sync_folder(path).map_err(Error::io(path, WRITABLE))?;
        Contents::of(path)?
            .part(|name| name == RESULT_FOLDER)
            .remove(path)
    }

    /// Removes the checkpoint of a run that has its result, unless it can be continued.
    fn remove_checkpoint_of(&self, run: &Run) -> Result<()> {
        if may_continue(run) {
            return Ok(());
        }
        let checkpoint = self.folder.checkpoint();
        for path in [checkpoint::previous(&checkpoint), checkpoint] {
            match fs::remove_file(&path) {
                Err(e) if e.kind() != ErrorKind::NotFound => {
                    return Err(Error::io(
                        &path,
                        "remove it by hand; the run itself is complete",
                    )(e));
                }
                _ => {}
            }
        }
        Ok(())
    }
}

/// Whether a run that has its result can be continued: because its time was up, or because it has not converged, and is a tempered one, a
/// nested one with a target, or a bridge. A bridge whose coarse run has not converged either begins anew after that run has gone on.
fn may_continue(run: &Run) -> bool {
    let grows = match run.method {
        Method::Nested => {
            let targets = [TARGET_ESS, TARGET_LN_Z_ERROR];
            (run.checks.iter()).any(|c| targets.contains(&c.name.as_str()))
        }
        Method::PtHmc => true,
        Method::Bridge => (run.checks.iter()).all(|c| c.pass || c.name != COARSE_RUN_CHECKS),
    };
    run.status != Status::Complete || grows && !run.converged()
}

/// Whether a finished run has left nothing to be moved or removed.
fn is_tidy(contents: &Contents, run: &Run) -> bool {
    let previous = checkpoint::previous(Path::new(CHECKPOINT_FILE));
    let is_checkpoint = |name: &str| name == CHECKPOINT_FILE || Path::new(name) == previous;
    !contents.has(|name| {
        is_leftover(name) || name == RESULT_FOLDER || is_checkpoint(name) && !may_continue(run)
    })
}

/// What is in a folder, if there is one.
fn look(path: &Path) -> Result<Contents> {
    match fs::symlink_metadata(path) {
        Err(e) if e.kind() == ErrorKind::NotFound => return Ok(Contents::default()),
        Err(source) => {
            let remedy = "choose a folder whose parent is there and readable";
            return Err(Error::io(path, remedy)(source));
        }
        // A run may be written and read through a link to a folder.
        Ok(found) if found.is_symlink() && !path.is_dir() => {
            refuse(path, Some(OutputFault::Link))?;
        }
        Ok(found) if !found.is_symlink() && !found.is_dir() => {
            refuse(path, Some(OutputFault::NotAFolder))?;
        }
        Ok(_) => {}
    }
    Contents::of(path)
}

/// What is in a folder that a new run may have; with `force`, also one of which the content is to be removed.
fn admitted(path: &Path, force: bool) -> Result<Contents> {
    let contents = look(path)?;
    if contents.is_started() {
        if !force {
            return Err(Error::Exists {
                path: path.to_path_buf(),
            });
        }
        refuse(path, protection(path)?)?;
    }
    refuse(path, contents.fault())?;
    Ok(contents)
}

fn refuse(path: &Path, fault: Option<OutputFault>) -> Result<()> {
    match fault {
        None => Ok(()),
        Some(fault) => Err(Error::OutputPath {
            path: path.to_path_buf(),
            fault,
        }),
    }
}

/// Why a folder must not be cleared, whatever is in it.
fn protection(path: &Path) -> Result<Option<OutputFault>> {
    let failed = |source| {
        Error::io(
            path,
            "check that the folder and those above it are readable",
        )(source)
    };
    if path.is_symlink() {
        return Ok(Some(OutputFault::Link));
    }
    let real = fs::canonicalize(path).map_err(failed)?;
    let holds = |other: Option<PathBuf>| {
        let other = other.and_then(|other| fs::canonicalize(other).ok());
        other.is_some_and(|other| other.starts_with(&real))
    };
    Ok(if real.parent().is_none() {
        Some(OutputFault::Root)
    } else if holds(std::env::home_dir()) {
        Some(OutputFault::Home)
    } else if holds(std::env::current_dir().ok()) {
        Some(OutputFault::WorkingDirectory)
    } else if is_mount_point(&real).map_err(failed)? {
        Some(OutputFault::MountPoint)
    } else {
        None
    })
}

/// Makes a folder and those above it, synced to the disk.
fn make(path: &Path) -> Result<()> {
    let missing: Vec<&Path> = path
        .ancestors()
        .take_while(|p| !p.as_os_str().is_empty() && !p.exists())
        .collect();
    fs::create_dir_all(path)
        .and_then(|()| missing.iter().try_for_each(|p| sync_folder(folder_of(p))))
        .map_err(Error::io(path, "choose a folder whose parent is writable"))
}

/// A new folder under a temporary name, with the rights of any new folder: by default, temporary ones are private.
fn temporary_folder(within: &Path) -> io::Result<tempfile::TempDir> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(TEMPORARY);
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(fs::Permissions::from_mode(0o777));
    }
    builder.tempdir_in(within)
}

fn json(path: &Path, value: &impl Serialize) -> Result<()> {
    let mut text = serde_json::to_vec_pretty(value)
        .map_err(|e| Error::io(path, "report this as a bug")(io::Error::other(e)))?;
    text.push(b'\n');
    write_atomically(path, &text)?;
    Ok(())
}
