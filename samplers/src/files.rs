//! Writes files completely or not at all: under a temporary name in the same folder, synced, and renamed.

use crate::error::{Error, Result};
use std::fs::File;
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// Prefix of the names of temporary files and folders. One that is left over is from a process that was killed.
pub const TEMPORARY: &str = ".oblate-tmp-";

/// Writes `bytes` to `path`; a file that was there is replaced.
///
/// # Errors
/// [`Error::Io`] if the folder is missing, not writable or full: the old file is untouched then; or if the folder
/// cannot be synced: the new file is in place, and may be lost if the computer loses power.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<()> {
    Pending::write(path, bytes)?.replace()
}

/// Writes `bytes` to `path`, where there must be nothing.
///
/// # Errors
/// [`Error::Io`] with [`ErrorKind::AlreadyExists`] if there is something, also if it came during the call; otherwise as of
/// [`write_atomically`].
pub fn create_atomically(path: &Path, bytes: &[u8]) -> Result<()> {
    Pending::write(path, bytes)?.create()
}

/// Writes the names in a folder to the disk.
///
/// # Errors
/// The operating system's. Folders that cannot be opened for this, and systems that do not sync folders, are no error,
/// because nothing more can be done there.
pub fn sync_folder(path: &Path) -> io::Result<()> {
    if cfg!(not(unix)) {
        return Ok(());
    }
    let synced = match File::open(path) {
        Ok(folder) => folder.sync_all(),
        Err(e) if e.kind() == ErrorKind::PermissionDenied => return Ok(()),
        Err(e) => Err(e),
    };
    match synced {
        Err(e) if matches!(e.kind(), ErrorKind::InvalidInput | ErrorKind::Unsupported) => Ok(()),
        other => other,
    }
}

/// The folder that a file is in.
#[must_use]
pub fn folder_of(path: &Path) -> &Path {
    path.parent()
        .filter(|p| !p.as_os_str().is_empty())
        .unwrap_or(Path::new("."))
}

/// A complete and synced file that is not yet at its path.
pub(crate) struct Pending {
    file: NamedTempFile,
    path: PathBuf,
}

impl Pending {
    /// Writes the file under a temporary name in the folder of its path.
    pub fn write(path: &Path, bytes: &[u8]) -> Result<Self> {
        let io = |source| Error::Io {
            path: path.to_path_buf(),
            source,
        };
        let mut builder = tempfile::Builder::new();
        builder.prefix(TEMPORARY);
        #[cfg(unix)]
        {
            // Readable as any other new file: temporary files are private by default, and the rename would keep that.
            use std::os::unix::fs::PermissionsExt;
            builder.permissions(std::fs::Permissions::from_mode(0o666));
        }
        let mut file = builder.tempfile_in(folder_of(path)).map_err(io)?;
        file.write_all(bytes).map_err(io)?;
        file.as_file().sync_all().map_err(io)?;
        Ok(Self {
            file,
            path: path.to_path_buf(),
        })
    }

    /// Renames it to its path, and replaces a file there.
    pub fn replace(self) -> Result<()> {
        let placed = self.file.persist(&self.path);
        finish(self.path, placed)
    }

    /// Renames it to its path, where there must be no file.
    fn create(self) -> Result<()> {
        let placed = self.file.persist_noclobber(&self.path);
        finish(self.path, placed)
    }
}

fn finish(path: PathBuf, placed: std::result::Result<File, tempfile::PersistError>) -> Result<()> {
    placed
        .map_err(|e| e.error)
        .and_then(|_| sync_folder(folder_of(&path)))
        .map_err(|source| Error::Io { path, source })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(unix)]
    #[test]
    fn a_written_file_has_the_rights_of_any_new_file() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let (ours, plain) = (folder.path().join("ours"), folder.path().join("plain"));
        write_atomically(&ours, b"x").unwrap();
        std::fs::write(&plain, b"x").unwrap();
        let mode = |p: &Path| std::fs::metadata(p).unwrap().permissions().mode();
        assert_eq!(mode(&ours), mode(&plain));
    }

    #[test]
    fn a_file_is_created_only_where_there_is_none() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        create_atomically(&path, b"first").unwrap();
        let error = create_atomically(&path, b"second").unwrap_err();
        assert!(
            matches!(&error, Error::Io { source, .. } if source.kind() == ErrorKind::AlreadyExists),
            "{error}"
        );
        assert_eq!(std::fs::read(&path).unwrap(), b"first");
        write_atomically(&path, b"third").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"third");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}
