//! Studies: each run in a folder of its own within `out`.

use crate::cli::{SMALL, oblate, refused};
use crate::folders::{files, tree};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

/// A study of tracks whose headers have the given names; returns its file.
fn study(folder: &Path, names: &[&str]) -> String {
    let track = fs::read_to_string(crate::cli::example("tracks/s2_spherical.ecsv")).unwrap();
    let own = track
        .lines()
        .find(|line| line.contains("name: s2_spherical"))
        .unwrap();
    let mut files = Vec::new();
    for (i, name) in names.iter().enumerate() {
        let quoted = serde_json::to_string(name).unwrap();
        let header = own.replace("s2_spherical", &quoted);
        let file = format!("track{i}.ecsv");
        fs::write(folder.join(&file), track.replace(own, &header)).unwrap();
        files.push(file);
    }
    let fit: String = SMALL
        .lines()
        .filter(|line| !line.is_empty())
        .map(|line| format!("fit.{line}\n"))
        .collect();
    let text = format!(
        "title = \"names\"\nout = {:?}\nallow_unconverged = true\n[tracks]\nfiles = {files:?}\nsamplers = [\"nested\"]\n{fit}",
        folder.join("results/out")
    );
    let path = folder.join("study.toml");
    fs::write(&path, text).unwrap();
    path.display().to_string()
}

#[test]
fn no_name_of_a_track_leads_out_of_the_study() {
    let temporary = tempfile::tempdir().unwrap();
    let absolute = temporary.path().join("absolute");
    let names = ["../../../escaped", absolute.to_str().unwrap(), ".."];
    let study = study(temporary.path(), &names);
    let before = tree(temporary.path());
    let output = oblate(&["run", &study, "-q"], "");
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let mut after = tree(temporary.path());
    let out = Path::new("results/out");
    let fits: Vec<PathBuf> = after
        .keys()
        .filter(|path| path.parent() == Some(&out.join("fits")))
        .cloned()
        .collect();
    assert_eq!(fits.len(), 3, "{fits:?}");
    assert!(fits.contains(&out.join("fits/%2E.%2F..%2F..%2Fescaped_nested")));
    after.retain(|path, _| !path.starts_with("results"));
    assert_eq!(after, before);
    // It is continued by the same rule.
    let output = oblate(&["run", &study, "-q"], "");
    assert_eq!(output.status.code(), Some(0), "{output:?}");
}

#[test]
fn an_error_is_assumed_for_tracks_without_errors_and_named() {
    let temporary = tempfile::tempdir().unwrap();
    let study = study(temporary.path(), &["whole"]);
    let bare = "phi,r\n-15,57\n-5,63\n5,55\n15,51\n";
    fs::write(temporary.path().join("bare.csv"), bare).unwrap();
    let text = fs::read_to_string(&study).unwrap();
    let files = "files = [\"track0.ecsv\"]";
    assert!(text.contains(files));
    let both = "files = [\"track0.ecsv\", \"bare.csv\"]";
    fs::write(&study, text.replace(files, both)).unwrap();
    refused(
        &oblate(&["run", &study, "-q"], ""),
        &["bare.csv", "no errors"],
    );
    let assumed = format!("{both}\nassume_error = \"3%\"");
    fs::write(&study, text.replace(files, &assumed)).unwrap();
    let output = oblate(&["run", &study, "-q"], "");
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let printed = String::from_utf8(output.stdout).unwrap();
    let said: Vec<&str> = printed.lines().filter(|l| l.contains("assumed")).collect();
    assert_eq!(said.len(), 1, "{printed}");
    assert!(said[0].starts_with("bare nested: assumed: the errors of r are 3% of r"));
}

#[test]
fn names_that_cannot_have_folders_of_their_own_are_refused_before_any_work() {
    let long = "x".repeat(300);
    for (names, words) in [
        (["a", "a"], ["`a`", "a `name` of its own"]),
        (["Stream", "stream"], ["`stream`", "`Stream`"]),
        (["a", ""], ["name ``", "empty"]),
        (["a", &long], ["307 bytes", "shorten"]),
    ] {
        let temporary = tempfile::tempdir().unwrap();
        let study = study(temporary.path(), &names);
        refused(&oblate(&["run", &study, "-q"], ""), &words);
        assert!(!temporary.path().join("results/out/fits").exists());
    }
}

#[test]
fn a_page_that_is_no_report_is_not_replaced() {
    let temporary = tempfile::tempdir().unwrap();
    let study = study(temporary.path(), &["a"]);
    let page = temporary.path().join("results/out/report.html");
    fs::create_dir_all(page.parent().unwrap()).unwrap();
    fs::write(&page, "<!DOCTYPE html>\n<html>mine</html>").unwrap();
    let words = ["report.html", "is not a report", "move it"];
    refused(&oblate(&["run", &study, "-q"], ""), &words);
    assert!(fs::read_to_string(&page).unwrap().contains("mine"));
    fs::remove_file(&page).unwrap();
    for _ in 0..2 {
        let output = oblate(&["run", &study, "-q"], "");
        assert_eq!(output.status.code(), Some(0), "{output:?}");
        assert!(page.exists());
    }
}

/// A folder of tracks and their population. Each fit takes a fraction of a second.
pub const TRACKS: &str = r#"
title = "tracks"
out = "out"
allow_unconverged = true
[tracks]
files = ["tracks"]
samplers = ["nested"]
fit.coarse_particles = 0
fit.model = { steps = 4, step_phase = 3.0, max_halvings = 2, orbit_steps = 16, releases = { particles = 128 } }
fit.sampling.nested = { n_live = 60, kernel = "random-slice", steps = 2, replaced_fraction = 0.5, max_batches = 1, simulations = 20, bootstraps = 20 }
[population]
samplers = ["nested"]
subsets = { sizes = [2, 100], repeats = 2 }
"#;

fn in_folder(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_oblate"));
    command
        .current_dir(folder)
        .args(arguments)
        .stdin(Stdio::null());
    command
}

/// A study of so many mocks and a track in the middle of them that no draw of the prior reaches.
fn tracks(count: usize) -> tempfile::TempDir {
    let temporary = tempfile::tempdir().unwrap();
    fs::write(temporary.path().join("study.toml"), TRACKS).unwrap();
    let count = count.to_string();
    let mocks = [
        "mock", "--count", &count, "--seed", "7", "--out", "tracks", "-q",
    ];
    let output = in_folder(temporary.path(), &mocks).output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let far = "phi,r,r_err\n-5,60000,1\n5,61000,1\n15,62000,1\n";
    fs::write(temporary.path().join("tracks/mock_7_20_far.csv"), far).unwrap();
    temporary
}

#[test]
fn a_failed_fit_is_reported_and_left_out_of_the_population() {
    let temporary = tracks(5);
    let ended = |arguments: &[&str]| {
        let mut command = in_folder(temporary.path(), &["run", "study.toml"]);
        command.args(arguments).output().unwrap()
    };
    let output = ended(&["--threads", "1"]);
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    let printed = String::from_utf8(output.stdout).unwrap();
    let failed: Vec<&str> = printed
        .lines()
        .filter(|l| l.starts_with("FAILED"))
        .collect();
    assert_eq!(failed.len(), 1, "{printed}");
    let reason = failed[0].strip_prefix("FAILED  ").unwrap();
    assert!(
        reason.starts_with("mock_7_20_far nested: none of 1000 prior draws"),
        "{reason}"
    );
    assert!(printed.contains("mock_7_6 "), "{printed}");
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(
        said.starts_with("6 fits will take about ") && said.contains("by a pilot of 6"),
        "{said}"
    );
    assert!(said.contains("fits: 5 of 6 done, 1 failed"), "{said}");
    let summary = temporary.path().join("out/population_nested/summary.json");
    let summary: serde_json::Value = serde_json::from_slice(&fs::read(summary).unwrap()).unwrap();
    let warning = summary["model_warnings"][0].as_str().unwrap();
    assert!(
        warning.contains("a stream is missing") && warning.ends_with(reason),
        "{warning}"
    );

    scaling(temporary.path(), &printed);

    // The same bytes with several fits at once, and one fit after the other by number, in any order.
    let whole = files(&temporary.path().join("out"));
    assert!(whole.len() > 60, "{whole:?}");
    assert_eq!(
        ended(&["--threads", "3", "--out", "at once", "-q"])
            .status
            .code(),
        Some(1)
    );
    assert_eq!(files(&temporary.path().join("at once")), whole);
    let first_lines = |number: &str| {
        let output = ended(&["--fit", number, "--out", "by number", "-q"]);
        (
            output.status.code(),
            String::from_utf8(output.stderr).unwrap(),
        )
    };
    for number in ["5", "2", "6", "1", "4"] {
        assert_eq!(first_lines(number).0, Some(0));
    }
    let (code, said) = first_lines("3");
    assert_eq!(code, Some(1));
    assert!(
        said.starts_with("error: none of 1000 prior draws"),
        "{said}"
    );
    assert!(!temporary.path().join("by number/report.html").exists());
    let (code, said) = first_lines("7");
    assert_eq!(code, Some(2));
    assert!(
        said.contains("fit = 7") && said.contains("1 to 6"),
        "{said}"
    );
    let output = ended(&["--out", "by number", "-q"]);
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    assert_eq!(files(&temporary.path().join("by number")), whole);
}

/// The widths of two populations of two streams and of that of all five, as printed and as in the summaries.
fn scaling(study: &Path, printed: &str) {
    let table = fs::read_to_string(study.join("out/scaling.csv")).unwrap();
    let rows: Vec<Vec<&str>> = table.lines().map(|l| l.split(',').collect()).collect();
    assert_eq!(rows.len(), 3, "{table}");
    assert_eq!(
        rows[0][..4],
        ["streams", "populations", "width_mu_pop", "sd_mu_pop"]
    );
    assert_eq!(
        (&rows[1][..2], &rows[2][..2]),
        (&["2", "2"][..], &["5", "1"][..])
    );
    assert_eq!(rows[2][3], "", "{table}");
    let width = |folder: &str| {
        let summary = fs::read(study.join("out").join(folder).join("summary.json")).unwrap();
        let summary: serde_json::Value = serde_json::from_slice(&summary).unwrap();
        let of = |end: &str| summary["parameters"]["mu_pop"][end].as_f64().unwrap();
        (
            of("hi68") - of("lo68"),
            summary["population"]["streams"].as_array().unwrap().len(),
        )
    };
    let [(one, first), (other, second)] = ["subsets/2_1", "subsets/2_2"].map(width);
    assert_eq!((first, second), (2, 2));
    let number = |cell: &str| cell.parse::<f64>().unwrap();
    assert!(
        (number(rows[1][2]) - 0.5 * (one + other)).abs() < 1e-12,
        "{table}"
    );
    let sd = (one - other).abs() / 2.0_f64.sqrt();
    assert!((number(rows[1][3]) - sd).abs() < 1e-12, "{table}");
    assert!((number(rows[2][2]) - width("population_nested").0).abs() < 1e-12);
    assert!(
        printed.contains("streams 2, populations 2, 68 % widths: mu_pop "),
        "{printed}"
    );
    let page = fs::read_to_string(study.join("out/report.html")).unwrap();
    assert!(page.contains("Number of streams") && page.contains("68 % width of"));
}

/// Kills a study of so many mocks so many times, after growing parts of its time, and compares all files with those of one that was never stopped.
fn killed(count: usize, times: u32) {
    let whole = tracks(count);
    let arguments = [
        "run",
        "study.toml",
        "-q",
        "--threads",
        "2",
        "--checkpoint-every",
        "0",
    ];
    let began = std::time::Instant::now();
    let output = in_folder(whole.path(), &arguments).output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    let time = began.elapsed();
    let expected = files(&whole.path().join("out"));
    let temporary = tracks(count);
    let mut kills = 0;
    for k in 1..=times {
        let mut child = in_folder(temporary.path(), &arguments)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        std::thread::sleep(
            time.mul_f64(f64::from(k) / f64::from(times))
                .min(Duration::from_secs(60)),
        );
        child.kill().unwrap();
        kills += u32::from(child.wait().unwrap().code().is_none());
    }
    assert!(kills > 0, "the study was never killed");
    let output = in_folder(temporary.path(), &arguments).output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    assert_eq!(files(&temporary.path().join("out")), expected);
    println!("killed {kills} times in {times} tries");
}

#[test]
fn a_killed_study_of_fits_at_once_ends_in_the_same_bytes() {
    killed(5, 4);
}

#[test]
fn a_folder_stands_for_its_tracks_and_a_population_may_be_theirs() {
    let temporary = tempfile::tempdir().unwrap();
    let tracks = temporary.path().join("tracks");
    fs::create_dir_all(&tracks).unwrap();
    for (name, to) in [("s2_spherical", "2.ECSV"), ("s1_prolate_tilted", "1.ecsv")] {
        let from = crate::cli::example(&format!("tracks/{name}.ecsv"));
        fs::copy(from, tracks.join(to)).unwrap();
    }
    fs::write(tracks.join("notes.txt"), "not a track").unwrap();
    let with = |text: &str| {
        fs::write(temporary.path().join("study.toml"), text).unwrap();
        in_folder(temporary.path(), &["run", "study.toml", "-q"])
            .output()
            .unwrap()
    };
    let fixed = TRACKS.replace("fit.model", "fit.prior.fixed = { dir_x = 0.1 }\nfit.model");
    refused(&with(&fixed), &["[tracks.fit]", "prior of q"]);
    let of_mocks = format!("{TRACKS}of = \"mocks\"\n");
    refused(
        &with(&of_mocks),
        &["[population]", "of = \"mocks\"", "[mocks]"],
    );
    // One track under two names is one stream.
    fs::copy(tracks.join("1.ecsv"), tracks.join("3.ecsv")).unwrap();
    refused(&with(TRACKS), &["[tracks]", "s1_prolate_tilted", "twice"]);
    fs::remove_file(tracks.join("3.ecsv")).unwrap();
    // A population without a result is named beside the others, and the fits have their report.
    let outside = format!("{TRACKS}settings.family = {{ q_min = 1.4999, q_max = 1.5 }}\n");
    let output = with(&outside);
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    let printed = String::from_utf8(output.stdout).unwrap();
    let failed = printed.lines().find(|line| line.starts_with("FAILED"));
    assert!(
        failed.is_some_and(|line| line.contains("population nested")),
        "{printed}"
    );
    assert!(temporary.path().join("out/report.html").exists());
    let output = with(TRACKS);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let printed = String::from_utf8(output.stdout).unwrap();
    let first = |line: &str| line.split_whitespace().next().unwrap().to_owned();
    let rows: Vec<String> = printed.lines().skip(1).take(3).map(first).collect();
    assert_eq!(rows, ["s1_prolate_tilted", "s2_spherical", "population"]);
    // With a selection the population for which all streams were kept is beside that of those that were.
    let selected = format!(
        "{TRACKS}settings.selection = {{ q = [0.6, 1.4], kept = [0.9, 0.1], error = [0.001, 0.001] }}\n"
    );
    let output = with(&selected.replace("\"out\"", "\"selected\""));
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let printed = String::from_utf8(output.stdout).unwrap();
    let rows: Vec<String> = printed.lines().skip(3).take(2).map(first).collect();
    assert_eq!(rows, ["population", "population_without_selection"]);
    let median = |folder: &str| {
        let folder = temporary.path().join("selected").join(folder);
        let summary = fs::read(folder.join("summary.json"));
        let summary: serde_json::Value = serde_json::from_slice(&summary.unwrap()).unwrap();
        summary["parameters"]["mu_pop"]["median"].as_f64().unwrap()
    };
    // Rounder haloes are kept less often: the population that they come from has a larger mean.
    assert!(median("population_nested") > median("population_without_selection_nested"));
    fs::remove_dir_all(&tracks).unwrap();
    fs::create_dir_all(&tracks).unwrap();
    refused(&with(TRACKS), &["[tracks]", "files", ".ecsv"]);
}

#[test]
#[cfg(unix)]
fn fits_that_may_go_on_are_given_to_slurm_and_not_sampled_by_its_watcher() {
    use std::os::unix::fs::PermissionsExt;
    let temporary = tempfile::tempdir().unwrap();
    let track = crate::cli::example("tracks/s2_spherical.ecsv");
    let text = TRACKS.split("[population]").next().unwrap();
    let text = text.replace("[\"tracks\"]", &format!("[{track:?}]"));
    let text = format!("{text}[slurm]\nattempts = 1\npoll_seconds = 1\n");
    let write = |text: &str| fs::write(temporary.path().join("study.toml"), text).unwrap();
    write(&text);
    let mut command = in_folder(temporary.path(), &["run", "study.toml", "-q"]);
    let output = command.output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let fits = temporary.path().join("out/fits");
    let before = files(&fits);

    // Commands of a cluster that takes jobs and does none.
    let programs = temporary.path().join("bin");
    fs::create_dir(&programs).unwrap();
    for (name, script) in [
        ("squeue", "#!/bin/sh\n"),
        ("sbatch", "#!/bin/sh\necho \"$@\" >> \"$SUBMITTED\"\n"),
    ] {
        let path = programs.join(name);
        fs::write(&path, script).unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
    }
    let path = format!(
        "{}:{}",
        programs.display(),
        std::env::var("PATH").unwrap_or_default()
    );
    let submitted = temporary.path().join("submitted");
    let by_slurm = || {
        let mut command = in_folder(temporary.path(), &["run", "study.toml", "-q"]);
        command.args(["--executor", "slurm"]);
        command.env("PATH", &path).env("SUBMITTED", &submitted);
        let output = command.output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{output:?}");
        fs::read_to_string(&submitted).unwrap_or_default()
    };
    assert_eq!(by_slurm(), "");
    write(&text.replace("max_batches = 1", "max_batches = 2"));
    let said = by_slurm();
    assert!(
        said.lines().count() == 1 && said.contains("--array=1 "),
        "{said}"
    );
    assert_eq!(files(&fits), before);
}

#[test]
#[ignore = "half a minute: the study of twelve mocks that is killed twenty times"]
fn a_study_of_twelve_mocks_killed_twenty_times_ends_in_the_same_bytes() {
    killed(12, 20);
}
