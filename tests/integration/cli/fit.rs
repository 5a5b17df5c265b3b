//! `oblate fit` and `oblate bridge`: what is in the folder, with and without a coarse model.

use super::{json, oblate, refused, small_fit, write};
use std::path::Path;

#[test]
fn a_fit_fills_its_folder_is_never_overwritten_and_agrees_with_itself() {
    let (folder, config, track) = small_fit();
    let run = |name: &str, threads: &str| {
        let out = folder.path().join(name).display().to_string();
        let args = [
            "fit",
            &track,
            "--config",
            &config,
            "--threads",
            threads,
            "--out",
            &out,
            "--json",
            "-q",
            "--allow-unconverged",
        ];
        (out.clone(), oblate(&args, ""))
    };
    let (one, output) = run("one", "1");
    assert_eq!(
        output.status.code(),
        Some(0),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let summary = json(&output.stdout);
    for key in [
        "ln_z",
        "ess",
        "q",
        "parameters",
        "cost",
        "converged",
        "checks",
    ] {
        assert!(!summary[key].is_null(), "{key}");
    }
    for file in [
        "posterior.zarr",
        "summary.json",
        "config.toml",
        "log.jsonl",
        "track.ecsv",
    ] {
        assert!(Path::new(&one).join(file).exists(), "{file}");
    }
    let (_, again) = run("one", "1");
    refused(&again, &["exists already", "--resume", "--force"]);
    // The same bits on two threads.
    let (two, output) = run("two", "2");
    let other = json(&output.stdout);
    assert_eq!(summary["ln_z"], other["ln_z"]);
    assert_eq!(summary["parameters"], other["parameters"]);
    let output = oblate(&["compare", &one, &two], "");
    assert_eq!(output.status.code(), Some(0));
    assert!(String::from_utf8_lossy(&output.stdout).contains("one against two: they agree"));
    // Runs in folders of the same name are told apart.
    let elsewhere = folder.path().join("elsewhere");
    std::fs::create_dir(&elsewhere).expect("a folder");
    let namesake = elsewhere.join("one");
    std::os::unix::fs::symlink(&one, &namesake).expect("a link");
    let namesake = namesake.display().to_string();
    let output = oblate(&["compare", &one, &namesake], "");
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(
        text.starts_with(&format!("{one} against {namesake}: ")),
        "{text}"
    );
    // Fixed shape components leave no closed prior of q: a population must refuse.
    let out = folder.path().join("population").display().to_string();
    let arguments = ["population", &one, "--out", &out, "--allow-unconverged"];
    refused(&oblate(&arguments, ""), &["prior"]);
    // The page holds the figures.
    let page = folder.path().join("page.html").display().to_string();
    let other = write(folder.path(), "notes.txt", "no run");
    let unfinished = folder.path().join("unfinished");
    std::fs::create_dir(&unfinished).expect("a folder");
    for file in ["versions.json", "config.toml"] {
        let copy = unfinished.join(file);
        std::fs::copy(Path::new(&one).join(file), copy).expect("a copy");
    }
    let unfinished = unfinished.display().to_string();
    let given = ["report", &one, &other, &two, &unfinished, "--out", &page];
    let output = oblate(&given, "");
    let notes = String::from_utf8_lossy(&output.stderr);
    assert!(notes.contains("notes.txt is no run folder"), "{notes}");
    assert!(notes.contains("unfinished has not finished"), "{notes}");
    assert_eq!(
        output.status.code(),
        Some(0),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let text = std::fs::read_to_string(&page).expect("the page");
    assert!(
        text.matches("<svg").count() >= 8,
        "{}",
        text.matches("<svg").count()
    );
    assert!(!text.contains("NaN"));
    // A figure of this report takes the path of the page after the page's path was checked.
    let figure = Path::new(&one).join("q.svg");
    std::fs::remove_file(&figure).expect("a figure");
    let output = oblate(
        &["report", &one, "--out", &figure.display().to_string()],
        "",
    );
    refused(&output, &["q.svg", "exists"]);
    let text = std::fs::read_to_string(&figure).expect("a figure");
    assert!(text.starts_with("<svg"), "{}", &text[..40]);
    // Figures as PDF, with fonts in it; without any on this machine that is refused.
    let output = oblate(
        &[
            "report", &one, "--format", "svg,pdf", "--out", &page, "--force",
        ],
        "",
    );
    let figure = std::fs::read(Path::new(&one).join("corner.pdf"));
    if output.status.code() == Some(0) {
        let figure = figure.expect("a figure");
        assert!(figure.starts_with(b"%PDF") && figure.windows(9).any(|w| w == b"/FontFile"));
    } else {
        refused(&output, &["format = pdf", "no fonts"]);
    }
    let output = oblate(&["report", &one, "--format", "png", "--out", &page], "");
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("svg or pdf"));
}

#[test]
fn a_fit_is_bridged_to_another_model_of_its_stream() {
    let (folder, config, track) = small_fit();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let (fit, out) = (path("fit"), path("bridged"));
    let mut arguments = vec!["fit", &track, "--config", &config, "--live", "300"];
    arguments.extend(["--out", &fit, "-q", "--allow-unconverged"]);
    assert_eq!(oblate(&arguments, "").status.code(), Some(0));
    let bridge = |more: &[&str]| {
        let mut arguments = vec!["bridge", &fit, "--out", &out, "--json", "-q"];
        arguments.extend(more);
        oblate(&arguments, "")
    };
    refused(&bridge(&[]), &["that of the fit itself", "--particles"]);
    refused(
        &bridge(&["--particles", "200", "--smc-particles", "10"]),
        &["smc_particles", "ten per parameter"],
    );
    assert!(!Path::new(&out).exists(), "nothing is left behind");
    let output = bridge(&[
        "--particles",
        "200",
        "--smc-particles",
        "200",
        "--allow-unconverged",
    ]);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let summary = json(&output.stdout);
    assert_eq!(summary["method"], "bridge");
    let parts = &summary["ln_z_error_parts"];
    for part in ["parent", "weights", "lineage-weights"] {
        assert!(parts[part].as_f64().expect("a number") >= 0.0, "{parts}");
    }
    // The settings in the folder are those of the fine model.
    let left = std::fs::read_to_string(Path::new(&out).join("config.toml")).expect("settings");
    assert!(left.contains("particles = 200"), "{left}");
    refused(
        &bridge(&["--particles", "200", "--smc-particles", "200"]),
        &["exists already", "--resume", "--force"],
    );
    let page = path("page.html");
    let output = oblate(&["report", &out, "--out", &page], "");
    assert_eq!(output.status.code(), Some(0));
    // A folder without a track, as a population's.
    std::fs::remove_file(Path::new(&fit).join("track.ecsv")).expect("a track");
    let output = oblate(
        &[
            "bridge",
            &fit,
            "--particles",
            "200",
            "--out",
            &path("other"),
        ],
        "",
    );
    refused(&output, &["has no track", "oblate fit"]);
}

#[test]
fn a_fit_begins_with_its_coarse_model_and_is_that_fit_bridged() {
    let (folder, config, track) = small_fit();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let summary = |arguments: &[&str]| {
        let mut all = arguments.to_vec();
        all.extend(["-q", "--json", "--allow-unconverged"]);
        let output = oblate(&all, "");
        assert_eq!(output.status.code(), Some(0), "{output:?}");
        json(&output.stdout)
    };
    let (one, two, three) = (path("one"), path("two"), path("three"));
    let both = summary(&[
        "fit",
        &track,
        "--config",
        &config,
        "--coarse-particles",
        "64",
        "--out",
        &one,
    ]);
    let settings_of = |run: &str| format!("{run}/config.toml");
    let within = Path::new(&one).join("coarse").display().to_string();
    let coarse = summary(&[
        "fit",
        &track,
        "--config",
        &settings_of(&within),
        "--out",
        &two,
    ]);
    let fine = summary(&[
        "bridge",
        &two,
        "--config",
        &settings_of(&one),
        "--out",
        &three,
    ]);
    for key in ["ln_z", "parameters", "ess"] {
        assert_eq!(both[key], fine[key], "{key}");
    }
    assert_eq!(both["method"], "bridge");
    let calls = |of: &serde_json::Value| of["cost"]["calls"].as_u64().expect("a number");
    assert_eq!(calls(&both), calls(&coarse) + calls(&fine));
    // The inner folder is a complete run, and can be read as one.
    let output = oblate(&["compare", &within, &two], "");
    assert!(output.status.success(), "{output:?}");
    // A report of it has both stages.
    let page = path("page.html");
    let output = oblate(&["report", &one, "--out", &page], "");
    assert!(output.status.success(), "{output:?}");
    let page = std::fs::read_to_string(page).expect("a page");
    assert!(
        page.contains("Diagnostics of a bridge") && page.contains("Diagnostics of a nested run")
    );
    assert!(Path::new(&one).join("coarse-diagnostics.svg").exists());
    // Settings that the second stage cannot use are refused before the first.
    let settings = write(
        folder.path(),
        "few.toml",
        "sampling.bridge.smc_particles = 10",
    );
    let five = path("five");
    let early = oblate(
        &["fit", &track, "--config", &settings, "--out", &five, "-q"],
        "",
    );
    refused(&early, &["smc_particles", "ten per parameter"]);
    assert!(!Path::new(&five).exists(), "nothing is left behind");
    refused(
        &oblate(&["merge", &one, &three, "--out", &path("merged")], ""),
        &["the result of a bridge", "coarse", "oblate bridge"],
    );
    // With its time spent, the command says which stage it reached, and continues.
    let four = path("four");
    let mut arguments = vec![
        "fit",
        &track,
        "--config",
        &config,
        "--coarse-particles",
        "64",
    ];
    arguments.extend(["--out", &four]);
    let output = oblate(
        &[&arguments[..], &["--max-minutes", "0", "-q"]].concat(),
        "",
    );
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    let say = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(
        say.contains("coarse model") && say.contains("--resume"),
        "{say}"
    );
    arguments.push("--resume");
    assert_eq!(summary(&arguments)["ln_z"], both["ln_z"]);
}

#[test]
fn a_fit_along_a_surrogate_has_the_same_bits_on_threads_and_after_a_stop() {
    let (folder, config, track) = small_fit();
    let fit = |name: &str, more: &[&str]| {
        let out = folder.path().join(name).display().to_string();
        let mut args = vec!["fit", &track, "--config", &config, "--sampler", "pt-hmc"];
        let changes = ["surrogate=true", "hmc_transitions=0", "slice_updates=1"];
        let changes = changes.map(|change| format!("sampling.pt_hmc.{change}"));
        args.extend(changes.iter().flat_map(|change| ["--set", change.as_str()]));
        args.extend(["--coarse-particles", "0", "--out", &out, "--json", "-q"]);
        args.extend(more);
        oblate(&args, "")
    };
    let whole = fit("whole", &["--threads", "1"]);
    assert_eq!(whole.status.code(), Some(1), "{whole:?}");
    let expected = json(&whole.stdout);
    assert!(expected["ln_z"]["value"].is_f64(), "{expected}");
    let stopped = fit("stopped", &["--threads", "2", "--max-minutes", "0"]);
    assert_eq!(stopped.status.code(), Some(1), "{stopped:?}");
    let again = json(&fit("stopped", &["--threads", "2", "--resume"]).stdout);
    for key in ["ln_z", "parameters", "checks"] {
        assert_eq!(again[key], expected[key], "{key}");
    }
}
