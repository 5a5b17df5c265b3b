//! The core loop with a perfect sampler: one coordinate, the prior volume itself, from which new points are drawn
//! exactly. What is left is the bookkeeping of iterations, ties and weights.

use super::*;
use crate::nested::evidence::DeadPoints;
use crate::nested::kernel::chain::Motion;
use crate::nested::tuning::mean;
use crate::output::Calls;
use crate::rng::unit_open;
use crate::surrogate::Examples;
use crate::target::{Marginal, Outcome, Prior};

struct Volume(Prior);

impl Target for Volume {
    fn prior(&self) -> &Prior {
        &self.0
    }
    fn ln_likelihood(&self, _: &[f64]) -> Outcome {
        Outcome::Fatal("the perfect sampler needs no target".to_owned())
    }
}

fn new_point(x: f64, ln_l: f64) -> NewPoint {
    NewPoint {
        u: vec![x],
        ln_l,
        calls: Calls::default(),
        examples: Examples::default(),
        motion: Motion::default(),
    }
}

/// ln Z of a run with `n_live` points in iterations of the fraction `replaced_fraction`, of a likelihood that falls
/// with the volume; `inside` gives the largest volume whose points exceed a likelihood bound.
fn perfect(
    (n_live, replaced_fraction): (usize, f64),
    ln_l: &dyn Fn(f64) -> f64,
    inside: &dyn Fn(f64) -> f64,
    seed: u64,
) -> (f64, f64) {
    let settings = Settings {
        n_live,
        replaced_fraction,
        ..Settings::default()
    };
    let unit = Marginal::Uniform { lo: 0.0, hi: 1.0 };
    let target = Volume(Prior::new([("x", "", unit)]).unwrap());
    let context = Context {
        target: &target,
        settings: &settings,
        seed,
    };
    let mut rng = stream(seed, Domain::Test, 0, 0);
    let mut state = State::new(&context);
    for lineage in 0..n_live {
        let x = unit_open(&mut rng);
        let lineage = u32::try_from(lineage).unwrap();
        state.live.push(&[x], ln_l(x), f64::NEG_INFINITY, lineage);
    }
    state.started = true;
    while state.delta_ln_z(&settings) >= settings.dlnz {
        let lowest = live::lowest(&state.live, settings.replaced_count());
        let reach = inside(lowest.contour);
        let born: Vec<NewPoint> = lowest
            .dying
            .iter()
            .map(|_| {
                let x = reach * unit_open(&mut rng);
                new_point(x, ln_l(x))
            })
            .collect();
        let genealogy: Vec<Genealogy> = lowest
            .dying
            .iter()
            .map(|&i| state.live.genealogy[i])
            .collect();
        state.commit(&lowest, &born, &genealogy, &mut rng);
    }
    let mut points = state.dead.clone();
    for i in 0..state.live.len() {
        points.push_from(&state.live, i);
    }
    let history = DeadPoints::of(&points);
    (history.weigh().ln_z, state.ranks.z_score(0))
}

fn moments(values: &[f64]) -> (f64, f64) {
    let mean = mean(values);
    let sum: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
    (mean, (sum / (values.len() - 1) as f64).sqrt())
}

#[test]
fn perfect_sampling_has_no_bias_and_the_known_scatter_for_any_replaced_fraction() {
    perfect_sampling(150);
}

#[test]
#[ignore = "the long form: run before a release"]
fn perfect_sampling_has_no_bias_and_the_known_scatter_for_more_runs() {
    perfect_sampling(600);
}

/// Limits are three to four standard errors of the means and deviations of so many runs.
fn perfect_sampling(count: u64) {
    let error = 1.0 / (count as f64).sqrt();
    // A Gaussian of width s in volume: L = exp(-X^2 / 2 s^2), ln Z = ln(s sqrt(pi/2)), H = -ln Z - 1/2.
    let s = 1e-3_f64;
    let ln_z = (s * std::f64::consts::FRAC_PI_2.sqrt()).ln();
    let information = -ln_z - 0.5;
    let n = 200;
    let ln_l = |x: f64| -0.5 * (x / s).powi(2);
    let inside = |l: f64| s * (-2.0 * l).sqrt();
    for (replaced_fraction, widening) in [(1e-9, 1.0), (0.1, 1.0), (0.5, 1.2)] {
        let runs: Vec<(f64, f64)> = (0..count)
            .into_par_iter()
            .map(|seed| perfect((n, replaced_fraction), &ln_l, &inside, seed))
            .collect();
        let errors: Vec<f64> = runs.iter().map(|r| r.0 - ln_z).collect();
        let (bias, sd) = moments(&errors);
        let expected = widening * (information / n as f64).sqrt();
        assert!(
            bias.abs() < 3.0 * sd * error,
            "fraction {replaced_fraction}: bias {bias}, sd {sd}"
        );
        assert!(
            (sd / expected - 1.0).abs() < 3.6 * error,
            "fraction {replaced_fraction}: sd {sd}, not {expected}"
        );
        let ranks: Vec<f64> = runs.iter().map(|r| r.1).collect();
        let (mean, sd) = moments(&ranks);
        assert!(
            mean.abs() < 3.2 * error && (sd - 1.0).abs() < 2.5 * error,
            "fraction {replaced_fraction}: ranks {mean} {sd}"
        );
    }
}

#[test]
fn plateaus_of_a_wedding_cake_have_no_bias() {
    // Tier i fills the volumes from 0.7^(i+1) to 0.7^i: the cake of the integration tests in five dimensions, with
    // ln Z summed over tiers.
    let height = |tier: f64| -0.7_f64.powf(0.4 * tier) / 0.32;
    let ln_l = |x: f64| height((x.ln() / 0.7_f64.ln()).floor());
    let inside = |l: f64| 0.7_f64.powf(((-0.32 * l).ln() / 0.7_f64.ln() / 0.4).round() + 1.0);
    let z: f64 = (0..200)
        .map(|i| 0.3 * 0.7_f64.powi(i) * height(f64::from(i)).exp())
        .sum();
    assert!((z.ln() + 2.098_453).abs() < 1e-6);
    let errors: Vec<f64> = (0..600)
        .into_par_iter()
        .map(|seed| perfect((200, 0.1), &ln_l, &inside, seed).0 - z.ln())
        .collect();
    let (bias, sd) = moments(&errors);
    // The scatter is 0.05: three errors of the mean are 0.006.
    assert!(bias.abs() < 0.006, "bias {bias}, sd {sd}");
}
