//! Importance sampling from a mixture fitted to a run: right where it accepts, and refused where it should be.

use crate::targets::hard::Hard;
use crate::targets::smooth::{self, Smooth};
use oblate_samplers::control::{Control, Silent};
use oblate_samplers::output::{Method, Path, Status};
use oblate_samplers::{Error, Event, Observer, Run, Target, boost, nested, pt};
use std::ops::ControlFlow;

fn parent(target: &dyn Target, seed: u64) -> Run {
    let settings = nested::Settings {
        n_live: 400,
        simulations: 100,
        ..nested::Settings::default()
    };
    nested::run(target, &settings, seed, &mut Control::new(&mut Silent)).unwrap()
}

fn boosted(target: &dyn Target, parent: &Run, draws: usize, seed: u64) -> Run {
    let settings = boost::Settings {
        draws,
        ..boost::Settings::default()
    };
    boost::run(
        target,
        parent,
        &settings,
        seed,
        &mut Control::new(&mut Silent),
    )
    .unwrap()
}

fn failed(run: &Run) -> Vec<&str> {
    let failed = run.gates.iter().filter(|g| !g.pass);
    failed.map(|g| g.name.as_str()).collect()
}

/// Two parents, each boosted: ln Z within four of its own errors, calls per effective draw at most `bar`, and all gates passed.
fn accepted(target: &Smooth, bar: f64) {
    for seed in [1, 2] {
        let run = boosted(target, &parent(target, seed), 8_000, seed);
        assert!(run.converged(), "{}: {:?}", target.name, run.gates);
        let z = (run.evidence.ln_z - target.ln_z) / run.evidence.error;
        assert!(z.abs() < 4.0, "{}: {z}", target.name);
        let cost = run.cost.calls as f64 / run.ess.kish;
        assert!(cost < bar, "{}: {cost} calls per draw", target.name);
        assert_eq!(run.method, Method::Boost);
        let sum: f64 = run.draws.weights().iter().sum();
        assert!((sum - 1.0).abs() < 1e-9);
    }
}

// The bars are twice what it costs: 1.6 calls for one mode, up to 4 for two, up to 34 for the shells.
#[test]
fn a_correlated_gaussian_is_accepted() {
    accepted(&smooth::mvn13(), 3.0);
}

#[test]
fn two_modes_are_accepted() {
    let target = smooth::twins13(0.5);
    accepted(&target, 8.0);
}

#[test]
fn moments_are_those_of_the_posterior() {
    // iso: the posterior is a normal of variance 1 / 10 about 0 in every direction.
    let target = smooth::iso(3);
    let run = boosted(&target, &parent(&target, 3), 8_000, 3);
    for j in 0..3 {
        let rows = || run.draws.column(j).into_iter().zip(run.draws.weights());
        let mean: f64 = rows().map(|(x, w)| x * w).sum();
        let square: f64 = rows().map(|(x, w)| x * x * w).sum();
        let size = run.ess.bulk[j];
        assert!(mean.abs() < 4.0 * (0.1 / size).sqrt(), "{mean}");
        // A normal's square has twice the squared variance as variance.
        assert!(
            (square - 0.1).abs() < 4.0 * (0.02 / size).sqrt(),
            "{square}"
        );
    }
}

#[test]
fn thin_shells_are_accepted_at_a_higher_price() {
    // In thirteen dimensions a Student distribution is nearly a shell itself, four times as thick as these.
    accepted(&smooth::shells(13), 70.0);
}

#[test]
fn a_posterior_that_no_mixture_resembles_is_refused() {
    // Two circles, a thousandth of their radius thick: a torus that would take thousands of components.
    let target = Hard::with(4, |u| {
        let ring = |x: f64, y: f64| {
            let r = (4.0 * x - 2.0).hypot(4.0 * y - 2.0);
            -0.5 * ((r - 1.0) / 1e-3).powi(2)
        };
        ring(u[0], u[1]) + ring(u[2], u[3])
    });
    let settings = nested::Settings {
        n_live: 300,
        kernel: nested::Kernel::RandomSlice,
        simulations: 20,
        ..nested::Settings::default()
    };
    let parent = nested::run(&target, &settings, 1, &mut Control::new(&mut Silent)).unwrap();
    let run = boosted(&target, &parent, 8_000, 1);
    assert!(failed(&run).contains(&"effective-share"), "{:?}", run.gates);
    assert!(!run.converged());
}

#[test]
fn a_parent_that_missed_a_mode_is_told() {
    // Draws of one of the two modes only: as from a run that never saw the other.
    let target = smooth::twins13(0.5);
    let mut one = parent(&target, 1);
    let far: Vec<bool> = one.draws.column(0).iter().map(|x| *x < 0.0).collect();
    for (weight, far) in one.draws.ln_weight.iter_mut().zip(far) {
        if far {
            *weight = f64::NEG_INFINITY;
        }
    }
    let sum: f64 = one.draws.weights().iter().sum();
    one.draws.ln_weight.iter_mut().for_each(|w| *w -= sum.ln());
    let run = boosted(&target, &one, 8_000, 1);
    // In thirteen dimensions the prior's share alone does not find the other: its evidence is missing, and the parent's has it.
    assert!(failed(&run).contains(&"parent-evidence"), "{:?}", run.gates);
}

#[test]
fn draws_of_tempered_chains_are_as_good() {
    let target = smooth::twins13(0.9);
    let settings = pt::Settings {
        ladders: 4,
        ..pt::Settings::default()
    };
    let tempered = pt::run(&target, &settings, 1, &mut Control::new(&mut Silent)).unwrap();
    let run = boosted(&target, &tempered, 8_000, 1);
    let z = (run.evidence.ln_z - target.ln_z) / run.evidence.error;
    assert!(z.abs() < 4.0, "{z}");
    let right: f64 = run
        .draws
        .column(0)
        .iter()
        .zip(run.draws.weights())
        .filter(|(x, _)| **x > 0.0)
        .map(|(_, w)| w)
        .sum();
    let error = (0.09 / run.ess.kish).sqrt();
    assert!((right - 0.9).abs() < 4.0 * error, "{right} +- {error}");
    assert!(!failed(&run).contains(&"pareto-k"), "{:?}", run.gates);
}

#[test]
fn a_boost_has_the_same_bits_on_any_number_of_threads() {
    let target = smooth::iso(3);
    let parent = parent(&target, 1);
    let bits = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        let pool = pool.build().unwrap();
        pool.install(|| boosted(&target, &parent, 3_000, 1).bits())
    };
    assert_eq!(bits(1), bits(3));
}

/// Stops after the first block.
struct Hasty;

impl Observer for Hasty {
    fn event(&mut self, event: &Event) -> ControlFlow<()> {
        match event {
            Event::Boost { .. } => ControlFlow::Break(()),
            _ => ControlFlow::Continue(()),
        }
    }
}

#[test]
fn an_interrupted_boost_keeps_what_it_has() {
    let target = smooth::iso(3);
    let parent = parent(&target, 1);
    let run = boost::run(
        &target,
        &parent,
        &boost::Settings::default(),
        1,
        &mut Control::new(&mut Hasty),
    )
    .unwrap();
    assert_eq!(run.status, Status::Interrupted);
    assert!(!run.converged());
    assert_eq!(run.cost.calls, 1024);
    assert!(run.evidence.error < 0.1, "{:?}", run.evidence);
    let Path::Importance {
        share,
        parent_share,
        ..
    } = &run.path
    else {
        panic!("{:?}", run.path);
    };
    assert_eq!(share.len(), parent_share.len());
}

#[test]
fn a_run_of_another_target_or_too_short_is_refused() {
    let refused = |target: &dyn Target, parent: &Run| {
        let settings = boost::Settings::default();
        let refused = boost::run(target, parent, &settings, 1, &mut Control::new(&mut Silent));
        match refused {
            Err(Error::Mismatch { why, .. }) => why,
            other => panic!("{other:?}"),
        }
    };
    let run = parent(&smooth::iso(3), 1);
    assert!(refused(&smooth::iso(4), &run).contains("other parameters"));
    assert!(refused(&smooth::gauss3(), &run).contains("ln L of its best draw"));
    let mut short = run.clone();
    short.draws.ln_weight[20..].fill(f64::NEG_INFINITY);
    assert!(refused(&smooth::iso(3), &short).contains("too few"));
    let walls = smooth::wall2();
    let mut run = parent(&walls, 1);
    run.names.clone_from(&walls.prior().names().to_vec());
    assert!(refused(&walls, &run).contains("walls"));
}

#[test]
#[ignore = "a table of a minute: run before a release with --ignored --nocapture"]
fn calls_of_a_boost() {
    println!("| target | calls per draw | tail index | z | error |\n|---|---|---|---|---|");
    for target in [
        smooth::mvn13(),
        smooth::twins13(0.5),
        smooth::shells(5),
        smooth::shells(13),
        smooth::shells(20),
    ] {
        let run = boosted(&target, &parent(&target, 1), 40_000, 1);
        let k = run.gates.iter().find(|g| g.name == "pareto-k").unwrap();
        println!(
            "| {} {} | {:.1} | {:.2} | {:+.2} | {:.3} | {:?}",
            target.name,
            target.dim(),
            run.cost.calls as f64 / run.ess.kish,
            k.value,
            (run.evidence.ln_z - target.ln_z) / run.evidence.error,
            run.evidence.error,
            failed(&run),
        );
    }
}
