//! What `--force` removes: files that runs and reports write, and never anything else.

use super::finished;
use super::message;
use crate::cli::{oblate, refused};
use crate::folders::{copy, tree};
use crate::runs;
use oblate::Error;
use oblate::data::{Measured, ObservedTrack, StarVelocity};
use oblate::error::OutputFault;
use oblate::posterior::zarr;
use oblate::run::LockedFolder;
use oblate::track::BinQuantity;
use std::fs;
use std::path::Path;

/// Asserts that a folder is refused with and without force, and stays as it is; returns the fault.
fn kept(path: &Path) -> OutputFault {
    let before = tree(path);
    let error = LockedFolder::create(path, true).unwrap_err();
    assert!(!message(&error).contains("--force"), "{error}");
    assert!(LockedFolder::create(path, false).is_err());
    assert_eq!(tree(path), before);
    match error {
        Error::OutputPath { fault, .. } => fault,
        other => panic!("{other}"),
    }
}

/// The foreign entries of a run folder.
fn foreign(path: &Path) -> Vec<String> {
    match kept(path) {
        OutputFault::Foreign { names } => names,
        other => panic!("{other}"),
    }
}

#[test]
fn names_alone_make_no_folder_one_of_ours() {
    let temporary = tempfile::tempdir().unwrap();
    let path = temporary.path();
    for marker in [
        "",
        "{}",
        "{\"kind\": \"run folder\", \"oblate\": \"0.1.0\"}",
    ] {
        fs::write(path.join("versions.json"), marker).unwrap();
        fs::write(path.join("config.toml"), "").unwrap();
        fs::write(path.join("thesis.tex"), "chapter one").unwrap();
        fs::create_dir_all(path.join("Documents/letters")).unwrap();
        let names = match kept(path) {
            OutputFault::NotARunFolder { names } => names,
            other => panic!("{other}"),
        };
        let all = ["Documents", "config.toml", "thesis.tex", "versions.json"];
        assert_eq!(names, all, "{marker}");
    }
    // Nor one that may be filled.
    let other = tempfile::tempdir().unwrap();
    fs::write(other.path().join("versions.json"), "{\"app\": 3}").unwrap();
    assert!(matches!(
        kept(other.path()),
        OutputFault::NotARunFolder { .. }
    ));
    fs::remove_file(other.path().join("versions.json")).unwrap();
    fs::write(other.path().join("log.jsonl"), "{\"app\": 3}\n").unwrap();
    assert!(matches!(
        kept(other.path()),
        OutputFault::NotARunFolder { .. }
    ));
}

#[test]
fn a_run_folder_with_anything_foreign_at_any_depth_is_kept_whole() {
    let temporary = tempfile::tempdir().unwrap();
    let whole = temporary.path().join("whole");
    finished(&whole);
    finished(&whole.join("coarse"));
    for place in [
        "notes.txt",
        "fit.png",
        "fit.svg.bak",
        "coarse/notes.txt",
        "coarse/coarse/config.toml",
        "posterior.zarr/.zmetadata",
        "posterior.zarr/weighted/notes",
        "posterior.zarr/weighted/theta/c/1",
        "posterior.zarr/weighted/theta/c/0/0.bak",
        "posterior.zarr/posterior/of_another_program/zarr.json",
        "posterior.zarr/plots/zarr.json",
        ".oblate-result/notes",
        ".oblate-tmp-Q1w2E3/posterior.zarr/notes",
    ] {
        let path = temporary.path().join(place.replace('/', " "));
        copy(&whole, &path);
        let file = path.join(place);
        fs::create_dir_all(file.parent().unwrap()).unwrap();
        fs::write(&file, "mine").unwrap();
        let names = foreign(&path);
        assert_eq!(names.len(), 1, "{names:?}");
        assert!(
            Path::new(place).starts_with(&names[0]),
            "{place}: {names:?}"
        );
    }
}

/// A track with everything that a bin may have, and a star.
fn with_all_quantities() -> ObservedTrack {
    let mut track = super::track();
    let measured = Measured {
        value: 7.0,
        error: 0.5,
    };
    for quantity in BinQuantity::ALL {
        let rows = vec![Some(measured), None, None];
        track.measured.insert(quantity, rows);
    }
    track.stars.push(StarVelocity {
        phi_deg: 7.0,
        v_km_s: measured,
    });
    track
}

#[test]
fn all_that_runs_and_reports_write_is_removed_and_nothing_beside_the_folder() {
    let temporary = tempfile::tempdir().unwrap();
    let path = temporary.path().join("fit");
    fs::write(temporary.path().join("thesis.tex"), "chapter one").unwrap();
    let track = with_all_quantities();
    for run in [
        runs::nested(100, 1),
        runs::tempered(80, 2),
        runs::bridged(80, 3),
    ] {
        finished(&path);
        finished(&path.join("coarse"));
        fs::remove_dir_all(path.join("posterior.zarr")).unwrap();
        let extras = zarr::Extras {
            track: Some(&track),
            prior: Some(&run.draws),
            ..zarr::Extras::default()
        };
        zarr::write(&path.join("posterior.zarr"), &run, extras).unwrap();
        for array in ["v_err", "width", "density", "star_v"] {
            let at = path.join("posterior.zarr/observed_data").join(array);
            assert!(at.is_dir(), "{array}");
        }
        fs::create_dir(path.join(".oblate-tmp-Q1w2E3")).unwrap();
        zarr::write(
            &path.join(".oblate-tmp-Q1w2E3/posterior.zarr"),
            &run,
            extras,
        )
        .unwrap();
        for name in [
            "fit",
            "velocities",
            "widths",
            "densities",
            "q",
            "corner",
            "diagnostics",
            "coarse-diagnostics",
        ] {
            fs::write(path.join(format!("{name}.svg")), "<svg/>").unwrap();
        }
        for name in ["checkpoint", "checkpoint.previous", ".oblate-tmp-abc"] {
            fs::write(path.join(name), "state").unwrap();
        }
        drop(LockedFolder::create(&path, true).unwrap());
        let left: Vec<_> = tree(&path).into_keys().collect();
        assert_eq!(
            left,
            [Path::new("log.jsonl"), Path::new("versions.json")],
            "the marker stays until the new one replaces it"
        );
        fs::remove_dir_all(&path).unwrap();
    }
    assert!(temporary.path().join("thesis.tex").exists());
}

#[test]
fn draws_whose_names_cannot_be_read_are_removed_all_the_same() {
    let temporary = tempfile::tempdir().unwrap();
    let path = temporary.path().join("fit");
    finished(&path);
    fs::write(path.join("posterior.zarr/zarr.json"), "").unwrap();
    fs::remove_file(path.join("posterior.zarr/weighted/zarr.json")).unwrap();
    assert!(LockedFolder::create(&path, true).is_ok());
    assert!(!path.join("posterior.zarr").exists());
}

#[cfg(unix)]
#[test]
fn nothing_is_removed_through_a_link() {
    use std::os::unix::fs::symlink;
    let temporary = tempfile::tempdir().unwrap();
    let (elsewhere, whole) = (
        temporary.path().join("elsewhere"),
        temporary.path().join("whole"),
    );
    finished(&elsewhere);
    copy(&elsewhere, &whole);
    let before = tree(&elsewhere);
    // The folder itself, also with a slash at its end.
    let link = temporary.path().join("link");
    symlink(&elsewhere, &link).unwrap();
    for path in [link.clone(), link.join("")] {
        let error = LockedFolder::create(&path, true).unwrap_err();
        assert!(error.to_string().contains("symbolic link"), "{error}");
    }
    // An entry of each kind.
    for (i, place) in [
        "summary.json",
        "posterior.zarr",
        "coarse",
        "fit.svg",
        ".oblate-result",
        ".oblate-tmp-Q1w2E3",
        "posterior.zarr/weighted/theta/c",
        "posterior.zarr/weighted/theta/c/0/0",
    ]
    .into_iter()
    .enumerate()
    {
        let path = temporary.path().join(format!("fit{i}"));
        copy(&whole, &path);
        let place = path.join(place);
        if place.is_dir() {
            fs::remove_dir_all(&place).unwrap();
        } else if place.exists() {
            fs::remove_file(&place).unwrap();
        }
        symlink(&elsewhere, &place).unwrap();
        assert_eq!(foreign(&path).len(), 1);
    }
    assert_eq!(tree(&elsewhere), before);
    // A link that leads nowhere is no place for a run; one to an empty folder is.
    let nowhere = temporary.path().join("nowhere");
    symlink(temporary.path().join("missing"), &nowhere).unwrap();
    let error = LockedFolder::create(&nowhere, false).unwrap_err();
    assert!(error.to_string().contains("symbolic link"), "{error}");
    fs::create_dir(temporary.path().join("missing")).unwrap();
    assert!(LockedFolder::create(&nowhere, false).is_ok());
}

#[test]
fn a_file_and_an_empty_path_are_no_folders() {
    let temporary = tempfile::tempdir().unwrap();
    let file = temporary.path().join("file");
    fs::write(&file, "mine").unwrap();
    for force in [false, true] {
        for (path, word) in [
            (file.as_path(), "is not a folder"),
            (Path::new(""), "empty"),
        ] {
            let error = LockedFolder::create(path, force).unwrap_err();
            let words = message(&error);
            assert!(
                words.contains(word) && !words.contains("--force"),
                "{words}"
            );
        }
    }
    assert_eq!(fs::read(&file).unwrap(), b"mine");
}

/// The arguments of a fit that would be refused later than its folder.
fn fit(out: &Path) -> Vec<String> {
    let track = crate::cli::example("tracks/s2_spherical.ecsv");
    let mut words = vec!["fit".to_owned(), track.display().to_string()];
    words.extend(["--out", &out.display().to_string(), "--force", "-q"].map(str::to_owned));
    words
}

#[test]
fn the_working_and_the_home_directory_are_never_cleared() {
    let temporary = tempfile::tempdir().unwrap();
    let path = temporary.path().join("fit");
    finished(&path);
    fs::create_dir(path.join("coarse")).unwrap();
    let before = tree(&path);
    let at = |directory: &Path, home: &Path, out: &Path| {
        std::process::Command::new(env!("CARGO_BIN_EXE_oblate"))
            .args(fit(out))
            .current_dir(directory)
            .env("HOME", home)
            .output()
            .unwrap()
    };
    let elsewhere = temporary.path();
    for out in [Path::new("."), Path::new("../fit"), &path] {
        refused(&at(&path, elsewhere, out), &["the working directory"]);
    }
    let above = at(&path.join("coarse"), elsewhere, Path::new(".."));
    refused(&above, &["the working directory"]);
    refused(&at(elsewhere, &path, &path), &["the home directory"]);
    let above = at(elsewhere, &path.join("coarse"), Path::new("fit/"));
    refused(&above, &["the home directory"]);
    assert_eq!(tree(&path), before);
}

/// The command in a mount namespace of its own, in which the folder `from` is also seen at `at`; none where that is not permitted.
#[cfg(target_os = "linux")]
fn mounted(from: &Path, at: &Path, arguments: &[String]) -> Option<std::process::Output> {
    let run = |script: &str| {
        let mut command = std::process::Command::new("unshare");
        command.args(["-r", "-m", "sh", "-c", script, "sh"]);
        command.arg(from).arg(at).arg(env!("CARGO_BIN_EXE_oblate"));
        command.args(arguments).output()
    };
    let mount = "mount --bind \"$1\" \"$2\"";
    if !run(mount).is_ok_and(|output| output.status.success()) {
        eprintln!("nothing is mounted: `unshare` is missing or not permitted here");
        return None;
    }
    Some(run(&format!("{mount} && shift 2 && exec \"$@\"")).unwrap())
}

#[cfg(target_os = "linux")]
#[test]
fn a_folder_that_is_mounted_is_never_cleared() {
    let temporary = tempfile::tempdir().unwrap();
    let (path, other) = (temporary.path().join("fit"), temporary.path().join("other"));
    finished(&path);
    // A run that is seen at another place of the same file system.
    finished(&other);
    let before = (tree(&path), tree(&other));
    if let Some(output) = mounted(&other, &path, &fit(&path)) {
        refused(&output, &["a mount point"]);
    }
    assert_eq!((tree(&path), tree(&other)), before);
    // A part of a run.
    fs::create_dir(path.join("coarse")).unwrap();
    let before = (tree(&path), tree(&other));
    if let Some(output) = mounted(&other, &path.join("coarse"), &fit(&path)) {
        refused(&output, &["coarse"]);
    }
    assert_eq!((tree(&path), tree(&other)), before);
}

#[test]
fn the_command_names_the_foreign_files_and_keeps_them() {
    let temporary = tempfile::tempdir().unwrap();
    let path = temporary.path().join("work");
    fs::create_dir_all(path.join("Documents")).unwrap();
    for (name, text) in [
        ("config.toml", "seed = 1"),
        ("versions.json", "{\"oblate\": \"0.1.0\"}"),
        ("thesis.tex", "chapter one"),
        ("a", ""),
        ("b\u{7}", ""),
        ("z", ""),
    ] {
        fs::write(path.join(name), text).unwrap();
    }
    let before = tree(&path);
    let words = fit(&path);
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    let output = oblate(&words, "");
    refused(
        &output,
        &["`Documents`", "`thesis.tex`", "`b\\u{7}`", "and 2 more"],
    );
    assert!(!String::from_utf8_lossy(&output.stderr).contains("--force"));
    assert_eq!(tree(&path), before);
}

#[test]
fn single_files_replace_regular_files_only() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let params = crate::cli::example("stream.toml").display().to_string();
    let stream = |out: &Path, force: bool| {
        let out = out.display().to_string();
        let mut words = vec!["stream", &params, "--particles", "256", "--steps", "20"];
        words.extend(["--particles-out", &out]);
        if force {
            words.push("--force");
        }
        oblate(&words, "")
    };
    let file = folder.join("particles.csv");
    assert_eq!(stream(&file, false).status.code(), Some(0));
    let whole = fs::read(&file).unwrap();
    fs::write(&file, "mine").unwrap();
    refused(&stream(&file, false), &["exists already", "--force"]);
    assert_eq!(fs::read(&file).unwrap(), b"mine");
    assert_eq!(stream(&file, true).status.code(), Some(0));
    assert_eq!(fs::read(&file).unwrap(), whole);
    let mut others = vec![(folder.join("folder"), "is a folder")];
    fs::create_dir(folder.join("folder")).unwrap();
    #[cfg(unix)]
    {
        let (link, pipe) = (folder.join("link"), folder.join("pipe"));
        std::os::unix::fs::symlink(&file, &link).unwrap();
        let made = std::process::Command::new("mkfifo").arg(&pipe).status();
        assert!(made.unwrap().success());
        others.extend([(link, "is a symbolic link"), (pipe, "a device or a pipe")]);
    }
    for (path, word) in others {
        let kind = fs::symlink_metadata(&path).unwrap().file_type();
        for force in [false, true] {
            let output = stream(&path, force);
            refused(&output, &[word, "choose another path"]);
            assert!(!String::from_utf8_lossy(&output.stderr).contains("--force"));
        }
        assert_eq!(fs::symlink_metadata(&path).unwrap().file_type(), kind);
    }
    assert_eq!(fs::read(&file).unwrap(), whole);
    let out = folder.join("folder").display().to_string();
    refused(
        &oblate(&["report", &out, "--out", &out], ""),
        &["is a folder"],
    );
}

#[test]
fn a_run_that_is_read_is_not_removed_for_the_one_that_is_made_from_it() {
    let temporary = tempfile::tempdir().unwrap();
    let path = temporary.path().join("fit");
    finished(&path);
    finished(&path.join("coarse"));
    let before = tree(&path);
    let [fit, coarse] = [&path, &path.join("coarse")].map(|path| path.display().to_string());
    for (verb, input, out) in [
        ("bridge", &fit, &fit),
        ("bridge", &coarse, &fit),
        ("bridge", &fit, &coarse),
        ("population", &fit, &fit),
        ("population", &coarse, &fit),
    ] {
        let words = [verb, input, "--out", out, "--force", "--allow-unconverged"];
        let more: &[&str] = if verb == "bridge" {
            &["--steps", "31"]
        } else {
            &[]
        };
        let output = oblate(&[&words[..], more].concat(), "");
        refused(&output, &["one of the runs that are to be read"]);
        assert_eq!(tree(&path), before, "{verb} {input} {out}");
    }
}
