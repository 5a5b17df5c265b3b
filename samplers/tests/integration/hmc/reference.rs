//! Annealing paths from a mixture.

use super::{
    DRAWS, Difference, Inversion, STEPS, correlated_metric, datum_pair, farthest_moment, plane,
};
use oblate_samplers::difference_pool::DifferencePool;
use oblate_samplers::hmc::{
    Evaluator, LocalSampler, Plan, Point, Reference, propose_involution, refresh, slice,
};
use oblate_samplers::rng::{Domain, RandomStream, standard_normal, stream, unit_open};
use rayon::prelude::*;

/// Densities fitted to two neighbouring clumps, and a little of the prior.
fn clumps() -> Reference {
    let mut rng = stream(24, Domain::Test, 0, 0);
    let clump = |i: usize, rng: &mut RandomStream| {
        let centre = if i.is_multiple_of(3) { -0.8 } else { 0.6 };
        [
            centre + 0.3 * standard_normal(rng),
            0.4 * standard_normal(rng),
        ]
    };
    let rows: Vec<f64> = (0..2000).flat_map(|i| clump(i, &mut rng)).collect();
    Reference::resembling(&rows, 2, |k| stream(24, Domain::Test, 1, k as u64)).unwrap()
}

/// A draw of the path from a reference at an inverse temperature with data drawn given it, before and after the steps of a
/// kernel.
fn moved_from(
    reference: &Reference,
    beta: f64,
    index: u64,
    step: impl Fn(&mut LocalSampler<'_, '_>, &mut Point, &mut RandomStream),
) -> ([f64; 2], [f64; 2]) {
    // No point of the plane has a larger log ratio of reference to prior.
    const HIGHEST: f64 = 2.5;
    let mut rng = stream(25, Domain::Test, 0, index);
    let prior = plane();
    let (mut point, datum) = loop {
        let (mut point, datum) = datum_pair(&mut rng, &prior, beta, true);
        point.ln_over_prior = reference.ln_over_prior(&point.z);
        assert!(point.ln_over_prior < HIGHEST, "{}", point.ln_over_prior);
        if unit_open(&mut rng).ln() < (1.0 - beta) * (point.ln_over_prior - HIGHEST) {
            break (point, datum);
        }
    };
    let metric = correlated_metric();
    let evaluator = Evaluator::from_reference(&datum, reference);
    let mut local_sampler = LocalSampler::of(evaluator, beta, &metric);
    point.ln_likelihood = local_sampler.evaluator.value(&point.z).unwrap();
    let before = [point.z[0], point.z[1]];
    for _ in 0..STEPS {
        step(&mut local_sampler, &mut point, &mut rng);
        assert_eq!(
            point.ln_over_prior.to_bits(),
            reference.ln_over_prior(&point.z).to_bits()
        );
    }
    (before, [point.z[0], point.z[1]])
}

#[test]
fn every_move_leaves_a_path_from_a_mixture_invariant_and_one_without_its_log_ratio_does_not() {
    laws_of_a_path_from_a_mixture(DRAWS / 5);
}

#[test]
#[ignore = "the long form: run before a release with --ignored"]
fn every_move_leaves_a_path_from_a_mixture_invariant_for_more_draws() {
    laws_of_a_path_from_a_mixture(DRAWS);
}

/// So many joint draws per move; all differences are in units of their own errors.
fn laws_of_a_path_from_a_mixture(draws: u64) {
    let reference = clumps();
    let beta = 0.4;
    let metric = correlated_metric();
    let plan = Plan {
        step: 0.8,
        length: 1.5,
        max_leapfrogs: 8,
        max_energy_range: 1000.0,
        slack: 0.0,
    };
    let far = |step: &(dyn Fn(&mut LocalSampler<'_, '_>, &mut Point, &mut RandomStream) + Sync)| {
        let pairs: Vec<_> = (0..draws)
            .into_par_iter()
            .map(|index| moved_from(&reference, beta, index, step))
            .collect();
        farthest_moment(&pairs)
    };
    let inversion = Inversion {
        square: 1.5,
        jacobian: true,
    };
    let orbit = Difference {
        sd: std::f64::consts::SQRT_2,
    };
    let none = DifferencePool::default();
    let trajectory = far(&|e, at, rng| {
        e.transition(at, &plan, rng).unwrap();
    });
    let sliced = far(&|e, at, rng| {
        slice(&mut e.evaluator, beta, &metric, &none, at, rng).unwrap();
    });
    let jumped = far(&|e, at, rng| {
        propose_involution(&mut e.evaluator, &inversion, beta, at, rng).unwrap();
    });
    let redrawn = far(&|e, at, rng| refresh(&e.evaluator, &orbit, beta, at, rng));
    // Five moments each: 4 errors happen once in 3,000 tests.
    for (name, deviation) in [
        ("trajectory", trajectory),
        ("slice", sliced),
        ("propose_involution", jumped),
        ("orbit", redrawn),
    ] {
        assert!(deviation < 4.0, "{name}: {deviation}");
    }
    // At beta = 1 the reference does not matter.
    let without = far(&|e, at, rng| refresh(&e.evaluator, &orbit, 1.0, at, rng));
    // A fixed difference, whose error falls as the root of the draws.
    let expected = 10.0 * (draws as f64 / DRAWS as f64).sqrt();
    assert!(without > expected.max(4.0), "{without} {expected}");
}

#[test]
fn a_reference_draws_its_own_density() {
    // The mean of prior over reference is 1 for draws of the reference; it is at most 20, because a twentieth of the
    // reference is the prior.
    let reference = clumps();
    assert!(reference.components() > 1 && !reference.is_prior());
    let ratios: Vec<f64> = (0..DRAWS)
        .map(|index| {
            let mut z = [0.0; 2];
            reference.draw(&mut z, &mut stream(26, Domain::Test, 0, index));
            (-reference.ln_over_prior(&z)).exp()
        })
        .collect();
    let n = ratios.len() as f64;
    let mean = ratios.iter().sum::<f64>() / n;
    let variance = ratios.iter().map(|r| (r - mean).powi(2)).sum::<f64>() / n;
    assert!(
        (mean - 1.0).abs() < 4.0 * (variance / n).sqrt(),
        "{mean} {variance}"
    );
}
