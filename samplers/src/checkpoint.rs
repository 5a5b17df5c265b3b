//! Checkpoints: a versioned, checksummed, atomically replaced file; the one before it is kept beside it.

use crate::error::{CheckpointFault, Error, Result};
use serde::{Serialize, de::DeserializeOwned};
use std::io::Write;
use std::path::{Path, PathBuf};

const MAGIC: &[u8; 8] = b"oblateck";

/// Version of the file's layout. A change is a changelogged event, and older files are refused by name.
pub const FORMAT_VERSION: u32 = 11;

/// Header: magic, format version, config hash, fingerprint, checksum, payload length.
const HEADER: usize = 8 + 4 + 8 + 8 + 8 + 8;

/// FNV-1a, 64 bits: the same on every machine and version.
#[must_use]
pub fn hash(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |h, b| {
        (h ^ u64::from(*b)).wrapping_mul(0x0100_0000_01b3)
    })
}

/// What the names of temporary files begin with.
pub const TEMPORARY: &str = ".tmp";

/// Writes `bytes` to `path` so that the file is either whole or as it was: temporary file beside it, sync, rename.
///
/// # Errors
/// [`Error::Io`] if the folder is missing, not writable or full; the old file is untouched then.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<()> {
    let io = |source| Error::Io {
        path: path.to_path_buf(),
        source,
    };
    let folder = path
        .parent()
        .filter(|p| !p.as_os_str().is_empty())
        .unwrap_or(Path::new("."));
    let mut builder = tempfile::Builder::new();
    builder.prefix(TEMPORARY);
    #[cfg(unix)]
    {
        // Readable as any other new file: temporary files are private by default, and the rename would keep that.
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    let mut file = builder.tempfile_in(folder).map_err(io)?;
    file.write_all(bytes).map_err(io)?;
    file.as_file().sync_all().map_err(io)?;
    file.persist(path).map_err(|e| io(e.error))?;
    // The rename itself is durable once the folder is synced; some file systems refuse that, harmlessly.
    if let Ok(dir) = std::fs::File::open(folder) {
        let _ = dir.sync_all();
    }
    Ok(())
}

/// The checkpoint before the last one.
#[must_use]
pub fn previous(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".previous");
    PathBuf::from(name)
}

/// Saves `state`; `fingerprint` identifies the target (a hash of ln L at a few fixed points). The last file becomes
/// the [`previous`] one.
///
/// # Errors
/// [`Error::Io`] if the file cannot be written, [`Error::Checkpoint`] if the state cannot be encoded.
pub fn save<T: Serialize>(
    path: &Path,
    config_hash: u64,
    fingerprint: u64,
    state: &T,
) -> Result<()> {
    let payload = postcard::to_stdvec(state).map_err(|e| Error::Checkpoint {
        path: path.to_path_buf(),
        fault: CheckpointFault::Unencodable {
            message: e.to_string(),
        },
    })?;
    let mut bytes = Vec::with_capacity(HEADER + payload.len());
    bytes.extend_from_slice(MAGIC);
    bytes.extend_from_slice(&FORMAT_VERSION.to_le_bytes());
    for word in [
        config_hash,
        fingerprint,
        hash(&payload),
        payload.len() as u64,
    ] {
        bytes.extend_from_slice(&word.to_le_bytes());
    }
    bytes.extend_from_slice(&payload);
    if path.exists() {
        std::fs::rename(path, previous(path)).map_err(|source| Error::Io {
            path: path.to_path_buf(),
            source,
        })?;
    }
    write_atomically(path, &bytes)
}

/// Loads a state saved with the same hashes; a damaged file is skipped for the [`previous`] one, with a warning
/// returned beside the state.
///
/// # Errors
/// [`Error::Io`] if neither file can be read; [`Error::Checkpoint`] if both are damaged, or if the file belongs to
/// another configuration, target or format.
pub fn load<T: DeserializeOwned>(
    path: &Path,
    config_hash: u64,
    fingerprint: u64,
) -> Result<(T, Option<String>)> {
    match load_one(path, config_hash, fingerprint) {
        Ok(state) => Ok((state, None)),
        Err(first) => match load_one(&previous(path), config_hash, fingerprint) {
            Ok(state) => Ok((
                state,
                Some(format!("{first}; the checkpoint before it is used")),
            )),
            Err(_) => Err(first),
        },
    }
}

fn load_one<T: DeserializeOwned>(path: &Path, config_hash: u64, fingerprint: u64) -> Result<T> {
    let bytes = std::fs::read(path).map_err(|source| Error::Io {
        path: path.to_path_buf(),
        source,
    })?;
    let fail = |fault| Error::Checkpoint {
        path: path.to_path_buf(),
        fault,
    };
    if bytes.len() < HEADER || &bytes[..8] != MAGIC {
        return Err(fail(CheckpointFault::NotACheckpoint));
    }
    let word = |at: usize| {
        let mut b = [0_u8; 8];
        b.copy_from_slice(&bytes[at..at + 8]);
        u64::from_le_bytes(b)
    };
    let found = u32::from_le_bytes([bytes[8], bytes[9], bytes[10], bytes[11]]);
    if found != FORMAT_VERSION {
        let written = FORMAT_VERSION;
        return Err(fail(CheckpointFault::Format { found, written }));
    }
    let payload = &bytes[HEADER..];
    if word(36) != payload.len() as u64 || word(28) != hash(payload) {
        return Err(fail(CheckpointFault::Checksum));
    }
    if word(12) != config_hash {
        return Err(fail(CheckpointFault::OtherSettings));
    }
    if word(20) != fingerprint {
        return Err(fail(CheckpointFault::OtherTarget));
    }
    postcard::from_bytes(payload).map_err(|e| {
        fail(CheckpointFault::Undecodable {
            message: e.to_string(),
        })
    })
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
}
