//! Threads, interruptions, budgets, files and failures of nested runs.

use super::{sample, settings};
use crate::targets::{hard, smooth};
use oblate_samplers::control::{CheckpointPlan, Control, Event, Observer, Silent};
use oblate_samplers::nested::{Kernel, Settings, run};
use oblate_samplers::output::{History, Status};
use oblate_samplers::{Error, Marginal, Outcome, Prior, Run, Target, checkpoint};
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

fn small(kernel: Kernel) -> Settings {
    // Enough for proposals of a mixture, which needs 50 points of a half in five dimensions.
    let n_live = if kernel == Kernel::Surrogate { 160 } else { 60 };
    Settings {
        simulations: 20,
        bootstraps: 20,
        ..settings(n_live, kernel)
    }
}

/// Breaks at iteration `at`.
struct StopAt(u64);

impl Observer for StopAt {
    fn event(&mut self, event: &Event) -> ControlFlow<()> {
        match event {
            Event::Nested { iteration, .. } if *iteration == self.0 => ControlFlow::Break(()),
            _ => ControlFlow::Continue(()),
        }
    }
}

fn plan(path: PathBuf, resume: bool) -> CheckpointPlan {
    CheckpointPlan {
        path,
        every: Duration::MAX,
        resume,
        config_hash: 5,
    }
}

/// Runs with a file, stopped at iteration `at`.
fn with_file(
    target: &dyn Target,
    settings: &Settings,
    file: &std::path::Path,
    resume: bool,
    at: u64,
) -> oblate_samplers::Result<Run> {
    let mut observer = StopAt(at);
    let mut control = Control::new(&mut observer);
    control.checkpoint = Some(plan(file.to_owned(), resume));
    run(target, settings, 1, &mut control)
}

#[test]
fn a_run_has_the_same_bits_on_any_number_of_threads() {
    let target = smooth::shells(5);
    for kernel in [
        Kernel::Uniform,
        Kernel::RandomSlice,
        Kernel::Differential,
        Kernel::Surrogate,
        Kernel::RandomWalk,
        Kernel::Galilean,
    ] {
        let bits: Vec<u64> = [1, 2, 5]
            .into_iter()
            .map(|threads| {
                let pool = rayon::ThreadPoolBuilder::new()
                    .num_threads(threads)
                    .build()
                    .unwrap();
                pool.install(|| sample(&target, &small(kernel), 3).bits())
            })
            .collect();
        assert!(bits.iter().all(|b| *b == bits[0]), "{kernel:?}: {bits:?}");
        assert_ne!(bits[0], sample(&target, &small(kernel), 4).bits());
    }
}

#[test]
fn a_run_resumed_after_any_iteration_has_the_bits_of_one_never_stopped() {
    let folder = tempfile::tempdir().unwrap();
    for (kernel, target) in [
        (Kernel::Uniform, smooth::shells(2)),
        (Kernel::RandomSlice, smooth::shells(5)),
        (Kernel::Differential, smooth::shells(5)),
        (Kernel::Surrogate, smooth::shells(5)),
        (Kernel::RandomWalk, smooth::shells(5)),
        (Kernel::Galilean, smooth::shells(5)),
    ] {
        let settings = small(kernel);
        let whole = sample(&target, &settings, 1);
        assert_eq!(whole.status, Status::Complete);
        let file = folder.path().join(format!("{kernel:?}"));
        for (i, at) in [0, 1, 7, 23, 24, 41, 60].into_iter().enumerate() {
            let part = with_file(&target, &settings, &file, i > 0, at).unwrap();
            assert_eq!(part.status, Status::Interrupted, "{kernel:?} at {at}");
            assert!(!part.converged());
        }
        let resumed = with_file(&target, &settings, &file, true, u64::MAX).unwrap();
        assert_eq!(resumed.bits(), whole.bits(), "{kernel:?}");
    }
}

#[test]
fn a_spent_budget_gives_a_valid_unconverged_run_that_can_be_resumed() {
    let folder = tempfile::tempdir().unwrap();
    let target = smooth::shells(5);
    let settings = small(Kernel::RandomSlice);
    let mut silent = Silent;
    let mut control = Control::new(&mut silent);
    control.checkpoint = Some(plan(folder.path().join("run"), true));
    control.budget.max_calls = 1000;
    let part = run(&target, &settings, 1, &mut control).unwrap();
    assert_eq!(part.status, Status::BudgetSpent);
    assert!(!part.converged());
    assert!(part.cost.calls >= 1000 && part.cost.calls < 3000);
    let open = part
        .checks
        .iter()
        .find(|g| g.name == "remaining-evidence")
        .unwrap();
    assert!(!open.pass && open.message.contains("resume"));
    assert!(part.evidence.ln_z.is_finite() && part.evidence.error.is_finite());
    assert!(
        part.draws
            .ln_weight
            .iter()
            .chain(&part.draws.theta)
            .all(|x| x.is_finite())
    );
    assert!(part.ess.bulk.iter().all(|x| x.is_finite()) && part.ess.quoted > 0.0);
    assert!(part.checks.iter().all(|g| !g.value.is_nan()));
    control.budget.max_calls = u64::MAX;
    let whole = run(&target, &settings, 1, &mut control).unwrap();
    assert_eq!(whole.bits(), sample(&target, &settings, 1).bits());
}

#[test]
fn a_checkpoint_of_another_run_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("run");
    let settings = small(Kernel::RandomSlice);
    with_file(&smooth::shells(5), &settings, &file, false, 3).unwrap();
    let refusal = |target: &dyn Target, settings: &Settings| {
        let error = with_file(target, settings, &file, true, 4).unwrap_err();
        assert!(error.to_string().contains("run"), "{error}");
        error.to_string()
    };
    let other = Settings {
        n_live: 61,
        ..settings.clone()
    };
    assert!(refusal(&smooth::shells(5), &other).contains("other settings"));
    let target = hard::rosen();
    assert!(refusal(&target, &settings).contains("other settings"));
    // The same prior, another likelihood.
    let other = Scaled(smooth::shells(5), 1.02);
    assert!(refusal(&other, &settings).contains("another target"));
    // The same one, as another computer rounds it.
    let rounded = Scaled(smooth::shells(5), 1.0 + 1e-14);
    with_file(&rounded, &settings, &file, true, 4).unwrap();
}

/// ln L times a factor.
struct Scaled(smooth::Smooth, f64);

impl Target for Scaled {
    fn prior(&self) -> &Prior {
        self.0.prior()
    }
    fn ln_likelihood(&self, theta: &[f64]) -> Outcome {
        match self.0.ln_likelihood(theta) {
            Outcome::Value(l) => Outcome::Value(l * self.1),
            other => other,
        }
    }
}

#[test]
fn a_damaged_checkpoint_names_its_file_and_the_one_before_it_serves() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("frail");
    let target = smooth::shells(5);
    let settings = small(Kernel::RandomSlice);
    let damage = |path: &std::path::Path| {
        let mut bytes = std::fs::read(path).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        std::fs::write(path, bytes).unwrap();
    };
    with_file(&target, &settings, &file, false, 3).unwrap();
    damage(&file);
    let error = with_file(&target, &settings, &file, true, 9).unwrap_err();
    assert!(matches!(error, Error::Checkpoint { .. }));
    let text = error.to_string();
    assert!(
        text.contains("frail") && text.contains("checksum"),
        "{text}"
    );

    with_file(&target, &settings, &file, false, 3).unwrap();
    with_file(&target, &settings, &file, true, 9).unwrap();
    damage(&file);
    let mut warned = Warned::default();
    let mut control = Control::new(&mut warned);
    control.checkpoint = Some(plan(file, true));
    let resumed = run(&target, &settings, 1, &mut control).unwrap();
    // A warning is sent, but is no part of the result, which has the bits of a run that was never stopped.
    assert!(
        warned.0.iter().any(|w| w.contains("checksum")),
        "{:?}",
        warned.0
    );
    assert_eq!(resumed.bits(), sample(&target, &settings, 1).bits());
}

/// Keeps the warnings that it receives.
#[derive(Default)]
struct Warned(Vec<String>);

impl Observer for Warned {
    fn event(&mut self, event: &Event) -> ControlFlow<()> {
        if let Event::Warning { message } = event {
            self.0.push(message.clone());
        }
        ControlFlow::Continue(())
    }
}

#[test]
fn a_finished_run_is_had_again_from_its_checkpoint_without_sampling() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("run");
    let settings = small(Kernel::RandomSlice);
    let target = Fails {
        inner: smooth::shells(5),
        calls: AtomicU64::new(0),
        at: u64::MAX,
    };
    let whole = with_file(&target, &settings, &file, false, u64::MAX).unwrap();
    let calls = target.calls.swap(0, Ordering::Relaxed);
    let again = with_file(&target, &settings, &file, true, u64::MAX).unwrap();
    assert_eq!(again.bits(), whole.bits());
    // The three points that identify the target.
    assert!(calls > 1000 && target.calls.into_inner() == 3, "{calls}");
    // If it cannot be written, the run still ends, with a warning.
    let mut warned = Warned::default();
    let mut control = Control::new(&mut warned);
    control.checkpoint = Some(plan(folder.path().join("nowhere/run"), false));
    let unsaved = run(&target.inner, &settings, 1, &mut control).unwrap();
    assert_eq!(unsaved.bits(), whole.bits());
    assert!(
        warned.0.iter().any(|w| w.contains("nowhere")),
        "{:?}",
        warned.0
    );
}

/// Gives every point the same outcome.
struct Always(Prior, Outcome);

impl Target for Always {
    fn prior(&self) -> &Prior {
        &self.0
    }
    fn ln_likelihood(&self, _: &[f64]) -> Outcome {
        self.1.clone()
    }
}

fn unit() -> Prior {
    Prior::new([("x", "", Marginal::Uniform { lo: 0.0, hi: 1.0 })]).unwrap()
}

#[test]
fn a_target_that_rejects_everything_is_given_up_after_a_hundred_thousand_draws() {
    let target = Always(unit(), Outcome::Reject("no stream"));
    let error = run(
        &target,
        &small(Kernel::Auto),
        1,
        &mut Control::new(&mut Silent),
    )
    .unwrap_err();
    match error {
        Error::NoStart { tries, cause } => {
            assert!((100_000..100_100).contains(&tries));
            assert_eq!(cause, "no stream");
        }
        other => panic!("{other}"),
    }
}

#[test]
fn an_interrupt_before_the_first_likelihood_is_an_empty_run_without_evidence() {
    let target = Always(unit(), Outcome::Reject("no stream"));
    let mut silent = Silent;
    let mut control = Control::new(&mut silent);
    control.budget.max_calls = 100;
    let run = run(&target, &small(Kernel::Auto), 1, &mut control).unwrap();
    assert_eq!(run.status, Status::BudgetSpent);
    assert!(run.draws.is_empty() && !run.converged());
    assert!(run.evidence.ln_z == f64::NEG_INFINITY && run.evidence.error == f64::INFINITY);
    assert_eq!(run.cost.rejected["no stream"], run.cost.calls);
}

/// Counts its calls.
struct Counts {
    inner: smooth::Smooth,
    values: AtomicU64,
    gradients: AtomicU64,
}

impl Target for Counts {
    fn prior(&self) -> &Prior {
        self.inner.prior()
    }
    fn ln_likelihood(&self, theta: &[f64]) -> Outcome {
        self.values.fetch_add(1, Ordering::Relaxed);
        self.inner.ln_likelihood(theta)
    }
    fn ln_likelihood_and_gradient(&self, theta: &[f64], gradient: &mut [f64]) -> Outcome {
        self.gradients.fetch_add(1, Ordering::Relaxed);
        self.inner.ln_likelihood_and_gradient(theta, gradient)
    }
    fn gradient_cost(&self) -> Option<f64> {
        self.inner.gradient_cost()
    }
}

#[test]
fn values_and_gradients_are_counted_as_they_are_asked_for() {
    for kernel in [Kernel::Differential, Kernel::Galilean] {
        let target = Counts {
            inner: smooth::shells(5),
            values: AtomicU64::new(0),
            gradients: AtomicU64::new(0),
        };
        let cost = sample(&target, &small(kernel), 1).cost;
        assert_eq!(cost.calls, target.values.into_inner());
        assert_eq!(cost.gradients, target.gradients.into_inner());
        assert_eq!(cost.gradients > 0, kernel == Kernel::Galilean);
    }
}

#[test]
fn galilean_trajectories_without_gradients_are_refused_before_any_call() {
    let target = Always(unit(), Outcome::Fatal("not to be called".to_owned()));
    let settings = small(Kernel::Galilean);
    let error = run(&target, &settings, 1, &mut Control::new(&mut Silent)).unwrap_err();
    assert!(matches!(error, Error::GalileanWithoutGradient), "{error}");
    let text = error.to_string();
    assert!(
        text.contains("`galilean`") && text.contains("`differential`"),
        "{text}"
    );
}

/// Fails at one of its calls, until that is switched off.
struct Fails {
    inner: smooth::Smooth,
    calls: AtomicU64,
    at: u64,
}

impl Target for Fails {
    fn prior(&self) -> &Prior {
        self.inner.prior()
    }
    fn ln_likelihood(&self, theta: &[f64]) -> Outcome {
        if self.calls.fetch_add(1, Ordering::Relaxed) == self.at {
            return Outcome::Fatal("the disk is gone".to_owned());
        }
        self.inner.ln_likelihood(theta)
    }
}

#[test]
fn a_fatal_target_stops_the_run_after_a_checkpoint_of_the_last_whole_iteration() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("run");
    let settings = small(Kernel::RandomSlice);
    let target = Fails {
        inner: smooth::shells(5),
        calls: AtomicU64::new(0),
        at: 2000,
    };
    let error = with_file(&target, &settings, &file, false, u64::MAX).unwrap_err();
    assert!(
        matches!(&error, Error::Fatal(why) if why == "the disk is gone"),
        "{error}"
    );
    assert!(file.exists() && !checkpoint::previous(&file).exists());
    let run = with_file(&target, &settings, &file, true, u64::MAX).unwrap();
    assert_eq!(run.bits(), sample(&target.inner, &settings, 1).bits());
}

#[test]
fn nan_counts_as_a_rejection_and_infinity_ends_the_run() {
    let nan = hard::Hard::with(1, |x| if x[0] < 0.5 { f64::NAN } else { 0.0 });
    let run_nan = sample(&nan, &small(Kernel::Auto), 1);
    assert!(run_nan.cost.rejected["nan"] > 10);
    assert!((run_nan.evidence.ln_z - 0.5_f64.ln()).abs() < 4.0 * run_nan.evidence.error);
    let infinite = Always(unit(), Outcome::Value(f64::INFINITY));
    let error = run(
        &infinite,
        &small(Kernel::Auto),
        1,
        &mut Control::new(&mut Silent),
    );
    assert!(matches!(error.unwrap_err(), Error::Infinite { .. }));
}

#[test]
fn a_result_is_consistent_with_itself() {
    let target = hard::quarter();
    let run = sample(&target, &settings(600, Kernel::Uniform), 1);
    assert!(run.converged(), "{:?}", run.checks);
    assert!((run.draws.weights().iter().sum::<f64>() - 1.0).abs() < 1e-12);
    assert!(run.draws.column(0).iter().all(|x| *x < 0.25));
    assert!(run.cost.rejected["beyond the quarter"] > 100);
    let History::Nested {
        ln_x,
        ln_likelihood,
        ln_likelihood_birth,
        live,
        insertion_rank,
    } = &run.history
    else {
        panic!("a nested run has a nested path")
    };
    assert_eq!(ln_x.len(), ln_likelihood.len());
    assert_eq!(ln_x.len(), live.len());
    assert!(ln_x.windows(2).all(|w| w[1] < w[0]));
    assert!(
        ln_likelihood
            .iter()
            .zip(ln_likelihood_birth)
            .all(|(l, b)| l >= b)
    );
    assert!(insertion_rank.iter().all(|v| *v > 0.0 && *v < 1.0));
}
