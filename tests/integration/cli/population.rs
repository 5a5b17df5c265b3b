//! Populations on the command line: several families at once, what is refused, and what is written.

use super::{json, oblate, refused, write};
use crate::folders::copy;
use oblate::data::{Handedness, ObservedTrack, ReadOptions};
use std::path::Path;

/// Three mocks, fitted quickly and badly, and their population by two families.
pub const STUDY: &str = r#"
title = "three mocks"
out = "OUT"
allow_unconverged = true
[mocks]
count = 3
seed = 3
samplers = ["nested"]
[mocks.fit]
model = { releases = { particles = 128 }, step_phase = 2.0, max_halvings = 3 }
prior.fixed = { r_s_halo_kpc = 15.0, r_s_prog_kpc = 2.0, x0_kpc = 60.0, z0_kpc = 30.0, vx0_km_s = 30.0, vy0_km_s = 140.0, vz0_km_s = 45.0, age_gyr = 3.0 }
sampling.nested = { n_live = 40, kernel = "random-slice", steps = 4, max_batches = 1 }
[population]
samplers = ["nested"]
families = ["truncated-gaussian", "beta"]
settings.sampling.nested = { n_live = 60 }
"#;

/// The table has the best family first, and the ln Bayes factor of each against it, with the error of both.
fn is_the_table_of(families: &[serde_json::Value], table: &str) {
    let ln_z = |row: &serde_json::Value| {
        let number = |key: &str| row["summary"]["ln_z"][key].as_f64().expect("a number");
        (number("value"), number("error"))
    };
    let mut sorted: Vec<&serde_json::Value> = families.iter().collect();
    sorted.sort_by(|a, b| ln_z(b).0.total_cmp(&ln_z(a).0));
    let lines: Vec<&str> = table.lines().take(families.len() + 1).collect();
    assert!(
        lines[0].contains("ln Z               ln Bayes factor"),
        "{table}"
    );
    for (line, row) in lines[1..].iter().zip(&sorted) {
        // family, converged, ln Z +- error, ln Bayes factor +- error, ESS, folder.
        let cells: Vec<&str> = line.split_whitespace().collect();
        assert_eq!(cells.len(), 10, "{line}");
        assert_eq!(
            (cells[0], cells[9]),
            (
                row["family"].as_str().unwrap(),
                row["folder"].as_str().unwrap()
            )
        );
        let converged = if row["summary"]["converged"] == true {
            "yes"
        } else {
            "NO"
        };
        assert_eq!(cells[1], converged);
        let ((value, error), (best, of_best)) = (ln_z(row), ln_z(sorted[0]));
        let is_best = cells[0] == sorted[0]["family"];
        let of_factor = if is_best { 0.0 } else { error.hypot(of_best) };
        for (cell, expected) in [(2, value), (4, error), (5, value - best), (7, of_factor)] {
            let printed: f64 = cells[cell].parse().expect("a number");
            assert!((printed - expected).abs() < 0.000_501, "{line}: {expected}");
        }
        assert!(is_best || value < best, "{table}");
        let ess: f64 = cells[8].parse().expect("a number");
        assert!(
            (ess - row["summary"]["ess"].as_f64().unwrap()).abs() < 0.51,
            "{line}"
        );
    }
    assert!(lines[1].contains("    0.000 +- 0.000 "), "{table}");
}

#[test]
fn a_population_is_compared_by_family_and_its_streams_are_checked() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name).display().to_string();
    let study = write(
        folder.path(),
        "study.toml",
        &STUDY.replace("OUT", &path("study")),
    );
    let output = oblate(&["run", &study, "-q"], "");
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(text.contains("population_beta") && text.contains("population_truncated-gaussian"));
    // The fits have one batch each: which setting lets them go on.
    let text = String::from_utf8_lossy(&output.stderr);
    let extend = format!("raise its `sampling.nested.max_batches` in {study} and repeat the study");
    assert!(
        text.contains("To extend mock_3_") && text.contains(&extend),
        "{text}"
    );
    let mocks = folder.path().join("study/mocks");
    let mut fits: Vec<String> = std::fs::read_dir(&mocks)
        .expect("fits")
        .map(|entry| entry.expect("an entry").path().display().to_string())
        .collect();
    fits.sort();
    assert_eq!(fits.len(), 3);
    let population = |fits: &[String], more: &[&str]| {
        let mut args = vec!["population"];
        args.extend(fits.iter().map(String::as_str));
        args.extend(["-q", "--allow-unconverged"]);
        args.extend(more);
        oblate(&args, "")
    };

    // Several families: a run folder each, which a report reads as any other.
    let out = path("families");
    let several = ["--family", "uniform,truncated-gaussian", "--out", &out];
    let output = population(&fits, &[&several[..], &["--json"]].concat());
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let families = json(&output.stdout);
    let rows = families["families"].as_array().expect("rows");
    assert_eq!(rows.len(), 2);
    for row in rows {
        let summary = &row["summary"];
        let population = &summary["population"];
        assert_eq!(population["streams"].as_array().expect("streams").len(), 3);
        let checks = summary["model_checks"].as_array().expect("checks");
        assert_eq!(checks.len(), 3);
        for check in &checks[..2] {
            let message = check["message"].as_str().expect("words");
            assert!(message.contains("mock_3_"), "{message}");
        }
        assert_eq!(checks[2]["name"], "predictive-p-value");
        assert_eq!(population["predictive"].as_array().expect("rows").len(), 4);
        for stream in population["streams"].as_array().expect("streams") {
            let without = &stream["without"];
            assert_eq!(without["parameters"].as_object().expect("rows").len(), 2);
            assert!(without["ln_predictive_density"].is_number());
        }
        let run = Path::new(row["folder"].as_str().expect("a folder"));
        let table = std::fs::read_to_string(run.join("density.csv")).expect("a table");
        assert!(table.starts_with("q,mean,median,lo68,hi68,lo95,hi95\n0.5,"));
        assert_eq!(table.lines().count(), 202);
        let table = std::fs::read_to_string(run.join("streams.csv")).expect("a table");
        assert!(table.starts_with("stream,q_median,q_lo68,"), "{table}");
        let width = table
            .lines()
            .next()
            .map_or(0, |names| names.split(',').count());
        assert_eq!(width, 1 + 10 + 3 + 2 + 2 * 4);
        assert_eq!(table.lines().count(), 4);
    }
    let names = |row: usize| rows[row]["summary"]["parameters"].clone();
    assert!(names(0)["width_pop"].is_object() && names(1)["sigma_pop"].is_object());
    // Again, as text, and read back to the bit; a lost table is written again.
    let lost =
        ["density.csv", "streams.csv"].map(|name| Path::new(&out).join("uniform").join(name));
    let tables = lost
        .each_ref()
        .map(|table| std::fs::read(table).expect("the table"));
    std::fs::remove_file(&lost[0]).expect("the table");
    // As one of an earlier result of this folder is.
    std::fs::write(&lost[1], "stream\n").expect("another table");
    let output = population(&fits, &[&several[..], &["--resume"]].concat());
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(text.starts_with("family "), "{text}");
    is_the_table_of(rows, &text);
    assert!(text.contains("NOT MEASURED: "), "{text}");
    let again = lost
        .each_ref()
        .map(|table| std::fs::read(table).expect("the table"));
    assert_eq!(again, tables);
    // A study writes beside run folders, not into one.
    let inside = STUDY.replace("OUT", &path("families/uniform"));
    let inside = write(folder.path(), "inside.toml", &inside);
    refused(
        &oblate(&["run", &inside, "-q"], ""),
        &["is the folder of one run"],
    );
    let page = path("page.html");
    let (uniform, gaussian) = (
        path("families/uniform"),
        path("families/truncated-gaussian"),
    );
    let output = oblate(&["report", &uniform, &gaussian, "--out", &page], "");
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let text = std::fs::read_to_string(&page).expect("the page");
    assert!(text.contains("given the population</th>") && text.contains("NOT MEASURED"));
    assert!(text.contains("<th>without</th><th>centre_pop</th>"));
    assert!(text.contains("<td>largest gap of q</td>"));
    assert!(text.contains("<p>Most influential stream: mock_3_"));
    assert!(text.contains("Move of each hyperparameter"));
    // The figures are ours, so that the run can be replaced.
    let output = population(&fits, &[&several[..], &["--force"]].concat());
    assert_eq!(output.status.code(), Some(0), "{output:?}");

    // Too few draws: the same with more batches is the command to type.
    let short = path("short");
    let one_batch = ["sampling.nested.max_batches=1", "sampling.nested.n_live=30"];
    let [batches, live] = one_batch;
    let output = population(&fits, &["--set", batches, "--set", live, "--out", &short]);
    let text = String::from_utf8_lossy(&output.stderr);
    let proposed = format!("--out {short}_2 --set sampling.nested.max_batches=2");
    assert!(text.contains(&proposed), "{output:?}");

    // Steps that are too few: the proposal changes those that the run had, three for each hyperparameter.
    let mixture = path("mixture");
    let of_mixture = ["--family", "mixture", "--out", &mixture];
    let output = population(&fits, &of_mixture);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let summary = Path::new(&mixture).join("summary.json");
    let text = std::fs::read_to_string(&summary).expect("a summary");
    let (before, check) = text.split_once("\"insertion-rank\"").expect("the check");
    let failed = check.replacen("\"pass\": true", "\"pass\": false", 1);
    let failed = format!("{before}\"insertion-rank\"{failed}");
    let failed = failed.replace("\"converged\": true", "\"converged\": false");
    std::fs::write(&summary, &failed).expect("a summary");
    let output = population(&fits, &[&of_mixture[..], &["--resume"]].concat());
    let text = String::from_utf8_lossy(&output.stderr);
    let dim = json(failed.as_bytes())["parameters"]
        .as_object()
        .expect("rows")
        .len();
    let proposed = format!("--set sampling.nested.steps={}", 6 * dim);
    assert!(text.contains(&proposed), "{text}");

    // With a selection, which the mocks' maker writes.
    let selection = path("selection.toml");
    let make = |more: &[&str]| {
        let few = [
            "selection",
            "--draws",
            "40",
            "--points",
            "3",
            "--particles",
            "600",
        ];
        oblate(&[&few[..], &["--out", &selection, "-q"], more].concat(), "")
    };
    let output = make(&["--set", "min_angle_deg=60.0", "--json"]);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let made = json(&output.stdout);
    assert_eq!(made["selection"]["q"].as_array().expect("values").len(), 3);
    assert_eq!(made["settings"]["min_angle_deg"], 60.0);
    refused(&make(&[]), &["selection.toml"]);
    let selected = path("selected");
    let with = [
        "--config",
        selection.as_str(),
        "--out",
        selected.as_str(),
        "--json",
    ];
    let output = population(&fits, &with);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let checks = json(&output.stdout)["model_checks"].clone();
    assert_eq!(checks[3]["name"], "selection-variance");
    let config = std::fs::read_to_string(Path::new(&selected).join("config.toml"));
    assert!(config.expect("settings").contains("[selection]"));

    // Streams whose folders have one name are told apart.
    let namesakes = ["a", "b"].map(|parent| path(&format!("{parent}/fit")));
    for (fit, namesake) in fits.iter().zip(&namesakes) {
        copy(Path::new(fit), Path::new(namesake));
    }
    let out = path("namesakes");
    let output = population(&namesakes, &["--out", &out]);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let table = std::fs::read_to_string(Path::new(&out).join("streams.csv")).expect("a table");
    assert!(namesakes.iter().all(|name| table.contains(name)), "{table}");

    // Refusals, each before anything is written.
    let nowhere = path("nowhere");
    let at = ["--out", nowhere.as_str()];
    let unknown = population(&fits, &[&at[..], &["--family", "gauss"]].concat());
    refused(
        &unknown,
        &[
            "gauss",
            "truncated-gaussian, uniform, mixture, beta, histogram",
        ],
    );
    let twice = population(&fits, &[&at[..], &["--family", "beta,beta"]].concat());
    refused(&twice, &["family = beta", "once"]);
    let into_run = population(&fits, &["--family", "beta,uniform", "--out", &uniform]);
    refused(&into_run, &["is the folder of one run"]);
    let into_fit = population(&fits, &["--family", "beta,uniform", "--out", &fits[0]]);
    refused(&into_fit, &["choose another folder"]);
    let inside_fit = format!("{}/population", fits[0]);
    refused(
        &population(&fits, &["--out", &inside_fit]),
        &["is, is in or holds one of the runs"],
    );
    let again = path("again");
    copy(Path::new(&fits[0]), Path::new(&again));
    let with_again = [&fits[..], std::slice::from_ref(&again)].concat();
    let is_refused = || {
        let output = population(&with_again, &at);
        refused(&output, &["again: the track is that of mock_3_", "twice"]);
    };
    is_refused();
    // In the other sense it is the same track, too.
    let track = Path::new(&again).join("track.ecsv");
    let mirrored = ReadOptions {
        handedness: Some(Handedness::Mirrored),
        ..ReadOptions::default()
    };
    let mirrored = ObservedTrack::read_with(&track, &mirrored).expect("a track");
    mirrored.write(&track).expect("a track");
    is_refused();
    // So it is with fewer digits.
    let mut rounded = mirrored;
    for r in &mut rounded.r_kpc {
        *r = (*r * 100.0).round() / 100.0;
    }
    rounded.write(&track).expect("a track");
    is_refused();
    // And without its last bin.
    let text = std::fs::read_to_string(&track).expect("a track");
    let (without, _) = text.trim_end().rsplit_once('\n').expect("bins");
    std::fs::write(&track, without).expect("a track");
    is_refused();
    for (key, value, words) in [
        ("q_max = 1.5", "q_max = 1.6", "[prior]"),
        ("[prior.fixed]", "[prior.fixed]\np_halo = 0.8", "[prior]"),
        ("fardal2015", "chen2025", "model.releases.recipe"),
        ("[model]", "[model]\nhalo = \"nfw_density\"", "model.halo"),
    ] {
        let other = path("other");
        copy(Path::new(&fits[1]), Path::new(&other));
        let config = Path::new(&other).join("config.toml");
        let text = std::fs::read_to_string(&config).expect("settings");
        assert!(text.contains(key), "{text}");
        std::fs::write(&config, text.replace(key, value)).expect("settings");
        let output = population(&[fits[0].clone(), other.clone()], &at);
        refused(&output, &[words]);
        std::fs::remove_dir_all(&other).expect("a folder");
    }
    // The distance of each stream has its own error: another distance is no other prior, and the next refusal is met.
    let other = path("other");
    copy(Path::new(&fits[1]), Path::new(&other));
    let config = Path::new(&other).join("config.toml");
    let text = std::fs::read_to_string(&config).expect("settings");
    let text = text.replace("fardal2015", "chen2025");
    let text = text.replace("[prior.fixed]", "[prior.fixed]\ndistance_factor = 1.1");
    assert!(text.contains("distance_factor"), "{text}");
    std::fs::write(&config, text).expect("settings");
    let output = population(&[fits[0].clone(), other], &at);
    refused(&output, &["model.releases.recipe"]);
    assert!(!Path::new(&nowhere).exists());
}

#[test]
fn a_population_of_fits_that_went_on_is_sampled_again() {
    let folder = tempfile::tempdir().expect("a folder");
    let text = STUDY
        .replace("OUT", &folder.path().join("study").display().to_string())
        .replace("count = 3", "count = 1")
        .replace("families = [\"truncated-gaussian\", \"beta\"]\n", "");
    let run = |text: &str| {
        let study = write(folder.path(), "study.toml", text);
        let output = oblate(&["run", &study, "-q", "--json"], "");
        assert_eq!(output.status.code(), Some(0), "{output:?}");
        let runs = json(&output.stdout)["runs"].clone();
        [0, 1].map(|k: usize| runs[k]["summary"]["ln_z"]["value"].clone())
    };
    let [fit, population] = run(&text);
    assert_eq!(run(&text), [fit.clone(), population.clone()]);
    let [longer, after] = run(&text.replace("max_batches = 1", "max_batches = 2"));
    assert!(longer != fit && after != population, "{fit} {population}");
    // By hand it is refused, because the folder's population is one of other fits.
    let fits = folder.path().join("study/mocks");
    let fit = std::fs::read_dir(fits)
        .expect("fits")
        .next()
        .expect("a fit");
    let fit = fit.expect("an entry").path().display().to_string();
    let out = folder.path().join("population").display().to_string();
    let args = [
        "population",
        &fit,
        "--out",
        &out,
        "-q",
        "--allow-unconverged",
    ];
    assert_eq!(oblate(&args, "").status.code(), Some(0));
    run(&text.replace("max_batches = 1", "max_batches = 3"));
    let resumed = [&args[..], &["--resume"]].concat();
    refused(&oblate(&resumed, ""), &["other settings", "--force"]);
}
