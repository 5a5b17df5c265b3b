//! Progress without a terminal: a line for each stage.

use super::{oblate, small_fit};
use oblate::cli::progress::Progress;
use oblate_samplers::{Event, Observer};
use std::time::Duration;

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

/// Progress that has seen these events, a tenth of a second apart.
fn shown(events: &[Event]) -> String {
    let mut progress = Progress::new("a fit", true);
    for event in events {
        std::thread::sleep(Duration::from_millis(100));
        assert!(progress.event(event).is_continue());
    }
    progress.current().to_owned()
}

#[test]
fn added_batches_have_a_time_left_before_and_after_their_checks_are_known() {
    let nested = |batches: f64| Event::Nested {
        iteration: 9,
        ln_x: -9.0,
        ln_z: -8.0,
        ln_z_error: 0.1,
        delta_ln_z: 0.009,
        dlnz: 0.01,
        calls: 100,
        efficiency: 0.1,
        batches,
    };
    let resumed = shown(&[nested(1.2), nested(1.4)]);
    assert!(resumed.contains("the batch ends in 1 s"), "{resumed}");
    let batch = Event::Batch {
        number: 1,
        of: 8,
        open: vec!["target-ess".to_owned()],
        needed: 100.0,
        ln_z: -8.0,
        ln_z_error: 0.1,
        ess: 4.0,
        calls: 90,
    };
    let open = shown(&[batch, nested(1.0), nested(1.1)]);
    // 6.9 batches at a batch a second, and no more than there may be.
    for words in [
        "ends in about ",
        " s, ",
        "batch 2",
        "open checks: target-ess",
    ] {
        assert!(open.contains(words), "{open}");
    }
    assert!(
        !open.contains("min") && !open.contains("the batch"),
        "{open}"
    );
}

#[test]
fn further_steps_of_a_bridge_have_a_time_left_by_their_draws_or_their_number() {
    let further = |batches: usize, further: usize, ess: f64| Event::Bridge {
        fraction: 1.0,
        further,
        of: 20,
        batches,
        of_batches: 2,
        ess: Some(ess),
        target_ess: 400.0,
        ln_z: -8.0,
        calls: 100,
    };
    let grows = shown(&[
        further(1, 0, 300.0),
        further(1, 1, 350.0),
        further(1, 2, 390.0),
    ]);
    assert!(grows.contains("ends in about 1 s, "), "{grows}");
    assert!(
        grows.contains("batch 1 of at most 2, further MCMC step 2 of at most 20, ESS 390 of 400"),
        "{grows}"
    );
    let stays = |batches: usize| shown(&[further(batches, 1, 300.0), further(batches, 2, 300.0)]);
    assert!(stays(2).contains("ends in at most "), "{}", stays(2));
    // Another batch may follow.
    assert!(!stays(1).contains("ends in at most "), "{}", stays(1));
}
