//! Points that do not depend on each other are evaluated together, in whatever order the target chooses.

use crate::targets::smooth::{self, Smooth};
use oblate_samplers::control::Silent;
use oblate_samplers::{Control, Outcome, Prior, Run, Target, nested, pt};
use std::sync::atomic::{AtomicUsize, Ordering};

/// Evaluates batches from their end, and counts their points.
struct Backwards {
    inner: Smooth,
    points: AtomicUsize,
}

impl Target for Backwards {
    fn prior(&self) -> &Prior {
        self.inner.prior()
    }
    fn ln_likelihood(&self, theta: &[f64]) -> Outcome {
        self.inner.ln_likelihood(theta)
    }
    fn ln_likelihoods(&self, thetas: &[Vec<f64>]) -> Vec<Outcome> {
        self.points.fetch_add(thetas.len(), Ordering::Relaxed);
        let outcomes = thetas.iter().rev().map(|t| self.ln_likelihood(t));
        let mut outcomes: Vec<Outcome> = outcomes.collect();
        outcomes.reverse();
        outcomes
    }
    fn ln_likelihood_and_gradient(&self, theta: &[f64], gradient: &mut [f64]) -> Outcome {
        self.inner.ln_likelihood_and_gradient(theta, gradient)
    }
    fn gradient_cost(&self) -> Option<f64> {
        self.inner.gradient_cost()
    }
}

fn by_nested(target: &dyn Target) -> Run {
    let settings = nested::Settings {
        n_live: 60,
        simulations: 20,
        bootstraps: 20,
        ..nested::Settings::default()
    };
    nested::run(target, &settings, 1, &mut Control::new(&mut Silent)).unwrap()
}

fn by_pt(target: &dyn Target, smc_particles: usize) -> Run {
    let settings = pt::Settings {
        rounds: 3,
        chain_sets: 4,
        smc_particles,
        ..pt::Settings::default()
    };
    pt::run(target, &settings, 1, &mut Control::new(&mut Silent)).unwrap()
}

/// Checks that a run is the same on both, and that at least so many points came in batches.
fn same_in_batches(name: &str, least: usize, sample: impl Fn(&dyn Target) -> Run) {
    let target = Backwards {
        inner: smooth::half_plane(),
        points: AtomicUsize::new(0),
    };
    let batched = sample(&target).bits();
    assert_eq!(batched, sample(&target.inner).bits(), "{name}");
    let points = target.points.into_inner();
    assert!(points >= least, "{name}: {points}");
}

#[test]
fn the_first_draws_come_in_batches_and_leave_a_run_as_it_is() {
    same_in_batches("nested", 60, by_nested);
    same_in_batches("chain_sets", 4 * 2, |target| by_pt(target, 0));
    same_in_batches("smc_samplers", 4 * 8, |target| by_pt(target, 8));
}
