//! The run folder: complete or absent, and never overwritten unless asked.

use crate::runs;
use oblate::Error;
use oblate::data::ObservedTrack;
use oblate::posterior::{Summary, SummaryContext, zarr};
use oblate::run::{RunFolder, Versions};

/// The message of an error of `oblate fit`.
fn message(error: &Error) -> String {
    let args = ["oblate", "fit", "track.ecsv", "--out", "run"];
    oblate::cli::message(error, &args.map(Into::into))
}

fn finished(path: &std::path::Path) -> RunFolder {
    let run = runs::nested(200, 1);
    let folder = RunFolder::create(path, false).unwrap();
    folder
        .begin("seed = 1\n", &Versions::new(&[b"seed = 1\n", b"phi,r\n"]))
        .unwrap();
    std::fs::write(folder.checkpoint(), b"state").unwrap();
    let summary = Summary::new(&run, &SummaryContext::default());
    let track =
        ObservedTrack::new("toy", &[5.0, 15.0, 25.0], 10.0, &[60.0, 61.0, 62.0], None).unwrap();
    let beside = zarr::Extras {
        track: Some(&track),
        prior: None,
    };
    folder.finish(&run, &summary, beside).unwrap();
    folder
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
}

#[test]
fn an_existing_folder_is_refused_without_force_and_stays_as_it_was() {
    let temporary = tempfile::tempdir().unwrap();
    let path = temporary.path().join("fit");
    let folder = finished(&path);
    let before = std::fs::read(folder.summary()).unwrap();
    let error = RunFolder::create(&path, false).unwrap_err();
    assert!(matches!(error, Error::Exists { .. }));
    assert!(message(&error).contains("--force"), "{error}");
    assert_eq!(std::fs::read(folder.summary()).unwrap(), before);
    let again = RunFolder::create(&path, true).unwrap();
    assert!(!again.finished());
}

#[test]
fn force_never_removes_a_folder_that_is_not_a_run() {
    let temporary = tempfile::tempdir().unwrap();
    let thesis = temporary.path().join("thesis.tex");
    std::fs::write(&thesis, "chapter one").unwrap();
    assert!(matches!(
        RunFolder::create(temporary.path(), true),
        Err(Error::Exists { .. })
    ));
    assert!(thesis.exists());
}

#[test]
fn a_folder_whose_run_was_killed_before_its_settings_is_as_good_as_none() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    std::fs::write(folder.join("versions.json"), "{").unwrap();
    std::fs::write(folder.join(".tmpQ1w2E3"), "see").unwrap();
    assert!(RunFolder::is_unstarted(folder) && RunFolder::create(folder, false).is_ok());
    std::fs::write(folder.join("config.toml"), "").unwrap();
    assert!(!RunFolder::is_unstarted(folder) && RunFolder::create(folder, false).is_err());
}

#[test]
fn an_unfinished_or_foreign_folder_is_refused_with_a_remedy() {
    let temporary = tempfile::tempdir().unwrap();
    let words = message(&RunFolder::open(temporary.path()).unwrap_err());
    assert!(
        words.contains("config.toml") && words.contains("run folder"),
        "{words}"
    );
    let folder = RunFolder::create(&temporary.path().join("new"), false).unwrap();
    folder.begin("", &Versions::new(&[])).unwrap();
    let words = message(&folder.read().unwrap_err());
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
    std::fs::write(
        folder.summary(),
        text.replacen("\"converged\"", "converged", 1),
    )
    .unwrap();
    let words = folder.read().unwrap_err().to_string();
    assert!(words.contains("summary.json, line 3"), "{words}");
}

#[test]
fn a_folder_in_use_is_neither_shared_nor_replaced() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = finished(&temporary.path().join("fit"));
    let log = folder.log().unwrap();
    for error in [
        folder.log().unwrap_err(),
        RunFolder::create(folder.path(), true).unwrap_err(),
    ] {
        assert!(error.to_string().contains("another run works"), "{error}");
    }
    assert!(folder.finished());
    drop(log);
    assert!(RunFolder::create(folder.path(), true).is_ok());
}

#[test]
fn inputs_are_told_apart_by_their_hash() {
    let of = |inputs: &[&[u8]]| Versions::new(inputs).input_hash;
    assert_eq!(of(&[b"a", b"bc"]), of(&[b"a", b"bc"]));
    assert_ne!(of(&[b"a", b"bc"]), of(&[b"ab", b"c"]));
    assert_ne!(of(&[b"a", b"bc"]), of(&[b"a", b"bd"]));
}

#[test]
fn the_log_appends_one_object_per_line() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = RunFolder::create(&temporary.path().join("fit"), false).unwrap();
    for step in 0..2 {
        // Opened twice, as a resumed run does.
        folder
            .log()
            .unwrap()
            .write(&serde_json::json!({"step": step}))
            .unwrap();
    }
    let text = std::fs::read_to_string(folder.path().join("log.jsonl")).unwrap();
    assert_eq!(text, "{\"step\":0}\n{\"step\":1}\n");
}
