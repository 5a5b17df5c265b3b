//! The command itself: machine-readable output, exit codes, and one clear error for each bad input.

mod arguments;
mod doctor;
mod eta;
mod exit;
mod export;
mod message;
mod next;
mod output;
mod population;
mod progress;
mod study;

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

pub fn example(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("examples")
        .join(name)
}

pub fn oblate(args: &[&str], input: &str) -> Output {
    let mut child = Command::new(env!("CARGO_BIN_EXE_oblate"))
        .args(args)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the command starts");
    // A command that refuses its arguments may end before it reads.
    let _ = child
        .stdin
        .take()
        .expect("stdin")
        .write_all(input.as_bytes());
    child.wait_with_output().expect("the command ends")
}

pub fn json(bytes: &[u8]) -> serde_json::Value {
    serde_json::from_slice(bytes).expect("JSON on standard output")
}

/// Asserts exit 2 and one error line that holds all `words`.
pub fn refused(output: &Output, words: &[&str]) {
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{text}");
    let errors = text.lines().filter(|line| line.starts_with("error: "));
    assert_eq!(errors.count(), 1, "{text}");
    for word in words {
        assert!(text.contains(word), "`{word}` is not in: {text}");
    }
}

fn write(folder: &Path, name: &str, text: &str) -> String {
    let path = folder.join(name);
    std::fs::write(&path, text).expect("a file");
    path.display().to_string()
}

#[test]
fn stream_prints_its_machine_form() {
    let params = example("stream.toml").display().to_string();
    let output = oblate(&["stream", &params, "--particles", "1000", "--json"], "");
    assert_eq!(output.status.code(), Some(0));
    let value = json(&output.stdout);
    let n = value["track"]["phi_deg"].as_array().expect("bins").len();
    assert!(n >= 3);
    for key in ["r_kpc", "n"] {
        assert_eq!(value["track"][key].as_array().expect("a column").len(), n);
    }
    let q = value["q"].as_f64().expect("q");
    assert!(q > 0.5 && q < 1.5);
    assert_eq!(value["axis"].as_array().expect("axis").len(), 3);
    assert!(value["seconds"].as_f64().expect("seconds") > 0.0);
}

#[test]
fn stream_takes_the_settings_of_a_fit() {
    let folder = tempfile::tempdir().expect("a folder");
    let text = "model.releases.particles = 512\nlikelihood = { edges = \"hard\", min_fraction = 0.02 }\nprior.fixed.age_gyr = 3.0\n";
    let config = write(folder.path(), "fit.toml", text);
    let params = example("stream.toml").display().to_string();
    let printed = |more: &[&str]| {
        let output = oblate(&[&["stream", &params], more].concat(), "");
        assert_eq!(output.status.code(), Some(0), "{output:?}");
        String::from_utf8(output.stdout).expect("text")
    };
    let by_flags = |particles| {
        let flags = [
            "--particles",
            particles,
            "--edge",
            "0",
            "--min-fraction",
            "0.02",
        ];
        printed(&flags)
    };
    assert_eq!(printed(&["--config", &config]), by_flags("512"));
    // Flags override the file.
    assert_eq!(
        printed(&["--config", &config, "--particles", "1024"]),
        by_flags("1024")
    );
    assert_ne!(printed(&[]), by_flags("2560"));
}

#[test]
fn evaluate_answers_line_by_line_and_its_gradient_is_the_slope() {
    let track = example("tracks/s2_spherical.ecsv").display().to_string();
    let point = |log10_m: f64| {
        format!(
            "{{\"log10_m_halo\":{log10_m},\"r_s_halo_kpc\":15.0,\"dir_x\":0.1,\"dir_y\":0.2,\"dir_z\":1.5,\
             \"log10_m_prog\":7.7,\"r_s_prog_kpc\":1.5,\"x0_kpc\":60.0,\"z0_kpc\":30.0,\"vx0_km_s\":30.0,\
             \"vy0_km_s\":140.0,\"vz0_km_s\":45.0,\"age_gyr\":3.0}}"
        )
    };
    let h = 1e-6;
    let input = format!(
        "{}\n{}\n{}\n",
        point(12.0 - h),
        point(12.0),
        point(12.0 + h)
    );
    let output = oblate(
        &[
            "evaluate",
            &track,
            "--gradient",
            "--particles",
            "256",
            "--steps",
            "50",
        ],
        &input,
    );
    assert_eq!(output.status.code(), Some(0));
    let lines: Vec<serde_json::Value> = String::from_utf8_lossy(&output.stdout)
        .lines()
        .map(|l| json(l.as_bytes()))
        .collect();
    assert_eq!(lines.len(), 3);
    let l = |i: usize| lines[i]["ln_likelihood"].as_f64().expect("a number");
    let slope = (l(2) - l(0)) / (2.0 * h);
    let gradient = lines[1]["gradient"]["log10_m_halo"]
        .as_f64()
        .expect("a number");
    assert!(
        (slope - gradient).abs() < 1e-4 * gradient.abs().max(1.0),
        "{slope} {gradient}"
    );
    assert!(lines[1]["rejected"].is_null());
}

/// The answers of `oblate evaluate` on a track to lines of input, with a small model and further arguments.
fn answers(arguments: &[&str], input: &str) -> Vec<serde_json::Value> {
    let track = example("tracks/s2_spherical.ecsv").display().to_string();
    let mut all = vec!["evaluate", &track, "--particles", "128"];
    all.extend(arguments);
    let output = oblate(&all, input);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    text.lines().map(|l| json(l.as_bytes())).collect()
}

#[test]
fn evaluate_answers_lists_as_it_answers_their_points_alone() {
    let points = std::fs::read_to_string(example("points.jsonl")).unwrap();
    let alone = answers(&["--gradient"], &points);
    let list = format!("[{}]\n[]\n", points.trim().replace('\n', ","));
    let lists = answers(&["--gradient", "--threads", "2"], &list);
    assert_eq!(lists[0].as_array().unwrap().len(), alone.len());
    for (one, other) in alone.iter().zip(lists[0].as_array().unwrap()) {
        for key in ["ln_likelihood", "gradient", "derived", "rejected"] {
            assert_eq!(one[key], other[key], "{key}");
        }
        assert!(one["derived"]["q"].as_f64().unwrap() > 0.5);
    }
    assert_eq!(lists[1], serde_json::json!([]));
}

#[test]
fn evaluate_rejects_points_outside_the_prior_and_goes_on() {
    let points = std::fs::read_to_string(example("points.jsonl")).unwrap();
    let outside = points.replace("\"age_gyr\": 3.0", "\"age_gyr\": 9.0");
    let all = answers(&["--gradient"], &(outside + &points));
    let causes: Vec<_> = all.iter().map(|a| a["rejected"].as_str()).collect();
    let cause = Some("outside_prior");
    assert_eq!(causes, [cause, cause, None, None]);
    assert!(all[0]["ln_likelihood"].is_null() && all[0].get("gradient").is_none());
    assert!(all[2]["ln_likelihood"].is_f64());
}

#[test]
fn evaluate_needs_no_fixed_parameters_and_refuses_other_values_of_them() {
    let config = example("quick_fit.toml").display().to_string();
    let free = "{\"log10_m_halo\": 12.0, \"dir_x\": 0.5, \"dir_y\": 0.2, \"dir_z\": 1.4, \"log10_m_prog\": 7.7";
    let input = format!("{free}}}\n{free}, \"age_gyr\": 3.0}}\n");
    let found = answers(&["--config", &config], &input);
    assert_eq!(found[0]["ln_likelihood"], found[1]["ln_likelihood"]);
    let track = example("tracks/s2_spherical.ecsv").display().to_string();
    let arguments = ["evaluate", &track, "--config", &config];
    refused(
        &oblate(&arguments, &format!("{free}, \"age_gyr\": 2.0}}\n")),
        &["standard input", "line 1", "age_gyr = 2: it is fixed at 3"],
    );
    refused(
        &oblate(&arguments, "{\"log10_m_halo\": 12.0}\n"),
        &["line 1", "dir_x = missing: give a value"],
    );
}

#[test]
fn evaluate_transforms_the_unit_cube_and_its_gradient() {
    let config = example("quick_fit.toml").display().to_string();
    let point = |u: f64| {
        format!(
            "{{\"log10_m_halo\": {u}, \"dir_x\": 0.7, \"dir_y\": 0.6, \"dir_z\": 0.8, \"log10_m_prog\": 0.35}}"
        )
    };
    let (u, h) = (0.34, 1e-6);
    let input = format!("[{}, {}, {}]\n", point(u - h), point(u), point(u + h));
    let found = answers(&["--config", &config, "--cube", "--gradient"], &input);
    let l = |i: usize| found[0][i]["ln_likelihood"].as_f64().unwrap();
    let slope = (l(2) - l(0)) / (2.0 * h);
    let gradient = found[0][1]["gradient"].as_object().unwrap();
    assert_eq!(gradient.len(), 5);
    let by_u = gradient["log10_m_halo"].as_f64().unwrap();
    assert!((slope / by_u - 1.0).abs() < 1e-3, "{slope} {by_u}");
    let parameters = &found[0][1]["parameters"];
    // Uniform between 11 and 14; another one is fixed.
    assert!((parameters["log10_m_halo"].as_f64().unwrap() - (11.0 + 3.0 * u)).abs() < 1e-12);
    assert_eq!(parameters["age_gyr"], 3.0);
    let outside = answers(&["--config", &config, "--cube"], &point(1.5));
    assert_eq!(outside[0]["rejected"], "outside_prior");
}

#[test]
fn mocks_are_written_with_their_truth_and_never_overwritten() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("mocks").display().to_string();
    let args = [
        "mock",
        "--count",
        "2",
        "--seed",
        "7",
        "--particles",
        "2000",
        "--out",
        &out,
        "--json",
    ];
    let output = oblate(&args, "");
    assert_eq!(output.status.code(), Some(0));
    let value = json(&output.stdout);
    assert_eq!(value["accepted"], 2);
    for mock in value["mocks"].as_array().expect("mocks") {
        let track = mock["track"].as_str().expect("a path");
        let read = oblate::data::ObservedTrack::read(Path::new(track)).expect("a track");
        let truth = read.meta["truth"]["q"].as_f64().expect("a number");
        assert!((truth - mock["q"].as_f64().expect("q")).abs() < 1e-12);
    }
    refused(&oblate(&args, ""), &["exists already", "--force"]);
}

#[test]
fn every_setting_is_printed_and_read_back() {
    let output = oblate(&["fit", "--print-config"], "");
    assert_eq!(output.status.code(), Some(0));
    let text = String::from_utf8(output.stdout).expect("text");
    let folder = tempfile::tempdir().expect("a folder");
    let path = write(folder.path(), "all.toml", &text);
    let again = oblate(&["fit", "--print-config", "--config", &path], "");
    assert_eq!(String::from_utf8_lossy(&again.stdout), text);
    // Every table of the first level has a comment that says where it is explained.
    let mut before = "";
    for line in text.lines() {
        if line.starts_with('[') && !line.contains('.') {
            assert!(
                before.starts_with("# ") && before.contains("docs/"),
                "{line}"
            );
        }
        before = line;
    }
}

#[test]
fn bad_settings_and_parameters_name_file_line_and_remedy() {
    let folder = tempfile::tempdir().expect("a folder");
    let track = example("tracks/s2_spherical.ecsv").display().to_string();
    let out = folder.path().join("run").display().to_string();
    let unknown = write(folder.path(), "unknown.toml", "seed = 1\nsneed = 2\n");
    let fit = |config: &str| oblate(&["fit", &track, "--config", config, "--out", &out], "");
    // A setting that no sampler can work with is refused before a folder is made.
    let few = write(
        folder.path(),
        "few.toml",
        "[sampling]\nsampler = \"nested\"\nnested = { n_live = 3 }\n",
    );
    refused(&fit(&few), &["n_live", "3"]);
    assert!(!folder.path().join("run").exists());
    refused(
        &fit(&unknown),
        &[
            "unknown.toml",
            "line 2",
            "sneed",
            "--print-config",
            "\n2 | sneed = 2\n  | ^^^^^\n",
        ],
    );
    // Keys of a table that is merged with defaults are reported with their own lines as well.
    let deep = "[sampling]\nsampler = \"nested\"\n\n[sampling.nested]\nn_live = 100\nn_alive = 3\n";
    let deep = write(folder.path(), "deep.toml", deep);
    refused(
        &fit(&deep),
        &["deep.toml", "line 6", "\n6 | n_alive = 3\n  | ^^^^^^^\n"],
    );
    let text = "[sampling]\nsampler = \"nested\"\nnested.steps = 4\nnested.n_live = \"a\"\n";
    let typed = write(folder.path(), "typed.toml", text);
    refused(
        &fit(&typed),
        &[
            "typed.toml",
            "line 4",
            "\n4 | nested.n_live = \"a\"\n  |        ^^^^^^\n",
        ],
    );
    refused(&fit("nowhere.toml"), &["nowhere.toml", "readable"]);
    let odd = write(
        folder.path(),
        "odd.toml",
        "[model.releases]\nparticles = 1001\n",
    );
    refused(&fit(&odd), &["particles = 1001", "multiple"]);
    let outside = std::fs::read_to_string(example("stream.toml"))
        .expect("the example")
        .lines()
        .map(|l| {
            if l.starts_with("age_gyr") {
                "age_gyr = 40.0"
            } else {
                l
            }
        })
        .collect::<Vec<_>>()
        .join("\n");
    let outside = write(folder.path(), "outside.toml", &outside);
    refused(
        &oblate(&["stream", &outside], ""),
        &["outside.toml", "age_gyr", "[1, 4]"],
    );
    refused(
        &oblate(&["evaluate", &track], "{\"age_gyr\": 1}\n"),
        &["standard input", "line 1", "log10_m_halo = missing"],
    );
    assert!(!Path::new(&out).exists(), "nothing is left behind");
}

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

/// Three free parameters, few particles, long steps: a fit of seconds.
pub const SMALL: &str = r#"
model = { releases = { particles = 128 }, step_phase = 2.0, max_halvings = 3 }
prior.fixed = { r_s_halo_kpc = 15.0, dir_x = 0.1, dir_y = 0.2, r_s_prog_kpc = 1.0, x0_kpc = 60.0, z0_kpc = 30.0, vx0_km_s = 30.0, vy0_km_s = 140.0, vz0_km_s = 45.0, age_gyr = 3.0 }
sampling.sampler = "nested"
sampling.nested = { n_live = 40, kernel = "random-slice", steps = 6 }
sampling.pt_hmc = { chain_sets = 2, first_scans = 4, smc_particles = 24, slice_updates = 3, extensions = 1 }
sampling.bridge = { smc_particles = 60, mcmc_steps = 4 }
"#;

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

#[test]
fn a_fit_fills_its_folder_is_never_overwritten_and_agrees_with_itself() {
    let folder = tempfile::tempdir().expect("a folder");
    let config = write(folder.path(), "small.toml", SMALL);
    let track = example("tracks/s2_spherical.ecsv").display().to_string();
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
    assert!(String::from_utf8_lossy(&output.stdout).contains("they agree"));
    // Fixed shape components leave no closed prior of q: a population must refuse.
    let out = folder.path().join("population").display().to_string();
    let arguments = ["population", &one, "--out", &out, "--allow-unconverged"];
    refused(&oblate(&arguments, ""), &["prior"]);
    // The page holds the figures.
    let page = folder.path().join("page.html").display().to_string();
    let other = write(folder.path(), "notes.txt", "no run");
    let output = oblate(&["report", &one, &other, &two, "--out", &page], "");
    let skipped = String::from_utf8_lossy(&output.stderr).contains("skipped: ");
    assert!(skipped, "{output:?}");
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
}

#[test]
fn a_fit_is_bridged_to_another_model_of_its_stream() {
    let folder = tempfile::tempdir().expect("a folder");
    let config = write(folder.path(), "small.toml", SMALL);
    let track = example("tracks/s2_spherical.ecsv").display().to_string();
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
    let folder = tempfile::tempdir().expect("a folder");
    let config = write(folder.path(), "small.toml", SMALL);
    let track = example("tracks/s2_spherical.ecsv").display().to_string();
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
fn a_fit_along_a_surrogate_needs_no_coarse_fit_and_has_the_same_bits_on_threads_and_after_a_stop() {
    let folder = tempfile::tempdir().expect("a folder");
    let config = write(folder.path(), "small.toml", SMALL);
    let track = example("tracks/s2_spherical.ecsv").display().to_string();
    let fit = |name: &str, more: &[&str]| {
        let out = folder.path().join(name).display().to_string();
        let mut args = vec!["fit", &track, "--config", &config, "--sampler", "pt-hmc"];
        let changes = [
            "surrogate_points=3000",
            "hmc_transitions=2",
            "max_leapfrogs=8",
        ];
        let changes = changes.map(|change| format!("sampling.pt_hmc.{change}"));
        args.extend(changes.iter().flat_map(|change| ["--set", change.as_str()]));
        args.extend(["--coarse-particles", "64", "--out", &out, "--json", "-q"]);
        args.extend(more);
        let output = oblate(&args, "");
        assert!(
            !folder.path().join(name).join("coarse").exists(),
            "{output:?}"
        );
        output
    };
    let whole = fit("whole", &["--threads", "1"]);
    assert_eq!(whole.status.code(), Some(1), "{whole:?}");
    let expected = json(&whole.stdout);
    assert!(expected["ln_z"]["value"].is_f64(), "{expected}");
    let stopped = fit("stopped", &["--threads", "2", "--max-minutes", "0"]);
    assert_eq!(stopped.status.code(), Some(130), "{stopped:?}");
    let again = json(&fit("stopped", &["--threads", "2", "--resume"]).stdout);
    for key in ["ln_z", "parameters", "checks"] {
        assert_eq!(again[key], expected[key], "{key}");
    }
}

#[test]
fn fits_from_several_seeds_are_merged_into_one() {
    let folder = tempfile::tempdir().expect("a folder");
    let config = write(folder.path(), "small.toml", SMALL);
    let path = |name: &str| folder.path().join(name).display().to_string();
    let fit = |track: &str, seed: &str, out: &str| {
        let track = example(&format!("tracks/{track}.ecsv"))
            .display()
            .to_string();
        let mut arguments = vec!["fit", &track, "--config", &config, "--live", "100"];
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
    let three = path("one_2");
    let notes = String::from_utf8_lossy(&output.stderr);
    let next: Vec<Vec<&str>> = notes
        .lines()
        .filter_map(|line| line.trim_start().strip_prefix("oblate "))
        .map(|words| words.split_whitespace().collect())
        .collect();
    let [fit, merger] = next.as_slice() else {
        panic!("{notes}")
    };
    assert!(fit.ends_with(&["--seed", "3", "--out", &three]), "{notes}");
    assert!(merger.contains(&three.as_str()), "{notes}");
    for (command, folder) in [(fit, &three), (merger, &path("both_2"))] {
        let quiet = ["-q", "--allow-unconverged"];
        let arguments = [command.as_slice(), &quiet].concat();
        assert_eq!(oblate(&arguments, "").status.code(), Some(0), "{command:?}");
        assert!(Path::new(folder).join("summary.json").exists(), "{folder}");
    }
    refused(&merge(&[&one, &two], &both), &["exists already"]);
    // It is a fit like any other.
    let page = path("page.html");
    let output = oblate(&["report", &both, "--out", &page], "");
    assert_eq!(output.status.code(), Some(0));
}

#[test]
fn a_tempered_fit_that_ended_too_soon_is_extended() {
    let folder = tempfile::tempdir().expect("a folder");
    let config = write(folder.path(), "small.toml", SMALL);
    let track = example("tracks/s2_spherical.ecsv").display().to_string();
    let fit = |name: &str, coarse: &str, extensions: &str, more: &[&str]| {
        let out = folder.path().join(name).display().to_string();
        let mut args = vec!["fit", &track, "--config", &config, "--sampler", "pt-hmc"];
        args.extend(["--coarse-particles", coarse, "--extensions", extensions]);
        args.extend(["--out", &out, "--json", "-q"]);
        args.extend(more);
        let output = oblate(&args, "");
        let say = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{say}");
        assert!(say.contains("--extensions"), "{say}");
        json(&output.stdout)
    };
    for coarse in ["0", "64"] {
        let name = |what: &str| format!("{what}{coarse}");
        let expected = fit(&name("at once"), coarse, "2", &[]);
        let short = fit(&name("in two"), coarse, "1", &[]);
        assert_ne!(short["ln_z"], expected["ln_z"]);
        let again = fit(&name("in two"), coarse, "1", &["--resume"]);
        assert_eq!(again["ln_z"], short["ln_z"]);
        // Killed during the extension, it is resumed with the same settings, and with more extensions continues.
        let out = folder.path().join(name("in two")).display().to_string();
        let going = [
            "fit",
            &track,
            "--config",
            &config,
            "--sampler",
            "pt-hmc",
            "--coarse-particles",
            coarse,
            "--extensions",
            "2",
            "--out",
            &out,
            "--resume",
            "--checkpoint-every",
            "0",
            "-q",
        ];
        let going = going.map(str::to_owned);
        assert!(killed(&going, 300));
        let again = fit(&name("in two"), coarse, "1", &["--resume"]);
        assert_eq!(again["ln_z"], short["ln_z"]);
        let longer = fit(&name("in two"), coarse, "2", &["--resume"]);
        assert_eq!(result(&longer), result(&expected), "{coarse}");
    }
}

/// A summary without the data of the processes that made it: their times, and the command of the last one.
fn result(summary: &serde_json::Value) -> serde_json::Value {
    let mut summary = summary.clone();
    summary["command"].take();
    for seconds in ["cpu_seconds", "wall_seconds"] {
        summary["cost"][seconds].take();
    }
    summary
}

/// Kills a command after so many milliseconds, and returns whether it was still running.
fn killed(args: &[String], after: u64) -> bool {
    let mut child = Command::new(env!("CARGO_BIN_EXE_oblate"))
        .args(args)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("the command starts");
    std::thread::sleep(std::time::Duration::from_millis(after));
    child.kill().expect("a kill");
    child.wait().expect("its end").code().is_none()
}

#[test]
fn a_fit_killed_at_twenty_moments_comes_to_the_numbers_of_one_never_stopped() {
    let folder = tempfile::tempdir().expect("a folder");
    let config = write(folder.path(), "small.toml", SMALL);
    let track = example("tracks/s2_spherical.ecsv").display().to_string();
    for (what, sampler, flags) in [
        ("nested", "nested", &[][..]),
        ("pt-hmc", "pt-hmc", &[][..]),
        ("coarse", "nested", &["--coarse-particles", "64"][..]),
        ("both", "pt-hmc", &["--coarse-particles", "64"][..]),
    ] {
        let args = |out: &str, more: &[&str]| -> Vec<String> {
            let mut args = vec!["fit", &track, "--config", &config, "--out", out];
            args.extend(["--sampler", sampler, "--checkpoint-every", "0", "-q"]);
            args.extend(["--json", "--allow-unconverged"]);
            args.extend(flags);
            args.extend(more);
            args.into_iter().map(str::to_owned).collect()
        };
        let of = |args: &[String]| -> serde_json::Value {
            let args: Vec<&str> = args.iter().map(String::as_str).collect();
            let output = oblate(&args, "");
            let say = String::from_utf8_lossy(&output.stderr).into_owned();
            assert_eq!(output.status.code(), Some(0), "{say}");
            json(&output.stdout)
        };
        let whole = folder.path().join(format!("whole_{what}"));
        let begun = std::time::Instant::now();
        let expected = of(&args(&whole.display().to_string(), &[]));
        let millis = u64::try_from(begun.elapsed().as_millis()).expect("a short fit");
        let out = folder.path().join(format!("killed_{what}"));
        let name = out.display().to_string();
        // Kills from the start to a fifth of a whole run, each at another time; on a slow computer there are as many.
        let mut kills = 0;
        for kill in 1..=20 {
            let after = 2 + millis * (kill * 7 % 20) / 100;
            kills += usize::from(killed(&args(&name, &["--resume"]), after));
            if out.join("summary.json").exists() {
                break;
            }
        }
        assert!(kills >= 3, "{what}: {kills} kills");
        if what == "nested" && !out.join("summary.json").exists() {
            // No time at all: still a result, which says that it is unfinished and can be resumed.
            let spent = of(&args(&name, &["--resume", "--max-minutes", "0"]));
            assert_eq!(spent["converged"], false);
            // The last kill may have come between the run's end and its summary.
            let over = spent["status"] == "complete";
            assert!(
                over || spent["status"] == "budget-spent",
                "{}",
                spent["status"]
            );
            assert_eq!(spent["ln_z"] == expected["ln_z"], over);
        }
        let resumed = of(&args(&name, &["--resume"]));
        assert_eq!(result(&resumed), result(&expected), "{what}");
    }
}
