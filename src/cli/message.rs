//! The message of an error on the command line: the library's own, and which flags help.

use crate::error::{Error, Rejection};
use oblate_samplers::error::CheckpointFault;

/// The message of an error, with the flags that help where there are any.
#[must_use]
pub fn message(error: &Error) -> String {
    match flags(error) {
        Some(flags) => format!("{error}; {flags}"),
        None => error.to_string(),
    }
}

fn flags(error: &Error) -> Option<&'static str> {
    use oblate_samplers::Error as S;
    Some(match error {
        Error::Exists { path } if path.is_file() => {
            "choose another --out, or replace it with --force"
        }
        Error::Exists { .. } => {
            "choose another --out, continue the run with --resume, or replace it with --force"
        }
        Error::OtherInputs { .. } => {
            "resume with the settings in its config.toml, or start again with --force"
        }
        Error::NotConverged { .. } => "--allow-unconverged uses it all the same",
        Error::SameModel => "give --profile fast, or more --particles or --steps",
        Error::NotAFit { .. } => "give a run folder that `oblate fit` made",
        Error::NotNested { .. } => "`oblate bridge` makes one",
        Error::Syntax { path, .. } if path.extension().is_some_and(|e| e == "toml") => {
            "`oblate fit --print-config` shows every key and its default"
        }
        Error::Io { path, .. } if path.ends_with(crate::run::SUMMARY_FILE) => {
            "`oblate fit` with --resume continues it"
        }
        Error::Io { path, .. } if path.ends_with("config.toml") => {
            "`oblate fit` and `oblate population` make run folders"
        }
        Error::NoTrack(Rejection::UnresolvedOrbit) => "give more --steps",
        Error::Sampler(S::Checkpoint {
            fault: CheckpointFault::OtherSettings | CheckpointFault::OtherTarget,
            ..
        }) => "start again with --force",
        Error::Sampler(S::Interrupted) => "the same command with --resume continues it",
        _ => return None,
    })
}
