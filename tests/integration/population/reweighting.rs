//! The reweighting of streams: q given the population, the error of sums over draws, and its checks.

use super::{UNIFORM, family, one_member, target, weighted};
use oblate::population::{Population, PopulationSettings, PopulationTarget, QPosterior, checks};
use oblate_samplers::Target;
use oblate_samplers::rng::{Domain, standard_normal, stream};

#[test]
fn a_stream_given_the_population_is_measurement_times_population() {
    // A normal measurement and a normal population, both well inside the support: their product is a normal.
    let (measured, error, mu, sigma) = (1.1_f64, 0.06_f64, 0.9_f64, 0.08_f64);
    let target = target(&[weighted("a", (measured, error), 4_000)]);
    let streams = target.streams_given_population(&one_member([mu, sigma]));
    let variance = 1.0 / (1.0 / (error * error) + 1.0 / (sigma * sigma));
    let mean = variance * (measured / (error * error) + mu / (sigma * sigma));
    // Quantiles to a cell of the grid, 1/4000, and rounded normal deviates of 16 and 2.5 %.
    for (found, deviate) in [
        (streams[0].q_given_population.median, 0.0),
        (streams[0].q_given_population.lo68, -0.994_458),
        (streams[0].q_given_population.hi95, 1.959_964),
    ] {
        let exact = mean + deviate * variance.sqrt();
        assert!((found - exact).abs() < 3e-4, "{found} {exact}");
    }
    assert!((streams[0].q.median - measured).abs() < 3e-4);
    assert_eq!(streams[0].name, "a");
}

#[test]
fn the_monte_carlo_variance_is_that_of_repeated_draws() {
    const REPEATS: u64 = 400;
    const DRAWS: u32 = 300;
    let (mut values, mut estimates) = (Vec::new(), 0.0);
    let alpha = [0.85, 0.05];
    for repeat in 0..REPEATS {
        let mut rng = stream(5, Domain::Post, 1, repeat);
        let q = (0..DRAWS).map(|_| 1.0 + 0.1 * standard_normal(&mut rng));
        let posterior = QPosterior::equal_weights("a", q.collect(), UNIFORM);
        let target = target(&[posterior]);
        values.push(target.ln_product(alpha));
        let streams = target.streams_given_population(&one_member(alpha));
        estimates += streams[0].ln_likelihood_variance / REPEATS as f64;
    }
    let n = REPEATS as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
    // A variance of 400 values has a standard error of 7 %: four of these; the second order of the logarithm is of the size of the
    // variance itself, 1 %.
    assert!(variance > 0.005, "{variance}");
    assert!(
        (estimates / variance - 1.0).abs() < 0.3,
        "{estimates} {variance}"
    );
}

#[test]
fn sums_of_few_draws_fail_their_checks_under_the_name_of_the_stream() {
    let draws = one_member([0.8, 0.02]);
    let wide = weighted("many draws", (0.8, 0.1), 4_000);
    let few = QPosterior {
        effective_size: 3.0,
        ..weighted("few draws", (0.95, 0.05), 4_000)
    };
    let all = |streams: &[QPosterior]| checks(&target(streams).streams_given_population(&draws));
    assert!(
        all(std::slice::from_ref(&wide))
            .iter()
            .all(|check| check.pass)
    );
    let copies_of_one = QPosterior {
        effective_size: 1.0,
        ..QPosterior::equal_weights("copies", vec![0.8; 400], UNIFORM)
    };
    for (stream, words) in [
        (few, "few draws has most of it"),
        (copies_of_one, "copies has most of it"),
    ] {
        let found = all(&[wide.clone(), stream]);
        let variance = &found[0];
        assert!(variance.name == "reweighting-variance" && !variance.pass);
        assert!(variance.message.contains(words), "{variance:?}");
    }
    // Draws that barely reach the population: a heavy tail.
    let q: Vec<f64> = (0..1_000).map(|i| 0.55 + 0.0005 * f64::from(i)).collect();
    let ln_l: Vec<f64> = q.iter().map(|q| -25.0 * (q - 0.55)).collect();
    let sum: f64 = ln_l.iter().map(|l| l.exp()).sum();
    let tail = QPosterior {
        ln_weight: ln_l.iter().map(|l| l - sum.ln()).collect(),
        ..QPosterior::equal_weights("far", q, UNIFORM)
    }
    .thinned(500);
    let streams = target(&[tail]).streams_given_population(&one_member([0.9, 0.01]));
    let found = checks(&streams);
    assert!(
        found[1].name == "reweighting-pareto-k" && !found[1].pass,
        "{streams:?}"
    );
    assert!(found[1].message.contains("that of far"));
}

#[test]
fn thinned_draws_are_worth_no_more_than_their_number() {
    let wide = weighted("wide", (0.8, 0.1), 4_000);
    let size = |posterior: &QPosterior, count| posterior.thinned(count).effective_size;
    let is = |found: f64, expected: f64| (found - expected).abs() < 1e-9;
    assert!(is(size(&wide, 1), 1.0) && is(size(&wide, 20), 20.0));
    assert!(is(size(&wide, 10_000), wide.effective_size));
    let few = QPosterior {
        effective_size: 3.0,
        ..wide.clone()
    };
    assert!(is(size(&few, 20), 3.0));
    let variance = |max_draws| {
        let settings = PopulationSettings { max_draws };
        let streams = std::slice::from_ref(&wide);
        let target = PopulationTarget::new(family(), streams, settings).unwrap();
        let streams = target.streams_given_population(&one_member([0.8, 0.02]));
        checks(&streams).swap_remove(0)
    };
    let [all, some, one] = [4_000, 20, 1].map(variance);
    assert!(
        all.pass && some.value > 50.0 * all.value,
        "{all:?} {some:?}"
    );
    assert!(!one.pass, "{one:?}");
}

#[test]
fn effective_draws_fall_from_all_to_few_as_the_population_narrows() {
    let q: Vec<f64> = (0..1_000).map(|i| 0.5005 + 0.001 * f64::from(i)).collect();
    let target = target(&[QPosterior::equal_weights("flat", q, UNIFORM)]);
    assert!((target.effective_draws([1.0, 1e4])[0] - 1_000.0).abs() < 1e-3);
    // On a grid of spacing h a normal of width sigma has 2 sqrt(pi) sigma / h effective draws.
    let expected = 2.0 * std::f64::consts::PI.sqrt() * 0.02 / 0.001;
    assert!((target.effective_draws([1.0, 0.02])[0] - expected).abs() < 1e-6 * expected);
    let mut derived = Vec::new();
    target.derived(&[1.0, 0.02], &mut derived);
    assert!((derived[0] - expected).abs() < 1e-6 * expected);
    assert_eq!(derived.len(), target.derived_names().len());
}
