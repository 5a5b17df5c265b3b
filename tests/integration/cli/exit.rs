//! The exit codes of docs/files.md.

use super::{oblate, small_fit};
use oblate::Error;
use oblate::cli::Exit;
use oblate::samplers::Error as SamplerError;
use std::collections::BTreeSet;
use std::io::ErrorKind;
use std::path::Path;

#[test]
fn the_page_has_every_exit_code() {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/files.md");
    let page = std::fs::read_to_string(page).expect("the page");
    let section = page.split("\n## ").find(|s| s.contains("Exit codes\n"));
    let listed: BTreeSet<u8> = section
        .expect("the section on exit codes")
        .lines()
        .filter_map(|line| line.strip_prefix("| ")?.split(' ').next()?.parse().ok())
        .collect();
    let ours = [Exit::Done, Exit::Failed, Exit::Usage, Exit::Interrupted].map(Exit::code);
    // A panic has a code of its own.
    assert_eq!(listed, ours.into_iter().chain([101]).collect());
}

#[test]
fn a_path_that_may_not_be_written_is_wrong_input_and_a_full_disk_is_not() {
    for (kind, exit) in [
        (ErrorKind::PermissionDenied, Exit::Usage),
        (ErrorKind::ReadOnlyFilesystem, Exit::Usage),
        (ErrorKind::NotFound, Exit::Usage),
        (ErrorKind::StorageFull, Exit::Failed),
        (ErrorKind::Other, Exit::Failed),
    ] {
        let (path, source) = (Path::new("page.html").to_path_buf(), kind.into());
        let error = Error::Sampler(SamplerError::Io { path, source });
        assert_eq!(Exit::from_error(&error), exit, "{kind}");
    }
}

#[cfg(unix)]
#[test]
fn an_interrupted_fit_exits_with_130_and_is_continued() {
    use std::process::{Command, Stdio};
    let (folder, config, track) = small_fit();
    let out = folder.path().join("run");
    let name = out.display().to_string();
    let mut args = vec!["fit", &track, "--config", &config, "--out", &name];
    args.extend([
        "--coarse-particles",
        "0",
        "--live",
        "400",
        "--allow-unconverged",
    ]);
    let child = Command::new(env!("CARGO_BIN_EXE_oblate"))
        .args(&args)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the command starts");
    // Interrupts are caught before there is a log.
    while !out.join("log.jsonl").exists() {
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    // An interrupt may be ignored, where the tests are a job in the background of a script.
    let signal = Command::new("kill")
        .args(["-TERM", &child.id().to_string()])
        .status();
    assert!(signal.expect("kill").success());
    let output = child.wait_with_output().expect("its end");
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(130), "{words}");
    assert!(
        words.contains("--resume") && !words.contains("error"),
        "{words}"
    );
    assert!(!out.join("summary.json").exists());
    args.push("--resume");
    let output = oblate(&args, "");
    assert_eq!(output.status.code(), Some(0), "{output:?}");
}
