//! The hierarchy against exact answers: densities to all digits, posteriors by quadrature, both samplers.

mod closed_forms;
mod joint;
mod leave_one_out;
mod predictive;
mod reweighting;
mod selection;
mod truncated_gaussian;

use closed_forms::with_normal;
use oblate::Error;
use oblate::params::QPrior;
use oblate::population::{
    Family, PopulationDensity, PopulationSettings, PopulationTarget, QPosterior, TruncatedGaussian,
    TruncatedGaussianSettings,
};
use oblate::posterior::{PopulationSummary, equal_to_prior, marginal_information};
use oblate_samplers::control::Silent;
use oblate_samplers::output::Draws;
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
            let (ours, exact) = (
                target.ln_product([mu, sigma]),
                closed_forms::ln_product(|datum| with_normal(datum, mu, sigma)),
            );
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
