//! `oblate mock`: tracks with their truth.

use super::{json, oblate, refused};
use oblate::data::ObservedTrack;
use oblate::track::BinQuantity;
use std::path::Path;

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

/// The mocks of a command with these flags: the value of q of each, and its track.
fn made(count: u32, flags: &[&str]) -> Vec<(f64, ObservedTrack)> {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("mocks").display().to_string();
    let count = count.to_string();
    let mock = ["mock", "--count", &count, "--seed", "7", "--out", &out];
    let few = ["--particles", "400", "--json", "-q"];
    let output = oblate(&[&mock[..], &few, flags].concat(), "");
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let listing = json(&output.stdout);
    let mocks = listing["mocks"].as_array().expect("mocks");
    let read = |mock: &serde_json::Value| {
        let track = mock["track"].as_str().expect("a path");
        let track = ObservedTrack::read(Path::new(track)).expect("a track");
        (mock["q"].as_f64().expect("a number"), track)
    };
    mocks.iter().map(read).collect()
}

#[test]
fn noise_is_that_of_the_radii_and_of_their_errors() {
    let of_noise = |noise: &str| made(2, &["--noise", noise, "--no-star-scatter"]);
    let (exact, quiet, loud) = (of_noise("0"), of_noise("0.02"), of_noise("0.06"));
    let mut squares = Vec::new();
    for ((exact, quiet), loud) in exact.iter().zip(&quiet).zip(&loud) {
        for (row, exact) in exact.1.r_kpc.iter().enumerate() {
            let off = |track: &ObservedTrack| track.r_kpc[row] / exact - 1.0;
            // The same numbers, three times as large, to the six digits of a file.
            let (small, large) = (off(&quiet.1), off(&loud.1));
            assert!((large - 3.0 * small).abs() < 1e-5, "{small} {large}");
            squares.push((large / 0.06).powi(2));
            for (track, noise) in [(&quiet.1, 0.02), (&loud.1, 0.06)] {
                let error = track.r_err_lo_kpc[row] / track.r_kpc[row];
                assert!((error / noise - 1.0).abs() < 1e-4, "{error} {noise}");
            }
        }
    }
    // Squares of unit normals, within four standard deviations of their mean.
    let n = squares.len() as f64;
    let mean = squares.iter().sum::<f64>() / n;
    assert!((mean - 1.0).abs() < 4.0 * (2.0 / n).sqrt(), "{mean} of {n}");
    // Without the flag it is two per cent.
    let default = made(2, &["--no-star-scatter"]);
    assert_eq!(default, quiet);
}

#[test]
fn errors_have_the_scatter_of_the_stars_unless_that_is_left_out() {
    let width = ["--width-noise", "0.001"];
    let with = made(2, &width);
    let without = made(2, &[&width[..], &["--no-star-scatter"]].concat());
    for ((_, with), (_, without)) in with.iter().zip(&without) {
        assert_eq!(with.r_kpc, without.r_kpc);
        let n = with.n.as_ref().expect("numbers of stars");
        for row in 0..with.len() {
            let [all, noise] = [with, without].map(|track| track.r_err_lo_kpc[row]);
            let of_noise = 0.02 * with.r_kpc[row];
            assert!((noise / of_noise - 1.0).abs() < 1e-4, "{noise} {of_noise}");
            // The standard error of a mean over so many stars, from the width of the stream with a noise of a thousandth.
            let width = with.measured[&BinQuantity::Width][row]
                .expect("a width")
                .value;
            let of_mean = width / n[row].sqrt();
            let expected = of_noise.hypot(of_mean);
            assert!((all / expected - 1.0).abs() < 0.005, "{all} {expected}");
        }
    }
}

#[test]
fn a_population_is_what_q_is_drawn_from() {
    let q = |population: &str| -> Vec<f64> {
        let mocks = made(40, &["--population", population]);
        mocks.into_iter().map(|(q, _)| q).collect()
    };
    for q in q("0.8,0") {
        assert!((q - 0.8).abs() < 1e-9, "{q}");
    }
    for mu in [0.8, 1.2] {
        // The range of the prior ends six standard deviations from the mean, and the criteria hardly depend on q within it.
        let (sigma, n) = (0.05, 40.0);
        let q = q(&format!("{mu},{sigma}"));
        let mean = q.iter().sum::<f64>() / n;
        let squares: f64 = q.iter().map(|q| (q - mean).powi(2)).sum();
        let sd = (squares / (n - 1.0)).sqrt();
        // Four standard errors of each.
        assert!((mean - mu).abs() < 4.0 * sigma / n.sqrt(), "{mu}: {mean}");
        assert!(
            (sd / sigma - 1.0).abs() < 4.0 / (2.0 * n).sqrt(),
            "{mu}: {sd}"
        );
    }
    let prior = made(40, &[]);
    let beyond = prior.iter().filter(|(q, _)| *q < 0.65 || *q > 1.35).count();
    // 0.3 of the prior, of which 40 draws have 12 with a standard deviation of 2.9.
    assert!((1..=23).contains(&beyond), "{beyond}");
}
