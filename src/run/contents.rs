//! The files and folders that runs and reports write into a run folder, and the removal of these and of nothing else.

use super::versions::{VERSIONS_FILE, marked};
use crate::error::{Error, OutputFault, Result};
use crate::posterior::zarr;
use crate::report::FigureFormat;
use oblate_samplers::checkpoint::previous;
use oblate_samplers::files::{TEMPORARY, sync_folder};
use std::fs;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

/// The file that is written last: a folder that has it holds a result.
pub const SUMMARY_FILE: &str = "summary.json";

/// The settings.
pub(super) const CONFIG_FILE: &str = "config.toml";

/// The track that was fitted.
pub(super) const TRACK_FILE: &str = "track.ecsv";

/// The log, which is locked while a run works in the folder.
pub(super) const LOG_FILE: &str = "log.jsonl";

/// The state of an unfinished run; the state before it is in the same folder.
pub(super) const CHECKPOINT_FILE: &str = "checkpoint";

/// The draws.
pub(super) const POSTERIOR_FOLDER: &str = "posterior.zarr";

/// The density of q in a population.
pub(super) const DENSITY_FILE: &str = "density.csv";

/// The streams of a population.
pub(super) const STREAMS_FILE: &str = "streams.csv";

/// The run folder of the coarse fit that came first.
pub(super) const COARSE_FOLDER: &str = "coarse";

/// A complete result whose pieces have not all been moved to their paths.
pub(super) const RESULT_FOLDER: &str = ".oblate-result";

/// The draws of the result before it, in [`RESULT_FOLDER`].
pub(super) const OLD_POSTERIOR_FOLDER: &str = "old.zarr";

/// Files of a result besides the draws, in the order in which they are moved.
pub(super) const RESULT_FILES: [&str; 3] = [VERSIONS_FILE, CONFIG_FILE, SUMMARY_FILE];

/// Figures that a report draws of a run, each a file `NAME.svg` or of another format.
const FIGURES: [&str; 12] = [
    "fit",
    "velocities",
    "widths",
    "densities",
    "modes",
    "q",
    "density",
    "streams",
    "influence",
    "corner",
    "diagnostics",
    "coarse-diagnostics",
];

/// The entries of a folder, as they are without following any link. Paths are relative to the folder.
#[derive(Debug, Default)]
pub(super) struct Contents {
    /// Whether the folder has the marker of a run.
    marked: bool,
    /// Files and folders that runs and reports write, each folder after all in it; without the log and the marker of the folder itself,
    /// which are never removed.
    own: Vec<(PathBuf, Kind)>,
    /// All others. What is in a foreign folder is not looked at.
    foreign: Vec<PathBuf>,
}

/// What an entry is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    File,
    Folder,
    /// A link, a device, a pipe.
    Other,
}

impl Contents {
    /// Lists a folder. One that does not exist is empty.
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be read.
    pub fn of(folder: &Path) -> Result<Self> {
        let mut contents = Self::default();
        match contents.read(folder) {
            Err(e) if e.kind() == ErrorKind::NotFound => Ok(Self::default()),
            other => other.map(|()| contents).map_err(Error::io(
                folder,
                "check that the folder and all in it are readable",
            )),
        }
    }

    /// Those of the entries whose name, or that of the outermost folder that they are in, is wanted.
    pub fn part(mut self, wanted: impl Fn(&str) -> bool) -> Self {
        self.own
            .retain(|(path, _)| outermost(path).is_some_and(&wanted));
        self.foreign
            .retain(|path| outermost(path).is_some_and(&wanted));
        self
    }

    /// Whether any of ours has such a name, or is in a folder of such a name.
    pub fn has(&self, wanted: impl Fn(&str) -> bool) -> bool {
        let mut names = self.own.iter().filter_map(|(path, _)| outermost(path));
        names.any(wanted)
    }

    /// Temporary files and folders of killed processes.
    pub fn leftovers(self) -> Self {
        self.part(is_leftover)
    }

    /// Whether a run has begun here: there is more than the files of a process that was killed before it had written
    /// its settings.
    pub fn is_started(&self) -> bool {
        self.has(|name| !is_leftover(name))
    }

    /// The fault of a folder that holds entries which are not ours; `None` if it holds none.
    pub fn fault(&self) -> Option<OutputFault> {
        let names: Vec<String> = self
            .foreign
            .iter()
            .map(|path| path.to_string_lossy().into_owned())
            .collect();
        match (names.is_empty(), self.marked) {
            (true, _) => None,
            (false, true) => Some(OutputFault::Foreign { names }),
            (false, false) => Some(OutputFault::NotARunFolder { names }),
        }
    }

    /// Removes all that is ours from the folder, unless there is anything that is not. Entries are removed one by one,
    /// and a folder only if it is empty then, so that an entry that was added meanwhile stays.
    ///
    /// # Errors
    /// [`Error::OutputPath`] if there is anything foreign; [`Error::Io`] if an entry cannot be removed.
    pub fn remove(&self, folder: &Path) -> Result<()> {
        if let Some(fault) = self.fault() {
            return Err(Error::OutputPath {
                path: folder.to_path_buf(),
                fault,
            });
        }
        // Summaries go first, so that a folder of which anything is gone has no result.
        let (first, then): (Vec<_>, Vec<_>) = self
            .own
            .iter()
            .partition(|(path, _)| path.ends_with(SUMMARY_FILE));
        for (path, kind) in first.into_iter().chain(then) {
            let path = folder.join(path);
            let removed = match kind {
                Kind::Folder => fs::remove_dir(&path),
                _ => fs::remove_file(&path),
            };
            match removed {
                Err(e) if e.kind() != ErrorKind::NotFound => return Err(kept(&path, e)),
                _ => {}
            }
        }
        sync_folder(folder).map_err(|e| kept(folder, e))
    }

    fn read(&mut self, root: &Path) -> io::Result<()> {
        self.marked = self.run_folder(root, Path::new(""))?;
        let mut mounted = Vec::new();
        for (path, kind) in &self.own {
            if *kind == Kind::Folder && is_mount_point(&root.join(path))? {
                mounted.push(path.clone());
            }
        }
        self.foreign.extend(mounted);
        self.foreign.sort();
        Ok(())
    }

    /// Entries of a run folder, `at` from the outermost one. Returns whether it has the marker of a run.
    fn run_folder(&mut self, root: &Path, at: &Path) -> io::Result<bool> {
        let outermost = at.as_os_str().is_empty();
        let marked = marked(&root.join(at))?;
        let mut last = Vec::new();
        for (name, kind) in entries(&root.join(at))? {
            let path = at.join(&name);
            // A name is not enough: without the marker only temporary and empty files are taken for those of a run.
            let empty = || fs::symlink_metadata(root.join(&path)).is_ok_and(|m| m.len() == 0);
            match (kind, name.to_str().unwrap_or_default()) {
                (Kind::File, name) if is_leftover(name) => self.own.push((path, kind)),
                (Kind::Folder, name) if is_leftover(name) => self.result(root, path)?,
                (Kind::File, LOG_FILE) if marked || empty() => last.push((path, kind)),
                _ if !marked => self.foreign.push(path),
                (Kind::File, VERSIONS_FILE) => last.push((path, kind)),
                (Kind::File, name) if is_file_of_a_run(name) => self.own.push((path, kind)),
                (Kind::Folder, POSTERIOR_FOLDER) => self.posterior(root, path)?,
                (Kind::Folder, RESULT_FOLDER) => self.result(root, path)?,
                (Kind::Folder, COARSE_FOLDER) if outermost => {
                    self.run_folder(root, &path)?;
                    self.own.push((path, kind));
                }
                _ => self.foreign.push(path),
            }
        }
        if !outermost {
            // The marker is removed last, so that an incompletely removed folder is still recognised.
            last.sort_by(|a, b| a.0.cmp(&b.0));
            self.own.append(&mut last);
        }
        Ok(marked)
    }

    /// A result that is being written, or whose pieces have not all been moved to their paths.
    fn result(&mut self, root: &Path, at: PathBuf) -> io::Result<()> {
        for (name, kind) in entries(&root.join(&at))? {
            let path = at.join(&name);
            match (kind, name.to_str().unwrap_or_default()) {
                (Kind::File, name) if RESULT_FILES.contains(&name) || is_leftover(name) => {
                    self.own.push((path, kind));
                }
                (Kind::Folder, POSTERIOR_FOLDER | OLD_POSTERIOR_FOLDER) => {
                    self.posterior(root, path)?;
                }
                _ => self.foreign.push(path),
            }
        }
        self.own.push((at, Kind::Folder));
        Ok(())
    }

    /// A folder of draws.
    fn posterior(&mut self, root: &Path, at: PathBuf) -> io::Result<()> {
        let inside = zarr::entries(&root.join(&at))?;
        let files = inside.files.iter().map(|path| (at.join(path), Kind::File));
        self.own.extend(files);
        let folders = inside.folders.iter().rev();
        self.own
            .extend(folders.map(|path| (at.join(path), Kind::Folder)));
        self.foreign
            .extend(inside.foreign.iter().map(|path| at.join(path)));
        self.own.push((at, Kind::Folder));
        Ok(())
    }
}

/// The first name of a relative path, if it is text.
fn outermost(path: &Path) -> Option<&str> {
    path.iter().next()?.to_str()
}

/// Whether a temporary name.
pub(super) fn is_leftover(name: &str) -> bool {
    name.starts_with(TEMPORARY)
}

/// Removes the files under temporary names that an interrupted write has left in the folder of a study. What cannot be removed stays: it
/// does no harm.
pub(super) fn remove_leftovers(folder: &Path) {
    let Ok(entries) = std::fs::read_dir(folder) else {
        return;
    };
    for entry in entries.flatten() {
        let is_file = entry.file_type().is_ok_and(|kind| kind.is_file());
        if is_file && entry.file_name().to_str().is_some_and(is_leftover) {
            let _ = std::fs::remove_file(entry.path());
        }
    }
}

fn is_file_of_a_run(name: &str) -> bool {
    let format = |end: &str| FigureFormat::ALL.iter().any(|format| format.name() == end);
    let figure = name.rsplit_once('.').filter(|(_, end)| format(end));
    [
        CONFIG_FILE,
        TRACK_FILE,
        SUMMARY_FILE,
        CHECKPOINT_FILE,
        DENSITY_FILE,
        STREAMS_FILE,
    ]
    .contains(&name)
        || previous(Path::new(CHECKPOINT_FILE)) == Path::new(name)
        || figure.is_some_and(|(figure, _)| FIGURES.contains(&figure))
}

/// Names and kinds of the entries of a folder.
fn entries(folder: &Path) -> io::Result<Vec<(PathBuf, Kind)>> {
    let kind = |entry: &fs::DirEntry| -> io::Result<Kind> {
        let found = entry.file_type()?;
        Ok(if found.is_file() {
            Kind::File
        } else if found.is_dir() {
            Kind::Folder
        } else {
            Kind::Other
        })
    };
    fs::read_dir(folder)?
        .map(|entry| {
            let entry = entry?;
            Ok((PathBuf::from(entry.file_name()), kind(&entry)?))
        })
        .collect()
}

/// Whether a folder is a mount point: by the attribute of the kernel where it has one (Linux 5.8), else by the file system, which is another one than
/// that of the folder above.
pub(super) fn is_mount_point(folder: &Path) -> io::Result<bool> {
    #[cfg(target_os = "linux")]
    {
        use rustix::fs::{AtFlags, CWD, StatxAttributes, StatxFlags, statx};
        if let Ok(found) = statx(CWD, folder, AtFlags::SYMLINK_NOFOLLOW, StatxFlags::empty())
            && found
                .stx_attributes_mask
                .contains(StatxAttributes::MOUNT_ROOT)
        {
            return Ok(found.stx_attributes.contains(StatxAttributes::MOUNT_ROOT));
        }
    }
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        let of = |path: &Path| fs::symlink_metadata(path).map(|m| m.dev());
        let above = folder.parent().unwrap_or(folder);
        Ok(of(folder)? != of(above)?)
    }
    #[cfg(not(unix))]
    Ok(false)
}

fn kept(path: &Path, source: io::Error) -> Error {
    Error::io(
        path,
        "check that nothing else is in it, and that it can be removed",
    )(source)
}
