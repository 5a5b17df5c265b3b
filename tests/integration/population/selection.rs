//! Selection of streams by q: the fraction that is kept in closed form, and populations that are biased without it.

use super::{UNIFORM, by_quadrature, family, synthetic, weighted};
use oblate::Error;
use oblate::data::Selection;
use oblate::population::{
    Population, PopulationSettings, PopulationTarget, QPosterior, TruncatedGaussian,
    selection_check,
};
use oblate_samplers::control::Silent;
use oblate_samplers::rng::{Domain, standard_normal, stream, unit_open};
use oblate_samplers::{Control, Outcome, Run, Target, nested, pt};

/// Keeps the fraction 0.05 at q = 0.5 and 0.95 at 1.5.
fn linear() -> Selection {
    Selection {
        q: vec![0.5, 1.5],
        kept: vec![0.05, 0.95],
        error: vec![0.0, 0.0],
    }
}

fn with_selection(
    streams: &[QPosterior],
    selection: &Selection,
) -> PopulationTarget<TruncatedGaussian, 2> {
    PopulationTarget::new(family(), streams, PopulationSettings { max_draws: 100_000 })
        .unwrap()
        .with_selection(selection)
        .unwrap()
}

/// The fraction that [`linear`] keeps of a truncated normal population: 0.5 more or less than its mean from 1.
fn exact_fraction(mu: f64, sigma: f64) -> f64 {
    let (a, b) = ((0.5 - mu) / sigma, (1.5 - mu) / sigma);
    let pdf = |x: f64| (-0.5 * x * x).exp() / std::f64::consts::TAU.sqrt();
    let mass =
        0.5 * (libm::erf(b / std::f64::consts::SQRT_2) - libm::erf(a / std::f64::consts::SQRT_2));
    let mean = mu + sigma * (pdf(a) - pdf(b)) / mass;
    0.5 + 0.9 * (mean - 1.0)
}

#[test]
fn the_likelihood_is_divided_by_the_fraction_that_is_kept_with_an_exact_gradient() {
    let streams = synthetic(400);
    let (plain, corrected) = (super::target(&streams), with_selection(&streams, &linear()));
    for alpha in [[1.0, 0.1], [0.6, 0.3], [1.45, 0.9], [0.8, 0.02]] {
        let difference = plain.ln_product(alpha) - corrected.ln_product(alpha);
        let exact = 6.0 * exact_fraction(alpha[0], alpha[1]).ln();
        // Cells of 1/400: the midpoint rule for a linear function times a normal of 8 cells or more.
        assert!(
            (difference - exact).abs() < 1e-4,
            "{alpha:?}: {difference} {exact}"
        );
        let mut gradient = [0.0; 2];
        let value = corrected.ln_likelihood_and_gradient(&alpha, &mut gradient);
        let Outcome::Value(value) = value else {
            panic!("{value:?}");
        };
        assert!((value - corrected.ln_product(alpha)).abs() < 1e-11);
        for k in 0..2 {
            let h = 1e-6 * alpha[1];
            let at = |sign: f64| {
                let mut moved = alpha;
                moved[k] += sign * h;
                corrected.ln_product(moved)
            };
            let central = (at(1.0) - at(-1.0)) / (2.0 * h);
            let tolerance =
                1e-13 * value.abs().max(1.0) / h + 1e-9 * (gradient[k].abs() + 1.0 / alpha[1]);
            assert!(
                (central - gradient[k]).abs() < tolerance,
                "{alpha:?} {k}: {central} {gradient:?}"
            );
        }
    }
    // Where no stream has any weight it stays so.
    let far = with_selection(
        &[QPosterior::equal_weights("narrow", vec![0.7], UNIFORM)],
        &linear(),
    );
    assert!(matches!(
        far.ln_likelihood(&[1.3, 1e-200]),
        Outcome::Reject(_)
    ));
}

#[test]
fn a_common_factor_has_no_influence() {
    let streams = synthetic(100);
    let flat = |fraction: f64| {
        with_selection(
            &streams,
            &Selection {
                kept: vec![fraction; 2],
                ..linear()
            },
        )
    };
    for alpha in [[1.0, 0.1], [0.6, 0.3], [1.2, 0.004]] {
        let plain = super::target(&streams).ln_product(alpha);
        for fraction in [1.0, 0.1] {
            let found = flat(fraction).ln_product(alpha);
            assert!((found - plain + 6.0 * f64::ln(fraction)).abs() < 1e-10);
        }
    }
}

/// The posterior of a stream with a normal likelihood, at the values of q within four errors of it.
fn near(name: &str, (measured, error): (f64, f64)) -> QPosterior {
    let all = weighted(name, (measured, error), 100);
    let rows = all.q.into_iter().zip(all.ln_weight);
    let near = rows.filter(|(q, _)| (q - measured).abs() < 4.0 * error);
    let (q, ln_weight): (Vec<f64>, Vec<f64>) = near.unzip();
    let sum: f64 = ln_weight.iter().map(|w| w.exp()).sum();
    QPosterior {
        q,
        ln_weight: ln_weight.iter().map(|w| w - sum.ln()).collect(),
        name: all.name,
        effective_size: all.effective_size,
        prior: all.prior,
    }
}

/// Streams of a population N(0.9, 0.2) that [`linear`] has kept, measured with errors of 0.03.
fn kept(count: usize, seed: u64) -> Vec<QPosterior> {
    let mut rng = stream(seed, Domain::Test, 7, 0);
    let mut streams = Vec::new();
    while streams.len() < count {
        let q = 0.9 + 0.2 * standard_normal(&mut rng);
        if !(0.5..1.5).contains(&q) || unit_open(&mut rng) > linear().at(q) {
            continue;
        }
        let measured = q + 0.03 * standard_normal(&mut rng);
        streams.push(near(&format!("stream {}", streams.len()), (measured, 0.03)));
    }
    streams
}

#[test]
fn a_population_of_selected_streams_is_biased_and_the_correction_removes_it() {
    let streams = kept(150, 3);
    let (_, mean, sd) = by_quadrature(&super::target(&streams));
    // The kept have a mean of 0.9 + 0.2^2 x 0.9 / 0.41 or so: 0.99.
    assert!(mean[0] - 0.9 > 4.0 * sd[0], "no bias: {mean:?} {sd:?}");
    let corrected = with_selection(&streams, &linear());
    let (ln_z, mean, sd) = by_quadrature(&corrected);
    for (k, truth) in [0.9, 0.2].into_iter().enumerate() {
        assert!(
            (mean[k] - truth).abs() < 3.0 * sd[k],
            "{k}: {mean:?} {sd:?}"
        );
    }
    let check = |run: &Run| {
        let evidence = &run.evidence;
        assert!(
            (evidence.ln_z - ln_z).abs() < 4.0 * evidence.error,
            "{evidence:?} {ln_z}"
        );
        let weights = run.draws.weights();
        for k in 0..2 {
            let column = run.draws.column(k);
            let average: f64 = column.iter().zip(&weights).map(|(x, w)| x * w).sum();
            let error = 4.0 * sd[k] / run.ess.quoted.sqrt();
            assert!((average - mean[k]).abs() < error, "{k}: {average} {mean:?}");
        }
    };
    let settings = nested::Settings {
        n_live: 200,
        ..nested::Settings::default()
    };
    check(&nested::run(&corrected, &settings, 1, &mut Control::new(&mut Silent)).unwrap());
    let settings = pt::Settings {
        rounds: 7,
        ..pt::Settings::default()
    };
    check(&pt::run(&corrected, &settings, 1, &mut Control::new(&mut Silent)).unwrap());
}

#[test]
fn what_is_said_about_the_streams_takes_the_selection_into_account() {
    let alpha = [0.9, 0.2];
    let member = super::one_member(alpha);
    // With one member the factors of the likelihood are what it predicts for each stream.
    let streams = synthetic(100);
    let target = with_selection(&streams, &linear());
    let without = target.leave_one_out(&member);
    let sum: f64 = without.iter().map(|w| w.ln_predictive_density).sum();
    assert!((sum - target.ln_product(alpha)).abs() < 1e-9, "{sum}");
    // Replicated streams are those that are kept: the quantiles of density times fraction.
    let one = with_selection(&streams[..1], &linear());
    let replicated = one.predictive(&member, 3)[0].population.clone();
    let mass = |end: f64| -> f64 {
        let rows = (0..10_000).map(|i| 0.5 + (f64::from(i) + 0.5) / 10_000.0);
        let kept = |q: f64| (-0.5 * ((q - alpha[0]) / alpha[1]).powi(2)).exp() * linear().at(q);
        rows.filter(|q| *q < end).map(kept).sum()
    };
    let below = mass(replicated.median) / mass(1.5);
    // Four standard errors of 2000 draws; without the selection it is 0.33.
    assert!((below - 0.5).abs() < 0.045, "{below}");
}

#[test]
fn errors_of_the_selection_are_checked() {
    let streams = synthetic(100);
    let draws = super::leave_one_out::on_a_grid(&streams);
    let variance = |error: f64, target: &PopulationTarget<TruncatedGaussian, 2>| {
        let selection = Selection {
            error: vec![error; 2],
            ..linear()
        };
        let target = target.clone().with_selection(&selection).unwrap();
        target.selection_variance(&draws).unwrap()
    };
    let target = super::target(&streams);
    assert_eq!(target.selection_variance(&draws), None);
    // Against tables of which one number is off by its error, to either side: the deviation of ln L from its mean, squared and averaged over the
    // same draws. Errors of different numbers are independent, so that these add; second orders of the logarithm are 1e-3.
    let error = 0.01;
    let rows = draws.resample(200, 0.5);
    let alphas: Vec<[f64; 2]> = rows
        .iter()
        .map(|row| draws.theta_row(*row).try_into().unwrap())
        .collect();
    let of = |selection: &Selection| -> Vec<f64> {
        let target = target.clone().with_selection(selection).unwrap();
        let values: Vec<f64> = alphas.iter().map(|a| target.ln_product(*a)).collect();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        values.iter().map(|v| v - mean).collect()
    };
    let truth = of(&linear());
    let mut total = 0.0;
    for row in 0..2 {
        for sign in [-1.0, 1.0] {
            let mut selection = linear();
            selection.kept[row] += sign * error;
            let found = of(&selection);
            let squares = found.iter().zip(&truth).map(|(a, b)| (a - b).powi(2));
            total += 0.5 * squares.sum::<f64>() / alphas.len() as f64;
        }
    }
    let estimate = variance(error, &target);
    assert!((estimate / total - 1.0).abs() < 0.01, "{estimate} {total}");
    assert!(selection_check(estimate).pass && !selection_check(variance(1.0, &target)).pass);
}

#[test]
fn selections_that_are_none_are_refused() {
    let refusal = |selection: Selection| {
        let target = super::target(&synthetic(50));
        target.with_selection(&selection).map(|_| ()).unwrap_err()
    };
    let short = Selection {
        kept: vec![0.5],
        ..linear()
    };
    let falling = Selection {
        q: vec![1.5, 0.5],
        ..linear()
    };
    for (selection, key) in [(short, "selection.kept"), (falling, "selection.q")] {
        assert!(matches!(refusal(selection), Error::Setting { key: found, .. } if found == key));
    }
    let nothing = Selection {
        kept: vec![0.0, 0.5],
        ..linear()
    };
    assert!(matches!(refusal(nothing), Error::OutOfRange(e) if e.key == "selection.kept"));
}
