//! ln Z against exact values, with the error that the run quotes.

use super::{failed, rounds, run};
use crate::targets::smooth::{self, Smooth};
use oblate_samplers::pt::Settings;

/// Seeds of every target: the campaign takes thirty.
const SEEDS: u64 = 3;

/// Every ln Z within four of its own errors.
fn evidence_is_right_within_its_error(target: &Smooth, count: usize) {
    evidence_is_right_with(target, &rounds(count));
}

fn evidence_is_right_with(target: &Smooth, settings: &Settings) {
    for seed in 1..=SEEDS {
        let run = run(target, settings, seed);
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
    evidence_is_right_within_its_error(&smooth::iso(13), 7);
}

#[test]
fn evidence_of_rotated_and_stiff_gaussians() {
    evidence_is_right_within_its_error(&smooth::mvn13(), 8);
    evidence_is_right_within_its_error(&smooth::stiff13(), 8);
}

#[test]
fn evidence_of_twins() {
    evidence_is_right_within_its_error(&smooth::twins13(0.5), 8);
    evidence_is_right_within_its_error(&smooth::twins13(0.9), 8);
}

#[test]
fn evidence_of_bounded_and_correlated_posteriors() {
    evidence_is_right_within_its_error(&smooth::binomial(), 8);
    evidence_is_right_within_its_error(&smooth::gauss3(), 8);
    evidence_is_right_within_its_error(&smooth::far8(), 8);
}

#[test]
fn evidence_of_shells() {
    evidence_is_right_within_its_error(&smooth::shells(5), 9);
}

/// Trajectories of two steps are too short by themselves.
#[test]
fn evidence_by_slices() {
    let by_slices = Settings {
        slice_updates: 12,
        max_leapfrogs: 2,
        ..rounds(7)
    };
    for target in [smooth::mvn13(), smooth::twins13(0.9), smooth::shells(5)] {
        evidence_is_right_with(&target, &by_slices);
    }
}

/// Three rounds fewer than from prior draws.
#[test]
fn evidence_after_smc() {
    let from_smc = Settings {
        smc_particles: 64,
        slice_updates: 12,
        max_leapfrogs: 2,
        first_scans: 16,
        ..rounds(5)
    };
    for target in [smooth::stiff13(), smooth::twins13(0.9), smooth::shells(5)] {
        evidence_is_right_with(&target, &from_smc);
    }
}

/// The last two rounds have a mixture as reference, fitted to the draws of the rounds before.
#[test]
fn evidence_from_a_mixture() {
    let shorter = Settings {
        mixture_rounds: 2,
        ..rounds(7)
    };
    let by_slices = Settings {
        slice_updates: 12,
        max_leapfrogs: 2,
        ..shorter.clone()
    };
    for (target, settings) in [
        (smooth::mvn13(), &shorter),
        (smooth::twins13(0.9), &shorter),
        (smooth::shells(5), &by_slices),
    ] {
        evidence_is_right_with(&target, settings);
    }
}

/// All rounds have a mixture as reference, the first one fitted to SMC particles.
#[test]
fn evidence_from_a_mixture_of_smc_samplers() {
    let settings = Settings {
        smc_particles: 192,
        slice_updates: 4,
        max_leapfrogs: 1,
        first_scans: 64,
        mixture_rounds: 3,
        ..rounds(3)
    };
    for target in [smooth::mvn13(), smooth::twins13(0.9), smooth::shells(5)] {
        evidence_is_right_with(&target, &settings);
    }
}

/// A last round that is extended until two looks pass counts all of its scans, and those of earlier rounds none.
#[test]
fn evidence_of_an_extended_round() {
    let going_on = Settings {
        extensions: 9,
        ..rounds(6)
    };
    for target in [smooth::far8(), smooth::gauss3()] {
        evidence_is_right_with(&target, &going_on);
        let (short, run) = (run(&target, &rounds(6), 1), run(&target, &going_on, 1));
        assert!(!short.converged(), "{}", target.name);
        assert_eq!(failed(&run), [""; 0], "{}", target.name);
        let times = run.draws.len() / short.draws.len();
        assert!(
            [4, 6, 10, 14, 22].contains(&times),
            "{} {times}",
            target.name
        );
        assert_eq!(run.draws.len(), times * short.draws.len());
        // The first scans are the same ones.
        let per_chain_set = short.draws.len() / 4;
        for chain_set in 0..4 {
            for j in 0..run.names.len() {
                let (ours, whole) = (short.draws.column(j), run.draws.column(j));
                assert_eq!(
                    ours[chain_set * per_chain_set..(chain_set + 1) * per_chain_set],
                    whole[chain_set * times * per_chain_set..][..per_chain_set]
                );
            }
        }
    }
}

/// On a path from a mixture each extension has a path of its own.
#[test]
fn evidence_of_extensions() {
    let settings = |extensions| Settings {
        smc_particles: 96,
        slice_updates: 4,
        max_leapfrogs: 1,
        first_scans: 32,
        mixture_rounds: 3,
        extensions,
        ..rounds(3)
    };
    let target = smooth::gauss3();
    let short = run(&target, &settings(0), 1);
    let whole = run(&target, &settings(9), 1);
    assert_eq!(failed(&whole), [""; 0]);
    let pull = (whole.evidence.ln_z - target.ln_z) / whole.evidence.error;
    assert!(pull.abs() < 4.0 && whole.evidence.error < 0.4, "{pull}");
    // The unextended run is too short; whole extensions count, and the round itself does not.
    assert!(!short.converged());
    let (extension, all) = (short.draws.len(), whole.draws.len());
    assert!(
        [3, 5, 9, 13, 21].contains(&(all / extension)) && all % extension == 0,
        "{all}"
    );
}

#[test]
fn a_run_that_may_go_on_ends_when_it_passes_or_may_no_more() {
    let target = smooth::gauss3();
    let with = |extensions| Settings {
        extensions,
        ..rounds(10)
    };
    let plain = run(&target, &with(0), 1);
    assert_eq!(failed(&plain), [""; 0]);
    // Which extensions may confirm.
    let confirmed = run(&target, &with(3), 1);
    assert_eq!(failed(&confirmed), [""; 0]);
    assert_eq!(confirmed.draws.len(), 2 * plain.draws.len());
    // Eight scans are too few, sixteen too.
    let few = |extensions| Settings {
        extensions,
        ..rounds(2)
    };
    let (short, once) = (run(&target, &few(0), 1), run(&target, &few(1), 1));
    assert!(!once.converged());
    assert_eq!(once.draws.len(), 2 * short.draws.len());
}

#[test]
fn a_cliff_in_the_likelihood_is_counted_by_every_estimate() {
    for target in [smooth::quarter(), smooth::half_plane()] {
        let run = run(&target, &rounds(9), 1);
        let estimates = &run.evidence.estimates;
        for name in ["bennett", "forward", "backward"] {
            assert!((estimates[name] - run.evidence.ln_z).abs() < 1e-6, "{name}");
        }
        assert!(
            !estimates.contains_key("thermodynamic"),
            "it would be wrong"
        );
        let pull = (run.evidence.ln_z - target.ln_z) / run.evidence.error;
        assert!(pull.abs() < 4.0, "{}: {pull}", target.name);
        assert!(run.cost.rejected["outside the flat top"] > 0);
        assert!(!super::check(&run, "rejected-transitions").pass);
    }
}
