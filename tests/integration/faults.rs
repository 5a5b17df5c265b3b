//! Faults injected into the real command at its system calls: killed, or out of disk space, at a write, a sync, a rename and the like.
//! Afterwards the same command continues, and every file must have the bytes of a run that was never disturbed.
//!
//! The faults come from `strace`, which Debian and most distributions have as a package; without it, or where a process may not be
//! traced, the tests say so and pass. The short form takes three calls of each kind; the long form, every write, sync and
//! rename, and sixty of the other kinds:
//!
//! `cargo test --release --test integration faults -- --ignored --nocapture`

use crate::folders::{copy, files};
use std::collections::BTreeMap;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

/// System calls that change the disk or write to it.
const CALLS: [&str; 10] = [
    "openat",
    "write",
    "fsync",
    "rename",
    "renameat",
    "mkdir",
    "unlink",
    "unlinkat",
    "rmdir",
    "ftruncate",
];

/// Settings of fits of a fraction of a second.
const SETTINGS: &str = r#"
coarse_particles = 0
model = { steps = 4, step_phase = 3.0, max_halvings = 2, orbit_steps = 16, releases = { particles = 32 } }
prior.fixed = { log10_m_halo = 12.0, r_s_halo_kpc = 15.0, log10_m_prog = 7.7, r_s_prog_kpc = 1.0, x0_kpc = 60.0, z0_kpc = 30.0, vx0_km_s = 30.0, vy0_km_s = 140.0, vz0_km_s = 45.0, age_gyr = 3.0 }
sampling.sampler = "nested"
sampling.nested = { n_live = 20, kernel = "random-slice", steps = 2, replaced_fraction = 0.5, max_batches = 1, simulations = 20, bootstraps = 20 }
sampling.pt_hmc = { chain_sets = 2, rounds = 2, first_scans = 4, smc_particles = 20, mcmc_steps = 2, slice_updates = 1, surrogate = false, extensions = 0 }
"#;

/// The fault at a system call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fault {
    /// The process is killed before the call.
    Kill,
    /// This call, and all later ones of its kind, fail because the disk is full.
    NoSpace,
}

impl Fault {
    /// The calls at which it can happen.
    fn calls(self) -> &'static [&'static str] {
        match self {
            Self::Kill => &CALLS,
            // A file that exists can be opened and removed on a full disk; renaming it may need room in the directory.
            Self::NoSpace => &["write", "fsync", "rename", "renameat", "mkdir"],
        }
    }

    fn injected(self, call: &str, number: usize) -> String {
        match self {
            Self::Kill => format!("inject={call}:signal=KILL:when={number}"),
            Self::NoSpace => format!("inject={call}:error=ENOSPC:when={number}+"),
        }
    }
}

/// A command whose faults are tried.
struct Scenario {
    name: &'static str,
    /// Makes what the command needs in a folder.
    prepare: fn(&Path),
    /// The command's arguments, run in that folder.
    first: fn() -> Vec<&'static str>,
    /// The arguments that continue after a fault.
    then: fn() -> Vec<&'static str>,
}

/// One thread, a checkpoint as often as there is one, and nothing printed but the result.
const COMMON: [&str; 6] = [
    "--checkpoint-every",
    "0",
    "--allow-unconverged",
    "--threads",
    "1",
    "-q",
];

/// A command with these arguments and the common ones, and more of them.
fn with(arguments: &[&'static str], more: &[&'static str]) -> Vec<&'static str> {
    [arguments, &COMMON, more].concat()
}

fn fit(more: &[&'static str]) -> Vec<&'static str> {
    with(&["fit", "track.ecsv", "--config", "small.toml"], more)
}

fn extension() -> Vec<&'static str> {
    fit(&[
        "--out",
        "run",
        "--sampler",
        "pt-hmc",
        "--resume",
        "--extensions",
        "2",
    ])
}

fn population(more: &[&'static str]) -> Vec<&'static str> {
    with(
        &[
            "population",
            "one",
            "--config",
            "population.toml",
            "--out",
            "run",
        ],
        more,
    )
}

fn study() -> Vec<&'static str> {
    with(&["run", "study.toml"], &[])
}

const SCENARIOS: [Scenario; 4] = [
    Scenario {
        name: "fit",
        prepare: inputs,
        first: || fit(&["--out", "run"]),
        then: || fit(&["--out", "run", "--resume"]),
    },
    Scenario {
        name: "extension",
        prepare: |folder| {
            inputs(folder);
            finished(folder, &fit(&["--out", "run", "--sampler", "pt-hmc"]));
        },
        first: extension,
        then: extension,
    },
    Scenario {
        name: "population",
        prepare: |folder| {
            inputs(folder);
            finished(folder, &fit(&["--out", "one"]));
            let settings = "sampling.nested = { n_live = 20, kernel = \"random-slice\", steps = 2, simulations = 20, bootstraps = 20 }\n";
            std::fs::write(folder.join("population.toml"), settings).expect("a file");
        },
        first: || population(&[]),
        then: || population(&["--resume"]),
    },
    Scenario {
        name: "study",
        prepare: |folder| {
            inputs(folder);
            let fit: String = SETTINGS
                .lines()
                .map(|line| format!("fit.{line}\n").replace("fit.\n", ""))
                .collect();
            let study = format!(
                "title = \"Faults\"\nout = \"run\"\n[tracks]\nfiles = [\"track.ecsv\"]\nsamplers = [\"nested\", \"pt-hmc\"]\n{fit}"
            );
            std::fs::write(folder.join("study.toml"), study).expect("a file");
        },
        first: study,
        then: study,
    },
];

/// Writes the track and the settings of the small fits.
fn inputs(folder: &Path) {
    let track = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/tracks/s2_spherical.ecsv");
    std::fs::copy(track, folder.join("track.ecsv")).expect("a track");
    std::fs::write(folder.join("small.toml"), SETTINGS).expect("a file");
}

/// The command without faults, which must succeed.
fn finished(folder: &Path, arguments: &[&str]) {
    let output = ended(oblate(folder).args(arguments));
    assert!(output.status.success(), "{arguments:?}: {output:?}");
}

fn oblate(folder: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_oblate"));
    command.current_dir(folder);
    command
}

/// The command under `strace` with options of its own.
fn traced(folder: &Path, options: &[&str], arguments: &[&str]) -> Output {
    let mut command = Command::new("strace");
    // Not with `--seccomp-bpf`: no signal would be injected.
    command
        .current_dir(folder)
        .args(["-f", "-qq"])
        .args(options)
        .arg(env!("CARGO_BIN_EXE_oblate"))
        .args(arguments);
    ended(&mut command)
}

fn ended(command: &mut Command) -> Output {
    command
        .stdin(Stdio::null())
        .output()
        .expect("the command starts")
}

/// Whether processes can be traced here.
fn can_trace() -> bool {
    let tried = Command::new("strace")
        .args(["-f", "-qq", "-e", "trace=write", "true"])
        .output();
    let can = tried.is_ok_and(|output| output.status.success());
    if !can {
        eprintln!("no faults are injected: `strace` is missing or may not trace here");
    }
    can
}

/// How often the main thread of an undisturbed run makes each call.
fn counts(scenario: &Scenario, prepared: &Path) -> BTreeMap<&'static str, usize> {
    let folder = tempfile::tempdir().expect("a folder");
    copy(prepared, folder.path());
    let trace = format!("trace={}", CALLS.join(","));
    let options = ["-o", "trace.txt", "-e", &trace];
    let output = traced(folder.path(), &options, &(scenario.first)());
    assert!(output.status.success(), "{output:?}");
    let text = std::fs::read_to_string(folder.path().join("trace.txt")).expect("the trace");
    let main = text
        .split_whitespace()
        .next()
        .expect("a process")
        .to_owned();
    CALLS
        .into_iter()
        .map(|call| {
            let lines = text.lines().filter(|line| {
                let mut words = line.split_whitespace();
                words.next() == Some(&main)
                    && words
                        .next()
                        .is_some_and(|word| word.starts_with(&format!("{call}(")))
            });
            (call, lines.count())
        })
        .collect()
}

/// A run may make a few calls fewer than the one in which they were counted, by the time that passes: it then ends before a fault at the
/// last one, which is tried so many calls earlier.
const EARLIER: usize = 8;

/// Runs the scenario's command with one fault in a copy of its prepared folder and continues it; returns what is
/// wrong, if anything is, and otherwise whether it came to the fault.
fn disturbed(
    scenario: &Scenario,
    prepared: &Path,
    fault: Fault,
    call: &str,
    number: usize,
    whole: &BTreeMap<PathBuf, Vec<u8>>,
) -> Result<bool, String> {
    let folder = tempfile::tempdir().expect("a folder");
    copy(prepared, folder.path());
    let trace = format!("trace={call}");
    let injected = fault.injected(call, number);
    let options = ["-o", "trace.txt", "-e", &trace, "-e", &injected];
    let output = traced(folder.path(), &options, &(scenario.first)());
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    if text.contains("panicked") {
        return Err(format!("panicked: {text}"));
    }
    match fault {
        Fault::Kill => {
            if output.status.signal() != Some(9) && output.status.code() != Some(137) {
                return match output.status.code() {
                    Some(0 | 1) => Ok(false),
                    _ => Err(format!("was not killed: {output:?}")),
                };
            }
        }
        Fault::NoSpace => {
            // Exit code 0 is right where only output or the log could not be written.
            if !matches!(output.status.code(), Some(0 | 1)) {
                return Err(format!(
                    "exit {:?} on a full disk: {text}",
                    output.status.code()
                ));
            }
        }
    }
    let again = ended(oblate(folder.path()).args((scenario.then)()));
    if !again.status.success() {
        return Err(format!("does not continue: {again:?}"));
    }
    let found = files(&folder.path().join("run"));
    let differ: Vec<&PathBuf> = whole
        .keys()
        .chain(found.keys())
        .filter(|name| whole.get(*name) != found.get(*name))
        .collect();
    if differ.is_empty() {
        Ok(true)
    } else {
        Err(format!("other bytes than an undisturbed run: {differ:?}"))
    }
}

/// Numbers of the calls with a fault, at most `most` of them: the first and the last ones, at which a run begins and
/// ends, and some of those in the middle.
fn chosen(count: usize, most: usize) -> Vec<usize> {
    if count <= most {
        return (1..=count).collect();
    }
    let ends = most.div_ceil(3);
    let middle = most - 2 * ends;
    let mut numbers: Vec<usize> = (1..=ends).collect();
    numbers.extend((1..=middle).map(|k| ends + k * (count - 2 * ends) / (middle + 1)));
    numbers.extend(count - ends + 1..=count);
    numbers.dedup();
    numbers
}

/// Tries faults of one kind in some scenarios, at most `most(call)` of each call; prints a table of their numbers.
fn tried(fault: Fault, scenarios: &[Scenario], most: impl Fn(&str) -> usize) {
    if !can_trace() {
        return;
    }
    let mut failures = Vec::new();
    for scenario in scenarios {
        let prepared = tempfile::tempdir().expect("a folder");
        let prepared = prepared.path();
        (scenario.prepare)(prepared);
        let folder = tempfile::tempdir().expect("a folder");
        copy(prepared, folder.path());
        finished(folder.path(), &(scenario.first)());
        let whole = files(&folder.path().join("run"));
        assert!(whole.len() > 20, "{whole:?}");
        let counts = counts(scenario, prepared);
        for call in fault.calls() {
            let numbers = chosen(counts[call], most(call));
            for &number in &numbers {
                let mut tries = (number.saturating_sub(EARLIER).max(1)..=number).rev();
                let result = tries.find_map(|number| {
                    match disturbed(scenario, prepared, fault, call, number, &whole) {
                        Ok(false) => None,
                        other => Some(other),
                    }
                });
                let result = result.unwrap_or_else(|| Err("was never killed".to_owned()));
                if let Err(why) = result {
                    // At once, because the long form takes an hour.
                    eprintln!("{} {fault:?} {call} {number}: {why}", scenario.name);
                    failures.push(format!("{} {call} {number}", scenario.name));
                }
            }
            println!(
                "| {} | {fault:?} | {call} | {} of {} |",
                scenario.name,
                numbers.len(),
                counts[call]
            );
        }
    }
    assert!(failures.is_empty(), "{}", failures.join(", "));
}

/// Faults of the long form in one scenario: at every call that changes what is stored under a name, and at 60 of the
/// other kinds.
fn tried_at_all_calls(fault: Fault, name: &str) {
    let scenario = SCENARIOS.into_iter().find(|one| one.name == name);
    let all = ["write", "fsync", "rename", "renameat"];
    let most = |call: &str| if all.contains(&call) { usize::MAX } else { 60 };
    tried(fault, &[scenario.expect("a scenario")], most);
}

#[test]
fn a_killed_command_continues_to_the_same_bytes() {
    tried(Fault::Kill, &SCENARIOS, |_| 3);
}

#[test]
fn a_full_disk_costs_no_work() {
    tried(Fault::NoSpace, &SCENARIOS, |_| 3);
}

/// Long forms, one test for each command and fault, so that a campaign can be cut in parts.
macro_rules! long_forms {
    ($($test:ident: $fault:ident $scenario:literal),* $(,)?) => {$(
        #[test]
        #[ignore = "every write, sync and rename of a command, up to an hour: run before a release with --ignored --nocapture"]
        fn $test() {
            tried_at_all_calls(Fault::$fault, $scenario);
        }
    )*};
}

long_forms! {
    a_fit_killed_at_all_calls_continues: Kill "fit",
    an_extension_killed_at_all_calls_continues: Kill "extension",
    a_population_killed_at_all_calls_continues: Kill "population",
    a_study_killed_at_all_calls_continues: Kill "study",
    a_disk_full_at_all_calls_costs_no_fit: NoSpace "fit",
    a_disk_full_at_all_calls_costs_no_extension: NoSpace "extension",
    a_disk_full_at_all_calls_costs_no_population: NoSpace "population",
    a_disk_full_at_all_calls_costs_no_study: NoSpace "study",
}
