//! Checkpoints: a versioned, checksummed, atomically replaced file; the one before it is kept beside it.

use crate::error::{CheckpointFault, Error, Result};
use crate::files::Pending;
use crate::read;
use crate::valid::Valid;
use serde::{Serialize, de::DeserializeOwned};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

const MAGIC: &[u8; 8] = b"oblateck";

/// Version of the file's layout. A change is listed in the changelog, and older files are refused with a message.
pub const FORMAT_VERSION: u32 = 35;

/// Largest size of a file. A run of ten thousand live points takes some tens of megabytes.
pub const MAX_BYTES: u64 = 16 << 30;

/// Header: magic, format version, config hash, fingerprint, checksum, payload length.
const HEADER: usize = 8 + 4 + 8 + 8 + 8 + 8;

/// FNV-1a, 64 bits: the same on every computer and in every version.
#[must_use]
pub fn hash(bytes: &[u8]) -> u64 {
    hash_on(0xcbf2_9ce4_8422_2325, bytes)
}

/// The hash of some bytes and then of these, where `before` is the [`hash`] of the former.
#[must_use]
pub fn hash_on(before: u64, bytes: &[u8]) -> u64 {
    bytes.iter().fold(before, |h, b| {
        (h ^ u64::from(*b)).wrapping_mul(0x0100_0000_01b3)
    })
}

/// The checkpoint before the last one.
#[must_use]
pub fn previous(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".previous");
    PathBuf::from(name)
}

/// Whether there is a checkpoint, at `path` or [`previous`] to it.
#[must_use]
pub fn exists(path: &Path) -> bool {
    path.exists() || previous(path).exists()
}

/// Saves `state`; `fingerprint` identifies the target (a hash of ln L at a few fixed points). The last file becomes the
/// [`previous`] one, once the new one is completely on the disk.
///
/// # Errors
/// [`Error::Io`] if the file cannot be written, [`Error::Checkpoint`] if the state cannot be encoded or is larger than [`MAX_BYTES`];
/// the last file is untouched then, or the previous one.
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
    if bytes.len() as u64 > MAX_BYTES {
        return Err(Error::Checkpoint {
            path: path.to_path_buf(),
            fault: CheckpointFault::TooLarge {
                gib: bytes.len() >> 30,
                max_gib: MAX_BYTES >> 30,
            },
        });
    }
    let fresh = Pending::write(path, &bytes)?;
    match std::fs::rename(path, previous(path)) {
        Err(source) if source.kind() != ErrorKind::NotFound => Err(Error::Io {
            path: path.to_path_buf(),
            source,
        }),
        _ => fresh.replace(),
    }
}

/// Loads a state saved with the same hashes; a damaged file is skipped for the [`previous`] one, with a warning
/// returned beside the state. Where the file is missing, a process was killed while it [saved](save) the next one, and
/// the previous one is the last: no warning then. `check` returns what is wrong with a state that can be decoded, but
/// that no run can have saved.
///
/// # Errors
/// [`Error::Io`] if neither file can be read; [`Error::Checkpoint`] if both are damaged, or if the file belongs to
/// another configuration, target or format.
pub fn load<T: DeserializeOwned>(
    path: &Path,
    config_hash: u64,
    fingerprint: u64,
    check: impl Fn(&T) -> Valid,
) -> Result<(T, Option<String>)> {
    let first = match load_one(path, config_hash, fingerprint, &check) {
        Ok(state) => return Ok((state, None)),
        Err(first) => first,
    };
    let missing =
        matches!(&first, Error::Io { source, .. } if source.kind() == ErrorKind::NotFound);
    match load_one(&previous(path), config_hash, fingerprint, &check) {
        Ok(state) => {
            let warning = (!missing).then(|| format!("{first}; the checkpoint before it is used"));
            Ok((state, warning))
        }
        Err(second) => Err(if missing { second } else { first }),
    }
}

fn load_one<T: DeserializeOwned>(
    path: &Path,
    config_hash: u64,
    fingerprint: u64,
    check: impl Fn(&T) -> Valid,
) -> Result<T> {
    let bytes = read::bytes(path, MAX_BYTES).map_err(|source| Error::Io {
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
    let undecodable = |message: String| fail(CheckpointFault::Undecodable { message });
    let (state, rest) =
        postcard::take_from_bytes(payload).map_err(|e| undecodable(e.to_string()))?;
    if !rest.is_empty() {
        return Err(undecodable("bytes are left over".to_owned()));
    }
    check(&state).map_err(|fault| {
        fail(CheckpointFault::Inconsistent {
            message: fault.to_owned(),
        })
    })?;
    Ok(state)
}
