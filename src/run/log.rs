//! `log.jsonl`: one JSON object per line, appended as the run goes.

use crate::error::{Error, Result};
use serde::Serialize;
use std::fs::{File, TryLockError};
use std::io::Write;
use std::path::{Path, PathBuf};

/// An open log. It is locked, so that no two runs work in one folder. Each line is written with one call, so that a killed run leaves
/// at most its last line incomplete.
#[derive(Debug)]
pub struct Log {
    path: PathBuf,
    file: File,
}

impl Log {
    /// Opens a log for appending, and makes it if it is not there.
    ///
    /// # Errors
    /// [`Error::FolderInUse`] if another run has it open; [`Error::Io`] if the file cannot be opened.
    pub fn append_to(path: &Path) -> Result<Self> {
        let file = File::options()
            .create(true)
            .append(true)
            .open(path)
            .map_err(|source| io(path, source))?;
        // Some file systems have no locks; there nothing prevents two runs in one folder.
        if let Err(TryLockError::WouldBlock) = file.try_lock() {
            return Err(Error::FolderInUse {
                path: path.to_path_buf(),
            });
        }
        Ok(Self {
            path: path.to_path_buf(),
            file,
        })
    }

    /// Appends one event.
    ///
    /// # Errors
    /// [`Error::Io`] if the event cannot be encoded or written.
    pub fn write(&mut self, event: &impl Serialize) -> Result<()> {
        let mut line =
            serde_json::to_vec(event).map_err(|e| io(&self.path, std::io::Error::other(e)))?;
        line.push(b'\n');
        self.file
            .write_all(&line)
            .map_err(|source| io(&self.path, source))
    }
}

fn io(path: &Path, source: std::io::Error) -> Error {
    Error::Io {
        path: path.to_path_buf(),
        source,
        remedy: "check that the run folder is writable and has space left",
    }
}
