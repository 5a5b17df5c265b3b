//! The likelihood of a track as a function of the 13 parameters: its coverage rules, its threads, its extremes; and its
//! gradients.

mod adjoint;
mod correlation;
mod gradient;
mod measurement;
mod observation;
mod precision;
mod symmetry;

use oblate::error::Rejection;
use oblate::likelihood::{
    Coverage, DataBin, ErrorCorrelation, Evaluation, LikelihoodSettings, Observation,
    StreamLikelihood, TrackLikelihood,
};
use oblate::orbit::OrbitMethod;
use oblate::params::{
    DIM, NAMES, PriorSettings, QRange, REQUIRED, StreamParams, StreamPrior, index_of,
    without_optional,
};
use oblate::potential::{DiscProfile, HaloKind, Nfw};
use oblate::scalar::{Dual, gradient_of, lift};
use oblate::spray::{Recipe, SamplingScheme, TableSettings};
use oblate::stream::{
    BaryonSettings, BulgeProfile, DiscPlane, DiscSettings, MassLoss, Model, ModelSettings,
    Particles, Precision, ReleaseRate, StepRule, StepSchedules, StepsPer, System,
};
use oblate::track::{BinEdges, Sums, Track};
use oblate_samplers::Prior;
use oblate_samplers::rng::{Domain, standard_normal, stream};
use proptest::prelude::*;
use rayon::prelude::*;

type Theta = [f64; DIM];

/// An orbit and masses like those of gala's first stream, in a nearly spherical halo.
const BASE: Theta = without_optional([
    12.1, 16.0, -0.25, -0.4, 1.64, 8.0, 1.5, 59.0, 53.0, -41.0, 156.0, -29.0, 3.0,
]);

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

/// The n-th prior draw, z and theta; optional parameters are absent, and their z mean nothing.
fn draw(n: u64) -> (Theta, Theta) {
    let mut rng = stream(20_261_121, Domain::Prior, 0, n);
    let z: Theta = std::array::from_fn(|_| standard_normal(&mut rng));
    let mut theta = BASE;
    prior().theta_from_z(&z, &mut theta);
    (z, theta)
}

/// ln L and its gradient with every number a dual: the reference for everything faster.
fn gradient_by_duals(
    likelihood: &StreamLikelihood,
    theta: &Theta,
) -> Result<(f64, Theta), Rejection> {
    let duals: [Dual<DIM>; DIM] = lift(theta);
    let value = likelihood.ln_likelihood_on::<Nfw, _>(&StreamParams::from_array(duals))?;
    Ok((value.re, gradient_of(&value)))
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
        step_rule: StepRule::Uniform,
        // Differences of neighbouring values are compared with gradients.
        precision: Precision::Double,
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
    let solution = model
        .progenitor_solution(&System::from_params(&params, Q))
        .ok()?;
    let (mut schedules, mut out) = (StepSchedules::default(), Particles::default());
    model.integrate(&solution, &mut schedules, &mut out).ok()?;
    let track = Track::new(&out, 10.0, settings.edges, 0.02 * out.len() as f64).ok()?;
    let data: Vec<DataBin> = track
        .bins
        .iter()
        .enumerate()
        .map(|(i, b)| {
            DataBin::symmetric(
                b.bin,
                b.r_kpc * (1.0 + 0.03 * (i as f64).sin()),
                0.02 * b.r_kpc,
            )
        })
        .collect();
    if data.len() < 3 {
        return None;
    }
    let track = TrackLikelihood::new(settings, 10.0, &data, &model.settings().releases).ok()?;
    Some(StreamLikelihood::new(model.clone(), track, Q))
}

fn largest(g: &[f64]) -> f64 {
    g.iter().fold(0.0, |m, v| m.max(v.abs()))
}

/// The central difference of `f` at 0, by Richardson's rule, at the step where it has converged best, and how far it
/// moved between that step and its half.
pub fn central(f: impl Fn(f64) -> f64, largest_step: f64) -> (f64, f64) {
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

/// Asserts that a derivative of ln L is that of central differences; ln L is even in the jitter.
fn matches_differences(
    likelihood: &StreamLikelihood,
    theta: &Theta,
    (name, step): (&str, f64),
    derivative: f64,
) {
    let i = index_of(name).expect("a parameter");
    let at = |change: f64| {
        let mut theta = *theta;
        theta[i] += change;
        if name == "jitter" {
            theta[i] = theta[i].abs();
        }
        let evaluation = likelihood.ln_likelihood(&theta);
        evaluation.expect("a likelihood").ln_likelihood
    };
    let numeric = (at(step) - at(-step)) / (2.0 * step);
    assert!(
        (numeric - derivative).abs() < 1e-5 * derivative.abs().max(1.0),
        "{name}: {derivative} {numeric}"
    );
}

/// Gradients in units of the prior's own scale: what a relative tolerance can be held against.
fn in_z(z: &Theta, gradient: &Theta) -> Theta {
    let mut g = *gradient;
    prior().gradient_to_z(z, &mut g);
    g
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
fn a_value_does_not_allocate_after_the_first() {
    let likelihood = likelihood_at(&BASE, &model(small()), &LikelihoodSettings::default());
    let adaptive = ModelSettings {
        step_rule: StepRule::Adaptive,
        steps: 4,
        ..small()
    };
    for likelihood in [
        likelihood.expect("a likelihood"),
        likelihood_at(&BASE, &model(adaptive), &LikelihoodSettings::default()).expect("another"),
    ] {
        let value = || likelihood.ln_likelihood(&BASE).expect("a value");
        let first = value();
        let info = allocation_counter::measure(|| assert_eq!(value(), first));
        assert_eq!(info.count_total, 0, "{info:?}");
    }
}

/// Sums of bins with these means: a hundred particles each, of one radius.
fn sums_of(means_kpc: &[f64]) -> Sums<f64> {
    Sums {
        weight: vec![100.0; means_kpc.len()],
        r: means_kpc.iter().map(|r| 100.0 * r).collect(),
        r2: means_kpc.iter().map(|r| 100.0 * r * r).collect(),
        ..Sums::default()
    }
}

/// The likelihood of one radius of 50 kpc with these errors.
fn one_bin(lo: f64, hi: f64, settings: &LikelihoodSettings) -> TrackLikelihood {
    let data = [DataBin {
        bin: 0,
        r_kpc: 50.0,
        r_err_lo_kpc: lo,
        r_err_hi_kpc: hi,
    }];
    let releases = TableSettings {
        particles: 100,
        ..TableSettings::default()
    };
    TrackLikelihood::new(settings, 10.0, &data, &releases).expect("a track")
}

#[test]
fn asymmetric_errors_are_a_normalised_split_normal_with_a_continuous_slope() {
    let track = one_bin(1.0, 3.0, &LikelihoodSettings::default());
    let at = |r: f64| {
        track
            .ln_likelihood(&sums_of(&[r]), &Observation::default())
            .expect("finite")
    };
    // Residuals of one sigma to each side cost the same.
    assert!((at(50.0) - at(49.0) - 0.5).abs() < 1e-9);
    assert!((at(50.0) - at(53.0) - 0.5).abs() < 1e-9);
    let step = 0.01;
    let integral: f64 = (0..10_000)
        .map(|k| step * at(20.0 + step * (f64::from(k) + 0.5)).exp())
        .sum();
    assert!((integral - 1.0).abs() < 1e-4, "{integral}");
    // The slope is that of the value, also where the two halves meet.
    for r in [48.0, 49.999_999, 50.0, 50.000_001, 55.0] {
        let mut bar = Sums::default();
        track
            .vjp(&sums_of(&[r]), &Observation::default(), &mut bar)
            .expect("finite");
        let slope = 100.0 * (bar.r[0] + 2.0 * r * bar.r2[0]);
        let expected = -(r - 50.0) / if r > 50.0 { 9.0 } else { 1.0 };
        assert!((slope - expected).abs() < 1e-6, "{r}: {slope} {expected}");
    }
    // With equal errors it is the normal, to rounding where the errors are nearly equal.
    let equal = one_bin(2.0, 2.0, &LikelihoodSettings::default());
    let nearly = one_bin(2.0, 2.0_f64.next_up(), &LikelihoodSettings::default());
    for r in [45.0, 50.0, 56.0] {
        let [a, b] = [&equal, &nearly].map(|t| {
            t.ln_likelihood(&sums_of(&[r]), &Observation::default())
                .expect("finite")
        });
        assert!((a - b).abs() < 1e-12, "{a} {b}");
    }
}

#[test]
fn residuals_are_in_standard_errors_and_fall_to_zero_with_the_cover() {
    // With half of their squares ln L is the same for every radius, which is what a surrogate relies on.
    for (lo, hi) in [(2.0, 2.0), (1.0, 3.0)] {
        let track = one_bin(lo, hi, &LikelihoodSettings::default());
        for r in [44.0, 50.0, 53.0] {
            let sums = sums_of(&[r]);
            let mut residuals = Vec::new();
            track
                .residuals(&sums, &Observation::default(), &mut residuals)
                .expect("finite");
            let expected = (r - 50.0) / if r > 50.0 { hi } else { lo };
            assert!((residuals[0] - expected).abs() < 1e-9, "{residuals:?}");
            let at = |sums: &Sums<f64>| {
                track
                    .ln_likelihood(sums, &Observation::default())
                    .expect("finite")
            };
            let rest = at(&sums) + 0.5 * residuals[0] * residuals[0];
            assert!((rest - at(&sums_of(&[50.0]))).abs() < 1e-9, "{rest}");
        }
        let mut uncovered = sums_of(&[53.0]);
        uncovered.weight = vec![0.0];
        let mut residuals = Vec::new();
        track
            .residuals(&uncovered, &Observation::default(), &mut residuals)
            .expect("finite");
        assert_eq!(residuals, [0.0]);
        // As a square, for the check of the fit, an uncovered bin is as bad as ln L has it.
        let squares = |sums: &Sums<f64>| {
            let mut squares = Vec::new();
            track
                .squares(sums, &Observation::default(), &mut squares)
                .expect("finite");
            squares
        };
        assert_eq!(squares(&uncovered), [100.0]);
        let expected = (3.0 / hi).powi(2);
        assert!((squares(&sums_of(&[53.0]))[0] - expected).abs() < 1e-9);
    }
}

#[test]
fn an_error_floor_raises_smaller_errors_only() {
    let settings = LikelihoodSettings {
        error_floor_percent: 4.0,
        ..LikelihoodSettings::default()
    };
    let floored = one_bin(1.0, 3.0, &settings);
    let expected = one_bin(2.0, 3.0, &LikelihoodSettings::default());
    let at = |t: &TrackLikelihood| {
        t.ln_likelihood(&sums_of(&[48.5]), &Observation::default())
            .expect("finite")
    };
    assert_eq!(at(&floored).to_bits(), at(&expected).to_bits());
    assert_eq!(
        floored.ln_likelihood_bound().to_bits(),
        expected.ln_likelihood_bound().to_bits()
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
        let track = TrackLikelihood::new(settings, 10.0, &data, &model.settings().releases)
            .expect("a likelihood");
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
        -50.0 - last.r_err_lo_kpc.ln() - oblate_samplers::normal::LN_SQRT_2PI - 1_000.0 / (n * n);
    assert!(
        (penalised - covered - miss).abs() < 1e-6,
        "{penalised} {covered} {miss}"
    );
}

#[test]
fn a_nan_parameter_is_a_counted_rejection() {
    let mut params = StreamParams::from_array(BASE);
    (params.jitter, params.phi0_deg) = (0.01, 3.0);
    (params.log10_m_disc, params.r_disc_kpc) = (10.3, 3.0);
    (params.inclination_disc_deg, params.phi_disc_deg) = (40.0, 20.0);
    (params.log10_m_bulge, params.r_bulge_kpc) = (9.7, 0.7);
    (params.p_halo, params.psi_halo_deg) = (0.8, 25.0);
    (params.m_prog_left, params.dissolved_at) = (0.4, 0.9);
    (params.release_peaking, params.coulomb_logarithm) = (1.3, 2.0);
    let theta = params.to_array();
    // Two models that read every parameter between them: no law of mass loss has both parameters of such laws.
    let likelihoods = [MassLoss::Linear, MassLoss::Complete].map(|law| {
        let settings = ModelSettings {
            halo: HaloKind::NfwTriaxial,
            baryons: BaryonSettings {
                disc: Some(DiscSettings {
                    profile: DiscProfile::MiyamotoNagai,
                    thickness: 0.1,
                    plane: DiscPlane::Angles,
                }),
                bulge: Some(BulgeProfile::Hernquist),
            },
            mass_loss: Some(law),
            release_rate: ReleaseRate::Tidal,
            dynamical_friction: true,
            ..small()
        };
        let model = model(settings);
        let track = model.stream(&params).and_then(|stream| stream.track(10.0));
        let track = crate::haloes::near(&track.expect("a track"), &settings);
        (law, StreamLikelihood::new(model, track, Q))
    });
    for (law, likelihood) in &likelihoods {
        likelihood.ln_likelihood(&theta).expect("a likelihood");
        let of_other_law = match law {
            MassLoss::Complete => "m_prog_left",
            _ => "dissolved_at",
        };
        for (i, name) in NAMES.into_iter().enumerate() {
            for bad in [f64::NAN, f64::INFINITY] {
                let mut theta = theta;
                theta[i] = bad;
                let value = likelihood.ln_likelihood(&theta);
                let gradient = likelihood.gradient(&theta);
                let is_read = name != of_other_law;
                assert_eq!(value.is_err(), is_read, "{law:?} {name} {bad}: {value:?}");
                assert_eq!(gradient.err(), value.err(), "{law:?} {name} {bad}");
            }
        }
    }
}

/// Angles count from the progenitor, which is at phi = 0.
#[test]
fn a_progenitor_on_the_other_side_of_the_sky_is_rejected() {
    let model = model(small());
    let likelihood =
        likelihood_at(&BASE, &model, &LikelihoodSettings::default()).expect("a stream");
    let mut theta = BASE;
    theta[7] = -theta[7];
    assert_eq!(
        likelihood.ln_likelihood(&theta),
        Err(Rejection::BadParameter)
    );
}

/// A progenitor at the very centre today, where the halo's acceleration has no direction.
#[test]
fn at_the_very_centre_value_and_gradient_agree() {
    for step_rule in [StepRule::Uniform, StepRule::Adaptive] {
        for orbit in [OrbitMethod::Accurate, OrbitMethod::Leapfrog] {
            let settings = ModelSettings {
                step_rule,
                orbit,
                ..small()
            };
            let model = model(settings);
            let likelihood =
                likelihood_at(&BASE, &model, &LikelihoodSettings::default()).expect("a track");
            let mut theta = BASE;
            // At the centre itself no adaptive step is short enough.
            for place in [0.0, 20.0] {
                (theta[7], theta[8]) = (place, 0.0);
                let refused = step_rule == StepRule::Adaptive && place <= 0.0;
                match (
                    likelihood.ln_likelihood(&theta),
                    likelihood.gradient(&theta),
                ) {
                    (Ok(value), Ok((same, gradient))) if !refused => {
                        assert_eq!(same, value);
                        assert!(gradient.iter().all(|g| g.is_finite()), "{gradient:?}");
                    }
                    (Err(cause), Err(same)) if refused => assert_eq!(cause, same),
                    other => panic!("{place}: {other:?}"),
                }
            }
        }
    }
}

#[test]
fn a_value_has_the_same_bits_with_and_without_its_gradient() {
    let hard = LikelihoodSettings {
        edges: BinEdges::Hard,
        coverage: Coverage::Reject,
        ..LikelihoodSettings::default()
    };
    let mut values = 0;
    for (likelihood_settings, step_rule) in [
        (LikelihoodSettings::default(), StepRule::Uniform),
        (LikelihoodSettings::default(), StepRule::Adaptive),
        (hard, StepRule::Uniform),
    ] {
        let model = model(ModelSettings {
            step_rule,
            ..small()
        });
        let likelihood = likelihood_at(&BASE, &model, &likelihood_settings).expect("a track");
        for n in 0..100 {
            // Near the track, where every bin counts, and anywhere in the prior.
            let (z, far) = draw(n);
            let near: Theta = std::array::from_fn(|i| BASE[i] * (1.0 + 0.01 * z[i]));
            for theta in [near, far] {
                let value = likelihood.ln_likelihood(&theta);
                values += usize::from(value.is_ok());
                let exact = likelihood.gradient(&theta).map(|(value, _)| value);
                assert_eq!(exact, value);
                let truncated = likelihood
                    .truncated_gradient(&theta)
                    .map(|(value, _)| value);
                assert_eq!(truncated, value);
            }
        }
    }
    assert!(values > 300, "only {values} values");
}

#[test]
fn values_and_gradients_have_the_same_bits_over_many_threads_and_in_batches() {
    let settings = ModelSettings {
        step_rule: StepRule::Adaptive,
        steps: 4,
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

    /// Bins with any weight, mean (in sigma from the datum) and scatter (kpc); the best ones come up to it.
    #[test]
    fn no_track_is_likelier_than_the_bound(
        bins in proptest::array::uniform3((0.0..300.0, -4.0..4.0, 0.0..30.0, 0.1..20.0, prop_oneof![Just(1.0), 0.2..5.0])),
        model_noise: bool,
        reject: bool,
        best: bool,
        correlation in prop::option::of((1.0..360.0, 0.0..=1.0)),
        jitter in prop_oneof![Just(0.0), 0.0..0.5],
    ) {
        let error_correlation = correlation.map(|(angle_deg, fraction)| ErrorCorrelation { angle_deg, fraction });
        let correlated = error_correlation.is_some();

        let data: Vec<DataBin> = bins
            .iter()
            .zip(0..)
            .map(|((_, _, _, r_err_kpc, ratio), bin)| DataBin {
                r_err_hi_kpc: if correlated { *r_err_kpc } else { ratio * r_err_kpc },
                ..DataBin::symmetric(bin, 50.0, *r_err_kpc)
            })
            .collect();
        let releases = TableSettings { particles: 300, ..TableSettings::default() };
        let coverage = if reject { Coverage::Reject } else { LikelihoodSettings::default().coverage };
        let settings = LikelihoodSettings { model_noise, coverage, error_correlation, ..LikelihoodSettings::default() };
        let observation = Observation { jitter, ..Observation::default() };
        let track = TrackLikelihood::new(&settings, 10.0, &data, &releases).expect("a track");
        let mut sums = Sums::default();
        for (weight, off, scatter, r_err_kpc, _) in bins {
            let (weight, off, scatter) = if best { (100.0, 0.0, 0.0) } else { (weight, off, scatter) };
            let mean: f64 = 50.0 + off * r_err_kpc;
            sums.weight.push(weight);
            sums.r.push(weight * mean);
            sums.r2.push(weight * (mean * mean + scatter * scatter));
        }
        let bound = track.ln_likelihood_bound();
        if let Ok(ln_likelihood) = track.ln_likelihood(&sums, &observation) {
            prop_assert!(ln_likelihood <= bound, "{ln_likelihood} above {bound}");
            let attained = best && !correlated && jitter <= 0.0;
            prop_assert!(!attained || bound - ln_likelihood < 1e-5, "{ln_likelihood} below {bound}");
        }
    }

    /// At any parameters a stream is finite or a rejection by name. With and without its gradient ln L has the same
    /// bits, or the rejection the same cause.
    #[test]
    fn extremes_give_finite_numbers_or_a_counted_rejection(
        log10_m_halo in extreme(11.0, 14.0),
        r_s_halo_kpc in extreme(1.0, 25.0),
        // Halves to the prior's q of .5 to 1.5: the length of the shape vector.
        length in extreme(1e-9, 8.0),
        (along, across) in (extreme(-1.0, 1.0), extreme(-1.0, 1.0)),
        log10_m_prog in extreme(7.0, 9.0),
        r_s_prog_kpc in extreme(1.0, 5.0),
        (x0, z0) in (extreme(0.0, 150.0), extreme(0.0, 150.0)),
        // Without velocity the progenitor falls through the centre; with one component alone it starts radially or on a
        // circle.
        velocity in [extreme(0.0, 250.0), extreme(0.0, 250.0), extreme(-250.0, 0.0)],
        age_gyr in extreme(1.0, 4.0),
        (particles, release_times) in prop_oneof![Just((8, 4)), Just((2, 1)), Just((64, 32)), Just((128, 8))],
        steps in prop_oneof![Just(1_usize), Just(2), Just(60)],
        step_rule in prop_oneof![Just(StepRule::Uniform), Just(StepRule::Adaptive)],
        steps_per in prop_oneof![Just(StepsPer::Particle), Just(StepsPer::Age)],
        (step_phase, max_halvings) in prop_oneof![Just((1.2, 4)), Just((0.3, 0)), Just((3.0, 6))],
        orbit in prop_oneof![Just(OrbitMethod::Accurate), Just(OrbitMethod::Leapfrog)],
        precision in prop_oneof![Just(Precision::Double), Just(Precision::Single)],
        halo in prop_oneof![Just(HaloKind::Nfw), Just(HaloKind::NfwDensity), Just(HaloKind::NfwTriaxial), Just(HaloKind::Logarithmic)],
    ) {
        let settings = ModelSettings {
            halo,
            baryons: BaryonSettings::default(),
            mass_loss: None,
            release_rate: ReleaseRate::default(),
            dynamical_friction: false,
            releases: TableSettings { particles, release_times, ..TableSettings::default() },
            steps,
            steps_per,
            step_rule,
            orbit,
            orbit_steps: 64,
            step_phase,
            max_halvings,
            precision,
        };
        let bin = |bin| DataBin::symmetric(bin, 50.0, 1.0);
        let data = [bin(-1), bin(0), bin(1)];
        let track = TrackLikelihood::new(&LikelihoodSettings::default(), 10.0, &data, &settings.releases)
            .expect("a track");
        let likelihood = StreamLikelihood::new(model(settings), track, Q);
        let theta = without_optional([
            log10_m_halo, r_s_halo_kpc, along * length, across * length, length,
            log10_m_prog, r_s_prog_kpc, x0, z0, velocity[0], velocity[1], velocity[2], age_gyr,
        ]);
        let value = likelihood.ln_likelihood(&theta);
        let gradient = likelihood.gradient(&theta);
        if let (Ok(value), Ok((_, gradient))) = (&value, &gradient) {
            prop_assert!(value.ln_likelihood.is_finite());
            prop_assert!(gradient.iter().all(|g| g.is_finite()));
        }
        prop_assert_eq!(value, gradient.map(|(value, _)| value));
    }
}
