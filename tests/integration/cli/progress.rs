//! Progress without a terminal: a line for each stage.

use super::{oblate, small_fit};

#[test]
fn every_stage_of_a_fit_is_named_and_counted() {
    let (folder, config, track) = small_fit();
    let stages = |name: &str, coarse: &str| {
        let out = folder.path().join(name).display().to_string();
        let mut args = vec!["fit", &track, "--config", &config, "--out", &out];
        args.extend(["--coarse-particles", coarse, "--allow-unconverged"]);
        let output = oblate(&args, "");
        assert_eq!(output.status.code(), Some(0), "{output:?}");
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        let lines = text
            .lines()
            .filter_map(|line| line.strip_prefix("s2_spherical nested: stage "));
        lines.map(str::to_owned).collect::<Vec<_>>()
    };
    assert_eq!(
        stages("alone", "0"),
        [
            "1 of 3, check of the prior",
            "2 of 3, sampling",
            "3 of 3, error of the model",
        ]
    );
    assert_eq!(
        stages("coarse", "64"),
        [
            "1 of 6, check of the prior",
            "2 of 6, check of the prior of the coarse model",
            "3 of 6, sampling of the coarse model",
            "4 of 6, error of the coarse model",
            "5 of 6, bridge to the model itself",
            "6 of 6, error of the model",
        ]
    );
}
