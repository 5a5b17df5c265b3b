//! `oblate mock`: tracks with their truth.

use super::{json, oblate, refused};
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
