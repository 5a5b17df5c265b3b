//! Reasons why a path is not written to or replaced.

/// Why nothing is written to a path, and nothing at it removed. The message follows the path, and ends with what to do.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum OutputFault {
    /// A folder without the marker of a run holds something.
    #[error(
        "is not empty and not the folder of a run: it holds {}; choose another folder",
        listed(names)
    )]
    NotARunFolder {
        /// Its entries.
        names: Vec<String>,
    },
    /// A run folder holds entries that neither runs nor reports write.
    #[error(
        "holds what neither runs nor reports write: {}; move it elsewhere, or choose another folder",
        listed(names)
    )]
    Foreign {
        /// The entries, relative to the folder.
        names: Vec<String>,
    },
    /// The folder of one run was given for several.
    #[error("is the folder of one run, and several are to be made; choose another folder")]
    RunFolder,
    /// The path is a symbolic link.
    #[error("is a symbolic link; give the path that it leads to, or another one")]
    Link,
    /// The folder is the root of a mounted file system.
    #[error("is a mount point, which is never cleared; choose a folder in it")]
    MountPoint,
    /// The folder is the home directory, or the home directory is in it.
    #[error("is or holds the home directory, and is never cleared; choose another folder")]
    Home,
    /// The folder is the working directory, or the working directory is in it.
    #[error(
        "is or holds the working directory, and is never cleared; choose another folder, or work from another directory"
    )]
    WorkingDirectory,
    /// The folder is the root of all folders.
    #[error("is the root directory, which is never cleared; choose another folder")]
    Root,
    /// There is a file where a folder is to be.
    #[error("is not a folder; choose another path")]
    NotAFolder,
    /// There is something other than a regular file where a file is to be.
    #[error("is {kind}, and only regular files are replaced; choose another path")]
    NotAFile {
        /// What it is, such as `a folder`.
        kind: &'static str,
    },
    /// There is a file where a study writes its report, and it is not a report.
    #[error("is not a report; move it elsewhere, or choose another folder")]
    NotAReport,
    /// The path is empty.
    #[error("an empty path names no folder; give one")]
    Empty,
}

/// Why a name cannot be made into that of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum NameFault {
    /// It has no letters.
    #[error("empty; give one")]
    Empty,
    /// It is longer than file systems allow.
    #[error("too long for a file: {bytes} bytes of at most {max}; shorten it")]
    TooLong {
        /// Bytes of the file's name.
        bytes: usize,
        /// The limit.
        max: usize,
    },
}

/// The first few of some names, and the number of the others.
fn listed(names: &[String]) -> String {
    const SHOWN: usize = 5;
    let shown: Vec<String> = names
        .iter()
        .take(SHOWN)
        .map(|name| format!("`{}`", name.escape_debug()))
        .collect();
    let shown = shown.join(", ");
    match names.len().saturating_sub(SHOWN) {
        0 => shown,
        more => format!("{shown} and {more} more"),
    }
}
