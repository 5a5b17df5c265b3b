//! Studies: each run in a folder of its own within `out`.

use crate::cli::{SMALL, oblate, refused};
use crate::folders::tree;
use std::fs;
use std::path::{Path, PathBuf};

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
