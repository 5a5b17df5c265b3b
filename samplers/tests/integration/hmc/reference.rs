//! Annealing paths from a mixture.

use super::{
    DRAWS, Difference, Inversion, STEPS, correlated_metric, datum_pair, farthest_moment, plane,
};
use oblate_samplers::difference_pool::DifferencePool;
use oblate_samplers::hmc::{
    Evaluator, LocalSampler, Plan, Point, Reference, Screen, propose_involution, refresh, slice,
};
use oblate_samplers::rng::{Domain, RandomStream, standard_normal, stream, unit_open};
use oblate_samplers::surrogate::{Examples, Surrogate};
use oblate_samplers::target::{Marginal, Outcome, Prior, Target};
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
    let redrawn = far(&|e, at, rng| refresh(&mut e.evaluator, &orbit, beta, at, rng));
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
    let without = far(&|e, at, rng| refresh(&mut e.evaluator, &orbit, 1.0, at, rng));
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

/// `ln L = -(z0 + 1.5)^2 / 0.3`, which the clumps do not have: most of their draws are not kept.
fn surrogate() -> Surrogate {
    let mut rng = stream(27, Domain::Test, 0, 0);
    let mut examples = Examples::default();
    for _ in 0..4_000 {
        let z = [0; 2].map(|_| 1.5 * standard_normal(&mut rng));
        examples.push(&z, -(z[0] + 1.5).powi(2) / 0.3, &[]);
    }
    Surrogate::fit(&examples, None, &mut rng).unwrap()
}

#[test]
fn a_screened_reference_draws_its_own_density() {
    let (plain, surrogate) = (clumps(), surrogate());
    let unit = Marginal::Normal { mean: 0.0, sd: 1.0 };
    let target = Flat(Prior::new(["x", "y"].map(|name| (name, "", unit))).unwrap());
    let ln_ratios = Evaluator::from_reference(&target, &plain).ln_ratios_of_draws(
        &surrogate,
        10_000,
        &mut stream(27, Domain::Test, 1, 0),
    );
    let screen = Screen::new(&surrogate, &ln_ratios);
    let screened = plain.clone().screened(screen);
    let mut evaluator = Evaluator::from_reference(&target, &screened);
    let draws: Vec<([f64; 2], f64)> = (0..4_000)
        .map(|index| {
            let mut z = [0.0; 2];
            evaluator.draw_reference(&mut z, &mut stream(27, Domain::Test, 2, index));
            let ratio = plain.ln_over_prior(&z) - evaluator.ln_over_prior(&z);
            (z, ratio.exp())
        })
        .collect();
    // The mean of plain over screened density is 1 over the integral of the latter, which all draws that it was shown estimate.
    let (ln_integral, variance) = evaluator.screened.ln_integral();
    let n = draws.len() as f64;
    let mean = draws.iter().map(|(_, ratio)| ratio).sum::<f64>() / n;
    let scatter = draws.iter().map(|(_, r)| (r - mean).powi(2)).sum::<f64>() / n;
    let error = (scatter / n / (mean * mean) + variance).sqrt();
    let difference = mean.ln() + ln_integral;
    assert!(
        difference.abs() < 4.0 * error && error < 0.1,
        "{difference} {error}"
    );
    // They lie where the surrogate is large, less than half as far from its maximum as the plain ones; no density is below a quarter of the
    // plain one.
    let mean_x = draws.iter().map(|(z, _)| z[0]).sum::<f64>() / n;
    let plain_x = (0..4_000).map(|index| {
        let mut z = [0.0; 2];
        plain.draw(&mut z, &mut stream(27, Domain::Test, 3, index));
        z[0]
    });
    let plain_x = plain_x.sum::<f64>() / n;
    assert!(
        (mean_x + 1.5).abs() < 0.5 * (plain_x + 1.5).abs(),
        "{mean_x} {plain_x}"
    );
    let largest = draws.iter().map(|(_, ratio)| *ratio).fold(0.0, f64::max);
    assert!(largest < 4.0 * 1.001, "{largest}");
}

#[test]
fn a_screen_of_a_surrogate_that_overflows_keeps_few_draws_everywhere() {
    let surrogate = surrogate();
    assert!(Screen::new(&surrogate, &[f64::NAN, f64::INFINITY]).is_none());
    let screen = Screen::new(&surrogate, &[f64::NAN, 0.0, -1.0, f64::NEG_INFINITY]).unwrap();
    let least = screen.ln_kept(f64::NEG_INFINITY);
    assert!(least.is_finite() && least < 0.0);
    let kept = [f64::NAN, f64::INFINITY].map(|ln_ratio| screen.ln_kept(ln_ratio).to_bits());
    assert_eq!(kept, [least.to_bits(), 0.0_f64.to_bits()]);
}

/// No data.
struct Flat(Prior);

impl Target for Flat {
    fn prior(&self) -> &Prior {
        &self.0
    }
    fn ln_likelihood(&self, _: &[f64]) -> Outcome {
        Outcome::Value(0.0)
    }
}
