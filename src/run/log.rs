//! `log.jsonl`: one JSON object per line, appended during the run.

use crate::error::{Error, Result};
use serde::Serialize;
use std::cell::Cell;
use std::fs::{File, TryLockError};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// An open log. It is locked, so that no two runs work in one folder. Each line is written with one call, so that a killed run leaves
/// at most its last line incomplete.
#[derive(Debug)]
pub struct Log {
    path: PathBuf,
    file: File,
    locked: bool,
    /// Whether the last line is incomplete.
    torn: Cell<bool>,
}

impl Log {
    /// Opens a log for appending, and makes it if it is not there.
    ///
    /// # Errors
    /// [`Error::FolderInUse`] if another run has it open; [`Error::Io`] if the file cannot be opened.
    pub fn append_to(path: &Path) -> Result<Self> {
        let file = File::options()
            .create(true)
            .read(true)
            .append(true)
            .open(path)
            .map_err(|source| io(path, source))?;
        let locked = match file.try_lock() {
            Ok(()) => true,
            Err(TryLockError::WouldBlock) => {
                return Err(Error::FolderInUse {
                    path: path.to_path_buf(),
                });
            }
            // Some file systems have no locks.
            Err(TryLockError::Error(_)) => false,
        };
        let torn = Cell::new(is_torn(&file));
        Ok(Self {
            path: path.to_path_buf(),
            file,
            locked,
            torn,
        })
    }

    /// Whether it is locked for other runs; some file systems have no locks.
    #[must_use]
    pub fn locked(&self) -> bool {
        self.locked
    }

    /// Appends one event.
    ///
    /// # Errors
    /// [`Error::Io`] if the event cannot be encoded or written.
    pub fn write(&self, event: &impl Serialize) -> Result<()> {
        let mut line = Vec::new();
        if self.torn.get() {
            line.push(b'\n');
        }
        serde_json::to_writer(&mut line, event)
            .map_err(|e| io(&self.path, std::io::Error::other(e)))?;
        line.push(b'\n');
        let written = (&self.file).write_all(&line);
        self.torn.set(written.is_err() && is_torn(&self.file));
        written.map_err(|source| io(&self.path, source))
    }

    /// Empties it.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be written.
    pub fn clear(&self) -> Result<()> {
        self.torn.set(false);
        self.file
            .set_len(0)
            .map_err(|source| io(&self.path, source))
    }
}

/// Whether the last line has no end.
fn is_torn(mut file: &File) -> bool {
    let mut last = [0];
    let read = file
        .seek(SeekFrom::End(-1))
        .and_then(|_| file.read_exact(&mut last));
    read.is_ok() && last != [b'\n']
}

fn io(path: &Path, source: std::io::Error) -> Error {
    Error::io(
        path,
        "check that the run folder is writable and has space left",
    )(source)
}
