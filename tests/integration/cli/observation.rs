//! Fits with parameters of the observation: what is printed and kept of those that are present, and of no others.

use super::{example, json, oblate, refused, small_fit, write};
use std::path::Path;

/// A point for `oblate evaluate` under the settings of [`SMALL`](super::SMALL), without optional parameters.
const POINT: &str = r#"{"log10_m_halo": 12.0, "dir_z": 1.2, "log10_m_prog": 7.7"#;

#[test]
fn a_fit_with_an_unseen_progenitor_has_its_angle_and_no_absent_parameter() {
    let (folder, config, track) = small_fit();
    let out = folder.path().join("run").display().to_string();
    let output = oblate(
        &[
            "fit",
            &track,
            "--config",
            &config,
            "--set",
            "prior.marginals.phi0_deg={kind=\"uniform\",lo=-30,hi=30}",
            "--set",
            "prior.fixed.distance_factor=1.02",
            "--out",
            &out,
            "--json",
            "-q",
            "--allow-unconverged",
        ],
        "",
    );
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let summary = json(&output.stdout);
    let parameters = summary["parameters"].to_string();
    assert!(parameters.contains("phi0_deg"), "{parameters}");
    for absent in ["jitter", "distance_factor"] {
        assert!(!parameters.contains(absent), "{parameters}");
    }
    let config = Path::new(&out).join("config.toml").display().to_string();
    let text = std::fs::read_to_string(&config).expect("settings");
    assert!(text.contains("[prior.marginals.phi0_deg]") && !text.contains("jitter"));
    // The page: with the track as the data have it.
    let page = folder.path().join("page.html").display().to_string();
    let output = oblate(&["report", &out, "--out", &page], "");
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let text = std::fs::read_to_string(&page).expect("the page");
    assert!(text.contains("phi0_deg") && !text.contains("jitter") && !text.contains("NaN"));
    // Evaluation by the settings in the folder.
    let evaluate = |end: &str, more: &[&str]| {
        let arguments = ["evaluate", &track, "--config", &config, "--gradient"];
        oblate(&[&arguments, more].concat(), &format!("{POINT}{end}}}\n"))
    };
    let output = evaluate(", \"phi0_deg\": 3.0", &[]);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let gradient = json(&output.stdout)["gradient"].clone();
    let gradient = gradient.as_object().expect("an object");
    assert_eq!(gradient.len(), 15);
    assert!(gradient["phi0_deg"].as_f64().expect("a number").abs() > 0.0);
    assert!(gradient["distance_factor"].is_f64());
    refused(&evaluate("", &[]), &["phi0_deg = missing"]);
    refused(
        &evaluate(", \"phi0_deg\": 3.0, \"jitter\": 0.1", &[]),
        &["jitter = 0.1", "absent", "prior.marginals.jitter"],
    );
    let output = evaluate(", \"phi0_deg\": 0.5", &["--cube"]);
    let parameters = json(&output.stdout)["parameters"].clone();
    assert!(parameters.get("jitter").is_none());
}

#[test]
fn only_what_is_present_is_printed() {
    let printed = |more: &[&str]| {
        let output = oblate(&[&["fit", "--print-config"], more].concat(), "");
        assert_eq!(output.status.code(), Some(0), "{output:?}");
        String::from_utf8(output.stdout).expect("text")
    };
    let text = printed(&[]);
    for absent in ["jitter", "distance_factor", "phi0_deg"] {
        assert!(!text.contains(absent), "{absent}");
    }
    let set = "prior.marginals.distance_factor={kind=\"normal\",mean=1.0,sd=0.05}";
    let text = printed(&["--set", set, "--set", "prior.fixed.jitter=0.02"]);
    let folder = tempfile::tempdir().expect("a folder");
    let path = write(folder.path(), "all.toml", &text);
    assert_eq!(printed(&["--config", &path]), text);
    assert!(text.contains("jitter = 0.02") && !text.contains("phi0_deg"));
    let track = example("tracks/s2_spherical.ecsv").display().to_string();
    let points = std::fs::read_to_string(example("points.jsonl")).expect("points");
    let output = oblate(&["evaluate", &track, "--gradient"], &points);
    let first = String::from_utf8(output.stdout).expect("text");
    let first = json(first.lines().next().expect("a line").as_bytes());
    assert_eq!(first["gradient"].as_object().expect("an object").len(), 13);
}

#[test]
fn an_impossible_prior_of_the_observation_is_refused_with_a_remedy() {
    let (folder, config, track) = small_fit();
    let out = folder.path().join("run").display().to_string();
    let fit = |set: &str| {
        let arguments = ["fit", &track, "--config", &config, "--set", set];
        oblate(&[&arguments[..], &["--out", &out]].concat(), "")
    };
    refused(
        &fit("prior.marginals.jitter={kind=\"normal\",mean=0.0,sd=0.1}"),
        &["prior.marginals.jitter", "negative", "half_normal"],
    );
    refused(
        &fit("prior.marginals.jitter={kind=\"uniform\",lo=-0.1,hi=0.1}"),
        &["prior.marginals.jitter.lo = -0.1", "allowed 0.0 to 1.0"],
    );
    refused(
        &fit("prior.fixed.distance_factor=0.0"),
        &["prior.fixed.distance_factor = 0", "allowed 0.1 to 10.0"],
    );
    assert!(!Path::new(&out).exists(), "nothing is left behind");
}
