//! `oblate merge`: fits of several seeds become one.

use super::next::{proposed, shell};
use super::{SMALL, example, json, oblate, refused, write};
use crate::folders::copy;
use std::path::Path;

#[test]
fn fits_from_several_seeds_are_merged_into_one() {
    let folder = tempfile::tempdir().expect("a folder");
    let config = write(folder.path(), "small.toml", SMALL);
    let path = |name: &str| folder.path().join(name).display().to_string();
    let fit = |track: &str, seed: &str, out: &str| {
        let track = example(&format!("tracks/{track}.ecsv"))
            .display()
            .to_string();
        let mut arguments = vec!["fit", &track, "--config", &config, "--live", "60"];
        arguments.extend(["--seed", seed, "--out", out, "-q", "--allow-unconverged"]);
        assert_eq!(oblate(&arguments, "").status.code(), Some(0));
    };
    let (one, two, other, both) = (path("one"), path("two"), path("other"), path("both"));
    fit("s2_spherical", "1", &one);
    fit("s2_spherical", "2", &two);
    fit("s3_oblate_edge_on", "3", &other);
    let merge = |runs: &[&String], out: &String| {
        let mut arguments = vec!["merge"];
        arguments.extend(runs.iter().map(|run| run.as_str()));
        arguments.extend(["--out", out, "--json", "--allow-unconverged"]);
        oblate(&arguments, "")
    };
    refused(&merge(&[&one, &one], &both), &["same seed"]);
    refused(&merge(&[&one, &other], &both), &["differ in their track"]);
    refused(&merge(&[&one, &two], &two), &["one of the runs"]);
    // Nor does a new folder in one of them become a run.
    for inside in ["two/new", "two/new/run", "missing/../two/new"] {
        let inside = path(inside);
        refused(&merge(&[&one, &two], &inside), &["one of the runs"]);
        let bridge = ["bridge", &two, "--particles", "200", "--out", &inside];
        refused(&oblate(&bridge, ""), &["one of the runs"]);
    }
    assert!(!Path::new(&path("two/new")).exists() && !Path::new(&path("missing")).exists());
    assert!(!Path::new(&both).exists(), "nothing is left behind");
    let output = merge(&[&one, &two], &both);
    assert_eq!(output.status.code(), Some(0));
    let summary = json(&output.stdout);
    let part = |run: &str| {
        let text = std::fs::read(Path::new(run).join("summary.json")).expect("a summary");
        json(&text)
    };
    let calls = |summary: &serde_json::Value| summary["cost"]["calls"].as_u64().expect("calls");
    assert_eq!(calls(&summary), calls(&part(&one)) + calls(&part(&two)));
    let names: Vec<&str> = summary["checks"]
        .as_array()
        .expect("checks")
        .iter()
        .filter_map(|check| check["name"].as_str())
        .collect();
    assert!(names.contains(&"mean-agreement-of-seeds"), "{names:?}");
    // It has not converged: the commands that sample with one more seed and merge again are those to type, and run as they stand.
    assert_eq!(summary["converged"], false);
    let three = path("both_seed3");
    let steps = proposed(&output);
    let [(_, fit), (_, merger)] = &steps[..] else {
        panic!("{steps:?}");
    };
    assert!(fit.ends_with(&format!("--seed 3 --out {three}")), "{fit}");
    for (command, made) in [(fit, &three), (merger, &path("both_2"))] {
        let output = shell(folder.path(), &format!("{command} -q --allow-unconverged"));
        assert_eq!(output.status.code(), Some(0), "{command}");
        assert!(Path::new(made).join("summary.json").exists(), "{made}");
    }
    // Coarse runs are parts too: nothing is proposed in the runs that they are in.
    let coarse = ["outer_1/coarse", "outer_2/coarse"].map(path);
    for (run, inner) in [&one, &two].into_iter().zip(&coarse) {
        copy(Path::new(run), Path::new(inner));
    }
    let steps = proposed(&merge(&[&coarse[0], &coarse[1]], &path("of_coarse")));
    let fit = &steps[0].1;
    let apart = path("of_coarse_seed3");
    assert!(fit.ends_with(&format!("--out {apart}")), "{fit}");
    refused(&merge(&[&one, &two], &both), &["exists already"]);
    // It is a fit like any other.
    let page = path("page.html");
    let output = oblate(&["report", &both, "--out", &page], "");
    assert_eq!(output.status.code(), Some(0));
}
