//! Exit codes (docs/files.md, section 9).

use crate::error::Error;
use std::io::ErrorKind;

/// How a command ended: the exit code of the process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exit {
    /// 0: done.
    Done,
    /// 1: it failed, a run has not converged, or compared runs disagree.
    Failed,
    /// 2: wrong usage or input.
    Usage,
    /// 130: interrupted; a run can be resumed from its checkpoint.
    Interrupted,
}

impl Exit {
    /// The number for the operating system.
    #[must_use]
    pub fn code(self) -> u8 {
        match self {
            Self::Done => 0,
            Self::Failed => 1,
            Self::Usage => 2,
            Self::Interrupted => 130,
        }
    }

    /// The exit of finished runs: done if all have converged, or need not.
    #[must_use]
    pub fn from_converged(converged: bool) -> Self {
        if converged { Self::Done } else { Self::Failed }
    }

    /// The exit of an error: [`Usage`](Self::Usage) if the user can correct it in the command or its inputs.
    #[must_use]
    pub fn from_error(error: &Error) -> Self {
        use oblate_samplers::Error as S;
        match error {
            Error::Sampler(S::Interrupted) => Self::Interrupted,
            Error::Sampler(S::Fatal(_) | S::Infinite { .. })
            | Error::NoTrack(_)
            | Error::Unwritten { .. }
            | Error::Output { .. } => Self::Failed,
            Error::InFile { source, .. } | Error::InTable { source, .. } => {
                Self::from_error(source)
            }
            Error::Io { source, .. } | Error::Sampler(S::Io { source, .. })
                if !is_of_the_path(source.kind()) =>
            {
                Self::Failed
            }
            _ => Self::Usage,
        }
    }
}

/// Whether a file could not be read or written because of the path that was given, and not because of the disk or the
/// computer.
fn is_of_the_path(kind: ErrorKind) -> bool {
    use ErrorKind as K;
    matches!(
        kind,
        K::NotFound
            | K::PermissionDenied
            | K::AlreadyExists
            | K::NotADirectory
            | K::IsADirectory
            | K::InvalidFilename
            | K::InvalidInput
            | K::InvalidData
            | K::ReadOnlyFilesystem
    )
}
