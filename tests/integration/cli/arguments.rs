//! Wrong arguments and files: texts that are not numbers, bytes that are not text.

use super::{SMALL, example, oblate, refused, write};
use clap::builder::ValueParser;
use clap::error::ErrorKind;
use std::ffi::OsString;
use std::path::Path;

#[test]
fn no_number_of_any_verb_may_be_infinite_or_nan() {
    let mut command = oblate::cli::command();
    command.build();
    let text = [
        ValueParser::string().type_id(),
        ValueParser::path_buf().type_id(),
        ValueParser::bool().type_id(),
    ];
    let mut seen = 0;
    for verb in command.get_subcommands().filter(|v| v.get_name() != "help") {
        for argument in verb.get_arguments() {
            let Some(flag) = argument.get_long() else {
                continue;
            };
            if !argument.get_action().takes_values()
                || text.contains(&argument.get_value_parser().type_id())
            {
                continue;
            }
            seen += 1;
            for number in ["nan", "inf", "-inf", "NaN", "1e999", "0.8,nan", "inf,0.1"] {
                let given = ["oblate", verb.get_name(), &format!("--{flag}={number}")];
                let refusal = oblate::cli::command()
                    .try_get_matches_from(given)
                    .expect_err("a number that is none");
                assert!(
                    matches!(
                        refusal.kind(),
                        ErrorKind::ValueValidation | ErrorKind::InvalidValue
                    ),
                    "{given:?}: {refusal}"
                );
            }
        }
    }
    assert!(seen > 30, "only {seen} flags seen");
}

/// Which of the flags that many subcommands have each one has.
#[test]
fn options_are_where_they_do_something() {
    let command = oblate::cli::command();
    for verb in command.get_subcommands() {
        let name = verb.get_name();
        let has = |flag: &str| verb.get_arguments().any(|a| a.get_long() == Some(flag));
        let prints_only = matches!(name, "completions" | "man");
        let computes = !prints_only
            && !matches!(
                name,
                "calibration" | "compare" | "export" | "orientation" | "report"
            );
        let samples = matches!(name, "bridge" | "fit" | "population" | "run");
        assert_eq!(has("threads"), computes, "{name} --threads");
        assert_eq!(has("quiet"), computes, "{name} --quiet");
        // The answers of `evaluate` are always JSON.
        assert_eq!(
            has("json"),
            !prints_only && name != "evaluate",
            "{name} --json"
        );
        for flag in ["max-minutes", "checkpoint-every"] {
            assert_eq!(has(flag), samples, "{name} --{flag}");
        }
        let draws = matches!(name, "bridge" | "fit" | "mock" | "population" | "selection");
        assert_eq!(has("seed"), draws, "{name} --seed");
    }
    for flag in ["--threads=2", "--json", "--quiet"] {
        refused(&oblate(&["man", flag], ""), &["unexpected argument"]);
    }
}

#[test]
fn a_number_out_of_its_range_is_refused_with_the_range() {
    let stream = example("stream.toml").display().to_string();
    for number in ["-0.1", "1.01", "1.5"] {
        let fraction = format!("--min-fraction={number}");
        let output = oblate(&["stream", &stream, "--particles", "200", &fraction], "");
        refused(&output, &["--min-fraction", "allowed 0.0 to 1.0"]);
    }
}

/// Every number of a settings file is checked: NaN and infinity pass none of the checks.
#[test]
fn no_number_of_a_settings_file_may_be_infinite_or_nan() {
    use oblate::data::ObservedTrack;
    use oblate::inference::{FitPlan, FitSettings, Sampler};
    let track =
        ObservedTrack::read(&example("tracks/s2_spherical.ecsv")).expect("the example's track");
    let mut all = toml::Table::try_from(FitSettings::default()).expect("TOML");
    let prior = "fixed = { age_gyr = 3.0 }\n\
                 marginals = { dir_x = { kind = \"normal\", mean = 0.0, sd = 1.0 }, \
                 dir_z = { kind = \"half_normal\", sd = 1.0 }, r_s_prog_kpc = { kind = \"uniform\", lo = 1.0, hi = 5.0 } }";
    let prior: toml::Table = toml::from_str(prior).expect("TOML");
    all["prior"].as_table_mut().expect("a table").extend(prior);
    let mut places = Vec::new();
    numbers(
        &toml::Value::Table(all.clone()),
        &mut Vec::new(),
        &mut places,
    );
    assert!(places.len() > 15, "{places:?}");
    let accepted = |table: &toml::Table| {
        let settings: Result<FitSettings, _> = table.clone().try_into();
        settings.is_ok_and(|settings| {
            [Sampler::Nested, Sampler::PtHmc].iter().all(|sampler| {
                FitPlan::of_settings(&track, &settings.with_sampler(*sampler)).is_ok()
            })
        })
    };
    assert!(accepted(&all));
    for place in &places {
        for number in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let mut table = toml::Value::Table(all.clone());
            let mut slot = &mut table;
            for key in place {
                slot = slot.get_mut(key.as_str()).expect("a key");
            }
            *slot = number.into();
            let table = table.as_table().expect("a table");
            assert!(!accepted(table), "{} = {number}", place.join("."));
        }
    }
}

/// The keys of all floating-point numbers.
fn numbers(value: &toml::Value, at: &mut Vec<String>, places: &mut Vec<Vec<String>>) {
    match value {
        toml::Value::Float(_) => places.push(at.clone()),
        toml::Value::Table(table) => {
            for (key, value) in table {
                at.push(key.clone());
                numbers(value, at, places);
                at.pop();
            }
        }
        _ => {}
    }
}

#[test]
fn a_byte_order_mark_changes_nothing() {
    let folder = tempfile::tempdir().expect("a folder");
    let marked = |name: &str, text: &str| write(folder.path(), name, &format!("\u{feff}{text}"));
    let settings = marked("settings.toml", "seed = 3\n");
    let output = oblate(&["fit", "--print-config", "--config", &settings], "");
    assert!(String::from_utf8_lossy(&output.stdout).contains("\nseed = 3\n"));
    let path = example("tracks/s2_spherical.ecsv");
    let text = std::fs::read_to_string(&path).expect("the example");
    let read = |path: &str| oblate::data::ObservedTrack::read(Path::new(path)).expect("a track");
    assert_eq!(
        read(&marked("s2_spherical.ecsv", &text)),
        read(&path.display().to_string())
    );
    for csv in [
        "phi,r,r_err\n-5,60,1\n5,61,1\n15,62,1\n",
        "# ours\nphi,r,r_err\n-5,60,1\n5,61,1\n15,62,1\n",
    ] {
        let plain = write(folder.path(), "t.csv", csv);
        let plain = read(&plain);
        assert_eq!(read(&marked("t.csv", csv)), plain);
    }
    let parameters = std::fs::read_to_string(example("stream.toml")).expect("the example");
    let stream = marked("stream.toml", &parameters);
    let output = oblate(&["stream", &stream, "--particles", "200"], "");
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let point: toml::Table = toml::from_str(&parameters).expect("TOML");
    let line = serde_json::to_string(&point).expect("JSON");
    let track = path.display().to_string();
    let output = oblate(
        &["evaluate", &track, "--particles", "128"],
        &format!("\u{feff}{line}\n"),
    );
    assert_eq!(output.status.code(), Some(0), "{output:?}");
}

#[test]
fn text_that_is_not_utf_8_is_refused_by_name() {
    let folder = tempfile::tempdir().expect("a folder");
    let wide: Vec<u8> = "\u{feff}phi,r\n"
        .encode_utf16()
        .flat_map(u16::to_le_bytes)
        .collect();
    for name in ["t.csv", "t.toml"] {
        let path = folder.path().join(name);
        std::fs::write(&path, &wide).expect("a file");
        let path = path.display().to_string();
        let output = if name == "t.csv" {
            oblate(&["fit", &path, "--out", "x"], "")
        } else {
            oblate(&["stream", &path], "")
        };
        refused(&output, &[name, "UTF-8"]);
    }
}

/// Only Linux has file names of any bytes.
#[cfg(target_os = "linux")]
#[test]
fn paths_need_not_be_utf_8() {
    use std::os::unix::ffi::{OsStrExt, OsStringExt};
    use std::process::Command;
    let folder = tempfile::tempdir().expect("a folder");
    let config = write(folder.path(), "small.toml", SMALL);
    let odd = |name: &str| {
        let bytes = [
            folder.path().as_os_str().as_bytes(),
            b"/",
            name.as_bytes(),
            b"\xff",
        ]
        .concat();
        OsString::from_vec(bytes)
    };
    let run = |args: &[OsString]| {
        let output = Command::new(env!("CARGO_BIN_EXE_oblate"))
            .args(args)
            .output()
            .expect("the command ends");
        let say = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(0), "{say}");
        super::json(&output.stdout)
    };
    let track = odd("track");
    std::fs::copy(example("tracks/s2_spherical.ecsv"), &track).expect("a copy");
    let words = |words: &[&str]| words.iter().map(OsString::from).collect::<Vec<_>>();
    let mut fit = words(&["fit", "--config", &config, "--coarse-particles", "0", "-q"]);
    fit.extend(words(&["--json", "--allow-unconverged", "--out"]));
    fit.extend([odd("run"), track]);
    let summary = run(&fit);
    assert!(
        summary["command"]
            .as_str()
            .expect("text")
            .contains("run\u{fffd}")
    );
    let mut report = words(&["report", "--json", "--out"]);
    report.extend([odd("page"), odd("run")]);
    assert!(
        run(&report)["report"]
            .as_str()
            .expect("text")
            .ends_with("page\u{fffd}")
    );
    let mut mock = words(&["mock", "--particles", "2000", "--json", "--out"]);
    mock.push(odd("mocks"));
    assert_eq!(run(&mock)["accepted"], 1);
    // As a subcommand or a number it is refused, like any other text.
    for args in [vec![odd("verb")], {
        let mut mock = words(&["mock", "--out", "x", "--count"]);
        mock.push(odd("1"));
        mock
    }] {
        let output = Command::new(env!("CARGO_BIN_EXE_oblate"))
            .args(args)
            .output()
            .expect("the command ends");
        assert_eq!(output.status.code(), Some(2), "{output:?}");
    }
}
