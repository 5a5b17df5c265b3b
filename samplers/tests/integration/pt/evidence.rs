//! ln Z against exact values, with the error that the run quotes.

use super::run;
use crate::targets::smooth::{self, Smooth};
use oblate_samplers::pt::Settings;

/// Five seeds, each within four of its own errors.
fn evidence_is_right_within_its_error(target: &Smooth, rounds: usize) {
    let settings = Settings {
        rounds,
        ..Settings::default()
    };
    for seed in 1..=5 {
        let run = run(target, &settings, seed);
        let pull = (run.evidence.ln_z - target.ln_z) / run.evidence.error;
        assert!(
            pull.abs() < 4.0 && run.evidence.error < 0.4,
            "{} seed {seed}: {} +- {}, exactly {}",
            target.name,
            run.evidence.ln_z,
            run.evidence.error,
            target.ln_z
        );
    }
}

#[test]
fn evidence_of_isotropic_gaussians() {
    evidence_is_right_within_its_error(&smooth::iso(2), 8);
    evidence_is_right_within_its_error(&smooth::iso(13), 8);
}

#[test]
fn evidence_of_rotated_and_stiff_gaussians() {
    evidence_is_right_within_its_error(&smooth::mvn13(), 9);
    evidence_is_right_within_its_error(&smooth::stiff13(), 9);
}

#[test]
fn evidence_of_twins() {
    evidence_is_right_within_its_error(&smooth::twins13(0.5), 9);
    evidence_is_right_within_its_error(&smooth::twins13(0.9), 9);
}

#[test]
fn evidence_of_bounded_and_correlated_posteriors() {
    evidence_is_right_within_its_error(&smooth::binomial(), 8);
    evidence_is_right_within_its_error(&smooth::gauss3(), 8);
    evidence_is_right_within_its_error(&smooth::far8(), 9);
}

#[test]
fn evidence_of_shells() {
    evidence_is_right_within_its_error(&smooth::shells(5), 9);
}
