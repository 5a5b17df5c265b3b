//! `versions.json`: the kind of a folder, the program that made it, and its inputs.

use oblate_samplers::checkpoint::hash;
use serde::{Deserialize, Serialize};
use std::fs;
use std::io;
use std::path::Path;

/// The file's name.
pub(super) const VERSIONS_FILE: &str = "versions.json";

/// Version of the layout of run folders.
pub(super) const FOLDER_FORMAT: u32 = 1;

/// Maximum number of bytes of `versions.json`; a longer file is not one.
pub(super) const MAX_VERSIONS_BYTES: u64 = 1 << 16;

/// The kind of a folder. This is its marker: only a folder whose `versions.json` has it is treated as a run folder.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum FolderKind {
    /// The folder of one run.
    #[serde(rename = "oblate run folder")]
    Run,
}

/// The program and the inputs that made a run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Versions {
    /// The kind of the folder.
    pub kind: FolderKind,
    /// Version of the layout of run folders.
    pub format: u32,
    /// Version of oblate.
    pub oblate: String,
    /// Version of the random streams.
    pub stream_version: u32,
    /// Hash of the settings and of every input, in hexadecimal.
    pub input_hash: String,
}

/// The part of the file that all versions of it have.
#[derive(Deserialize)]
struct Marker {
    #[serde(rename = "kind")]
    _kind: FolderKind,
}

impl Versions {
    /// The versions of this program for given inputs: the settings, then the bytes of every input. The length of each is hashed with
    /// it, so that different inputs cannot be concatenated to the same bytes.
    #[must_use]
    pub fn new(inputs: &[&[u8]]) -> Self {
        let mut bytes = Vec::new();
        for input in inputs {
            bytes.extend_from_slice(&(input.len() as u64).to_le_bytes());
            bytes.extend_from_slice(&hash(input).to_le_bytes());
        }
        Self {
            kind: FolderKind::Run,
            format: FOLDER_FORMAT,
            oblate: env!("CARGO_PKG_VERSION").to_owned(),
            stream_version: oblate_samplers::rng::STREAM_VERSION,
            input_hash: format!("{:016x}", hash(&bytes)),
        }
    }
}

/// Whether a folder has the marker of a run: by what is in its `versions.json`, not by that name.
///
/// # Errors
/// The operating system's, with which a file of that name cannot be read.
pub(super) fn marked(folder: &Path) -> io::Result<bool> {
    let path = folder.join(VERSIONS_FILE);
    let found = match fs::symlink_metadata(&path) {
        Ok(found) => found,
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(false),
        Err(e) => return Err(e),
    };
    if !found.is_file() || found.len() > MAX_VERSIONS_BYTES {
        return Ok(false);
    }
    Ok(serde_json::from_slice::<Marker>(&fs::read(&path)?).is_ok())
}
