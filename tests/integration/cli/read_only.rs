//! Folders that may not be written.
#![cfg(unix)]

use super::{json, oblate, small_fit};
use std::fs::{self, Permissions};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Command, Output};

/// A user without rights.
const NOBODY: u32 = 65_534;

fn set_mode(path: &Path, mode: u32) {
    fs::set_permissions(path, Permissions::from_mode(mode)).expect("a mode");
}

/// Runs a copy of the command in `folder`, as nobody where modes do not bind the user of the tests.
fn unprivileged(folder: &Path, read_only: &Path, args: &[&str]) -> Output {
    let program = folder.join("oblate");
    if !program.exists() {
        fs::copy(env!("CARGO_BIN_EXE_oblate"), &program).expect("a copy");
    }
    let probe = read_only.join("probe");
    let mut command = Command::new(program);
    if fs::write(&probe, "").is_ok() {
        fs::remove_file(&probe).expect("removed");
        command.uid(NOBODY);
    }
    command.args(args).output().expect("the command ends")
}

#[test]
fn a_run_in_a_folder_that_is_not_writable_is_reported_without_files_of_figures() {
    let (folder, config, track) = small_fit();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let (run, page) = (path("run"), path("pages/here.html"));
    let fit = ["fit", &track, "--config", &config, "--out", &run];
    let flags = ["--coarse-particles", "0", "--allow-unconverged", "-q"];
    let fitted = oblate(&[&fit[..], &flags].concat(), "");
    assert_eq!(fitted.status.code(), Some(0));
    fs::create_dir(path("pages")).expect("a folder");
    set_mode(Path::new(&path("pages")), 0o777);
    set_mode(folder.path(), 0o755);
    let run = Path::new(&run);
    set_mode(run, 0o555);
    let unprivileged = |args: &[&str]| unprivileged(folder.path(), run, args);
    let figures = || {
        let entries = fs::read_dir(run).expect("the run").map(|e| e.expect("one"));
        entries
            .filter(|e| e.path().extension().is_some_and(|e| e == "svg"))
            .count()
    };
    let shown = run.display().to_string();
    let output = unprivileged(&["report", &shown, "--out", &page, "--json"]);
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(0), "{words}");
    assert_eq!(json(&output.stdout)["report"], page);
    assert!(
        words.contains("not writable") && words.contains(&shown),
        "{words}"
    );
    let text = fs::read_to_string(&page).expect("the page");
    assert!(text.contains("<svg") && figures() == 0);

    // An output that may not be written is one fault, whichever subcommand finds it.
    let inside = |name: &str| run.join(name).display().to_string();
    for args in [
        &["report", &shown, "--out", &inside("page.html")][..],
        &["export", &shown, "--out", &inside("draws.fits")],
        &["mock", "--particles", "400", "--out", &inside("mocks")],
    ] {
        let output = unprivileged(args);
        assert_eq!(output.status.code(), Some(2), "{args:?}: {output:?}");
    }
    set_mode(run, 0o755);
}
