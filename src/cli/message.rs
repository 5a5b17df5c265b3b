//! The message of an error on the command line: the library's own, and which flags of the subcommand help.

use crate::error::{Error, Rejection, TrackFault};
use clap::Command;
use clap::parser::ValueSource;
use oblate_samplers::error::CheckpointFault;
use std::ffi::OsString;

/// The message of an error, with the flags that help. Only flags that the subcommand has are named, and a switch that was given is not
/// proposed again.
pub fn with_flags(error: &Error, flags: &Flags) -> String {
    match hint(error, flags) {
        Some(hint) => format!("{error}; {hint}"),
        None => error.to_string(),
    }
}

/// The flags of a command line's subcommand.
#[derive(Default)]
pub struct Flags {
    /// All that the subcommand has.
    known: Vec<String>,
    /// Those that were given.
    given: Vec<String>,
}

impl Flags {
    /// Those of the command line `args` of a command; none if it is not valid.
    pub fn of(mut command: Command, args: &[OsString]) -> Self {
        let mut flags = Self::default();
        let Ok(matches) = command.try_get_matches_from_mut(args) else {
            return flags;
        };
        let Some((verb, given)) = matches.subcommand() else {
            return flags;
        };
        for argument in command
            .find_subcommand(verb)
            .into_iter()
            .flat_map(Command::get_arguments)
        {
            if let Some(flag) = argument.get_long() {
                flags.known.push(format!("--{flag}"));
                if given.value_source(argument.get_id().as_str()) == Some(ValueSource::CommandLine)
                {
                    flags.given.push(format!("--{flag}"));
                }
            }
        }
        flags
    }

    /// Whether the subcommand has a flag.
    fn has(&self, flag: &str) -> bool {
        self.known.iter().any(|known| known == flag)
    }

    /// Whether the subcommand has a switch that was not given.
    fn offers(&self, switch: &str) -> bool {
        self.has(switch) && !self.given.iter().any(|given| given == switch)
    }

    /// Those of some flags that the subcommand has.
    fn among<'a>(&self, flags: &[&'a str]) -> Vec<&'a str> {
        let of = flags.iter().copied();
        of.filter(|flag| self.has(flag)).collect()
    }
}

fn hint(error: &Error, flags: &Flags) -> Option<String> {
    use oblate_samplers::Error as S;
    let some = |words: &str| Some(words.to_owned());
    match error {
        Error::InFile { source, .. } | Error::InTable { source, .. } => hint(source, flags),
        Error::Exists { path } => {
            let is_run = flags.has("--resume");
            let mut ways = Vec::new();
            if let Some(to) = flags.among(&["--particles-out", "--out"]).first() {
                ways.push(format!("choose another {to}"));
            }
            if path.is_dir() && flags.offers("--resume") {
                ways.push("continue the run with --resume".to_owned());
            }
            // Subcommands that fill a run folder replace folders, the others files.
            if path.is_dir() == is_run && flags.offers("--force") {
                ways.push("replace it with --force".to_owned());
            }
            alternatives(&ways)
        }
        Error::OtherInputs { .. } if flags.offers("--force") => {
            some("resume with the settings in its config.toml, or start again with --force")
        }
        Error::Unwritten { .. } => some(
            "make room if the disk is full; then the same command, with --resume for a single run, writes the result",
        ),
        Error::OtherInputs { .. } => {
            some("choose another folder with --out").filter(|_| flags.has("--out"))
        }
        Error::NotConverged { .. } => some("--allow-unconverged uses it all the same")
            .filter(|_| flags.offers("--allow-unconverged")),
        Error::NoneKept { .. } => {
            some("--draws sets their number").filter(|_| flags.has("--draws"))
        }
        Error::SameModel => {
            let finer = flags.among(&["--particles", "--steps"]);
            let mut ways: Vec<String> = flags
                .has("--profile")
                .then(|| "give --profile fast".to_owned())
                .into_iter()
                .collect();
            ways.extend(finer.iter().map(|flag| format!("more {flag}")));
            alternatives(&ways)
        }
        Error::TrackFile {
            fault: TrackFault::NoErrors,
            ..
        } => some("or give --assume-error 2%").filter(|_| flags.has("--assume-error")),
        Error::NotAFit { .. } => some("give a run folder that `oblate fit` made"),
        Error::NotNested { .. } => some("`oblate bridge` makes one"),
        Error::Syntax { path, .. } if path.extension().is_some_and(|e| e == "toml") => {
            some("`oblate fit --print-config` shows every key and its default")
                .filter(|_| flags.has("--config") && flags.has("--profile"))
        }
        Error::Io { path, .. } if path.ends_with(crate::run::SUMMARY_FILE) => some(
            "`oblate fit --resume`, `oblate bridge --resume` or `oblate population --resume` continues it: the one that began it",
        ),
        Error::NoTrack(Rejection::UnresolvedOrbit) => {
            some("give more --steps").filter(|_| flags.has("--steps"))
        }
        Error::Sampler(S::Checkpoint {
            fault: CheckpointFault::OtherSettings | CheckpointFault::OtherTarget,
            ..
        }) if flags.offers("--force") => some("start again with --force"),
        Error::Sampler(S::Io { path, .. }) if path.ends_with("checkpoint") => some(
            "make room if the disk is full; then the same command, with --resume for a single run, continues from the checkpoint before",
        ),
        Error::Sampler(S::LooseBound { .. }) if flags.offers("--force") => {
            some("the same command with --force and --set sampling.nested.kernel=differential")
                .filter(|_| flags.has("--set"))
        }
        Error::Sampler(S::Interrupted) if flags.offers("--resume") => {
            some("the same command with --resume continues it")
        }
        _ => None,
    }
}

/// Some remedies as one text: `a`, `a, or b`, `a, b, or c`.
fn alternatives(ways: &[String]) -> Option<String> {
    let (last, others) = ways.split_last()?;
    if others.is_empty() {
        return Some(last.clone());
    }
    Some(format!("{}, or {last}", others.join(", ")))
}
