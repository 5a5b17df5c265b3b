//! Tracks: bad ones are refused with file, line and remedy, and what is assumed is said.

use super::{SMALL, oblate, refused, write};
use std::path::Path;

#[test]
fn bad_tracks_name_file_line_and_remedy_and_leave_nothing_behind() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("run").display().to_string();
    let good = "phi,r,r_err\n-15,60,1.2\n-5,61,1.2\n5,62,1.2\n15,63,1.2\n";
    for (name, text, words) in [
        (
            "column.csv",
            good.replace("phi,r,", "phi,radius,"),
            vec!["line 1", "`radius` is not known"],
        ),
        (
            "errors.csv",
            good.replace(",r_err", "").replace(",1.2", ""),
            vec!["no errors", "--assume-error 2%"],
        ),
        (
            "near.csv",
            good.replace("r_err", "r_errs"),
            vec!["the nearest name is `r_err`"],
        ),
        ("nan.csv", good.replace("61", "nan"), vec!["line 3"]),
        ("negative.csv", good.replace("61", "-61"), vec!["line 3"]),
        (
            "unsorted.csv",
            good.replace("5,62", "-25,62"),
            vec!["line 4"],
        ),
        ("unequal.csv", good.replace("5,62", "2,62"), vec!["line"]),
        (
            "two.csv",
            "phi,r,r_err\n-5,60,1\n5,61,1\n".to_owned(),
            vec!["at least 3"],
        ),
    ] {
        let path = write(folder.path(), name, &text);
        let output = oblate(&["fit", &path, "--out", &out], "");
        let mut all = vec![name];
        all.extend(words);
        refused(&output, &all);
    }
    refused(
        &oblate(&["fit", "no_such.ecsv", "--out", &out], ""),
        &["no_such.ecsv"],
    );
    // A track that no prior draw can cover: right form, impossible size.
    let far = write(folder.path(), "far.csv", &good.replace(",6", ",6000"));
    refused(
        &oblate(&["fit", &far, "--particles", "256", "--out", &out], ""),
        &["none of 1000 prior draws", "widen the prior"],
    );
    assert!(!Path::new(&out).exists(), "nothing is left behind");
}

#[test]
fn an_assumed_error_is_named_in_the_summary_and_on_the_page() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name).display().to_string();
    let config = write(
        folder.path(),
        "small.toml",
        &format!("coarse_particles = 0\n{SMALL}likelihood.error_floor_percent = 3.0\n"),
    );
    let bare = "phi,r\n-15,57\n-5,63\n5,55\n15,51\n";
    let track = write(folder.path(), "bare.csv", bare);
    let out = path("run");
    let output = oblate(
        &[
            "fit",
            &track,
            "--assume-error",
            "2.5%",
            "--profile",
            "fast",
            "--particles",
            "128",
            "--config",
            &config,
            "--out",
            &out,
            "--allow-unconverged",
        ],
        "",
    );
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let said = "the errors of r are 2.5% of r";
    let printed = String::from_utf8(output.stdout).expect("text");
    assert!(printed.contains(&format!("Assumed: {said}")), "{printed}");
    let read = |name: &str| std::fs::read_to_string(Path::new(&out).join(name)).expect("a file");
    let summary: serde_json::Value = serde_json::from_str(&read("summary.json")).expect("JSON");
    let assumed = summary["assumptions"][0].as_str().expect("a text");
    assert!(assumed.starts_with(said), "{assumed}");
    assert!(read("track.ecsv").contains("assume_error: \"2.5%\""));
    // A profile replaces the model, not the floor of the data's errors.
    assert!(read("config.toml").contains("error_floor_percent = 3.0"));
    let page = path("page.html");
    let output = oblate(&["report", &out, "--out", &page], "");
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let html = std::fs::read_to_string(&page).expect("a page");
    assert!(html.contains(&format!("Assumed: {said}")));
}
