//! Bridges from coarse likelihoods to fine ones whose evidences, moments and weights are known.

use crate::pulls::pull;
use crate::stops::{StopAt, plan};
use crate::targets::bell::Bell;
use crate::targets::smooth;
use oblate_samplers::control::{CheckpointPlan, Control, Silent};
use oblate_samplers::output::{History, Method, Status};
use oblate_samplers::{Error, Event, Observer, Outcome, Prior, Run, Target, bridge, nested, pt};
use std::ops::{ControlFlow, RangeInclusive};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

fn parent(target: &dyn Target, seed: u64) -> Run {
    let settings = nested::Settings {
        n_live: 400,
        simulations: 100,
        ..nested::Settings::default()
    };
    nested::run(target, &settings, seed, &mut Control::new(&mut Silent)).unwrap()
}

fn bridged(fine: &dyn Target, coarse: &dyn Target, parent: &Run, seed: u64) -> Run {
    let settings = bridge::Settings::default();
    bridge::run(
        fine,
        coarse,
        parent,
        &settings,
        seed,
        &mut Control::new(&mut Silent),
    )
    .unwrap()
}

fn failed(run: &Run) -> Vec<&str> {
    let failed = run.checks.iter().filter(|g| !g.pass);
    failed.map(|g| g.name.as_str()).collect()
}

#[test]
fn the_evidence_and_the_moments_are_those_of_the_fine_likelihood() {
    evidence_and_moments(1..=2);
}

#[test]
#[ignore = "the long form: run before a release with --ignored"]
fn the_evidence_and_the_moments_are_those_of_the_fine_likelihood_for_more_seeds() {
    evidence_and_moments(1..=5);
}

#[test]
fn a_coarse_run_that_was_stopped_before_its_end_fails_a_check() {
    let target = Bell::new(2, 6.0, 0.8);
    let coarse = parent(&target, 1);
    let failed_of = |parent: &Run| {
        let run = bridged(&target, &target, parent, 1);
        let mut checks = run.checks.iter();
        let check = checks.find(|check| check.name == "coarse-run-checks");
        check.expect("the check").value
    };
    let stopped = Run {
        status: Status::BudgetSpent,
        ..coarse.clone()
    };
    let more = failed_of(&stopped) - failed_of(&coarse);
    assert!((more - 1.0).abs() < 1e-12, "{more}");
}

/// Every ln Z and every mean within four of its own errors.
fn evidence_and_moments(seeds: RangeInclusive<u64>) {
    let coarse = Bell::new(5, 6.0, 0.8);
    let fine = Bell::new(5, 30.0, 1.0);
    for seed in seeds {
        let run = bridged(&fine, &coarse, &parent(&coarse, seed), seed);
        assert_eq!(run.method, Method::Bridge);
        let z = pull(&run, fine.ln_z());
        assert!(z.abs() < 4.0, "seed {seed}: {z}, {:?}", run.evidence);
        assert!(run.evidence.error < 0.5, "{:?}", run.evidence);
        // Four hundred live points are few for the parent's own checks.
        let own = failed(&run)
            .into_iter()
            .find(|name| *name != "coarse-run-checks");
        assert_eq!(own, None, "{:?}", run.checks);
        // The posterior is a normal of precision 31 about 30 / 31.
        for j in 0..5 {
            let mean = run.draws.column(j).iter().sum::<f64>() / run.draws.len() as f64;
            let error = (1.0 / (31.0 * run.ess.bulk[j])).sqrt();
            assert!(
                (mean - 30.0 / 31.0).abs() < 4.5 * error,
                "{j}: {mean} +- {error}"
            );
        }
    }
}

#[test]
fn modes_that_a_coarse_likelihood_weighs_wrongly_are_weighed_again() {
    weights_of_modes(1..=1);
}

#[test]
#[ignore = "the long form: run before a release with --ignored"]
fn modes_that_a_coarse_likelihood_weighs_wrongly_are_weighed_again_for_more_seeds() {
    weights_of_modes(1..=3);
}

/// Every ln Z and every mode weight within four of its own errors.
fn weights_of_modes(seeds: RangeInclusive<u64>) {
    let (coarse, fine) = (smooth::twins13(0.5), smooth::twins13(0.9));
    for seed in seeds {
        let run = bridged(&fine, &coarse, &parent(&coarse, seed), seed);
        assert!(pull(&run, fine.ln_z).abs() < 4.0, "{:?}", run.evidence);
        let x = run.draws.column(0);
        let right = x.iter().filter(|x| **x > 0.0).count() as f64 / x.len() as f64;
        // The coarse run's mode weights are kept: their error comes from its lineages, a few of which hold each mode.
        let parent_right = 0.5;
        let size = run.ess.quoted.min(run.ess.kish);
        let error = (parent_right * parent_right / size).sqrt();
        assert!(
            (right - 0.9).abs() < 4.0 * error,
            "seed {seed}: {right} +- {error}"
        );
    }
}

#[test]
fn draws_of_tempered_chains_can_be_bridged() {
    let (coarse, fine) = (smooth::twins13(0.5), smooth::twins13(0.9));
    let settings = pt::Settings {
        rounds: 8,
        ..pt::Settings::default()
    };
    let tempered = pt::run(&coarse, &settings, 1, &mut Control::new(&mut Silent)).unwrap();
    let run = bridged(&fine, &coarse, &tempered, 1);
    assert!(pull(&run, fine.ln_z).abs() < 4.0, "{:?}", run.evidence);
}

/// The mean of each parameter from parallel tempering and a bridge, in its own standard errors: 60 of twelve independent runs.
#[test]
fn effective_sizes_of_a_bridge_from_tempered_chains_are_those_of_its_means() {
    let (coarse, fine) = (Bell::new(5, 6.0, 0.8), Bell::new(5, 30.0, 1.0));
    // Chains that move by one slice update in a scan.
    let tempering = pt::Settings {
        rounds: 9,
        hmc_transitions: 0,
        slice_updates: 1,
        ..pt::Settings::default()
    };
    let settings = bridge::Settings {
        smc_particles: 1_000,
        mcmc_steps: 2,
        further_mcmc_steps: 0,
        max_batches: 1,
    };
    let mut squares = 0.0;
    for seed in 1..=12 {
        let mut silent = Silent;
        let mut control = Control::new(&mut silent);
        let parent = pt::run(&coarse, &tempering, seed, &mut control).unwrap();
        let run = bridge::run(&fine, &coarse, &parent, &settings, seed, &mut control).unwrap();
        assert_eq!((run.ess.bulk.len(), run.ess.tail.len()), (5, 5));
        for j in 0..5 {
            let column = run.draws.column(j);
            let mean = column.iter().sum::<f64>() / column.len() as f64;
            let variance = 1.0 / (31.0 * run.draws.ess_of_mean(&column));
            squares += (mean - 30.0 / 31.0).powi(2) / variance / 60.0;
        }
    }
    // Chi-square of 60 degrees of freedom over 60: a standard deviation of 0.18, and 0.13 of the effective sizes themselves.
    assert!((0.4..1.8).contains(&squares), "{squares}");
}

#[test]
fn further_mcmc_steps_and_batches_are_made_until_the_draws_are_enough_also_later() {
    let (coarse, fine) = (Bell::new(3, 6.0, 0.8), Bell::new(3, 30.0, 1.0));
    let mut parent = parent(&coarse, 1);
    // Four hundred live points are few for its own checks, and without them no further steps are made.
    parent.checks.clear();
    let folder = tempfile::tempdir().unwrap();
    let with = |smc_particles: usize, steps_and_batches: [usize; 2], name: &str| {
        let [further_mcmc_steps, max_batches] = steps_and_batches;
        let settings = bridge::Settings {
            smc_particles,
            mcmc_steps: 1,
            further_mcmc_steps,
            max_batches,
        };
        let mut silent = Silent;
        let mut control = Control::new(&mut silent);
        control.checkpoint = Some(plan(&folder.path().join(name)));
        bridge::run(&fine, &coarse, &parent, &settings, 1, &mut control).unwrap()
    };
    // A hundred draws are never enough, nor are three hundred.
    let (short, long) = (with(100, [2, 1], "short"), with(100, [2, 3], "long"));
    assert_eq!([short.draws.len(), long.draws.len()], [100, 300]);
    assert!(long.ess.quoted < 400.0);
    assert_eq!(with(100, [2, 3], "short").bits(), long.bits());
    // Eight hundred are once their copies have parted, and five batches of a hundred and fifty.
    let enough = with(800, [1_000, 1], "enough");
    assert!(with(800, [0, 1], "few").ess.quoted < 400.0);
    let batches = with(150, [8, 100], "batches");
    for run in [enough, batches] {
        assert!(run.ess.quoted >= 400.0, "{:?}", run.ess);
        assert!(pull(&run, fine.ln_z()).abs() < 4.0, "{:?}", run.evidence);
    }
}

/// A likelihood that counts its values.
struct Counted(Bell, AtomicU64);

impl Target for Counted {
    fn prior(&self) -> &Prior {
        self.0.prior()
    }

    fn ln_likelihood(&self, theta: &[f64]) -> Outcome {
        self.1.fetch_add(1, Ordering::Relaxed);
        self.0.ln_likelihood(theta)
    }
}

#[test]
fn further_mcmc_steps_need_no_values_of_the_coarse_likelihood() {
    let fine = Bell::new(3, 30.0, 1.0);
    let mut parent = parent(&Bell::new(3, 6.0, 0.8), 1);
    parent.checks.clear();
    let values = [0, 5].map(|further_mcmc_steps| {
        let coarse = Counted(Bell::new(3, 6.0, 0.8), AtomicU64::new(0));
        let settings = bridge::Settings {
            smc_particles: 100,
            mcmc_steps: 2,
            further_mcmc_steps,
            max_batches: 1,
        };
        let mut silent = Silent;
        let mut control = Control::new(&mut silent);
        let run = bridge::run(&fine, &coarse, &parent, &settings, 1, &mut control).unwrap();
        (run.cost.calls, coarse.1.into_inner())
    });
    let [(few, without), (many, with)] = values;
    assert!(many > few && with == without, "{values:?}");
}

/// Ratios of evidences by one batch and by four, of sixteen seeds each: mean squares in their own errors.
#[test]
fn several_batches_have_a_smaller_error_than_one_and_it_is_right() {
    let (coarse, fine) = (Bell::new(3, 6.0, 0.8), Bell::new(3, 30.0, 1.0));
    let mut parent = parent(&coarse, 1);
    parent.checks.clear();
    let mut errors = [0.0; 2];
    for (error, max_batches) in errors.iter_mut().zip([1, 4]) {
        let settings = bridge::Settings {
            smc_particles: 50,
            mcmc_steps: 4,
            further_mcmc_steps: 0,
            max_batches,
        };
        let mut squares = 0.0;
        for seed in 1..=16 {
            let mut silent = Silent;
            let mut control = Control::new(&mut silent);
            let run = bridge::run(&fine, &coarse, &parent, &settings, seed, &mut control).unwrap();
            assert_eq!(run.draws.len(), 50 * max_batches);
            let off = run.evidence.ln_z - parent.evidence.ln_z - (fine.ln_z() - coarse.ln_z());
            let part = |name: &str| run.evidence.error_parts[name].powi(2);
            squares += off * off / (part("weights") + part("lineage-weights")) / 16.0;
            *error += part("weights").sqrt() / 16.0;
        }
        // Chi-square of 16 degrees of freedom over 16: a standard deviation of 0.35. The parent's own draws add to it.
        assert!((0.1..2.4).contains(&squares), "{max_batches}: {squares}");
    }
    assert!(errors[1] < 0.7 * errors[0], "{errors:?}");
}

/// Parallel tempering along a surrogate.
fn along_a_surrogate(target: &dyn Target) -> Run {
    let settings = pt::Settings {
        smc_particles: 200,
        mcmc_steps: 5,
        first_scans: 64,
        rounds: 4,
        extensions: 6,
        slice_updates: 1,
        hmc_transitions: 0,
        mixture_rounds: 24,
        surrogate: true,
        ..pt::Settings::default()
    };
    let mut silent = Silent;
    pt::run(target, &settings, 1, &mut Control::new(&mut silent)).unwrap()
}

/// Moves along a surrogate that learns the fine likelihood: its modes and evidence, in few steps, with the same bits after stops and on
/// any number of threads.
#[test]
fn a_surrogate_of_the_coarse_run_moves_the_particles_of_the_bridge() {
    let (coarse, fine) = (smooth::twins13(0.5), smooth::twins13(0.9));
    let parent = along_a_surrogate(&coarse);
    assert!(parent.surrogate.is_some());
    let settings = bridge::Settings {
        smc_particles: 350,
        mcmc_steps: 2,
        further_mcmc_steps: 3,
        max_batches: 6,
    };
    let plainly = || {
        let mut silent = Silent;
        let mut control = Control::new(&mut silent);
        bridge::run(&fine, &coarse, &parent, &settings, 1, &mut control).unwrap()
    };
    let run = plainly();
    assert!(pull(&run, fine.ln_z).abs() < 4.0, "{:?}", run.evidence);
    let x = run.draws.column(0);
    let right: Vec<f64> = x.iter().map(|x| f64::from(u8::from(*x > 0.0))).collect();
    let weight = right.iter().sum::<f64>() / right.len() as f64;
    let truth = fine.right().unwrap();
    let error = (truth * (1.0 - truth) / run.draws.ess_of_mean(&right)).sqrt();
    assert!((weight - truth).abs() < 4.0 * error, "{weight} +- {error}");
    // Several batches are needed for so many.
    assert!(run.ess.quoted >= 400.0, "{:?}", run.ess);
    assert!(run.surrogate.is_some() && run.surrogate != parent.surrogate);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build();
    assert_eq!(pool.unwrap().install(plainly).bits(), run.bits());
    let folder = tempfile::tempdir().unwrap();
    let stopped = || {
        let mut observer = StopAt(3);
        let mut control = Control::new(&mut observer);
        control.checkpoint = Some(plan(&folder.path().join("bridge.ckpt")));
        bridge::run(&fine, &coarse, &parent, &settings, 1, &mut control)
    };
    let resumed = (0..100).find_map(|_| stopped().ok()).unwrap();
    assert_eq!(resumed.bits(), run.bits());
    // Nor does a likelihood that fails for a while change anything.
    let failing = Failing {
        target: smooth::twins13(0.9),
        left: AtomicU64::new(run.cost.calls / 4),
    };
    let failed = |target: &dyn Target| {
        let mut silent = Silent;
        let mut control = Control::new(&mut silent);
        control.checkpoint = Some(plan(&folder.path().join("failed.ckpt")));
        bridge::run(target, &coarse, &parent, &settings, 1, &mut control)
    };
    assert!(matches!(failed(&failing), Err(Error::Fatal(_))));
    assert!(failed(&fine).unwrap().draws == run.draws);
}

/// A likelihood that fails after so many values.
struct Failing<T> {
    target: T,
    left: AtomicU64,
}

impl<T: Target> Target for Failing<T> {
    fn prior(&self) -> &Prior {
        self.target.prior()
    }
    fn ln_likelihood(&self, theta: &[f64]) -> Outcome {
        let left = self.left.load(Ordering::Relaxed);
        self.left.store(left.saturating_sub(1), Ordering::Relaxed);
        if left == 0 {
            return Outcome::Fatal("the disk is gone".to_owned());
        }
        self.target.ln_likelihood(theta)
    }
}

/// Two likelihoods without overlap: the bridge still ends, and its checks fail.
#[test]
fn a_coarse_likelihood_far_from_the_fine_one_fails_the_checks() {
    let coarse = Bell::new(5, 100.0, -1.0);
    let fine = Bell::new(5, 100.0, 1.0);
    // Few particles: there are many steps.
    let settings = bridge::Settings {
        smc_particles: 400,
        ..bridge::Settings::default()
    };
    let mut silent = Silent;
    let mut control = Control::new(&mut silent);
    let parent = parent(&coarse, 1);
    let run = bridge::run(&fine, &coarse, &parent, &settings, 1, &mut control).unwrap();
    assert!(failed(&run).contains(&"ess-bulk"), "{:?}", run.checks);
    let History::Bridge {
        fraction,
        ancestors,
        ..
    } = &run.history
    else {
        panic!("{:?}", run.history);
    };
    assert!(fraction.windows(2).all(|s| s[0] < s[1]) && fraction.last() == Some(&1.0));
    assert!(ancestors.last().unwrap() < &100.0);
}

#[test]
fn a_bridge_has_the_same_bits_on_any_number_of_threads() {
    let (coarse, fine) = (Bell::new(3, 6.0, 0.8), Bell::new(3, 30.0, 1.0));
    let parent = parent(&coarse, 1);
    let bits = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        let pool = pool.build().unwrap();
        pool.install(|| bridged(&fine, &coarse, &parent, 1).bits())
    };
    assert_eq!(bits(1), bits(3));
}

/// Stops after the first step.
struct Hasty;

impl Observer for Hasty {
    fn event(&mut self, event: &Event) -> ControlFlow<()> {
        match event {
            Event::Bridge { .. } => ControlFlow::Break(()),
            _ => ControlFlow::Continue(()),
        }
    }
}

/// ln L of a state that a symmetry moved, or whose gradient was computed, differs by rounding from a new value; in single precision by
/// hundredths, and by more where ln L is chaotic, which few draws are.
#[test]
fn a_parent_may_have_its_likelihoods_to_rounding_and_not_worse() {
    let (coarse, fine) = (Bell::new(3, 6.0, 0.8), Bell::new(3, 30.0, 1.0));
    let parent = parent(&coarse, 1);
    let attempt = |shift: f64, every: usize| {
        let mut parent = parent.clone();
        for l in parent.draws.ln_likelihood.iter_mut().step_by(every) {
            *l += shift;
        }
        let mut silent = Silent;
        let mut control = Control::new(&mut silent);
        let settings = bridge::Settings::default();
        bridge::run(&fine, &coarse, &parent, &settings, 1, &mut control)
    };
    assert!(attempt(0.01, 1).is_ok());
    assert!(matches!(
        attempt(0.1, 1),
        Err(Error::OtherLikelihood { .. })
    ));
    assert!(attempt(1.0, 20).is_ok());
}

#[test]
fn what_cannot_be_bridged_is_refused_and_an_interrupt_ends_it() {
    let (coarse, fine) = (Bell::new(3, 6.0, 0.8), Bell::new(3, 30.0, 1.0));
    let parent = parent(&coarse, 1);
    let attempt = |fine: &dyn Target, coarse: &dyn Target, smc_particles: usize| {
        let settings = bridge::Settings {
            smc_particles,
            ..bridge::Settings::default()
        };
        let mut silent = Silent;
        let mut control = Control::new(&mut silent);
        bridge::run(fine, coarse, &parent, &settings, 1, &mut control).unwrap_err()
    };
    assert!(matches!(
        attempt(&fine, &fine, 500),
        Error::OtherLikelihood { .. }
    ));
    assert!(matches!(
        attempt(&Bell::new(4, 1.0, 0.0), &coarse, 500),
        Error::OtherParameters { .. }
    ));
    assert!(matches!(
        attempt(&fine, &coarse, 10),
        Error::Setting {
            name: "smc_particles",
            ..
        }
    ));
    let nowhere = Nowhere(Bell::new(3, 6.0, 0.8));
    assert!(matches!(
        attempt(&nowhere, &coarse, 500),
        Error::NoCommonSupport
    ));
    assert!(matches!(
        attempt(&fine, &nowhere, 500),
        Error::OtherLikelihood { .. }
    ));
    let settings = bridge::Settings::default();
    let mut hasty = Hasty;
    let mut control = Control::new(&mut hasty);
    let stopped = bridge::run(&fine, &coarse, &parent, &settings, 1, &mut control);
    assert!(matches!(stopped, Err(Error::Interrupted)));
}

#[test]
fn a_bridge_stopped_anywhere_and_resumed_has_the_bits_of_one_never_stopped() {
    let (coarse, fine) = (Bell::new(3, 6.0, 0.8), Bell::new(3, 30.0, 1.0));
    let parent = parent(&coarse, 1);
    let expected = bridged(&fine, &coarse, &parent, 1).bits();
    let folder = tempfile::tempdir().unwrap();
    let settings = bridge::Settings::default();
    let resumed = |events: u64, seed: u64| {
        let mut observer = StopAt(events);
        let mut control = Control::new(&mut observer);
        control.checkpoint = Some(plan(&folder.path().join("bridge.ckpt")));
        bridge::run(&fine, &coarse, &parent, &settings, seed, &mut control)
    };
    // Started, then twelve MCMC steps after each of a few steps of the bridge, with a checkpoint after each.
    let mut stops = 0;
    let run = loop {
        match resumed([1, 2, 5, 12, 31][stops % 5], 1) {
            Ok(run) => break run,
            Err(error) => assert!(matches!(error, Error::Interrupted), "{error}"),
        }
        stops += 1;
        assert!(stops < 100, "it does not get on");
    };
    assert!(stops > 3, "{stops}");
    assert_eq!(run.bits(), expected);
    // Not that of another seed.
    assert!(matches!(
        resumed(u64::MAX, 2),
        Err(Error::Checkpoint { .. })
    ));
}

#[test]
fn a_finished_bridge_is_had_again_from_its_checkpoint_without_sampling() {
    let (coarse, fine) = (Bell::new(3, 6.0, 0.8), Bell::new(3, 30.0, 1.0));
    let parent = parent(&coarse, 1);
    let folder = tempfile::tempdir().unwrap();
    let at_most = |events: u64| {
        let mut observer = StopAt(events);
        let mut control = Control::new(&mut observer);
        control.checkpoint = Some(CheckpointPlan {
            every: Duration::MAX,
            ..plan(&folder.path().join("bridge.ckpt"))
        });
        let settings = bridge::Settings::default();
        bridge::run(&fine, &coarse, &parent, &settings, 1, &mut control)
    };
    let whole = at_most(u64::MAX).unwrap();
    // Stopped at its first event, a run with anything left to sample has no result.
    assert_eq!(at_most(1).unwrap().bits(), whole.bits());
}

/// The same parameters without a likelihood.
struct Nowhere(Bell);

impl Target for Nowhere {
    fn prior(&self) -> &Prior {
        self.0.prior()
    }
    fn ln_likelihood(&self, _: &[f64]) -> Outcome {
        Outcome::Reject("nowhere")
    }
}
