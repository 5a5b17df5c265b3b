//! The gradient in reverse against the one by duals.

use super::*;

#[test]
fn the_adjoint_equals_the_duals_at_prior_draws_and_every_setting() {
    let noisy = LikelihoodSettings::default();
    let soft = LikelihoodSettings {
        model_noise: false,
        ..noisy
    };
    let hard = LikelihoodSettings {
        edges: BinEdges::Hard,
        ..soft
    };
    let reject = LikelihoodSettings {
        edges: BinEdges::Hard,
        coverage: Coverage::Reject,
        ..soft
    };
    let with = |sampling_scheme, recipe, orbit| {
        let releases = TableSettings {
            particles: 200,
            release_times: 10,
            sampling_scheme,
            recipe,
            seed: 3,
        };
        ModelSettings {
            releases,
            steps: 30,
            steps_per: StepsPer::Particle,
            orbit_steps: 128,
            step_rule: StepRule::Uniform,
            orbit,
            precision: Precision::Double,
            ..ModelSettings::default()
        }
    };
    let adaptive = |settings| ModelSettings {
        step_rule: StepRule::Adaptive,
        steps: 3,
        ..settings
    };
    let per_age = |settings: ModelSettings| ModelSettings {
        steps: 2 * settings.steps,
        steps_per: StepsPer::Age,
        ..settings
    };
    let settings = [
        (small(), soft),
        (small(), noisy),
        (
            with(
                SamplingScheme::Random,
                Recipe::Fardal2015Published,
                OrbitMethod::Accurate,
            ),
            hard,
        ),
        (
            with(
                SamplingScheme::Random,
                Recipe::Chen2025,
                OrbitMethod::Leapfrog,
            ),
            reject,
        ),
        (
            with(
                SamplingScheme::Sobol,
                Recipe::Chen2025,
                OrbitMethod::Accurate,
            ),
            soft,
        ),
        (
            with(
                SamplingScheme::SobolSmeared,
                Recipe::Chen2025,
                OrbitMethod::Accurate,
            ),
            noisy,
        ),
        (adaptive(small()), noisy),
        (per_age(small()), soft),
        (per_age(adaptive(small())), noisy),
        (
            adaptive(with(
                SamplingScheme::Random,
                Recipe::default(),
                OrbitMethod::Leapfrog,
            )),
            soft,
        ),
    ];
    let (mut compared, mut equal, mut chaotic) = (0, 0, 0);
    let mut differences = Vec::new();
    let mut worst = 0.0_f64;
    for (number, (model_settings, likelihood_settings)) in settings.iter().enumerate() {
        let model = model(*model_settings);
        let before = compared;
        for n in 0..25 {
            let (z, theta) = draw(n);
            let Some(likelihood) = likelihood_at(&theta, &model, likelihood_settings) else {
                continue;
            };
            let (Ok((value, fast)), Ok((reference, slow))) = (
                likelihood.gradient(&theta),
                gradient_by_duals(&likelihood, &theta),
            ) else {
                continue;
            };
            let plain = likelihood
                .ln_likelihood(&theta)
                .expect("a value where there is a gradient");
            let tolerance =
                1e-10 * reference.abs().max(1.0) + ROUNDINGS * rounding(&likelihood, &theta);
            for value in [value, plain] {
                let d = (value.ln_likelihood - reference).abs();
                assert!(d < tolerance, "{n}: {value:?} {reference}, {tolerance:e}");
            }
            let fast = in_z(&z, &fast);
            let d = distance(&fast, &in_z(&z, &slow));
            let shaken = shaken(&likelihood, &theta)
                .map(|(_, gradient)| distance(&in_z(&z, &gradient), &fast))
                .fold(0.0, f64::max);
            if shaken > 1e-3 {
                chaotic += 1;
                continue;
            }
            assert!(d < 1e-10 + ROUNDINGS * shaken, "{n}: {d:e}, {shaken:e}");
            worst = worst.max(d / (1e-10 + shaken));
            equal += usize::from(d < 1e-10);
            differences.push(d);
            compared += 1;
        }
        assert!(
            compared >= before + 12,
            "setting {number}: {} of 25",
            compared - before
        );
    }
    differences.sort_by(f64::total_cmp);
    println!(
        "{compared} gradients, {equal} equal to 1e-10: median {:e}; at most {worst:.1} roundings beyond; {chaotic} chaotic",
        differences[compared / 2]
    );
    assert!(equal >= 100, "{equal} of {compared}");
    // Where rounding alone moves the gradient by a thousandth of itself there is nothing to compare.
    assert!(chaotic < compared / 4, "{chaotic} beside {compared}");
}

/// How many times the change that rounding the parameters makes two ways of computing may differ by: each of their steps
/// rounds too.
const ROUNDINGS: f64 = 10.0;

/// The largest difference of two vectors in units of the second's largest number.
fn distance(a: &Theta, b: &Theta) -> f64 {
    let differences = a.iter().zip(b).map(|(a, b)| (a - b).abs());
    differences.fold(0.0, f64::max) / largest(b)
}

#[test]
fn the_truncated_gradient_differs_for_chaotic_particles_only() {
    let model = model(small());
    let (mut same, mut tamed) = (0, 0);
    for n in 0..60 {
        let (z, theta) = draw(n);
        let Some(likelihood) = likelihood_at(&theta, &model, &LikelihoodSettings::default()) else {
            continue;
        };
        let (Ok((a, exact)), Ok((b, smooth))) = (
            likelihood.gradient(&theta),
            likelihood.truncated_gradient(&theta),
        ) else {
            continue;
        };
        assert_eq!(a, b, "the value is the same: {n}");
        let (exact, smooth) = (largest(&in_z(&z, &exact)), largest(&in_z(&z, &smooth)));
        same += usize::from((exact - smooth).abs() <= 1e-12 * exact);
        // The remaining differences come from the progenitor's own orbit through the centre.
        tamed += usize::from(smooth < 1e-1 * exact);
    }
    println!("{same} the same, {tamed} tamed by ten or more");
    assert!(same >= 10 && tamed >= 1, "{same} {tamed}");
}
