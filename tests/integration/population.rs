//! The hierarchy against exact answers: densities to all digits, posteriors by quadrature, both samplers.

mod joint;
mod leave_one_out;
mod predictive;
mod selection;

use crate::golden::{cases, json, number};
use oblate::Error;
use oblate::params::QPrior;
use oblate::population::{
    Family, Population, PopulationDensity, PopulationSettings, PopulationTarget, QPosterior,
    TruncatedGaussian, TruncatedGaussianSettings, checks, gauss_legendre,
};
use oblate::posterior::{PopulationSummary, equal_to_prior, marginal_information};
use oblate::scalar::{gradient_of, lift};
use oblate_samplers::control::Silent;
use oblate_samplers::output::Draws;
use oblate_samplers::rng::{Domain, standard_normal, stream};
use oblate_samplers::{Control, Marginal, Outcome, Prior, Run, Target, nested, pt};

const UNIFORM: QPrior = QPrior::Uniform { lo: 0.5, hi: 1.5 };

fn family() -> TruncatedGaussian {
    TruncatedGaussian::new(TruncatedGaussianSettings::default()).unwrap()
}

fn target(streams: &[QPosterior]) -> PopulationTarget<TruncatedGaussian, 2> {
    PopulationTarget::new(family(), streams, PopulationSettings { max_draws: 100_000 }).unwrap()
}

/// Streams whose likelihoods of q are normals: (measured q, its error).
const MEASURED: [(f64, f64); 6] = [
    (0.82, 0.05),
    (1.10, 0.12),
    (0.97, 0.08),
    (1.31, 0.20),
    (0.60, 0.15),
    (1.02, 0.04),
];

/// The posterior of one such stream under the uniform prior, as weighted draws on a regular grid of q.
fn weighted(name: &str, (measured, error): (f64, f64), count: u32) -> QPosterior {
    let q: Vec<f64> = (0..count)
        .map(|i| 0.5 + (f64::from(i) + 0.5) / f64::from(count))
        .collect();
    let ln_l: Vec<f64> = q
        .iter()
        .map(|q| -0.5 * ((q - measured) / error).powi(2))
        .collect();
    let sum: f64 = ln_l.iter().map(|l| l.exp()).sum();
    QPosterior {
        name: name.to_owned(),
        ln_weight: ln_l.iter().map(|l| l - sum.ln()).collect(),
        q,
        effective_size: f64::from(count),
        prior: UNIFORM,
    }
}

fn synthetic(count: u32) -> Vec<QPosterior> {
    MEASURED
        .iter()
        .enumerate()
        .map(|(i, m)| weighted(&format!("stream {i}"), *m, count))
        .collect()
}

/// `sum_n ln [ integral L_n(q) pi(q | alpha) dq / integral L_n(q) pi(q) dq ]` in closed form: the product of two normals is a
/// normal, and all integrals are over [0.5, 1.5]. Written with differences of the error function, independently of the library.
fn exact_ln_product(mu: f64, sigma: f64) -> f64 {
    let mass = |m: f64, s: f64| {
        let z = |x: f64| (x - m) / (s * std::f64::consts::SQRT_2);
        0.5 * (libm::erf(z(1.5)) - libm::erf(z(0.5)))
    };
    MEASURED
        .iter()
        .map(|&(d, e)| {
            let variance = e * e + sigma * sigma;
            let narrow = e * sigma / variance.sqrt();
            let centre = (d * sigma * sigma + mu * e * e) / variance;
            let ln_normal = -0.5 * (d - mu).powi(2) / variance - 0.5 * variance.ln();
            // The error of the likelihood's own normalisation, e, appears in the evidence under the uniform prior.
            ln_normal + mass(centre, narrow).ln()
                - mass(mu, sigma).ln()
                - (mass(d, e)).ln()
                - 0.5 * std::f64::consts::TAU.ln()
        })
        .sum()
}

#[test]
fn truncated_normal_meets_the_golden_values_with_gradient() {
    for case in cases(&json("truncated_normal.json")) {
        let field = |name: &str| number(&case[name]);
        let (lo, hi, mu, sigma, q) = (
            field("lo"),
            field("hi"),
            field("mu"),
            field("sigma"),
            field("q"),
        );
        let family = TruncatedGaussian::new(TruncatedGaussianSettings {
            q_min: lo,
            q_max: hi,
            ..TruncatedGaussianSettings::default()
        })
        .unwrap();
        let ours = family.ln_pdf(lift(&[mu, sigma]))(q);
        let ours_f64 = family.ln_pdf([mu, sigma])(q);
        // Distance in sigmas that is squared, from mu or from the nearest bound, and from mu to that bound; each is
        // a difference of numbers with a rounding of 1e-16, divided by sigma.
        let origin = mu.clamp(lo, hi);
        let (t, c) = ((q - origin).abs() / sigma, (mu - origin).abs() / sigma);
        let grain = 2e-16 * lo.abs().max(hi.abs()).max(mu.abs()) / sigma;
        let terms = 1.0 + t * (0.5 * t + c) + sigma.ln().abs() + c.max(1.0).ln();
        let tolerance = 1e-15 * terms + 4.0 * grain * (t + c + 1.0);
        let value = field("ln_pdf");
        assert!(
            (ours.re - value).abs() < tolerance,
            "{case}: {} {tolerance}",
            ours.re
        );
        assert!((ours_f64 - value).abs() < tolerance, "{case}: {ours_f64}");
        let [d_mu, d_sigma] = gradient_of(&ours);
        let slope = 1e-14 * (t + c + 1.0) / sigma + 10.0 * grain / sigma;
        assert!(
            (d_mu - field("d_mu")).abs() < slope,
            "{case}: {d_mu} {slope}"
        );
        let slope = 1e-14 * (1.0 + t * (t + c) + c) / sigma + 10.0 * grain * (1.0 + t + c) / sigma;
        assert!(
            (d_sigma - field("d_sigma")).abs() < slope,
            "{case}: {d_sigma} {slope}"
        );
    }
}

#[test]
fn gradient_of_the_target_matches_central_differences() {
    let target = target(&synthetic(400));
    for alpha in [
        [1.0, 0.1],
        [0.51, 0.3],
        [1.49, 0.9],
        [0.8, 0.02],
        [1.2, 0.004],
    ] {
        let mut gradient = [0.0; 2];
        let value = target.ln_likelihood_and_gradient(&alpha, &mut gradient);
        let Outcome::Value(value) = value else {
            panic!("{alpha:?}: {value:?}");
        };
        // A quotient of duals is rounded once more than one of numbers: the arguments differ in their last digit.
        let plain = target.ln_product(alpha);
        assert!(
            (value - plain).abs() < 1e-13 * (1.0 + plain.abs()),
            "{value} {plain}"
        );
        for i in 0..2 {
            let h = 1e-6 * alpha[1];
            let at = |sign: f64| {
                let mut moved = alpha;
                moved[i] += sign * h;
                target.ln_product(moved)
            };
            let central = (at(1.0) - at(-1.0)) / (2.0 * h);
            // Rounding of ln L over the step; truncation h^2 / 6 times a third derivative of order |g| / sigma^2.
            let tolerance = 1e-14 * target.ln_product(alpha).abs().max(1.0) / h
                + 1e-10 * (gradient[i].abs() + 1.0 / alpha[1]);
            assert!(
                (central - gradient[i]).abs() < tolerance,
                "{alpha:?} {i}: {central} {gradient:?}"
            );
        }
    }
}

#[test]
fn the_sum_over_draws_is_the_integral() {
    // Draws on a grid of spacing 1/4000: the midpoint rule, whose error for a smooth integrand narrower than the
    // range is dominated by its slope at the ends, h^2 / 24 times slope over integral.
    let target = target(&synthetic(4_000));
    for mu in [0.5, 0.7, 1.0, 1.25, 1.5] {
        for sigma in [0.02, 0.05, 0.2, 0.6, 1.0] {
            let (ours, exact) = (target.ln_product([mu, sigma]), exact_ln_product(mu, sigma));
            assert!((ours - exact).abs() < 1e-4, "{mu} {sigma}: {ours} {exact}");
        }
    }
}

#[test]
fn weighted_equal_weight_and_thinned_draws_agree() {
    let weighted = synthetic(4_000);
    let equal: Vec<QPosterior> = weighted
        .iter()
        .map(|stream| {
            let thinned = stream.thinned(2_000);
            assert_eq!(thinned.q.len(), 2_000);
            QPosterior::equal_weights(&stream.name, thinned.q, UNIFORM)
        })
        .collect();
    let (a, b) = (target(&weighted), target(&equal));
    let settings = PopulationSettings { max_draws: 2_000 };
    let c = PopulationTarget::new(family(), &weighted, settings).unwrap();
    for alpha in [[1.0_f64, 0.1], [0.6, 0.3], [1.4, 0.8], [1.0, 0.04]] {
        // Quantiles of cells of probability 1/2000: six sums, each with an error of order 1/2000 at most.
        let difference = (a.ln_product(alpha) - b.ln_product(alpha)).abs();
        assert!(difference < 6.0 / 2_000.0, "{alpha:?}: {difference}");
        let (b, c) = (b.ln_product(alpha), c.ln_product(alpha));
        assert!((b - c).abs() < 1e-12, "{b} {c}");
    }
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

#[test]
fn a_population_without_overlap_is_rejected_by_cause_and_never_a_nan() {
    let target = target(&[QPosterior::equal_weights("narrow", vec![0.7], UNIFORM)]);
    // So narrow that the squared distance overflows.
    assert_eq!(
        target.ln_likelihood(&[1.3, 1e-200]),
        Outcome::Reject("no overlap with a stream")
    );
    assert_eq!(
        target.ln_likelihood_and_gradient(&[1.3, 1e-200], &mut [0.0; 2]),
        Outcome::Reject("no overlap with a stream")
    );
    assert!(matches!(
        target.ln_likelihood(&[1.3, -0.1]),
        Outcome::Reject(_)
    ));
    assert!(matches!(
        target.ln_likelihood(&[f64::NAN, 0.1]),
        Outcome::Reject(_)
    ));
    // Far but not infinitely far: finite.
    assert!(matches!(target.ln_likelihood(&[1.3, 1e-100]), Outcome::Value(l) if l.is_finite()));
}

#[test]
fn draws_outside_the_support_of_a_narrower_family_count_as_zero() {
    let settings = TruncatedGaussianSettings {
        q_min: 0.8,
        q_max: 1.2,
        ..TruncatedGaussianSettings::default()
    };
    let narrow = |q: Vec<f64>| {
        let family = TruncatedGaussian::new(settings).unwrap();
        let stream = QPosterior::equal_weights("a", q, UNIFORM);
        PopulationTarget::new(family, &[stream], PopulationSettings::default())
    };
    // Half of the draws are lost, and their weight with them.
    let all = narrow(vec![0.9, 1.1]).unwrap().ln_product([1.0, 0.1]);
    let half = narrow(vec![0.9, 1.1, 0.6, 1.4])
        .unwrap()
        .ln_product([1.0, 0.1]);
    assert!((all - half - std::f64::consts::LN_2).abs() < 1e-14);
    let error = narrow(vec![0.6, 1.4]).unwrap_err().to_string();
    assert!(
        error.contains("a: no draw of q lies in [0.8, 1.2]"),
        "{error}"
    );
}

#[test]
fn what_cannot_be_combined_is_refused_with_its_name_and_a_remedy() {
    let stream = || QPosterior::equal_weights("NGC 1", vec![0.9, 1.1], UNIFORM);
    let refusal = |streams: &[QPosterior]| {
        let error = PopulationTarget::new(family(), streams, PopulationSettings::default())
            .map(|_| ())
            .unwrap_err();
        assert!(matches!(error, Error::Posterior { .. }), "{error}");
        error.to_string()
    };
    let none = PopulationTarget::new(family(), &[], PopulationSettings::default()).map(|_| ());
    assert!(matches!(none, Err(Error::TooFewRuns { given: 0, min: 1 })));
    let unknown = QPosterior {
        prior: QPrior::Unknown,
        ..stream()
    };
    let message = refusal(&[stream(), unknown]);
    assert!(
        message.starts_with("NGC 1: the prior of q in this fit is not known"),
        "{message}"
    );
    let narrow = QPosterior {
        prior: QPrior::Uniform { lo: 0.6, hi: 1.5 },
        ..stream()
    };
    assert!(refusal(&[narrow]).contains("uniform on [0.6, 1.5], does not cover"));
    let empty = QPosterior {
        q: vec![],
        ln_weight: vec![],
        ..stream()
    };
    assert!(refusal(&[empty]).contains("no draws"));
    let outside = QPosterior::equal_weights("NGC 1", vec![0.9, 1.6], UNIFORM);
    assert!(refusal(&[outside]).contains("q = 1.6 is outside the fit's own prior"));
    let unnormalised = QPosterior {
        ln_weight: vec![0.0, 0.0],
        ..stream()
    };
    assert!(refusal(&[unnormalised]).contains("add up to 2"));
    let ragged = QPosterior {
        ln_weight: vec![0.0],
        ..stream()
    };
    assert!(refusal(&[ragged]).contains("2 draws of q, but 1 weights"));
    let error = PopulationTarget::new(family(), &[stream()], PopulationSettings { max_draws: 0 })
        .map(|_| ())
        .unwrap_err();
    assert!(matches!(error, Error::OutOfRange(ref e) if e.key == "reweighting.max_draws"));
}

#[test]
fn bands_of_the_population_density_are_quantiles_over_the_draws() {
    let family = family();
    // 101 equal draws of mu at fixed sigma: at q = 1 the density falls with |mu - 1|, so its quantiles are known.
    let mu: Vec<f64> = (0..=100).map(|i| 1.0 + 0.002 * f64::from(i)).collect();
    let draws = Draws {
        dim: 2,
        theta: mu.iter().flat_map(|m| [*m, 0.1]).collect(),
        ln_likelihood: vec![0.0; 101],
        ln_weight: vec![-(101.0_f64).ln(); 101],
        chain: vec![0; 101],
        cluster: vec![0; 101],
        ..Draws::default()
    };
    let density = PopulationDensity::new(&family, &draws, 201).unwrap();
    let at = |mu: f64| family.ln_pdf([mu, 0.1])(1.0).exp();
    assert!((density.q[100] - 1.0).abs() < 1e-12);
    // 2000 rows of 101 draws: quantiles to half a draw, which moves mu by 0.002 and the density by 2 % at most.
    for (ours, p) in [
        (density.median[100], 0.5),
        (density.lo68[100], 0.84),
        (density.hi68[100], 0.16),
        (density.lo95[100], 0.975),
        (density.hi95[100], 0.025),
    ] {
        let exact = at(1.0 + 0.2 * p);
        assert!((ours / exact - 1.0).abs() < 0.03, "{p}: {ours} {exact}");
    }
    let integral: f64 = density.mean.iter().sum::<f64>() / 200.0;
    assert!((integral - 1.0).abs() < 1e-3, "{integral}");
    assert!(PopulationDensity::new(&family, &Draws::default(), 201).is_err());
    assert!(PopulationDensity::new(&family, &draws, 1).is_err());
}

/// ln Z, means and standard deviations of (mu, sigma) by the midpoint rule over the hyperprior.
fn by_quadrature(target: &PopulationTarget<TruncatedGaussian, 2>) -> (f64, [f64; 2], [f64; 2]) {
    const CELLS: u32 = 300;
    let centre = |i: u32| (f64::from(i) + 0.5) / f64::from(CELLS);
    let (mut z, mut mean, mut square) = (0.0, [0.0; 2], [0.0; 2]);
    for i in 0..CELLS {
        for j in 0..CELLS {
            let alpha = [0.5 + centre(i), centre(j)];
            let l = target.ln_product(alpha).exp();
            z += l;
            for k in 0..2 {
                mean[k] += l * alpha[k];
                square[k] += l * alpha[k] * alpha[k];
            }
        }
    }
    let mean = mean.map(|m| m / z);
    let sd = std::array::from_fn(|k| (square[k] / z - mean[k] * mean[k]).sqrt());
    ((z / f64::from(CELLS * CELLS)).ln(), mean, sd)
}

#[test]
fn both_samplers_recover_the_hyperposterior_of_quadrature() {
    let target = target(&synthetic(150));
    let (ln_z, mean, sd) = by_quadrature(&target);
    let seed = 11;
    let nested = nested::run(
        &target,
        &nested::Settings {
            n_live: 400,
            ..nested::Settings::default()
        },
        seed,
        &mut Control::new(&mut Silent),
    )
    .unwrap();
    let pt = pt::run(
        &target,
        &pt::Settings {
            rounds: 8,
            ..pt::Settings::default()
        },
        seed,
        &mut Control::new(&mut Silent),
    )
    .unwrap();
    let check = |run: &Run| {
        assert_eq!(run.names, ["mu_pop", "sigma_pop"]);
        let evidence = &run.evidence;
        assert!(
            evidence.error > 0.0 && evidence.error < 0.2,
            "{}",
            evidence.error
        );
        assert!(
            (evidence.ln_z - ln_z).abs() < 3.0 * evidence.error,
            "{:?}: {} +- {}, exact {ln_z}",
            run.method,
            evidence.ln_z,
            evidence.error
        );
        assert!(run.ess.quoted > 200.0, "{}", run.ess.quoted);
        let weights = run.draws.weights();
        for k in 0..2 {
            let average: f64 = run
                .draws
                .column(k)
                .iter()
                .zip(&weights)
                .map(|(x, w)| x * w)
                .sum();
            // Four standard errors of a mean over the quoted number of effective draws.
            let error = 4.0 * sd[k] / run.ess.quoted.sqrt();
            assert!(
                (average - mean[k]).abs() < error,
                "{:?} {k}: {average}, exact {} +- {error}",
                run.method,
                mean[k]
            );
        }
        // The probability that this many independent draws lie outside their hyperprior is negligible.
        assert!(run.draws.column(1).iter().all(|s| *s > 0.0 && *s < 1.0));
    };
    check(&nested);
    check(&pt);
    let combined = nested.evidence.error.hypot(pt.evidence.error);
    assert!((nested.evidence.ln_z - pt.evidence.ln_z).abs() < 3.0 * combined);
}

/// Draws of the hyperparameters that are all the same.
fn one_member(alpha: [f64; 2]) -> Draws {
    Draws {
        dim: 2,
        theta: alpha.to_vec(),
        ln_likelihood: vec![0.0],
        ln_weight: vec![0.0],
        chain: vec![0],
        cluster: vec![0],
        ..Draws::default()
    }
}

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
    let found = all(&[wide, few]);
    let variance = &found[0];
    assert!(variance.name == "reweighting-variance" && !variance.pass);
    assert!(
        variance.message.contains("few draws has most of it"),
        "{variance:?}"
    );
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
fn a_posterior_that_is_its_prior_is_named() {
    let unit = Marginal::Uniform { lo: 0.0, hi: 1.0 };
    let prior = Prior::new([("filled", "", unit), ("measured", "", unit)]).unwrap();
    let mut run = crate::runs::nested(400, 3);
    let count: u32 = 2_000;
    let theta = (0..count).flat_map(|i| {
        let u = (f64::from(i) + 0.5) / f64::from(count);
        [u, 0.3 + 0.4 * u]
    });
    run.draws = Draws {
        dim: 2,
        theta: theta.collect(),
        ln_likelihood: vec![0.0; 2_000],
        ln_weight: vec![-f64::from(count).ln(); 2_000],
        chain: vec![0; 2_000],
        cluster: vec![0; 2_000],
        ..Draws::default()
    };
    run.ess.quoted = f64::from(count);
    let population = PopulationSummary {
        streams: Vec::new(),
        information: marginal_information(&run, &prior),
        ..PopulationSummary::default()
    };
    assert_eq!(equal_to_prior(&population.information), ["filled"]);
    // Uniform on 40 % of the prior: ln 2.5 nats, less the bias of 19 / 4000.
    let information = population.information[1].1;
    assert!(
        (information - 2.5_f64.ln() + 19.0 / 4_000.0).abs() < 1e-9,
        "{information}"
    );
    let verdict = population.verdict().unwrap();
    assert!(
        verdict.starts_with("NOT MEASURED: the posterior of filled equals its prior"),
        "{verdict}"
    );
    assert!(!population.measures_nothing());
}

#[test]
fn hyperpriors_are_settings() {
    let settings = TruncatedGaussianSettings {
        mu_pop: Marginal::Normal { mean: 1.0, sd: 0.2 },
        sigma_pop: Marginal::HalfNormal { sd: 0.3 },
        ..TruncatedGaussianSettings::default()
    };
    let text = serde_json::to_string(&settings).unwrap();
    assert_eq!(
        serde_json::from_str::<TruncatedGaussianSettings>(&text).unwrap(),
        settings
    );
    assert!(serde_json::from_str::<TruncatedGaussianSettings>(r#"{"sigma": 1.0}"#).is_err());
    let target = PopulationTarget::new(
        TruncatedGaussian::new(settings).unwrap(),
        &synthetic(50),
        PopulationSettings::default(),
    )
    .unwrap();
    assert_eq!(
        target.prior().marginals(),
        [settings.mu_pop, settings.sigma_pop]
    );
    assert_eq!(target.streams(), 6);
}

#[test]
fn the_rule_integrates_polynomials_exactly() {
    let rule = gauss_legendre::<48>();
    for power in [0, 1, 2, 17, 60, 95] {
        let sum: f64 = rule.iter().map(|(x, w)| w * x.powi(power)).sum();
        let exact = 1.0 / f64::from(power + 1);
        assert!((sum / exact - 1.0).abs() < 4e-14, "{power}: {sum}");
    }
}

#[test]
fn every_member_is_normalised_on_the_support() {
    let family = family();
    for (mu, sigma) in [
        (1.0_f64, 0.1),
        (0.5, 0.3),
        (1.5, 1.0),
        (2.5, 0.2),
        (0.3, 0.05),
        (9.0, 40.0),
    ] {
        let ln_pdf = family.ln_pdf([mu, sigma]);
        // Midpoints: error of order h^2 times the second derivative's integral, at most the slope at the ends.
        let n = 200_000;
        let h = 1.0 / f64::from(n);
        let sum: f64 = (0..n)
            .map(|i| h * ln_pdf(0.5 + h * (f64::from(i) + 0.5)).exp())
            .sum();
        assert!((sum - 1.0).abs() < 1e-6, "{mu} {sigma}: {sum}");
    }
}

#[test]
fn value_and_gradient_are_continuous_where_the_mean_crosses_a_bound() {
    let family = family();
    for bound in [0.5, 1.5] {
        let at = |mu: f64| family.ln_pdf(lift(&[mu, 0.2]))(0.9);
        let (inside, outside) = (at(bound - 1e-12), at(bound + 1e-12));
        assert!((inside.re - outside.re).abs() < 1e-10);
        for (a, b) in gradient_of(&inside).iter().zip(gradient_of(&outside)) {
            assert!((a - b).abs() < 1e-9, "{a} {b}");
        }
    }
}

#[test]
fn impossible_hyperpriors_are_refused_with_their_key() {
    let default = TruncatedGaussianSettings::default();
    let uniform = |lo, hi| Marginal::Uniform { lo, hi };
    for (settings, key) in [
        (
            TruncatedGaussianSettings {
                q_min: 1.5,
                ..default
            },
            "family.q_min",
        ),
        (
            TruncatedGaussianSettings {
                mu_pop: uniform(1.0, 0.0),
                ..default
            },
            "family.mu_pop",
        ),
        (
            TruncatedGaussianSettings {
                sigma_pop: uniform(-1.0, 1.0),
                ..default
            },
            "family.sigma_pop.lo",
        ),
    ] {
        match TruncatedGaussian::new(settings).unwrap_err() {
            Error::Setting { key: found, .. } => assert_eq!(found, key),
            Error::OutOfRange(wrong) => assert_eq!(wrong.key, key),
            other => panic!("{other}"),
        }
    }
}
