//! `oblate evaluate`: line by line, lists, rejected points, the unit cube.

use super::{example, json, oblate, refused, write};

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
    let folder = tempfile::tempdir().expect("a folder");
    let double = "model = { precision = \"double\" }\n";
    let config = write(folder.path(), "double.toml", double);
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
            "--config",
            &config,
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
    let folder = tempfile::tempdir().expect("a folder");
    let quick = std::fs::read_to_string(example("quick_fit.toml")).unwrap();
    let double = quick.replace("model = {", "model = { precision = \"double\",");
    let config = write(folder.path(), "double.toml", &double);
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
