//! The same bits on any number of threads, and however often a run is stopped.

use super::rounds;
use crate::stops::{StopAt, plan};
use crate::targets::smooth::{self, Flip, Smooth};
use oblate_samplers::control::{Budget, CheckpointPlan, Silent};
use oblate_samplers::output::Status;
use oblate_samplers::pt::{self, Settings};
use oblate_samplers::{Control, Error, Event, Observer, Outcome, Prior, Run, Symmetry, Target};
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

fn target() -> Smooth {
    smooth::twins13(0.9).with_symmetries(vec![Symmetry::Involution(Box::new(Flip))])
}

/// Stops a run after so many scans.
struct StopAfter(u64);

impl Observer for StopAfter {
    fn event(&mut self, event: &Event) -> ControlFlow<()> {
        if let Event::Tempered { .. } = event {
            self.0 = self.0.saturating_sub(1);
        }
        if self.0 == 0 {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    }
}

fn whole(target: &dyn Target, settings: &Settings) -> Run {
    let mut silent = Silent;
    pt::run(target, settings, 7, &mut Control::new(&mut silent)).unwrap()
}

fn resumed(
    target: &dyn Target,
    settings: &Settings,
    path: &Path,
    scans: u64,
) -> Result<Run, Error> {
    let mut observer = StopAfter(scans);
    let mut control = Control::new(&mut observer);
    control.checkpoint = Some(plan(path));
    pt::run(target, settings, 7, &mut control)
}

#[test]
fn one_two_and_five_threads_give_the_same_bits() {
    let bits = |threads| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| whole(&target(), &rounds(6)).bits())
    };
    let one = bits(1);
    assert_eq!(one, bits(2));
    assert_eq!(one, bits(5));
}

#[test]
fn a_run_stopped_eleven_times_and_resumed_has_the_bits_of_one_never_stopped() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("pt.ckpt");
    let settings = Settings {
        extensions: 1,
        ..rounds(6)
    };
    let target = target();
    let expected = whole(&target, &settings);
    // 252 scans; 4, 12, 28, 60 and 124 are the ends of rounds; the last one is extended by 128.
    assert_eq!(expected.draws.len(), 4 * 2 * 128);
    for scans in [1, 3, 1, 7, 16, 20, 12, 40, 60, 80, 60] {
        let run = resumed(&target, &settings, &path, scans).unwrap();
        assert_eq!(run.status, Status::Interrupted);
        assert!(!run.converged() && !run.draws.is_empty());
    }
    let run = resumed(&target, &settings, &path, u64::MAX).unwrap();
    assert_eq!(run.status, Status::Complete);
    assert_eq!(run.bits(), expected.bits());
    // A finished run resumes to itself.
    let again = resumed(&target, &settings, &path, u64::MAX).unwrap();
    assert_eq!(again.bits(), expected.bits());
}

#[test]
fn a_finished_run_is_extended_where_more_extensions_are_allowed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("pt.ckpt");
    let target = target();
    let of = |extensions| Settings {
        extensions,
        ..from_smc()
    };
    for extensions in [0, 1, 1, 3] {
        let run = resumed(&target, &of(extensions), &path, u64::MAX).unwrap();
        assert!(!run.converged(), "too short to tell");
        assert_eq!(run.bits(), whole(&target, &of(extensions)).bits());
    }
}

fn from_smc() -> Settings {
    Settings {
        smc_particles: 72,
        slice_updates: 2,
        max_leapfrogs: 4,
        mixture_rounds: 3,
        extensions: 1,
        ..rounds(3)
    }
}

#[test]
fn a_run_stopped_during_smc_says_so_and_resumes_to_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("pt.ckpt");
    let (target, settings) = (target(), from_smc());
    let expected = whole(&target, &settings);
    let mut stops = 0;
    for events in [3, 20, 41, 2] {
        let mut observer = StopAt(events);
        let mut control = Control::new(&mut observer);
        control.checkpoint = Some(plan(&path));
        let stopped = pt::run(&target, &settings, 7, &mut control);
        assert!(matches!(stopped, Err(Error::Interrupted)), "{stopped:?}");
        stops += 1;
    }
    assert_eq!(stops, 4);
    let run = resumed(&target, &settings, &path, u64::MAX).unwrap();
    assert_eq!(run.bits(), expected.bits());
    // One thread or three.
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        assert_eq!(
            pool.install(|| whole(&target, &settings).bits()),
            expected.bits()
        );
    }
}

fn along_a_surrogate() -> Settings {
    Settings {
        surrogate: true,
        hmc_transitions: 0,
        slice_updates: 1,
        ..from_smc()
    }
}

#[test]
fn a_surrogate_that_is_fitted_within_a_round_has_the_same_bits_after_stops() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("pt.ckpt");
    let settings = Settings {
        chain_sets: 2,
        temperatures: 4,
        min_temperatures: 4,
        max_temperatures: 4,
        first_scans: 260,
        rounds: 2,
        extensions: 0,
        ..along_a_surrogate()
    };
    let target = target();
    let expected = whole(&target, &settings);
    // Rounds of 260 and 520 scans; a fit follows scan 512 of the second.
    for scans in [300, 471, 1, 1] {
        let run = resumed(&target, &settings, &path, scans).unwrap();
        assert_eq!(run.status, Status::Interrupted);
    }
    let run = resumed(&target, &settings, &path, u64::MAX).unwrap();
    assert_eq!(run.bits(), expected.bits());
}

#[test]
fn a_run_along_a_surrogate_has_the_same_bits_on_threads_and_after_stops() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("pt.ckpt");
    let (target, settings) = (target(), along_a_surrogate());
    let expected = whole(&target, &settings);
    // Rounds of 4, 8 and 16 scans and an extension of 16: stops before and after each fit.
    for scans in [1, 3, 1, 7, 1, 15, 1, 3] {
        let run = resumed(&target, &settings, &path, scans).unwrap();
        assert_eq!(run.status, Status::Interrupted);
    }
    let run = resumed(&target, &settings, &path, u64::MAX).unwrap();
    assert_eq!(run.bits(), expected.bits());
    assert_ne!(run.bits(), whole(&target, &from_smc()).bits());
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(3)
        .build()
        .unwrap();
    assert_eq!(
        pool.install(|| whole(&target, &settings).bits()),
        expected.bits()
    );
}

#[test]
fn a_spent_budget_stops_with_a_valid_unconverged_run_that_resumes() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("pt.ckpt");
    let (target, settings) = (target(), rounds(6));
    let mut silent = Silent;
    let mut control = Control::new(&mut silent);
    control.checkpoint = Some(plan(&path));
    control.budget = Budget {
        max_calls: 1000,
        ..Budget::default()
    };
    let run = pt::run(&target, &settings, 7, &mut control).unwrap();
    assert_eq!(run.status, Status::BudgetSpent);
    assert!(!run.converged());
    assert!(run.cost.calls + run.cost.gradients >= 1000);
    let numbers = run
        .checks
        .iter()
        .map(|g| g.value)
        .chain(run.evidence.estimates.values().copied())
        .chain(run.evidence.error_parts.values().copied())
        .chain([
            run.evidence.ln_z,
            run.evidence.error,
            run.evidence.information,
        ])
        .chain(run.ess.bulk.iter().chain(&run.ess.tail).copied())
        .chain(run.draws.theta.iter().copied());
    for number in numbers {
        assert!(!number.is_nan());
    }
    let rest = resumed(&target, &settings, &path, u64::MAX).unwrap();
    assert_eq!(rest.bits(), whole(&target, &settings).bits());
}

#[test]
fn a_checkpoint_of_other_settings_seed_or_target_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("pt.ckpt");
    resumed(&target(), &rounds(6), &path, 5).unwrap();
    let refused = |result: Result<Run, Error>, word: &str| {
        let message = result.unwrap_err().to_string();
        assert!(message.contains(word), "{message}");
    };
    refused(resumed(&target(), &rounds(7), &path, 5), "other settings");
    refused(
        resumed(&smooth::mvn13(), &rounds(6), &path, 5),
        "another target",
    );
    let mut silent = Silent;
    let mut control = Control::new(&mut silent);
    control.checkpoint = Some(CheckpointPlan {
        config_hash: 43,
        ..plan(&path)
    });
    refused(
        pt::run(&target(), &rounds(6), 7, &mut control),
        "other settings",
    );
    let mut control = Control::new(&mut silent);
    control.checkpoint = Some(plan(&path));
    refused(
        pt::run(&target(), &rounds(6), 8, &mut control),
        "another seed",
    );
}

#[test]
fn a_damaged_checkpoint_names_the_file_and_the_one_before_it_is_used() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("pt.ckpt");
    let (target, settings) = (target(), rounds(6));
    resumed(&target, &settings, &path, 20).unwrap();
    let damage = |path: &Path| {
        let mut bytes = std::fs::read(path).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 0x40;
        std::fs::write(path, bytes).unwrap();
    };
    damage(&path);
    let run = resumed(&target, &settings, &path, u64::MAX).unwrap();
    assert_eq!(run.bits(), whole(&target, &settings).bits());
    damage(&path);
    damage(&oblate_samplers::checkpoint::previous(&path));
    let message = resumed(&target, &settings, &path, 5)
        .unwrap_err()
        .to_string();
    assert!(
        message.contains("pt.ckpt") && message.contains("checksum"),
        "{message}"
    );
}

/// Fails for good after so many gradients.
struct Failing {
    inner: Smooth,
    left: AtomicU64,
}

impl Target for Failing {
    fn prior(&self) -> &Prior {
        self.inner.prior()
    }
    fn ln_likelihood(&self, theta: &[f64]) -> Outcome {
        self.inner.ln_likelihood(theta)
    }
    fn ln_likelihood_and_gradient(&self, theta: &[f64], gradient: &mut [f64]) -> Outcome {
        let left = self
            .left
            .fetch_update(Ordering::Relaxed, Ordering::Relaxed, |n| {
                Some(n.saturating_sub(1))
            });
        if left == Ok(0) {
            return Outcome::Fatal("the disk is gone".to_owned());
        }
        self.inner.ln_likelihood_and_gradient(theta, gradient)
    }
    fn gradient_cost(&self) -> Option<f64> {
        Some(2.0)
    }
    fn symmetries(&self) -> &[Symmetry] {
        self.inner.symmetries()
    }
}

#[test]
fn a_target_that_fails_stops_the_run_after_a_checkpoint_to_go_on_from() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("pt.ckpt");
    let settings = rounds(6);
    let failing = Failing {
        inner: target(),
        left: AtomicU64::new(20_000),
    };
    let message = resumed(&failing, &settings, &path, u64::MAX)
        .unwrap_err()
        .to_string();
    assert!(
        message.contains("the disk is gone") && message.contains("resume"),
        "{message}"
    );
    let run = resumed(&target(), &settings, &path, u64::MAX).unwrap();
    assert_eq!(run.bits(), whole(&target(), &settings).bits());
}
