//! The messages of errors: each flag that one names is a flag of its subcommand.

use clap::Command;
use oblate::cli::{command, message};
use oblate::{Error, Rejection};
use std::ffi::OsString;
use std::path::Path;

/// A valid command line of every subcommand.
const LINES: [&str; 17] = [
    "mock --out x",
    "stream p.toml --particles-out x",
    "evaluate t.ecsv",
    "fit t.ecsv --out x",
    "selection --out s.toml",
    "calibration r --figure f.svg",
    "bridge r --out x",
    "merge a b --out x",
    "compare a b",
    "population a --out x",
    "orientation a",
    "report a --out x",
    "run s.toml --out x",
    "export r --out d.fits",
    "doctor",
    "completions bash",
    "man --out x",
];

fn args(line: &str) -> Vec<OsString> {
    let words = ["oblate"].into_iter().chain(line.split_whitespace());
    words.map(OsString::from).collect()
}

fn verb<'a>(command: &'a Command, name: &str) -> &'a Command {
    command
        .find_subcommand(name)
        .unwrap_or_else(|| panic!("no verb {name}"))
}

/// The flags in a text: what begins with two dashes and a letter.
fn flags(text: &str) -> Vec<&str> {
    let is_flag = |c: char| c.is_ascii_lowercase() || c == '-';
    text.match_indices("--")
        .filter(|(at, _)| !text[..*at].ends_with(|c: char| c == '-' || c.is_alphanumeric()))
        .map(|(at, _)| {
            let rest = &text[at..];
            &rest[..rest.find(|c| !is_flag(c)).unwrap_or(rest.len())]
        })
        .filter(|flag| flag[2..].starts_with(|c: char| c.is_ascii_lowercase()))
        .collect()
}

/// Asserts that a text which subcommand `name` prints names only flags that this subcommand has; after `` `oblate VERB `` those of that subcommand.
fn names_its_own_flags(command: &Command, name: &str, text: &str) {
    for (k, part) in text.split('`').enumerate() {
        let quoted = part.strip_prefix("oblate ").filter(|_| k % 2 == 1);
        let quoted = quoted.and_then(|line| line.split_whitespace().next());
        let verb = verb(command, quoted.unwrap_or(name));
        for flag in flags(part) {
            let known = verb.get_arguments().any(|a| {
                a.get_long()
                    .is_some_and(|long| flag.strip_prefix("--") == Some(long))
            });
            assert!(known, "`{}` has no {flag}: {text}", verb.get_name());
        }
    }
}

/// The command line after clap has given every subcommand the flags that all subcommands have.
fn built() -> Command {
    let mut command = command();
    command.build();
    command
}

/// Errors that flags may help against; `folder` is one that exists.
fn errors(folder: &Path) -> Vec<Error> {
    let io = |path: &str| Error::Io {
        path: path.into(),
        source: std::io::Error::from(std::io::ErrorKind::NotFound),
        remedy: "give another",
    };
    let file = folder.join("file");
    std::fs::write(&file, "").expect("a file");
    vec![
        Error::Exists {
            path: folder.to_path_buf(),
        },
        Error::Exists { path: file },
        Error::OtherInputs {
            path: folder.to_path_buf(),
        },
        Error::NotConverged {
            name: "a".to_owned(),
        },
        Error::NoneKept { q: 0.75, tries: 10 },
        Error::SameModel,
        Error::NotAFit {
            path: folder.to_path_buf(),
        },
        Error::NotNested {
            path: folder.to_path_buf(),
            coarse: folder.join("coarse"),
        },
        Error::Syntax {
            path: "settings.toml".into(),
            line: None,
            message: "unknown key".to_owned(),
            remedy: "give the known keys",
        },
        io("r/summary.json"),
        io("r/config.toml"),
        Error::NoTrack(Rejection::UnresolvedOrbit),
        Error::Sampler(oblate_samplers::Error::Interrupted),
        Error::Sampler(oblate_samplers::Error::LooseBound { calls: 3 }),
        Error::InFile {
            path: "study.toml".into(),
            line: None,
            source: Box::new(Error::SameModel),
        },
    ]
}

#[test]
fn every_flag_of_a_message_is_one_of_its_verb_and_no_switch_is_proposed_twice() {
    let folder = tempfile::tempdir().expect("a folder");
    let command = built();
    let known: Vec<&str> = command.get_subcommands().map(Command::get_name).collect();
    let tested: Vec<&str> = LINES
        .iter()
        .filter_map(|line| line.split_whitespace().next())
        .collect();
    for name in known.iter().filter(|name| **name != "help") {
        assert!(tested.contains(name), "no line of `{name}`");
    }
    let mut proposed = 0;
    for line in LINES {
        let name = line.split_whitespace().next().expect("a verb");
        let valid = self::command().try_get_matches_from(args(line));
        assert!(valid.is_ok(), "{line}: {valid:?}");
        for error in errors(folder.path()) {
            let text = message(&error, &args(line));
            names_its_own_flags(&command, name, &text);
            proposed += flags(&text).len();
            for switch in ["--force", "--resume", "--allow-unconverged"] {
                let given = args(&format!("{line} {switch}"));
                let text = message(&error, &given);
                let valid = self::command().try_get_matches_from(&given).is_ok();
                // A command after a backtick is another one.
                let own: String = text.split('`').step_by(2).collect();
                assert!(!valid || !flags(&own).contains(&switch), "{text}");
            }
        }
    }
    assert!(proposed > 20, "only {proposed} flags were proposed");
}

#[test]
fn an_unfinished_run_is_continued_by_the_command_that_began_it() {
    let error = Error::Io {
        path: "runs/population/summary.json".into(),
        source: std::io::Error::from(std::io::ErrorKind::NotFound),
        remedy: "finish the run first",
    };
    let text = message(&error, &args("report runs/population --out x"));
    for verb in ["fit", "bridge", "population"] {
        assert!(
            text.contains(&format!("`oblate {verb} --resume`")),
            "{text}"
        );
    }
}

#[test]
fn a_selection_without_streams_of_some_q_needs_more_draws() {
    let error = Error::NoneKept { q: 0.75, tries: 10 };
    let text = message(&error, &args("selection --out s.toml"));
    assert!(
        text.contains("q = 0.75") && text.contains("--draws"),
        "{text}"
    );
    assert!(!text.contains("loosen"), "{text}");
}

#[test]
fn every_flag_in_the_command_line_s_own_texts_is_a_flag() {
    let command = built();
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/cli");
    let mut seen = 0;
    for entry in std::fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("a file").path();
        let stem = path
            .file_stem()
            .expect("a name")
            .to_string_lossy()
            .into_owned();
        let name = if stem == "study" { "run" } else { &stem };
        let own = command.find_subcommand(name);
        let verbs: Vec<&Command> = match own {
            Some(verb) => vec![verb],
            None => command.get_subcommands().collect(),
        };
        let text = std::fs::read_to_string(&path).expect("text");
        // An example has other subcommands too.
        let code = text.lines().filter(|line| {
            let line = line.trim_start();
            !line.starts_with("//") && !line.contains("Example:")
        });
        for line in code {
            for flag in flags(line) {
                let known = verbs.iter().any(|verb| {
                    verb.get_arguments()
                        .any(|a| a.get_long() == flag.strip_prefix("--"))
                });
                assert!(known, "{}: {flag}", path.display());
                seen += 1;
            }
        }
    }
    assert!(seen > 20, "only {seen} flags seen");
}

#[test]
fn every_example_is_a_valid_command_line() {
    let mut seen = 0;
    for verb in command().get_subcommands() {
        let help = verb.get_after_help().map(ToString::to_string);
        for line in help.unwrap_or_default().lines() {
            let line = line.trim().split(" < ").next().unwrap_or_default();
            if line.starts_with("oblate ") {
                let parsed = command().try_get_matches_from(line.split_whitespace());
                assert!(parsed.is_ok(), "{line}: {parsed:?}");
                seen += 1;
            }
        }
    }
    assert!(seen > 8, "only {seen} examples seen");
}

/// Messages of the library name settings; only the command line names flags.
#[test]
fn no_text_of_the_library_names_a_flag() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut folders = vec![root.join("src"), root.join("samplers/src")];
    let mut seen = 0;
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).expect("a folder") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                if !path.ends_with("src/cli") {
                    folders.push(path);
                }
                continue;
            }
            // The variables of a style sheet begin as flags do, and the programs of Slurm have flags of their own.
            if path.extension().is_some_and(|end| end == "css") || path.ends_with("slurm.rs") {
                continue;
            }
            let text = std::fs::read_to_string(&path).expect("text");
            for line in text.lines().filter(|l| !l.trim_start().starts_with("//")) {
                assert!(flags(line).is_empty(), "{}: {line}", path.display());
            }
            seen += 1;
        }
    }
    assert!(seen > 100, "only {seen} files seen");
}
