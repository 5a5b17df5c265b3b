//! Standard output and standard error that are closed or full.
#![cfg(target_os = "linux")]

use super::{example, refused, small_fit};
use std::fs::File;
use std::io::{Read, Write};
use std::path::Path;
use std::process::{Command, Output, Stdio};

/// A device without space left.
fn full() -> Stdio {
    File::options()
        .write(true)
        .open("/dev/full")
        .expect("a full device")
        .into()
}

/// A pipe that nobody reads.
fn closed() -> Stdio {
    let (_, writer) = std::io::pipe().expect("a pipe");
    writer.into()
}

fn oblate(args: &[&str], stdout: Stdio, stderr: Stdio) -> Output {
    Command::new(env!("CARGO_BIN_EXE_oblate"))
        .args(args)
        .stdin(Stdio::null())
        .stdout(stdout)
        .stderr(stderr)
        .output()
        .expect("the command ends")
}

/// Arguments that print something within a second.
fn prints(folder: &Path) -> Vec<Vec<String>> {
    let stream = example("stream.toml").display().to_string();
    let mocks = folder.join("mocks").display().to_string();
    [
        vec!["--help"],
        vec!["--version"],
        vec!["fit", "--help"],
        vec!["man"],
        vec!["completions", "bash"],
        vec!["fit", "--print-config"],
        vec!["stream", &stream, "--particles", "200"],
        vec!["stream", &stream, "--particles", "200", "--json"],
        vec!["mock", "--particles", "2000", "--force", "--out", &mocks],
    ]
    .map(|args| args.into_iter().map(str::to_owned).collect())
    .to_vec()
}

fn borrowed(args: &[String]) -> Vec<&str> {
    args.iter().map(String::as_str).collect()
}

#[test]
fn a_closed_standard_output_ends_quietly_with_the_exit_code_of_the_work() {
    let folder = tempfile::tempdir().expect("a folder");
    for args in prints(folder.path()) {
        let output = oblate(&borrowed(&args), closed(), Stdio::piped());
        assert_eq!(output.status.code(), Some(0), "{args:?}: {output:?}");
        assert!(output.stderr.is_empty(), "{args:?}: {output:?}");
    }
}

#[test]
fn a_full_standard_output_is_an_error() {
    let folder = tempfile::tempdir().expect("a folder");
    for args in prints(folder.path()) {
        let output = oblate(&borrowed(&args), full(), Stdio::piped());
        let words = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{args:?}: {words}");
        assert!(
            words.starts_with("error: standard output: "),
            "{args:?}: {words}"
        );
        assert_eq!(words.lines().count(), 1, "{args:?}: {words}");
    }
}

#[test]
fn errors_that_cannot_be_told_leave_the_exit_code_as_it_is() {
    for args in [
        &["fit", "nowhere.ecsv", "--out", "x"][..],
        &["no-such-verb"],
    ] {
        for stderr in [full(), closed()] {
            assert_eq!(oblate(args, Stdio::null(), stderr).status.code(), Some(2));
        }
        // No standard error at all.
        let shell = "exec \"$0\" \"$@\" 2>&-";
        let status = Command::new("sh")
            .args(["-c", shell, env!("CARGO_BIN_EXE_oblate")])
            .args(args)
            .status();
        assert_eq!(status.expect("a shell").code(), Some(2));
    }
}

#[test]
fn a_fit_comes_to_its_end_whatever_its_output_does() {
    let (folder, config, track) = small_fit();
    let fit = |name: &str, more: &[&str], stdout: Stdio, stderr: Stdio| {
        let out = folder.path().join(name).display().to_string();
        let mut args = vec!["fit", &track, "--config", &config, "--out", &out];
        args.extend(["--sampler", "pt-hmc", "--coarse-particles", "0"]);
        args.extend(more);
        let output = oblate(&args, stdout, stderr);
        assert!(Path::new(&out).join("summary.json").exists(), "{name}");
        output
    };
    // It has not converged, and standard error has the command that continues it.
    for (name, stderr) in [("full", full()), ("closed", closed())] {
        let output = fit(name, &[], Stdio::piped(), stderr);
        assert_eq!(output.status.code(), Some(1), "{name}");
        let words = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(words.starts_with("NOT CONVERGED"), "{words}");
    }
    let output = fit("unread", &["-q"], closed(), Stdio::piped());
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{words}");
    assert!(!words.contains("error: "), "{words}");
    let unread = ["-q", "--allow-unconverged", "--resume"];
    let output = fit("unread", &unread, closed(), Stdio::piped());
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    // The result is there, and cannot be printed.
    let output = fit("unread", &unread, full(), Stdio::piped());
    assert_eq!(output.status.code(), Some(1), "{output:?}");
}

#[test]
fn evaluate_ends_when_nobody_reads_its_answers() {
    let track = example("tracks/s2_spherical.ecsv").display().to_string();
    let point: toml::Table =
        toml::from_str(&std::fs::read_to_string(example("stream.toml")).expect("the example"))
            .expect("TOML");
    let line = format!("{}\n", serde_json::to_string(&point).expect("JSON"));
    let mut child = Command::new(env!("CARGO_BIN_EXE_oblate"))
        .args(["evaluate", &track, "--particles", "128", "--steps", "30"])
        .stdin(Stdio::piped())
        .stdout(closed())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the command starts");
    let mut input = child.stdin.take().expect("stdin");
    let ended = (0..100_000).any(|_| input.write_all(line.as_bytes()).is_err());
    assert!(ended, "it reads on");
    assert_eq!(child.wait().expect("its end").code(), Some(0));
    let mut words = String::new();
    child
        .stderr
        .take()
        .expect("stderr")
        .read_to_string(&mut words)
        .expect("text");
    assert!(words.is_empty(), "{words}");
}

#[test]
fn an_unreadable_standard_input_is_named_in_the_message() {
    let track = example("tracks/s2_spherical.ecsv").display().to_string();
    let mut child = Command::new(env!("CARGO_BIN_EXE_oblate"))
        .args(["evaluate", &track])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the command starts");
    let mut input = child.stdin.take().expect("stdin");
    input.write_all(b"\xff\xff\n").expect("bytes");
    drop(input);
    let output = child.wait_with_output().expect("its end");
    refused(&output, &["standard input", "UTF-8"]);
}
