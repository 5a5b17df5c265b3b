//! The result of a run: replaced in one step, and read completely or not at all.

use super::message;
use super::{beginning, finish, finished, track};
use crate::cli::{SMALL, example, oblate};
use crate::folders::{copy, tree};
use crate::runs;
use oblate::Error;
use oblate::run::{LockedFolder, RunFolder};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;
use std::sync::atomic::{AtomicBool, Ordering};

/// What the command does for a tempered fit of few scans.
fn tempered(track: &Path, config: &Path, out: &Path, extensions: &str) -> Output {
    let words = [track, config, out].map(|path| path.display().to_string());
    let [track, config, out] = &words;
    oblate(
        &[
            "fit",
            track,
            "--config",
            config,
            "--sampler",
            "pt-hmc",
            "--coarse-particles",
            "0",
            "--extensions",
            extensions,
            "--out",
            out,
            "--resume",
            "-q",
        ],
        "",
    )
}

/// A tempered fit of few scans, which ends unconverged; with more extensions it is continued.
fn fit(track: &Path, config: &Path, out: &Path, extensions: &str) {
    let output = tempered(track, config, out, extensions);
    let say = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{say}");
    assert!(!say.contains("error"), "{say}");
}

/// Moves the pieces of a result from one place to another, in the order in which a run does it, and stops after so many.
fn pieces(folder: &Path) -> [(PathBuf, PathBuf); 5] {
    let result = folder.join(".oblate-result");
    let place = |name: &str| (result.join(name), folder.join(name));
    let (new, old) = place("posterior.zarr");
    [
        (old.clone(), result.join("old.zarr")),
        (new, old),
        place("versions.json"),
        place("config.toml"),
        place("summary.json"),
    ]
}

#[test]
fn a_result_is_replaced_whole_wherever_the_replacement_stops() {
    let temporary = tempfile::tempdir().unwrap();
    let config = temporary.path().join("small.toml");
    fs::write(&config, SMALL).unwrap();
    let track = example("tracks/s2_spherical.ecsv");
    let path = |name: &str| temporary.path().join(name);
    let (short, long) = (path("short"), path("long"));
    fit(&track, &config, &short, "1");
    copy(&short, &long);
    fit(&track, &config, &long, "2");
    let read = |path: &Path| RunFolder::open(path).unwrap().read().unwrap();
    let (before, after) = (read(&short), read(&long));
    assert_ne!(before.run.bits(), after.run.bits());
    // All but the log, which has every process, and the checkpoints.
    let files = |path: &Path| {
        let mut files = tree(path);
        for other in ["log.jsonl", "checkpoint", "checkpoint.previous"] {
            files.remove(Path::new(other));
        }
        files
    };
    for steps in 0..=6 {
        let out = path(&format!("stopped{steps}"));
        copy(&short, &out);
        fs::copy(long.join("checkpoint"), out.join("checkpoint")).unwrap();
        let new = out.join(if steps == 0 {
            ".oblate-tmp-Q1w2E3"
        } else {
            ".oblate-result"
        });
        copy(&long.join("posterior.zarr"), &new.join("posterior.zarr"));
        for file in ["versions.json", "config.toml", "summary.json"] {
            fs::copy(long.join(file), new.join(file)).unwrap();
        }
        for (from, to) in pieces(&out).iter().take(steps.max(1) - 1) {
            fs::rename(from, to).unwrap();
        }
        let expected = if steps == 0 { &before } else { &after };
        let stored = read(&out);
        assert_eq!(stored.run.bits(), expected.run.bits(), "{steps}");
        assert_eq!(stored.summary, expected.summary, "{steps}");
        assert_eq!(stored.config, expected.config, "{steps}");
        let page = path(&format!("{steps}.html"));
        let [folder, page] = [&out, &page].map(|path| path.display().to_string());
        let output = oblate(&["report", &folder, "--out", &page], "");
        assert_eq!(output.status.code(), Some(0), "{output:?}");
        for figure in ["fit", "q", "corner", "diagnostics"] {
            fs::remove_file(out.join(format!("{figure}.svg"))).unwrap();
        }
        // The next start moves the remaining pieces. Before the renaming the result is that of the shorter fit.
        let (extensions, expected) = if steps == 0 {
            ("1", &short)
        } else {
            ("2", &long)
        };
        fit(&track, &config, &out, extensions);
        assert!(files(&out) == files(expected), "{steps}");
        let checkpoint = |path: &Path| fs::read(path.join("checkpoint")).unwrap();
        assert!(checkpoint(&out) == checkpoint(&long), "{steps}");
    }
}

#[test]
fn draws_that_are_damaged_or_of_another_run_are_refused_with_a_remedy() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = finished(&temporary.path().join("fit"));
    let other = finished(&temporary.path().join("other"));
    let chunk = "weighted/theta/c/0/0";
    let damages: [(&str, &dyn Fn(&Path)); 6] = [
        ("a bit", &|draws| {
            let mut bytes = fs::read(draws.join(chunk)).unwrap();
            bytes[1000] ^= 1;
            fs::write(draws.join(chunk), bytes).unwrap();
        }),
        ("no chunk", &|draws| {
            fs::remove_file(draws.join(chunk)).unwrap();
        }),
        ("longer", &|draws| {
            let file = fs::File::options().write(true).open(draws.join(chunk));
            file.unwrap().set_len(1 << 40).unwrap();
        }),
        ("metadata", &|draws| {
            fs::write(draws.join("weighted/theta/zarr.json"), "{}").unwrap();
        }),
        ("no group", &|draws| {
            fs::remove_dir_all(draws.join("prior")).unwrap();
        }),
        ("another run", &|draws| {
            let folder = LockedFolder::create(other.path(), true).unwrap();
            folder.begin(&beginning(&track())).unwrap();
            finish(&folder, &runs::nested(200, 2));
            fs::remove_dir_all(draws).unwrap();
            copy(&other.posterior(), draws);
        }),
    ];
    let whole = temporary.path().join("whole");
    copy(&folder.posterior(), &whole);
    for (what, damage) in damages {
        damage(&folder.posterior());
        let error = folder.read().unwrap_err();
        assert!(matches!(error, Error::Checksum { .. }), "{what}: {error}");
        let words = message(&error);
        assert!(
            words.contains("damaged") && words.contains("restore"),
            "{words}"
        );
        let _ = fs::remove_dir_all(folder.posterior());
        copy(&whole, &folder.posterior());
        assert!(folder.read().is_ok(), "{what}");
    }
    // What a viewer of folders leaves is no damage.
    fs::write(folder.posterior().join("weighted/.DS_Store"), "x").unwrap();
    assert!(folder.read().is_ok());
}

#[test]
fn a_reader_sees_one_whole_result_while_results_replace_each_other() {
    let temporary = tempfile::tempdir().unwrap();
    let path = temporary.path().join("fit");
    let folder = LockedFolder::create(&path, false).unwrap();
    folder.begin(&beginning(&track())).unwrap();
    let results = [runs::nested(200, 1), runs::nested(300, 2)];
    finish(&folder, &results[0]);
    let bits = results.each_ref().map(oblate::Run::bits);
    let over = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let reader = scope.spawn(|| {
            let mut reads = 0;
            while !over.load(Ordering::Relaxed) {
                let stored = RunFolder::open(&path).and_then(|folder| folder.read());
                let found = stored.map(|stored| stored.run.bits());
                assert!(found.as_ref().is_ok_and(|b| bits.contains(b)), "{found:?}");
                reads += 1;
            }
            reads
        });
        for run in results.iter().cycle().take(12) {
            finish(&folder, run);
            if reader.is_finished() {
                break;
            }
        }
        over.store(true, Ordering::Relaxed);
        assert!(reader.join().unwrap() > 0);
    });
}

#[test]
fn a_foreign_file_among_the_draws_is_not_lost_when_they_are_replaced() {
    let temporary = tempfile::tempdir().unwrap();
    let config = temporary.path().join("small.toml");
    fs::write(&config, SMALL).unwrap();
    let track = example("tracks/s2_spherical.ecsv");
    let out = temporary.path().join("fit");
    fit(&track, &config, &out, "0");
    let mine = out.join("posterior.zarr/mine.txt");
    fs::write(&mine, "mine").unwrap();
    let before = tree(&out);
    let output = tempered(&track, &config, &out, "1");
    crate::cli::refused(&output, &["posterior.zarr/mine.txt"]);
    assert_eq!(tree(&out), before);
}
