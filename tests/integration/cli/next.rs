//! What the command proposes after a run that has not ended well can be typed as it is.

use super::{SMALL, example, json, write};
use oblate::config::read;
use oblate::inference::FitSettings;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// The command line `line` in a shell, as a user types it, in a folder.
pub(super) fn shell(folder: &Path, line: &str) -> Output {
    let bin = env!("CARGO_BIN_EXE_oblate");
    let words = line.strip_prefix("oblate ").expect("a command of ours");
    let mut command = Command::new("sh");
    command.args(["-c", &format!("'{bin}' {words}")]);
    command.current_dir(folder).output().expect("a shell")
}

/// The commands that standard error proposes, with what each is for.
pub(super) fn proposed(output: &Output) -> Vec<(String, String)> {
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    let lines: Vec<&str> = text.lines().collect();
    let pairs = lines.windows(2).filter_map(|pair| {
        let command = pair[1].strip_prefix("    ")?;
        let purpose = pair[0].strip_prefix("To ")?;
        command
            .starts_with("oblate ")
            .then(|| (purpose.to_owned(), command.to_owned()))
    });
    pairs.collect()
}

/// The likelihood calls of a run that was printed as JSON.
fn calls(output: &Output) -> u64 {
    let calls = &json(&output.stdout)["cost"]["calls"];
    calls.as_u64().expect("calls")
}

/// A folder with a track and a settings file, both with a space in their names.
fn folder() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a folder");
    write(folder.path(), "my settings.toml", SMALL);
    let track = example("tracks/s2_spherical.ecsv");
    std::fs::copy(track, folder.path().join("my track.ecsv")).expect("a copy");
    let path = folder.path().to_path_buf();
    (folder, path)
}

const FIT: &str = "oblate fit 'my track.ecsv' --config 'my settings.toml' -q --json --out 'my run'";

#[test]
fn a_nested_fit_with_failed_checks_gets_more_live_points_or_is_repeated() {
    let (_kept, folder) = folder();
    let first = shell(
        &folder,
        &format!(
            "{FIT} --coarse-particles 0 --max-minutes 60 --set model.step_phase=3 --set model.max_halvings=1"
        ),
    );
    assert_eq!(first.status.code(), Some(1), "{first:?}");
    let steps = proposed(&first);
    let [(more, longer), (other, repeated)] = &steps[..] else {
        panic!("{steps:?}");
    };
    assert_eq!(more, "add batches of live points:");
    assert_eq!(other, "sample again with other settings:");
    assert!(!repeated.contains("--max-minutes"), "{repeated}");
    let longer = shell(&folder, longer);
    assert_ne!(longer.status.code(), Some(2), "{longer:?}");
    assert!(calls(&longer) > calls(&first));
    let repeated = shell(&folder, repeated);
    assert_ne!(repeated.status.code(), Some(2), "{repeated:?}");
    let settings = |name: &str| -> FitSettings {
        read(&folder.join(name).join("config.toml")).expect("settings")
    };
    assert_eq!(settings("my run").sampling.nested.max_batches, 2);
    let model = settings("my run_2").model;
    assert!(
        model.step_phase < settings("my run").model.step_phase,
        "steps are too long"
    );
}

#[test]
fn a_tempered_fit_is_extended_and_one_out_of_time_is_continued() {
    let (_kept, folder) = folder();
    // A setting goes before a flag, so that the command which extends it must change the setting.
    let few = "--set sampling.pt_hmc.extensions=1";
    let fit = format!("{FIT} --sampler pt-hmc --coarse-particles 64 {few}");
    let first = shell(&folder, &format!("{fit} --max-minutes 0"));
    assert_eq!(first.status.code(), Some(1), "{first:?}");
    let text = String::from_utf8_lossy(&first.stderr).into_owned();
    assert!(text.contains("The time limit was reached"), "{text}");
    let steps = proposed(&first);
    assert_eq!(steps.len(), 1, "{steps:?}");
    assert_eq!(steps[0].0, "continue it:");
    let second = shell(&folder, &steps[0].1);
    assert_eq!(second.status.code(), Some(1), "{second:?}");
    // The checks of the coarse fit, which the bridge takes over, are explained too.
    let text = String::from_utf8_lossy(&second.stderr).into_owned();
    assert!(
        text.contains("The coarse fit, my run/coarse: NOT CONVERGED"),
        "{text}"
    );
    assert!(text.contains("    looks-passed = "), "{text}");
    let steps = proposed(&second);
    assert_eq!(steps[0].0, "extend its last round:");
    let third = shell(&folder, &steps[0].1);
    assert_ne!(third.status.code(), Some(2), "{}: {third:?}", steps[0].1);
    assert!(calls(&third) > calls(&second));
}

#[test]
fn one_setting_is_changed_by_its_key() {
    let (_kept, folder) = folder();
    let printed = |more: &str| {
        let line = format!("oblate fit --print-config --config 'my settings.toml' {more}");
        let output = shell(&folder, &line);
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        (
            output.status.code(),
            text(&output.stdout),
            text(&output.stderr),
        )
    };
    let (code, settings, _) = printed(
        "--live 50 --set sampling.nested.n_live=60 --set likelihood.edges=hard --set prior.fixed.age_gyr=2.5",
    );
    assert_eq!(code, Some(0));
    for line in ["n_live = 60", "edges = \"hard\"", "age_gyr = 2.5"] {
        assert!(settings.contains(line), "{line} is not in {settings}");
    }
    for (change, words) in [
        (
            "sampling.nested.live=3",
            "sampling.nested.live = 3: unknown field `live`",
        ),
        ("seed=many", "seed = many: invalid type"),
        ("seed", "such as sampling.nested.steps=32"),
        ("seed.of=3", "`seed` is not a table"),
    ] {
        let (code, _, message) = printed(&format!("--set {change}"));
        assert_eq!(code, Some(2), "{change}");
        assert!(message.contains(words), "{change}: {message}");
    }
}

#[test]
fn a_bridge_from_a_fit_with_failed_checks_begins_with_what_continues_that_fit() {
    let (_kept, folder) = folder();
    let fit = shell(&folder, &format!("{FIT} --coarse-particles 0"));
    assert_eq!(fit.status.code(), Some(1), "{fit:?}");
    let bridge = "oblate bridge 'my run' --particles 200 -q --json --out finer";
    let bridge = shell(&folder, bridge);
    assert_eq!(bridge.status.code(), Some(1), "{bridge:?}");
    let steps = proposed(&bridge);
    let purposes: Vec<&str> = steps.iter().map(|step| step.0.as_str()).collect();
    let [first, .., last] = &purposes[..] else {
        panic!("{purposes:?}");
    };
    assert_eq!(*first, "add batches of live points:");
    assert_eq!(*last, "bridge it again after that:");
    let longer = shell(&folder, &format!("{} --json", steps[0].1));
    assert_ne!(longer.status.code(), Some(2), "{longer:?}");
    assert!(calls(&longer) > calls(&fit));
    let again = shell(&folder, &steps[steps.len() - 1].1);
    assert_ne!(again.status.code(), Some(2), "{again:?}");
}

/// Settings of a fit of two parameters: the numbers of particles of its two models, their steps, and how it is sampled.
fn two_parameters(
    coarse_particles: usize,
    particles: usize,
    steps: &str,
    sampling: &str,
) -> String {
    format!(
        r#"
coarse_particles = {coarse_particles}
model = {{ releases = {{ particles = {particles} }}, {steps} }}
prior.fixed = {{ r_s_halo_kpc = 15.0, dir_x = 0.1, dir_y = 0.2, dir_z = 1.0, r_s_prog_kpc = 1.0, x0_kpc = 60.0, z0_kpc = 30.0, vx0_km_s = 30.0, vy0_km_s = 140.0, vz0_km_s = 45.0, age_gyr = 3.0 }}
sampling.sampler = "nested"
{sampling}
"#
    )
}

#[test]
fn a_bridge_with_few_draws_gets_batches_or_more_coarse_draws() {
    let (_kept, folder) = folder();
    // The coarse run has draws enough, and its bridge has few.
    let sampling = r#"
sampling.nested = { n_live = 300, kernel = "random-slice", steps = 12, target_ess = 100, max_batches = 4 }
sampling.bridge = { smc_particles = 20, mcmc_steps = 1, further_mcmc_steps = 1, max_batches = 1 }
"#;
    let settings = two_parameters(64, 128, "step_phase = 2.0, max_halvings = 3", sampling);
    write(&folder, "my settings.toml", &settings);
    let first = shell(&folder, FIT);
    assert_eq!(first.status.code(), Some(1), "{first:?}");
    let steps = proposed(&first);
    let [(more, longer), (other, repeated)] = &steps[..] else {
        panic!("{steps:?}");
    };
    assert_eq!(more, "add batches to its bridge:");
    assert_eq!(other, "sample again with other settings:");
    assert!(repeated.contains("target_ess=400"), "{repeated}");
    let longer = shell(&folder, longer);
    assert_eq!(longer.status.code(), Some(1), "{longer:?}");
    assert!(calls(&longer) > calls(&first));
}

#[test]
fn a_bridge_to_a_model_that_is_not_accurate_enough_is_continued_to_a_finer_one() {
    let (_kept, folder) = folder();
    let sampling = r#"sampling.nested = { n_live = 200, kernel = "random-slice", steps = 16, max_batches = 8 }"#;
    let settings = two_parameters(0, 64, "step_phase = 1.2", sampling);
    write(&folder, "my settings.toml", &settings);
    let fit = shell(&folder, FIT);
    assert_eq!(json(&fit.stdout)["converged"], true, "{fit:?}");
    let bridge = "oblate bridge 'my run' --particles 128 -q --json --out finer";
    let bridge = shell(&folder, bridge);
    let summary = json(&bridge.stdout);
    assert_eq!(summary["converged"], true, "{bridge:?}");
    let checks = summary["model_checks"].as_array().expect("checks");
    assert!(
        checks.iter().any(|check| check["pass"] == false),
        "{summary}"
    );
    let steps = proposed(&bridge);
    let [(purpose, finer)] = &steps[..] else {
        panic!("{steps:?}");
    };
    assert_eq!(purpose, "continue it to a finer model:");
    assert!(finer.starts_with("oblate bridge finer "), "{finer}");
    assert!(
        finer.contains("--set model.releases.particles=512"),
        "{finer}"
    );
    let finer = shell(&folder, &format!("{finer} --json -q"));
    assert_ne!(finer.status.code(), Some(2), "{finer:?}");
    assert!(calls(&finer) > 0);
}
