//! The run folder: complete or absent, overwritten only if asked for, and never cleared of files that no run has
//! written.

#[cfg(unix)]
mod disk;
mod force;
mod interrupted;
mod log;
mod names;
mod result;
mod several;
mod study;
mod watched;

use crate::folders::tree;
use crate::runs;
use oblate::Error;
use oblate::data::ObservedTrack;
use oblate::posterior::{SUMMARY_FORMAT, Summary, SummaryContext, zarr};
use oblate::run::{Beginning, LockedFolder, RunFolder, Versions};
use oblate_samplers::Run;
use std::path::{Path, PathBuf};

/// The message of an error of `oblate fit`.
pub fn message(error: &Error) -> String {
    let args = ["oblate", "fit", "track.ecsv", "--out", "run"];
    oblate::cli::message(error, &args.map(Into::into))
}

fn track() -> ObservedTrack {
    ObservedTrack::new(
        "toy",
        &[5.0, 15.0, 25.0],
        10.0,
        &[60.0, 61.0, 62.0],
        &[1.2, 1.22, 1.24],
    )
    .unwrap()
}

fn beginning(track: &ObservedTrack) -> Beginning<'_> {
    Beginning {
        config_toml: "seed = 1\n".to_owned(),
        versions: Versions::new(&[b"seed = 1\n", b"phi,r\n"]),
        track: Some(track),
    }
}

/// Writes the result of `run` into a folder, with draws of a prior.
fn finish(folder: &LockedFolder, run: &Run) -> Summary {
    let track = track();
    let summary = Summary::new(run, &SummaryContext::default());
    let extras = zarr::Extras {
        track: Some(&track),
        prior: Some(&run.draws),
        ..zarr::Extras::default()
    };
    folder
        .finish(run, summary, extras, &beginning(&track))
        .unwrap()
}

/// A run folder with all that a run leaves.
fn finished(path: &Path) -> RunFolder {
    let folder = LockedFolder::create(path, false).unwrap();
    folder.begin(&beginning(&track())).unwrap();
    std::fs::write(folder.folder().checkpoint(), b"state").unwrap();
    finish(&folder, &runs::nested(200, 1));
    folder.folder().clone()
}

#[test]
fn a_finished_run_is_read_back_and_leaves_no_checkpoint() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = finished(&temporary.path().join("fit"));
    assert!(folder.finished() && !folder.checkpoint().exists());
    let stored = RunFolder::open(folder.path()).unwrap().read().unwrap();
    assert_eq!(stored.run.bits(), runs::nested(200, 1).bits());
    assert_eq!(
        (stored.name.as_str(), stored.config.as_str()),
        ("fit", "seed = 1\n")
    );
    // No temporary files are left.
    let names: Vec<PathBuf> = std::fs::read_dir(folder.path())
        .unwrap()
        .map(|e| e.unwrap().file_name().into())
        .collect();
    assert_eq!(names.len(), 6, "{names:?}");
}

#[test]
fn an_existing_folder_is_refused_without_force_and_stays_as_it_was() {
    let temporary = tempfile::tempdir().unwrap();
    let path = temporary.path().join("fit");
    finished(&path);
    let before = tree(&path);
    let error = LockedFolder::create(&path, false).unwrap_err();
    assert!(matches!(error, Error::Exists { .. }));
    assert!(message(&error).contains("--force"), "{error}");
    assert_eq!(tree(&path), before);
    let again = LockedFolder::create(&path, true).unwrap();
    assert!(!again.folder().finished());
}

#[test]
fn a_folder_whose_run_was_killed_before_its_settings_is_as_good_as_none() {
    let temporary = tempfile::tempdir().unwrap();
    let path = temporary.path();
    // In the order in which they come: the log, a temporary file, the marker.
    std::fs::write(path.join("log.jsonl"), "").unwrap();
    drop(LockedFolder::create(path, false).unwrap());
    std::fs::write(path.join(".oblate-tmp-Q1w2E3"), "see").unwrap();
    let folder = LockedFolder::create(path, false).unwrap();
    assert_eq!(tree(path).len(), 1, "the temporary file is gone");
    folder.begin(&beginning(&track())).unwrap();
    std::fs::remove_file(path.join("config.toml")).unwrap();
    std::fs::remove_file(path.join("track.ecsv")).unwrap();
    drop(folder);
    drop(LockedFolder::create(path, false).unwrap());
    std::fs::write(path.join("config.toml"), "").unwrap();
    assert!(matches!(
        LockedFolder::create(path, false),
        Err(Error::Exists { .. })
    ));
}

#[test]
fn an_unfinished_or_foreign_folder_is_refused_with_a_remedy() {
    let temporary = tempfile::tempdir().unwrap();
    let words = message(&RunFolder::open(temporary.path()).unwrap_err());
    assert!(
        words.contains("config.toml") && words.contains("run folder"),
        "{words}"
    );
    let folder = LockedFolder::create(&temporary.path().join("new"), false).unwrap();
    folder.begin(&beginning(&track())).unwrap();
    let words = message(&folder.folder().read().unwrap_err());
    assert!(
        words.contains("summary.json") && words.contains("--resume"),
        "{words}"
    );
}

#[test]
fn a_damaged_summary_is_refused_with_its_line() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = finished(&temporary.path().join("fit"));
    let text = std::fs::read_to_string(folder.summary()).unwrap();
    let damaged = |from: &str, to: &str| {
        std::fs::write(folder.summary(), text.replacen(from, to, 1)).unwrap();
        folder.read().unwrap_err().to_string()
    };
    let words = damaged("\"converged\"", "converged");
    assert!(words.contains("summary.json, line 3"), "{words}");
    let format = format!("\"format\": {SUMMARY_FORMAT}");
    let words = damaged(&format, "\"format\": 1");
    assert!(words.contains("a summary of version 1"), "{words}");
}

#[test]
fn a_folder_in_use_is_neither_shared_nor_replaced() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = finished(&temporary.path().join("fit"));
    let log = oblate::run::Log::append_to(&folder.log()).unwrap();
    for error in [
        oblate::run::Log::append_to(&folder.log()).unwrap_err(),
        LockedFolder::create(folder.path(), true).unwrap_err(),
    ] {
        assert!(error.to_string().contains("another run works"), "{error}");
    }
    assert!(folder.finished());
    drop(log);
    assert!(LockedFolder::create(folder.path(), true).is_ok());
}

#[test]
fn inputs_are_told_apart_by_their_hash() {
    let of = |inputs: &[&[u8]]| Versions::new(inputs).input_hash;
    assert_eq!(of(&[b"a", b"bc"]), of(&[b"a", b"bc"]));
    assert_ne!(of(&[b"a", b"bc"]), of(&[b"ab", b"c"]));
    assert_ne!(of(&[b"a", b"bc"]), of(&[b"a", b"bd"]));
}

#[test]
fn a_folder_of_another_format_is_named() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = finished(&temporary.path().join("fit"));
    let text = std::fs::read_to_string(folder.versions()).unwrap();
    std::fs::write(
        folder.versions(),
        text.replace("\"format\": 1", "\"format\": 9"),
    )
    .unwrap();
    let words = folder.read_versions().unwrap_err().to_string();
    assert!(words.contains("format 9 of run folders"), "{words}");
}

#[test]
fn a_summary_of_another_version_is_refused_by_its_number() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = finished(&temporary.path().join("fit"));
    let text = std::fs::read_to_string(folder.summary()).unwrap();
    let format = format!("\"format\": {SUMMARY_FORMAT}");
    let other = text.replacen(&format, "\"format\": 99", 1);
    assert_ne!(text, other);
    std::fs::write(folder.summary(), other).unwrap();
    let words = folder.read().unwrap_err().to_string();
    assert!(
        words.contains("summary.json") && words.contains("version 99"),
        "{words}"
    );
}

#[test]
fn files_longer_than_any_of_their_kind_are_refused_unread() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = finished(&temporary.path().join("fit"));
    for (path, limit) in [
        (folder.summary(), "4 MiB"),
        (folder.config(), "1 MiB"),
        (folder.versions(), "64 KiB"),
    ] {
        let before = std::fs::read(&path).unwrap();
        let file = std::fs::File::options().write(true).open(&path).unwrap();
        file.set_len(1 << 40).unwrap();
        let read = folder
            .read()
            .map(|_| ())
            .and(folder.read_versions().map(|_| ()));
        let words = read.unwrap_err().to_string();
        assert!(words.contains(&format!("longer than {limit}")), "{words}");
        std::fs::write(&path, before).unwrap();
    }
    // A chunk of another size is no longer what the checksum was taken of, and is not read to find that out.
    let chunk = folder.posterior().join("weighted/theta/c/0/0");
    let file = std::fs::File::options().write(true).open(chunk).unwrap();
    file.set_len(1 << 40).unwrap();
    assert!(matches!(folder.read(), Err(Error::Checksum { .. })));
}
