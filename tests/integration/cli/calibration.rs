//! `oblate calibration`: ranks of the truth in finished fits.

use super::{example, json, oblate, refused, write};
use oblate::data::ObservedTrack;
use oblate::params::{PriorSettings, StreamPrior};
use oblate::posterior::zarr;
use oblate::scalar::Vec3;
use serde_json::json;
use std::path::Path;

/// Writes a track with a truth that has the values of the fixed parameters of [`SMALL`](super::SMALL), with another first radius for each `k`.
fn track(folder: &Path, k: usize, log10_m_halo: f64) -> String {
    let mut track = ObservedTrack::read(&example("tracks/s2_spherical.ecsv")).expect("a track");
    track.r_kpc[0] += 0.01 * k as f64;
    track.meta.insert(
        "truth".to_owned(),
        json!({
            "log10_m_halo": log10_m_halo, "r_s_halo_kpc": 15.0, "dir_x": 0.1, "dir_y": 0.2, "dir_z": 0.8, "log10_m_prog": 8.0,
            "r_s_prog_kpc": 1.0, "x0_kpc": 60.0, "z0_kpc": 30.0, "vx0_km_s": 30.0, "vy0_km_s": 140.0, "vz0_km_s": 45.0, "age_gyr": 3.0
        }),
    );
    let path = folder.join(format!("mock{k}.ecsv"));
    track.write(&path).expect("a file");
    path.display().to_string()
}

#[test]
fn a_table_without_fits_is_no_calibration() {
    let folder = tempfile::tempdir().expect("a folder");
    let empty = write(folder.path(), "empty.json", "{\"fits\":[]}");
    for json in [&[][..], &["--json"]] {
        let output = oblate(&[&["calibration", &empty][..], json].concat(), "");
        refused(&output, &["0 runs where at least 1"]);
        assert!(output.stdout.is_empty(), "{output:?}");
    }
}

#[test]
fn fits_of_mocks_are_ranked_and_others_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let config = write(folder.path(), "small.toml", super::SMALL);
    let path = |name: &str| folder.path().join(name).display().to_string();
    let fit = |track: &str, run: &str| {
        let args = ["fit", track, "--config", &config, "--out", run];
        let more = ["--coarse-particles", "0", "--allow-unconverged", "-q"];
        let output = oblate(&[&args[..], &more].concat(), "");
        assert_eq!(output.status.code(), Some(0), "{output:?}");
    };
    let runs = [path("one"), path("two")];
    fit(&track(folder.path(), 1, 12.0), &runs[0]);
    fit(&track(folder.path(), 2, 12.0), &runs[1]);

    // A fit that has only begun is no reason to wait with the others.
    let begun = path("begun");
    std::fs::create_dir(&begun).expect("a folder");
    for file in ["versions.json", "config.toml", "track.ecsv"] {
        std::fs::copy(Path::new(&runs[0]).join(file), Path::new(&begun).join(file)).expect(file);
    }

    // No fit passes with 40 live points, so that the verdict is about both.
    let figure = path("ranks.svg");
    let args = [
        "calibration",
        &runs[0],
        &runs[1],
        &config,
        &begun,
        "--figure",
        &figure,
        "--json",
    ];
    let output = oblate(&args, "");
    let notes = String::from_utf8_lossy(&output.stderr);
    assert!(notes.contains("small.toml is no run folder"), "{notes}");
    assert!(notes.contains("begun has not finished"), "{notes}");
    let said = json(&output.stdout);
    assert_eq!(said["calibration"]["all"][0]["fits"], 2);
    assert_eq!(said["calibration"]["converged"], json!([]));
    assert!(
        std::fs::read_to_string(&figure)
            .expect("the figure")
            .starts_with("<svg")
    );
    refused(&oblate(&args, ""), &["exists already", "--force"]);
    let nothing_to_replace = oblate(&["calibration", &runs[0], "--force"], "");
    refused(&nothing_to_replace, &["--figure", "--errors"]);
    let errors = path("errors.svg");
    let both = [&args[..], &["--errors", &errors, "--force"]].concat();
    assert_eq!(json(&oblate(&both, "").stdout), said);

    // The rank is that of the draws.
    let stored = zarr::read(&Path::new(&runs[0]).join("posterior.zarr")).expect("draws");
    let draws = &stored.draws;
    let pairs = draws.column(0).into_iter().zip(draws.weights());
    let below: f64 = pairs.filter(|(m, _)| *m < 12.0).map(|(_, w)| w).sum();
    let rank = &said["fits"][0]["ranks"][0];
    assert_eq!(rank[0], "log10_m_halo");
    assert!(
        (rank[1].as_f64().expect("a number") - below).abs() < 1e-9,
        "{rank} {below}"
    );
    // So is the error of q, which is the first derived quantity. The track has 10 degrees for each bin.
    let prior = StreamPrior::new(&PriorSettings::default()).expect("the prior");
    let truth = prior.q_range().shape(Vec3::new(0.1, 0.2, 0.8)).q;
    let off = draws.derived_column(0).into_iter().zip(draws.weights());
    let q_error: f64 = off.map(|(q, w)| (q - truth).abs() * w).sum();
    let said_error = said["fits"][0]["q_error"].as_f64().expect("a number");
    assert!(
        (said_error - q_error).abs() < 1e-9,
        "{said_error} {q_error}"
    );
    let bins = said["fits"][0]["r_kpc"].as_array().map_or(0, Vec::len);
    assert_eq!(said["fits"][0]["extent"]["length_deg"], 10.0 * bins as f64);
    assert_eq!(said["q_errors"], json!([]), "two points are no line");
    // Three free parameters, five derived quantities; none of the fixed ones.
    assert_eq!(said["fits"][0]["ranks"].as_array().map(Vec::len), Some(8));

    // A part of a set of fits as a table gives the same ranks as its runs.
    let one = oblate(&["calibration", &runs[0], "--json"], "");
    let part = write(
        folder.path(),
        "part.json",
        &String::from_utf8_lossy(&one.stdout),
    );
    let gathered = oblate(&["calibration", &part, &runs[1], "--json"], "");
    assert_eq!(json(&gathered.stdout), said);
    let words = ["0 of 2 fits have passed their checks. CPU seconds of a fit: median"];
    let text = oblate(&["calibration", &part, &runs[1]], "");
    assert!(String::from_utf8_lossy(&text.stdout).contains(words[0]));
    let twice = oblate(&["calibration", &part, &runs[0]], "");
    refused(&twice, &["one", "would count twice"]);
    let no_table = write(folder.path(), "no_table.json", "{\n\"fits\": 3}");
    let no_table = oblate(&["calibration", &no_table], "");
    refused(
        &no_table,
        &["no_table.json", "line 2", "not a table of ranks"],
    );
    let outside = write(
        folder.path(),
        "outside.json",
        &String::from_utf8_lossy(&one.stdout).replace("[\"log10_m_halo\",", "[\"log10_m_halo\",1"),
    );
    let outside = oblate(&["calibration", &outside], "");
    refused(
        &outside,
        &["the rank of log10_m_halo in one is", "outside [0, 1]"],
    );

    let twice = oblate(&["calibration", &runs[0], &runs[0]], "");
    refused(&twice, &["one", "would count twice"]);
    let excluded = path("excluded");
    fit(&track(folder.path(), 3, 15.0), &excluded);
    let excluded = oblate(&["calibration", &excluded], "");
    refused(
        &excluded,
        &["track.ecsv: log10_m_halo = 15 lies outside its prior [11, 14]"],
    );
    let gala = path("gala");
    fit(
        &example("tracks/s2_spherical.ecsv").display().to_string(),
        &gala,
    );
    let words = ["the header has no true", "give fits of mocks"];
    refused(&oblate(&["calibration", &gala], ""), &words);
}
