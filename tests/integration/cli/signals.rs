//! Signals: which of them stop a command, and when.
#![cfg(target_os = "linux")]

use super::{small_fit, write};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

const HUP: u64 = 1;
const INT: u64 = 1 << 1;
const TERM: u64 = 1 << 14;
const REQUESTS: u64 = HUP | INT | TERM;

/// The signals on a line of the status of a process.
fn signals(process: &str, line: &str) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).expect("a status");
    let mut lines = status.lines();
    let mask = lines.find_map(|found| found.strip_prefix(line)?.strip_prefix(':'));
    u64::from_str_radix(mask.expect("the line").trim(), 16).expect("a mask")
}

/// Starts `sh -c SCRIPT PROGRAM ARGS`, and waits until the program catches the request to terminate.
fn started(script: &str, args: &[&str]) -> Child {
    let child = Command::new("sh")
        .args(["-c", script, env!("CARGO_BIN_EXE_oblate")])
        .args(args)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the command starts");
    let began = Instant::now();
    while signals(&child.id().to_string(), "SigCgt") & TERM == 0 {
        assert!(began.elapsed() < Duration::from_secs(60), "never caught");
        std::thread::sleep(Duration::from_millis(2));
    }
    child
}

const PLAIN: &str = r#"exec "$0" "$@""#;

fn kill(child: &Child, signal: &str) {
    let sent = Command::new("kill")
        .args([signal, &child.id().to_string()])
        .status();
    assert!(sent.expect("kill").success());
}

fn code_and_words(output: &Output) -> (Option<i32>, String) {
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    (output.status.code(), words)
}

#[test]
fn signals_that_were_ignored_at_the_start_do_not_stop_a_fit() {
    let (folder, config, track) = small_fit();
    let out = folder.path().join("run");
    let name = out.display().to_string();
    let mut args = vec!["fit", &track, "--config", &config, "--out", &name];
    args.extend(["--coarse-particles", "0", "--live", "100"]);
    args.extend(["--allow-unconverged", "-q"]);
    // As `nohup` and a script's job in the background start it.
    let child = started(&format!("trap '' HUP INT; {PLAIN}"), &args);
    let id = child.id().to_string();
    // The tests may themselves have been started so.
    let ignored = signals("self", "SigIgn") | HUP | INT;
    assert_eq!(signals(&id, "SigIgn") & REQUESTS, ignored & REQUESTS);
    assert_eq!(signals(&id, "SigCgt") & REQUESTS, REQUESTS & !ignored);
    while !out.join("log.jsonl").exists() {
        std::thread::sleep(Duration::from_millis(2));
    }
    kill(&child, "-HUP");
    kill(&child, "-INT");
    let (code, words) = code_and_words(&child.wait_with_output().expect("its end"));
    assert_eq!(code, Some(0), "{words}");
    assert!(out.join("summary.json").exists());
}

/// Arguments of a fit that looks at an interrupt for the first time after 50 values of ln L with so many particles.
fn slow<'a>(track: &'a str, config: &'a str, out: &'a str, particles: &'a str) -> Vec<&'a str> {
    let mut args = vec!["fit", track, "--config", config, "--out", out];
    args.extend(["--coarse-particles", "0", "--particles", particles]);
    args.extend(["--threads", "1", "--allow-unconverged", "-q"]);
    args
}

#[test]
fn two_signals_at_once_are_one_request_and_the_check_of_the_prior_heeds_it() {
    let (folder, config, track) = small_fit();
    let out = folder.path().join("run");
    let name = out.display().to_string();
    let child = started(PLAIN, &slow(&track, &config, &name, "16384"));
    let ignored = signals("self", "SigIgn");
    let caught = signals(&child.id().to_string(), "SigCgt");
    assert_eq!(caught & REQUESTS, REQUESTS & !ignored);
    // As `timeout` sends them, but far enough apart to be seen as two.
    kill(&child, "-TERM");
    std::thread::sleep(Duration::from_millis(50));
    kill(&child, "-TERM");
    let (code, words) = code_and_words(&child.wait_with_output().expect("its end"));
    assert_eq!(code, Some(130), "{words}");
    assert!(
        words.contains("Interrupted before the result, at stage 1 of 3, check of the prior")
            && words.contains("--resume"),
        "{words}"
    );
    assert!(!out.exists());
}

#[test]
fn a_later_signal_ends_the_process_at_once() {
    let (folder, config, track) = small_fit();
    let name = folder.path().join("run").display().to_string();
    // Its first look comes after seconds.
    let child = started(PLAIN, &slow(&track, &config, &name, "131072"));
    kill(&child, "-TERM");
    std::thread::sleep(Duration::from_millis(1_100));
    kill(&child, "-TERM");
    let (code, words) = code_and_words(&child.wait_with_output().expect("its end"));
    assert_eq!((code, words.as_str()), (Some(130), ""));
}

#[test]
fn a_study_is_stopped_while_it_makes_mocks() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("results");
    let study = format!(
        "title = \"mocks\"\nout = {out:?}\n[mocks]\ncount = 2000\nseed = 7\nsamplers = [\"nested\"]\n\
         mock = {{ model = {{ releases = {{ particles = 400 }} }} }}\n"
    );
    let study = write(folder.path(), "study.toml", &study);
    let child = started(PLAIN, &["run", &study]);
    kill(&child, "-TERM");
    let (code, words) = code_and_words(&child.wait_with_output().expect("its end"));
    assert_eq!(code, Some(130), "{words}");
    assert!(
        words.contains("Stopped before the end") && words.contains("oblate run"),
        "{words}"
    );
    assert!(!words.contains("error") && !out.exists(), "{words}");
}
