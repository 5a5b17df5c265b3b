//! The command itself: machine-readable output, exit codes, and one clear error for each bad input.

mod arguments;
mod baryons;
mod calibration;
mod compare;
mod doctor;
mod eta;
mod evaluate;
mod exit;
mod export;
mod fit;
mod haloes;
mod man;
mod measured;
mod merge;
mod message;
mod mock;
mod next;
mod observation;
mod orientation;
mod output;
mod population;
mod population_words;
mod progress;
mod read_only;
mod resume;
mod senses;
mod settings;
mod signals;
mod stream;
mod study;
mod track;

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

/// Three free parameters, few particles, long steps: a fit of seconds.
pub const SMALL: &str = r#"
model = { releases = { particles = 128 }, step_phase = 2.0, max_halvings = 3 }
prior.fixed = { r_s_halo_kpc = 15.0, dir_x = 0.1, dir_y = 0.2, r_s_prog_kpc = 1.0, x0_kpc = 60.0, z0_kpc = 30.0, vx0_km_s = 30.0, vy0_km_s = 140.0, vz0_km_s = 45.0, age_gyr = 3.0 }
sampling.sampler = "nested"
sampling.nested = { n_live = 40, kernel = "random-slice", steps = 6, max_batches = 1 }
sampling.pt_hmc = { chain_sets = 2, first_scans = 4, smc_particles = 24, slice_updates = 3, surrogate = false, extensions = 1 }
sampling.bridge = { smc_particles = 60, mcmc_steps = 4 }
"#;

/// A new folder, a file of these settings in it, and a track.
fn small_fit() -> (tempfile::TempDir, String, String) {
    let folder = tempfile::tempdir().expect("a folder");
    let config = write(folder.path(), "small.toml", SMALL);
    let track = example("tracks/s2_spherical.ecsv").display().to_string();
    (folder, config, track)
}
