//! The likelihood of a track as a function of the 13 parameters: its gradients against each other and against central
//! differences in three coordinate systems, its exact symmetry, its coverage rules.

use oblate::likelihood::{
    Coverage, DataBin, Evaluation, LikelihoodSettings, StreamLikelihood, TrackLikelihood,
};
use oblate::orbit::OrbitMethod;
use oblate::params::{DIM, PriorSettings, QRange, StreamPrior};
use oblate::spray::{Design, Recipe, TableSettings};
use oblate::stream::{Arrivals, Flights, Galaxy, Model, ModelSettings, StepRule, StepsPer};
use oblate::track::{BinEdges, Track};
use oblate_samplers::Prior;
use oblate_samplers::rng::{Domain, standard_normal, stream};
use proptest::prelude::*;
use rayon::prelude::*;

type Theta = [f64; DIM];

/// An orbit and masses like those of gala's first stream, in a nearly spherical halo.
const BASE: Theta = [
    12.1, 16.0, -0.25, -0.4, 1.64, 8.0, 1.5, 59.0, 53.0, -41.0, 156.0, -29.0, 3.0,
];

const Q: QRange = QRange {
    q_min: 0.5,
    q_max: 1.5,
};

fn prior() -> Prior {
    StreamPrior::new(&PriorSettings::default())
        .expect("the default prior")
        .prior()
        .clone()
}

/// The n-th prior draw, z and theta.
fn draw(n: u64) -> (Theta, Theta) {
    let mut rng = stream(20_261_121, Domain::Prior, 0, n);
    let z: Theta = std::array::from_fn(|_| standard_normal(&mut rng));
    let mut theta = [0.0; DIM];
    prior().theta_from_z(&z, &mut theta);
    (z, theta)
}

fn model(settings: ModelSettings) -> Model {
    Model::new(&settings).expect("a model")
}

fn small() -> ModelSettings {
    ModelSettings {
        releases: TableSettings {
            particles: 256,
            ..TableSettings::default()
        },
        steps: 40,
        steps_per: StepsPer::Particle,
        orbit_steps: 256,
        steps_per_turn: 0,
        ..ModelSettings::default()
    }
}

/// A likelihood whose data is the model's own track at `theta`, with radii off by a few per cent.
fn likelihood_at(
    theta: &Theta,
    model: &Model,
    settings: &LikelihoodSettings,
) -> Option<StreamLikelihood> {
    let params = oblate::params::StreamParams::from_array(*theta);
    let setup = model.setup(&Galaxy::from_params(&params, Q)).ok()?;
    let (mut flights, mut out) = (Flights::default(), Arrivals::default());
    model.carry(&setup, &mut flights, &mut out).ok()?;
    let track = Track::of(&out, 10.0, settings.edges, 0.02 * out.len() as f64);
    let data: Vec<DataBin> = track
        .bins
        .iter()
        .enumerate()
        .map(|(i, b)| DataBin {
            bin: b.bin,
            r_kpc: b.r_kpc * (1.0 + 0.03 * (i as f64).sin()),
            r_err_kpc: 0.02 * b.r_kpc,
        })
        .collect();
    if data.len() < 3 {
        return None;
    }
    let track = TrackLikelihood::new(settings, 10.0, &data, out.len()).ok()?;
    Some(StreamLikelihood::new(model.clone(), track, Q))
}

fn largest(g: &[f64]) -> f64 {
    g.iter().fold(0.0, |m, v| m.max(v.abs()))
}

/// Gradients in units of the prior's own scale: what a relative tolerance can be held against.
fn in_z(z: &Theta, gradient: &Theta) -> Theta {
    let mut g = *gradient;
    prior().gradient_to_z(z, &mut g);
    g
}

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
    let with = |design, recipe, orbit| {
        let releases = TableSettings {
            particles: 200,
            epochs: 10,
            design,
            recipe,
            seed: 3,
        };
        ModelSettings {
            releases,
            steps: 30,
            steps_per: StepsPer::Particle,
            orbit_steps: 128,
            steps_per_turn: 0,
            orbit,
            ..ModelSettings::default()
        }
    };
    let dynamical = |settings| ModelSettings {
        step_rule: StepRule::Dynamical,
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
                Design::Random,
                Recipe::Fardal2015Published,
                OrbitMethod::Accurate,
            ),
            hard,
        ),
        (
            with(Design::Random, Recipe::Chen2025, OrbitMethod::Leapfrog),
            reject,
        ),
        (
            with(Design::Sobol, Recipe::Chen2025, OrbitMethod::Accurate),
            soft,
        ),
        (dynamical(small()), noisy),
        (per_age(small()), soft),
        (per_age(dynamical(small())), noisy),
        (
            dynamical(with(
                Design::Random,
                Recipe::default(),
                OrbitMethod::Leapfrog,
            )),
            soft,
        ),
    ];
    let (mut compared, mut equal, mut chaotic) = (0, 0, 0);
    let mut differences = Vec::new();
    let mut worst = 0.0_f64;
    for (model_settings, likelihood_settings) in &settings {
        let model = model(*model_settings);
        for n in 0..25 {
            let (z, theta) = draw(n);
            let Some(likelihood) = likelihood_at(&theta, &model, likelihood_settings) else {
                continue;
            };
            let (Ok((value, fast)), Ok((reference, slow))) = (
                likelihood.gradient(&theta),
                likelihood.gradient_by_duals(&theta),
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

/// Values and gradients where every parameter has moved by a few units in its last place. The flow amplifies that, and all
/// rounding, where particles meet a centre in long steps.
fn shaken(
    likelihood: &StreamLikelihood,
    theta: &Theta,
) -> impl Iterator<Item = (Evaluation, Theta)> {
    let moved = |k: usize| {
        let mut theta = *theta;
        for (i, t) in theta.iter_mut().enumerate() {
            *t *= 1.0 + [-4e-16, 4e-16][(i >> (k % 4)) % 2] * (1.0 + k as f64);
        }
        theta
    };
    (0..6).filter_map(move |k| likelihood.gradient(&moved(k)).ok())
}

#[test]
fn a_value_does_not_allocate_after_the_first() {
    let likelihood = likelihood_at(&BASE, &model(small()), &LikelihoodSettings::default());
    let dynamical = ModelSettings {
        step_rule: StepRule::Dynamical,
        ..small()
    };
    for likelihood in [
        likelihood.expect("a likelihood"),
        likelihood_at(&BASE, &model(dynamical), &LikelihoodSettings::default()).expect("another"),
    ] {
        let value = || likelihood.ln_likelihood(&BASE).expect("a value");
        let first = value();
        let info = allocation_counter::measure(|| assert_eq!(value(), first));
        assert_eq!(info.count_total, 0, "{info:?}");
    }
}

/// What rounding does to ln L at a point: there derivatives are astronomical where it is large, and no comparison proves
/// anything.
fn rounding(likelihood: &StreamLikelihood, theta: &Theta) -> f64 {
    let Ok(here) = likelihood.ln_likelihood(theta) else {
        return f64::NAN;
    };
    shaken(likelihood, theta)
        .map(|(value, _)| (value.ln_likelihood - here.ln_likelihood).abs())
        .fold(0.0, f64::max)
}

#[test]
fn the_smooth_gradient_forgets_chaotic_pasts_and_nothing_else() {
    let model = model(small());
    let (mut same, mut tamed) = (0, 0);
    for n in 0..60 {
        let (z, theta) = draw(n);
        let Some(likelihood) = likelihood_at(&theta, &model, &LikelihoodSettings::default()) else {
            continue;
        };
        let (Ok((a, exact)), Ok((b, smooth))) = (
            likelihood.gradient(&theta),
            likelihood.smooth_gradient(&theta),
        ) else {
            continue;
        };
        assert_eq!(a, b, "the value is the same: {n}");
        let (exact, smooth) = (largest(&in_z(&z, &exact)), largest(&in_z(&z, &smooth)));
        same += usize::from((exact - smooth).abs() <= 1e-12 * exact);
        // What is left where it is still large is the progenitor's own orbit through the centre.
        tamed += usize::from(smooth < 1e-1 * exact);
    }
    println!("{same} the same, {tamed} tamed by ten or more");
    assert!(same >= 10 && tamed >= 1, "{same} {tamed}");
}

/// The central difference of `f` at 0, by Richardson's rule, at the step where it has converged best, and how far it
/// moved between that step and its half.
fn central(f: impl Fn(f64) -> f64, largest_step: f64) -> (f64, f64) {
    let plain = |h: f64| (f(h) - f(-h)) / (2.0 * h);
    let mut best = (f64::NAN, f64::INFINITY);
    let mut last: Option<f64> = None;
    for k in 0..12 {
        let h = largest_step * 0.4_f64.powi(k);
        let d = (4.0 * plain(0.5 * h) - plain(h)) / 3.0;
        if let Some(last) = last
            && (d - last).abs() < best.1
        {
            best = (d, (d - last).abs());
        }
        last = Some(d);
    }
    best
}

#[test]
fn the_gradient_matches_central_differences_in_theta_u_and_z() {
    let model = model(small());
    let settings = LikelihoodSettings::default();
    let prior = prior();
    let check = |n: u64| -> Option<bool> {
        let (z, theta) = draw(n);
        let likelihood = likelihood_at(&theta, &model, &settings)?;
        let (_, by_theta) = likelihood.gradient(&theta).ok()?;
        if rounding(&likelihood, &theta)
            > 1e-9
                * likelihood
                    .ln_likelihood(&theta)
                    .map_or(0.0, |e| e.ln_likelihood.abs().max(1.0))
        {
            return None;
        }
        let value = |theta: &Theta| {
            likelihood
                .ln_likelihood(theta)
                .map_or(f64::NAN, |e| e.ln_likelihood)
        };
        let scale = largest(&in_z(&z, &by_theta));
        let mut converged = 0;
        for i in 0..DIM {
            let marginal = prior.marginals()[i];
            let slope = marginal.dtheta_dz(z[i]);
            let du_dz = oblate_samplers::normal::ln_pdf(z[i]).exp();
            let u = marginal.u_from_theta(theta[i]);
            let at = |value_i: f64| {
                let mut t = theta;
                t[i] = value_i;
                value(&t)
            };
            // One derivative, in three coordinates, all in units of z.
            let h = 1e-3;
            let by_z = by_theta[i] * slope;
            let numeric = [
                central(|d| at(theta[i] + d), h * slope),
                central(|d| at(marginal.theta_from_z(z[i] + d)), h),
                central(|d| at(marginal.theta_from_u(u + d)), h * du_dz),
            ];
            for ((d, moved), unit) in numeric.into_iter().zip([slope, 1.0, du_dz]) {
                // Where particles meet a centre in steps too long for it, ln L is rough below any step: no central
                // difference converges, and there is nothing to compare.
                if moved * unit < 1e-5 * scale {
                    converged += 1;
                    let error = (d * unit - by_z).abs();
                    assert!(
                        error < 1e-6 * scale + 5.0 * moved * unit,
                        "draw {n}, {i}: {by_z} {d}, of {scale}"
                    );
                }
            }
        }
        Some(converged == 3 * DIM)
    };
    let outcomes: Vec<bool> = (100..200_u64).into_par_iter().filter_map(check).collect();
    let (checked, tried) = (outcomes.iter().filter(|c| **c).count(), outcomes.len());
    println!("{checked} of {tried} draws have converged differences in all coordinates");
    assert!(checked >= 50, "{checked} of {tried}");
}

#[test]
fn the_gradient_holds_near_q_min_q_one_and_the_bounds() {
    // Enough steps for the heaviest halo.
    let model = model(ModelSettings {
        steps: 400,
        ..small()
    });
    let settings = LikelihoodSettings::default();
    let prior = prior();
    // A well-behaved stream with one coordinate pushed to its edge at a time.
    let base = BASE;
    let mut cases = vec![base];
    for (i, value) in [
        (0, 11.0 + 1e-7),
        (0, 14.0 - 1e-7),
        (1, 10.0 + 1e-7),
        (1, 25.0 - 1e-7),
        (5, 7.0 + 1e-9),
        (5, 9.0 - 1e-9),
        (6, 1.0 + 1e-7),
        (6, 5.0 - 1e-7),
        (12, 1.0 + 1e-7),
        (12, 4.0 - 1e-7),
        (4, 1e-9),
        (4, 6.0),
    ] {
        let mut theta = base;
        theta[i] = value;
        if (i, value > 13.0) == (0, true) {
            // A heavier halo holds a faster progenitor: without this it would fall through the centre.
            for v in &mut theta[9..12] {
                *v *= 7.0;
            }
            theta[12] = 1.0 + 1e-7;
        }
        cases.push(theta);
    }
    // |dir| -> 0 is q_min; |dir| = 1.538 is q = 1.
    let length = f64::sqrt(0.25 * 0.25 + 0.4 * 0.4 + 1.64 * 1.64);
    for target in [1e-3, 1.538_172_254_455_5, 5.0] {
        let mut theta = base;
        for d in &mut theta[2..5] {
            *d *= target / length;
        }
        cases.push(theta);
    }
    for (n, theta) in cases.iter().enumerate() {
        let likelihood = likelihood_at(theta, &model, &settings).expect("a stream");
        let (_, fast) = likelihood.gradient(theta).expect("a gradient");
        let (_, slow) = likelihood.gradient_by_duals(theta).expect("a gradient");
        let mut z = [0.0; DIM];
        prior.z_from_theta(theta, &mut z);
        let (fast, slow) = (in_z(&z, &fast), in_z(&z, &slow));
        let d = fast
            .iter()
            .zip(&slow)
            .fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()));
        assert!(d < 1e-9 * largest(&slow), "case {n}: {fast:?} {slow:?}");
        for i in 2..5 {
            let value = |d: f64| {
                let mut t = *theta;
                t[i] += d;
                likelihood.ln_likelihood(&t).expect("finite").ln_likelihood
            };
            let (numeric, moved) = central(value, 1e-3);
            let exact = likelihood.gradient(theta).expect("a gradient").1[i];
            let scale = largest(&slow).max(1.0);
            assert!(moved < 1e-5 * scale, "case {n}, dir {i}: {moved}");
            let error = (numeric - exact).abs();
            assert!(
                error < 1e-6 * scale + 5.0 * moved,
                "case {n}, dir {i}: {exact} {numeric}"
            );
        }
    }
}

/// Masses by s, velocities by sqrt(s), age by 1/sqrt(s).
fn scaled(theta: &Theta, s: f64) -> Theta {
    let mut t = *theta;
    for i in [0, 5] {
        t[i] += s.log10();
    }
    for v in &mut t[9..12] {
        *v *= s.sqrt();
    }
    t[12] /= s.sqrt();
    t
}

#[test]
fn the_scaling_symmetry_is_exact_in_value_and_gradient() {
    let model = model(small());
    let mut checked = 0;
    for n in 200..280 {
        let (_, theta) = draw(n);
        let Some(likelihood) = likelihood_at(&theta, &model, &LikelihoodSettings::default()) else {
            continue;
        };
        let value = |t: &Theta| likelihood.ln_likelihood(t).expect("finite").ln_likelihood;
        let here = value(&theta);
        let rounding = rounding(&likelihood, &theta);
        if rounding > 1e-9 * here.abs().max(1.0) {
            continue;
        }
        for s in [1.7, 0.6] {
            let there = value(&scaled(&theta, s));
            let tolerance = 1e-11 * here.abs().max(1.0) + 30.0 * rounding;
            assert!(
                (here - there).abs() < tolerance,
                "{n} {s}: {here} {there} {rounding:e}"
            );
        }
        let (_, g) = likelihood.gradient(&theta).expect("a gradient");
        // The derivative along ln s: 1/ln 10 for the logarithms of mass, v/2 for velocities, -T/2 for the age.
        let terms = [
            g[0] / std::f64::consts::LN_10,
            g[5] / std::f64::consts::LN_10,
            0.5 * theta[9] * g[9],
            0.5 * theta[10] * g[10],
            0.5 * theta[11] * g[11],
            -0.5 * theta[12] * g[12],
        ];
        let along: f64 = terms.iter().sum();
        assert!(
            along.abs() < 1e-9 * largest(&terms),
            "{n}: {along:e} of {terms:?}"
        );
        checked += 1;
    }
    println!("{checked} draws");
    assert!(checked >= 25, "{checked}");
}

#[test]
fn mirrored_streams_have_the_same_track() {
    // z -> -z of everything leaves the projection as it is; so does a rotation about z but for the angle's zero, which
    // is the progenitor's.
    let model = model(small());
    let (_, theta) = draw(3);
    let track = |theta: &Theta| {
        let params = oblate::params::StreamParams::from_array(*theta);
        let setup = model
            .setup(&Galaxy::from_params(&params, Q))
            .expect("a setup");
        let (mut flights, mut out) = (Flights::default(), Arrivals::default());
        model
            .carry(&setup, &mut flights, &mut out)
            .expect("particles");
        out
    };
    let mut mirrored = theta;
    for i in [4, 8, 11] {
        mirrored[i] = -mirrored[i];
    }
    // Out-of-plane kicks follow the angular momentum, a pseudovector: flip them by reversing nothing but z, which the
    // release does by itself because Fardal's kicks along the pole change sign with it only in distribution.
    let (a, b) = (track(&theta), track(&mirrored));
    let mean =
        |t: &Arrivals| t.x.iter().zip(&t.y).map(|(x, y)| x.hypot(*y)).sum::<f64>() / t.len() as f64;
    assert!(
        (mean(&a) / mean(&b) - 1.0).abs() < 0.02,
        "{} {}",
        mean(&a),
        mean(&b)
    );
}

#[test]
fn an_uncovered_track_is_rejected_by_name_or_penalised_smoothly() {
    let model = model(small());
    let theta = BASE;
    let soft = LikelihoodSettings::default();
    let likelihood = likelihood_at(&theta, &model, &soft).expect("a stream");
    let mut data: Vec<DataBin> = likelihood.track().data().copied().collect();
    let last = data[data.len() - 1];
    data.push(DataBin {
        bin: last.bin + 40,
        ..last
    });
    let build = |settings: &LikelihoodSettings| {
        let track = TrackLikelihood::new(settings, 10.0, &data, 256).expect("a likelihood");
        StreamLikelihood::new(model.clone(), track, Q)
    };
    let reject = LikelihoodSettings {
        edges: BinEdges::Hard,
        coverage: Coverage::Reject,
        ..soft
    };
    let cause = build(&reject)
        .ln_likelihood(&theta)
        .expect_err("the last bin is empty");
    assert_eq!(cause, oblate::Rejection::Uncovered);
    let penalised = build(&soft)
        .ln_likelihood(&theta)
        .expect("finite")
        .ln_likelihood;
    let covered = likelihood
        .ln_likelihood(&theta)
        .expect("finite")
        .ln_likelihood;
    // One missing bin of n costs z_miss^2/2 and lambda/n^2.
    let n = data.len() as f64;
    let miss =
        -450.0 - last.r_err_kpc.ln() - oblate_samplers::normal::LN_SQRT_2PI - 1_000.0 / (n * n);
    assert!(
        (penalised - covered - miss).abs() < 1e-6,
        "{penalised} {covered} {miss}"
    );
}

#[test]
fn a_nan_parameter_is_a_counted_rejection() {
    let model = model(small());
    let theta = BASE;
    let likelihood =
        likelihood_at(&theta, &model, &LikelihoodSettings::default()).expect("a stream");
    for i in 0..DIM {
        for bad in [f64::NAN, f64::INFINITY] {
            let mut t = theta;
            t[i] = bad;
            let value = likelihood.ln_likelihood(&t);
            let gradient = likelihood.gradient(&t);
            assert!(
                value.is_err() || (2..5).contains(&i),
                "{i} {bad}: {value:?}"
            );
            assert!(gradient.is_err() || (2..5).contains(&i), "{i} {bad}");
            if let Ok(e) = value {
                assert!(e.ln_likelihood.is_finite());
            }
        }
    }
}

#[test]
fn values_and_gradients_have_the_same_bits_over_many_threads_and_in_batches() {
    let settings = ModelSettings {
        step_rule: StepRule::Dynamical,
        ..small()
    };
    for settings in [small(), settings] {
        let model = model(settings);
        let likelihood =
            likelihood_at(&BASE, &model, &LikelihoodSettings::default()).expect("a track");
        let points: Vec<Theta> = (0..9)
            .map(|i| {
                let mut theta = BASE;
                theta[0] += 0.01 * f64::from(i);
                theta
            })
            .collect();
        let values: Vec<_> = points.iter().map(|t| likelihood.ln_likelihood(t)).collect();
        let gradients: Vec<_> = points.iter().map(|t| likelihood.gradient(t)).collect();
        for threads in [1, 2, 5] {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .expect("threads");
            pool.install(|| {
                assert_eq!(values, likelihood.ln_likelihoods(&points));
                for (theta, (value, gradient)) in points.iter().zip(values.iter().zip(&gradients)) {
                    assert_eq!(*value, likelihood.ln_likelihood_in_parallel(theta));
                    assert_eq!(*gradient, likelihood.gradient_in_parallel(theta));
                }
            });
        }
    }
}

/// A parameter from its extremes or anywhere between.
fn extreme(lo: f64, hi: f64) -> impl Strategy<Value = f64> {
    prop_oneof![Just(lo), Just(hi), lo..hi]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1_000))]

    /// Whatever is asked of it, a stream is finite or a rejection by name, and so are ln L and its gradient.
    #[test]
    fn extremes_give_finite_numbers_or_a_counted_rejection(
        log10_m_halo in extreme(11.0, 14.0),
        r_s_halo_kpc in extreme(1.0, 25.0),
        // Halves to the prior's q of .5 to 1.5: the length of the shape vector.
        length in extreme(1e-9, 8.0),
        (along, across) in (extreme(-1.0, 1.0), extreme(-1.0, 1.0)),
        log10_m_prog in extreme(7.0, 9.0),
        r_s_prog_kpc in extreme(1.0, 5.0),
        (x0, z0) in (extreme(1e-6, 150.0), extreme(1e-6, 150.0)),
        // No velocity at all is a plunge through the centre; one of them alone a radial or a circular start.
        velocity in [extreme(0.0, 250.0), extreme(1e-9, 250.0), extreme(-250.0, 0.0)],
        age_gyr in extreme(1.0, 4.0),
        (particles, epochs) in prop_oneof![Just((8, 4)), Just((2, 1)), Just((64, 32)), Just((128, 8))],
        steps in prop_oneof![Just(1_usize), Just(2), Just(60)],
        step_rule in prop_oneof![Just(StepRule::Uniform), Just(StepRule::Dynamical)],
        steps_per in prop_oneof![Just(StepsPer::Particle), Just(StepsPer::Age)],
        orbit in prop_oneof![Just(OrbitMethod::Accurate), Just(OrbitMethod::Leapfrog)],
    ) {
        let settings = ModelSettings {
            releases: TableSettings { particles, epochs, ..TableSettings::default() },
            steps,
            steps_per,
            step_rule,
            orbit,
            orbit_steps: 64,
            steps_per_turn: 0,
        };
        let bin = |bin| DataBin { bin, r_kpc: 50.0, r_err_kpc: 1.0 };
        let data = [bin(-1), bin(0), bin(1)];
        let track = TrackLikelihood::new(&LikelihoodSettings::default(), 10.0, &data, particles)
            .expect("a track");
        let likelihood = StreamLikelihood::new(model(settings), track, Q);
        let theta = [
            log10_m_halo, r_s_halo_kpc, along * length, across * length, length,
            log10_m_prog, r_s_prog_kpc, x0, z0, velocity[0], velocity[1], velocity[2], age_gyr,
        ];
        match likelihood.ln_likelihood(&theta) {
            Ok(evaluation) => prop_assert!(evaluation.ln_likelihood.is_finite()),
            Err(cause) => prop_assert!(!cause.name().is_empty()),
        }
        match likelihood.gradient(&theta) {
            Ok((evaluation, gradient)) => {
                prop_assert!(evaluation.ln_likelihood.is_finite());
                prop_assert!(gradient.iter().all(|g| g.is_finite()));
            }
            Err(cause) => prop_assert!(!cause.name().is_empty()),
        }
    }
}
