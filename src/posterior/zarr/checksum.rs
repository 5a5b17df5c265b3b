//! A checksum of a posterior's files: damaged files and files of another run are detected before anything is read.

use super::entries::Entries;
use oblate_samplers::checkpoint::{hash, hash_on};
use serde::{Deserialize, Serialize};
use std::fs::{self, File};
use std::io::{self, Read};
use std::path::Path;

/// Size and content of all files that the writer made. Other files, which a viewer of folders may have left, do not count.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Checksum {
    /// Bytes in all files.
    pub bytes: u64,
    /// FNV-1a, 64 bits, in hexadecimal, of each file in the order of their paths: the length of the path, the path, the length of the
    /// file, the file.
    pub fnv1a: String,
}

impl Checksum {
    /// That of the writer's files in the folder `path`.
    ///
    /// # Errors
    /// The operating system's, with which the folder or a file of it cannot be read.
    pub fn of(path: &Path, entries: &Entries) -> io::Result<Self> {
        let mut all = Running {
            bytes: 0,
            hash: hash(&[]),
        };
        for file in &entries.files {
            all.add(path, file)?;
        }
        Ok(Self {
            bytes: all.bytes,
            fnv1a: format!("{:016x}", all.hash),
        })
    }

    /// Whether the writer's files in the folder `path` have this checksum. Files of another size are not read.
    ///
    /// # Errors
    /// As of [`of`](Self::of).
    pub fn agrees(&self, path: &Path, entries: &Entries) -> io::Result<bool> {
        let mut bytes = 0_u64;
        for file in &entries.files {
            bytes = bytes.saturating_add(fs::metadata(path.join(file))?.len());
        }
        Ok(bytes == self.bytes && Self::of(path, entries)? == *self)
    }
}

/// An unfinished checksum.
struct Running {
    bytes: u64,
    hash: u64,
}

impl Running {
    fn add(&mut self, root: &Path, relative: &Path) -> io::Result<()> {
        let names: Vec<_> = relative.iter().map(|n| n.to_string_lossy()).collect();
        let name = names.join("/");
        let mut file = File::open(root.join(relative))?;
        let length = file.metadata()?.len();
        self.put(&(name.len() as u64).to_le_bytes());
        self.put(name.as_bytes());
        self.put(&length.to_le_bytes());
        let mut block = vec![0; 1 << 16];
        loop {
            let read = file.read(&mut block)?;
            if read == 0 {
                break;
            }
            self.put(&block[..read]);
            self.bytes += read as u64;
        }
        Ok(())
    }

    fn put(&mut self, bytes: &[u8]) {
        self.hash = hash_on(self.hash, bytes);
    }
}
