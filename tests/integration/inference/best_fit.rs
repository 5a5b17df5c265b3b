//! Diagnostics of the best fit, computed by hand from the model at its parameters.

use super::example_track;
use crate::runs;
use oblate::data::{Measured, ObservedTrack, StarVelocity};
use oblate::inference::{Diagnostics, FitSettings, StreamTarget, diagnose};
use oblate::params::{StreamParams, without_optional};
use oblate::potential::Potential;
use oblate::scalar::Vec3;
use oblate::track::{BinQuantity, Track, TrackBin};
use oblate::units::G;
use oblate_samplers::{Run, Target};
use std::collections::BTreeMap;
use std::f64::consts::PI;

/// A run whose best draw, the second of two, has these values of the free parameters.
fn run_at(target: &StreamTarget, theta: &[f64]) -> Run {
    let mut run = runs::nested(2, 1);
    run.names = target.prior().names().to_vec();
    run.draws.dim = theta.len();
    run.draws.theta = [&vec![0.0; theta.len()], theta].concat();
    run.draws.ln_likelihood = vec![-2.0, -1.0];
    run
}

fn settings(particles: usize) -> FitSettings {
    let mut settings = FitSettings::default();
    settings.model.releases.particles = particles;
    settings
}

/// Mass density from the Laplacian of a potential by differences of fourth order, and its error: that of the differences, relative to the largest of the
/// three second derivatives.
fn density(potential: &dyn Potential<f64>, x: Vec3<f64>) -> (f64, f64) {
    let h = 0.01 * x.norm2().sqrt();
    let second = |e: [f64; 3]| {
        let at = |k: f64| potential.value(x + Vec3::from(e) * (k * h));
        (16.0 * (at(1.0) + at(-1.0)) - at(2.0) - at(-2.0) - 30.0 * at(0.0)) / (12.0 * h * h)
    };
    let parts = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(second);
    let largest = parts
        .iter()
        .fold(0.0_f64, |largest, part| largest.max(part.abs()));
    (
        parts.iter().sum::<f64>() / (4.0 * PI * G),
        1e-6 * largest / (4.0 * PI * G),
    )
}

/// The parameters of a stream 67 kpc from the centre of a halo with this q.
fn params_with_q(target: &StreamTarget, q: f64, r_s_kpc: f64) -> StreamParams<f64> {
    let axis = Vec3::new(0.3, -0.5, 0.8);
    let dir = target.likelihood().q_range().dir(q, axis).unwrap();
    StreamParams::from_array(without_optional([
        12.0, r_s_kpc, dir.x, dir.y, dir.z, 8.0, 1.0, 60.0, 30.0, 30.0, 140.0, 45.0, 3.0,
    ]))
}

#[test]
fn the_least_density_is_that_of_the_potential_and_is_told_where_it_is_negative() {
    let track = example_track();
    let mut settings_to_three = settings(64);
    settings_to_three.prior.q_max = 3.0;
    let target = StreamTarget::from_track(&track, &settings_to_three).unwrap();
    // q, and whether the smaller density is that on the axis and whether it is negative.
    for (q, on_axis_is_less, negative) in [
        (0.55, true, true),
        (0.95, true, false),
        (1.05, false, false),
        (1.45, false, false),
        (2.4, false, true),
    ] {
        let params = params_with_q(&target, q, 12.0);
        let theta = &params.to_array()[..target.dim()];
        let found = diagnose(&target, &track, &run_at(&target, theta));
        let potential = target.likelihood().potential(&params);
        let axis = params.dir() * (1.0 / params.dir().norm2().sqrt());
        let across = Vec3::new(axis.y, -axis.x, 0.0);
        let across = across * (1.0 / across.norm2().sqrt());
        let r = params.position_kpc().norm2().sqrt();
        let [on_axis, across] = [axis, across].map(|n| density(&*potential, n * r));
        assert_eq!(on_axis.0 < across.0, on_axis_is_less, "{q}");
        let (expected, error) = if on_axis_is_less { on_axis } else { across };
        let stated = found.numbers["least_density_msun_kpc3"];
        assert!(
            (stated - expected).abs() < error,
            "{q}: {stated} {expected} +- {error}"
        );
        // No verdict of chance.
        assert!(expected.abs() > 100.0 * error, "{q}: {expected} +- {error}");
        assert_eq!(expected < 0.0, negative, "{q}: {expected}");
        let mut warnings = found.warnings.iter();
        let warned = warnings.any(|w| w.contains("mass density is negative"));
        assert_eq!(warned, negative, "{q}: {:?}", found.warnings);
    }
    // A halo that is flattened in its density has none below zero.
    let mut of_density = settings(64);
    of_density.model.halo = oblate::potential::HaloKind::NfwDensity;
    let target = StreamTarget::from_track(&track, &of_density).unwrap();
    let params = params_with_q(&target, 0.55, 12.0);
    let theta = &params.to_array()[..target.dim()];
    let found = diagnose(&target, &track, &run_at(&target, theta));
    let stated = found.numbers["least_density_msun_kpc3"];
    assert!(stated > 0.0 && found.warnings.is_empty(), "{stated}");
}

/// The model's bin for each row of a track.
fn rows(model: &Track, track: &ObservedTrack) -> Vec<TrackBin> {
    let of_row = |phi: &f64| {
        let mut bins = model.bins.iter();
        *bins
            .find(|bin| (bin.phi_deg - phi).abs() < 1e-6)
            .expect("a bin")
    };
    track.phi_deg.iter().map(of_row).collect()
}

/// Chi-square and number of each kind of data.
const KINDS: [(&str, &str); 5] = [
    ("best_fit_chi2", "best_fit_bins"),
    ("best_fit_chi2_velocity", "best_fit_velocities"),
    ("best_fit_chi2_width", "best_fit_widths"),
    ("best_fit_chi2_density", "best_fit_densities"),
    ("best_fit_chi2_star_velocity", "best_fit_star_velocities"),
];

#[test]
fn chi_squares_of_the_best_fit_are_those_of_its_track_each_of_its_own_data() {
    let mut settings = settings(512);
    let text = "fixed = { v_host_km_s = 20.0, log10_n_stars = 3.0, distance_factor = 1.1 }\n\
                marginals.z0_kpc = { kind = \"normal\", mean = 0.0, sd = 150.0 }";
    settings.prior = toml::from_str(text).unwrap();
    let mut track = example_track();
    // The model by itself, with what the observation adds: 20 km/s, 1,000 stars and radii at 1 / 1.1 of its distance.
    let theta = [
        12.0, 15.0, 0.3, 0.4, 1.45, 7.7, 1.0, 60.0, 30.0, 30.0, 140.0, 45.0, 3.0,
    ];
    let particles = oblate::stream::Model::new(&settings.model)
        .unwrap()
        .stream(&StreamParams::from_array(without_optional(theta)))
        .unwrap();
    let model = Track::new(&particles, 10.0, settings.likelihood.edges, 1.0).unwrap();
    let bins = rows(&model, &track);
    // Residuals in errors: of bin k, k / 4 - 1, with the sign of the parity, and none in every third bin of the densities.
    let residual =
        |k: usize| if k.is_multiple_of(2) { 1.0 } else { -1.0 } * (0.25 * k as f64 - 1.0);
    let datum = |k: usize, value: f64, error: f64| Measured {
        value: value + residual(k) * error,
        error,
    };
    let of_bins = |of: &dyn Fn(usize, &TrackBin) -> Option<Measured>| -> Vec<Option<Measured>> {
        bins.iter().enumerate().map(|(k, bin)| of(k, bin)).collect()
    };
    let kpc = 1.0 / 1.1;
    track.measured = BTreeMap::from([
        (
            BinQuantity::Velocity,
            of_bins(&|k, bin| Some(datum(k, bin.v_km_s + 20.0, 3.0 + k as f64))),
        ),
        (
            BinQuantity::Width,
            of_bins(&|k, bin| Some(datum(k, bin.width_kpc * kpc, 0.1 + 0.01 * k as f64))),
        ),
        (
            BinQuantity::Density,
            of_bins(&|k, bin| {
                (k % 3 != 0).then(|| datum(k, 1e3 * bin.density_per_deg, 0.5 + k as f64))
            }),
        ),
    ]);
    for (k, bin) in bins.iter().enumerate() {
        let value = bin.r_kpc * kpc + residual(k) * track.r_err_lo_kpc[k];
        track.r_kpc[k] = value;
    }
    // Two stars in the same bin, whose errors have the scatter of its velocities.
    let (bin, scatter) = (bins[6], bins[6].v_err_km_s * bins[6].effective_n.sqrt());
    track.stars = [(-2.0, 2.0), (3.0, -1.5)]
        .map(|(from_centre, residual)| {
            let error = 4.0_f64;
            let value = bin.v_km_s + 20.0 + residual * error.hypot(scatter);
            StarVelocity {
                phi_deg: bin.phi_deg + from_centre,
                v_km_s: Measured { value, error },
            }
        })
        .to_vec();
    let found = |track: &ObservedTrack| -> Diagnostics {
        let target = StreamTarget::from_track(track, &settings).unwrap();
        diagnose(&target, track, &run_at(&target, &theta))
    };
    let all = 0..bins.len();
    let sum = |of: &dyn Fn(&usize) -> bool| -> (f64, usize) {
        let of: Vec<usize> = all.clone().filter(of).collect();
        (of.iter().map(|k| residual(*k).powi(2)).sum(), of.len())
    };
    let (whole, some) = (sum(&|_| true), sum(&|k| k % 3 != 0));
    let expected = [whole, whole, whole, some, (4.0 + 2.25, 2)];
    let before = found(&track);
    for ((chi2, count), (value, number)) in KINDS.into_iter().zip(expected) {
        assert_eq!(
            before.numbers[count].to_bits(),
            (number as f64).to_bits(),
            "{count}"
        );
        let stated = before.numbers[chi2];
        assert!(
            (stated - value).abs() < 1e-6 * value,
            "{chi2}: {stated} {value}"
        );
    }

    // Ten errors added to the residual of the fifth bin, which was zero there, or of the first star.
    let move_datum = |kind: usize, track: &mut ObservedTrack| {
        let by_ten = |datum: &mut Measured| datum.value += 10.0 * datum.error;
        match kind {
            0 => track.r_kpc[4] += 10.0 * track.r_err_lo_kpc[4],
            4 => by_ten(&mut track.stars[0].v_km_s),
            _ => {
                let quantity = BinQuantity::ALL[kind - 1];
                let rows = track.measured.get_mut(&quantity).unwrap();
                by_ten(rows[4].as_mut().unwrap());
            }
        }
    };
    let of_star = 2.0 + 10.0 * 4.0 / 4.0_f64.hypot(scatter);
    for kind in 0..KINDS.len() {
        let mut moved = track.clone();
        move_datum(kind, &mut moved);
        let after = found(&moved);
        for (other, (chi2, _)) in KINDS.into_iter().enumerate() {
            let change = after.numbers[chi2] - before.numbers[chi2];
            let expected = match (other == kind, kind) {
                (false, _) => 0.0,
                (true, 4) => of_star.powi(2) - 4.0,
                (true, _) => 100.0,
            };
            assert!(
                (change - expected).abs() < 1e-4,
                "{kind} {chi2}: {change} {expected}"
            );
        }
    }
}
