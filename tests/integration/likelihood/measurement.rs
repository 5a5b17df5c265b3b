//! Velocities, widths and densities: what they add to ln L, and its gradients with them.

use super::*;
use oblate::likelihood::BinMeasurement;
use oblate::track::BinQuantity;

const LN_SQRT_2PI: f64 = 0.918_938_533_204_672_7;

/// A weight of 100 with a radius of 50 kpc, a width of 3 kpc, and velocities of 80 +- 20 km/s.
fn sums() -> Sums<f64> {
    Sums {
        weight: vec![100.0],
        r: vec![5_000.0],
        r2: vec![100.0 * (2_500.0 + 9.0)],
        v: vec![8_000.0],
        v2: vec![100.0 * (6_400.0 + 400.0)],
        mean_square_weight: 1.0,
    }
}

fn velocity(value: f64, error: f64) -> BinMeasurement {
    BinMeasurement {
        bin: 0,
        quantity: BinQuantity::Velocity,
        value,
        error,
        of_one_star: false,
    }
}

fn width(value: f64, error: f64) -> BinMeasurement {
    BinMeasurement {
        quantity: BinQuantity::Width,
        ..velocity(value, error)
    }
}

fn density(value: f64, error: f64) -> BinMeasurement {
    BinMeasurement {
        quantity: BinQuantity::Density,
        ..velocity(value, error)
    }
}

/// What a measurement adds to ln L at these sums.
fn added(
    measurement: BinMeasurement,
    settings: &LikelihoodSettings,
    sums: &Sums<f64>,
    observation: &Observation<f64>,
) -> f64 {
    let plain = one_bin(1.0, 1.0, settings);
    let with = plain.clone().with_measurements(&[measurement]);
    let [with, plain] =
        [with.expect("a bin"), plain].map(|t| t.ln_likelihood(sums, observation).expect("finite"));
    with - plain
}

fn normal(residual: f64, variance: f64) -> f64 {
    -0.5 * (residual * residual / variance + variance.ln()) - LN_SQRT_2PI
}

#[test]
fn a_measurement_adds_the_logarithm_of_a_normal_distribution() {
    let quiet = LikelihoodSettings {
        model_noise: false,
        ..LikelihoodSettings::default()
    };
    let noisy = LikelihoodSettings::default();
    let factor = SamplingScheme::default().variance_factor();
    let seen = Observation {
        v_host_km_s: 7.0,
        distance_factor: 1.25,
        log10_n_stars: 3.0,
        ..Observation::default()
    };
    let plain = Observation::default();
    // The mean velocity has the variance of the velocities over the weight; the width that of the standard deviation of a normal distribution.
    let of_mean = 400.0 * factor / 100.0;
    let of_width = 9.0 * factor / 200.0;
    // All particles are in this bin of 10 degrees: 1,000 stars are 100 per degree, with Poisson's error of a hundred particles.
    let of_density = 100.0 * factor;
    for (measurement, settings, observation, residual, variance) in [
        (velocity(70.0, 5.0), quiet, plain, 10.0, 25.0),
        (velocity(70.0, 5.0), quiet, seen, 17.0, 25.0),
        (velocity(70.0, 5.0), noisy, plain, 10.0, 25.0 + of_mean),
        (width(2.5, 0.4), quiet, plain, 0.5, 0.16),
        (width(2.5, 0.4), quiet, seen, 3.0 / 1.25 - 2.5, 0.16),
        (width(2.5, 0.4), noisy, plain, 0.5, 0.16 + of_width),
        (density(110.0, 5.0), quiet, seen, -10.0, 25.0),
        (density(110.0, 5.0), noisy, seen, -10.0, 25.0 + of_density),
    ] {
        let found = added(measurement, &settings, &sums(), &observation);
        let expected = normal(residual, variance);
        // A parsec is added to the width in quadrature.
        assert!((found - expected).abs() < 1e-5, "{found} {expected}");
    }
    // Both together are independent.
    let both = one_bin(1.0, 1.0, &quiet).with_measurements(&[velocity(70.0, 5.0), width(2.5, 0.4)]);
    let both = both
        .expect("a bin")
        .ln_likelihood(&sums(), &plain)
        .expect("finite");
    let r = one_bin(1.0, 1.0, &quiet)
        .ln_likelihood(&sums(), &plain)
        .expect("finite");
    let expected = r + normal(10.0, 25.0) + normal(0.5, 0.16);
    assert!((both - expected).abs() < 1e-5, "{both} {expected}");
}

/// A star differs from the mean by the scatter of the velocities in its bin, 20 km/s, besides its own error.
#[test]
fn one_star_has_the_scatter_of_its_bin() {
    let quiet = LikelihoodSettings {
        model_noise: false,
        ..LikelihoodSettings::default()
    };
    let star = BinMeasurement {
        of_one_star: true,
        ..velocity(70.0, 5.0)
    };
    let observation = Observation {
        v_host_km_s: 3.0,
        ..Observation::default()
    };
    let found = added(star, &quiet, &sums(), &observation);
    let variance: f64 = 400.0 + 25.0;
    let expected = -0.5 * (13.0_f64.powi(2) / variance + variance.ln()) - LN_SQRT_2PI;
    assert!((found - expected).abs() < 1e-9, "{found} {expected}");
}

#[test]
fn a_bin_without_particles_counts_as_missed_by_its_measurements_too() {
    let empty = Sums {
        weight: vec![0.0],
        r: vec![0.0],
        r2: vec![0.0],
        v: vec![0.0],
        v2: vec![0.0],
        mean_square_weight: 1.0,
    };
    let penalty = LikelihoodSettings::default();
    let found = added(
        velocity(70.0, 5.0),
        &penalty,
        &empty,
        &Observation::default(),
    );
    let expected = -50.0 - 5.0_f64.ln() - LN_SQRT_2PI;
    assert!((found - expected).abs() < 1e-12, "{found} {expected}");
    let reject = LikelihoodSettings {
        coverage: Coverage::Reject,
        ..penalty
    };
    let track = one_bin(1.0, 1.0, &reject).with_measurements(&[width(2.0, 1.0)]);
    let track = track.expect("a bin");
    let rejected = track.ln_likelihood(&empty, &Observation::default());
    assert!(matches!(rejected, Err(Rejection::Uncovered)));
}

#[test]
fn a_measurement_needs_a_bin_with_a_radius_and_a_possible_value() {
    let track = one_bin(1.0, 1.0, &LikelihoodSettings::default());
    let refused = |measurement| {
        let refused = track.clone().with_measurements(&[measurement]);
        refused.expect_err("refused").to_string()
    };
    let elsewhere = BinMeasurement {
        bin: 1,
        ..velocity(0.0, 1.0)
    };
    assert!(refused(elsewhere).contains("bin 1"));
    for (measurement, key) in [
        (velocity(f64::NAN, 1.0), "track.v "),
        (velocity(0.0, 0.0), "track.v_err"),
        (width(0.0, 1.0), "track.width "),
        (width(1.0, f64::INFINITY), "track.width_err"),
        (density(1.0, 0.0), "track.density_err"),
    ] {
        let words = refused(measurement);
        assert!(words.contains(key), "{words}");
    }
}

/// The likelihood with velocities and widths of the model's own track, off by up to three errors, in every other bin.
/// With `by_stars` half of the velocities are those of single stars, whose variance is the model's too.
fn measured(likelihood: &StreamLikelihood, theta: &Theta, by_stars: bool) -> StreamLikelihood {
    let params = StreamParams::from_array(*theta);
    let (track, _) = likelihood.track_at(&params).expect("a track");
    let mut measurements = Vec::new();
    for (i, d) in likelihood.track().data().enumerate() {
        let bin = track.bins.iter().find(|b| b.bin == d.bin).expect("covered");
        let quantity = BinQuantity::ALL[i % 3];
        let error = [
            6.0,
            0.2 * bin.width_kpc + 0.05,
            0.3 * bin.density_per_deg + 1e-3,
        ][i % 3];
        measurements.push(BinMeasurement {
            bin: d.bin,
            quantity,
            value: bin.value(quantity) + error * (3.0 * (i as f64).cos()).max(-0.4),
            error,
            of_one_star: by_stars && quantity == BinQuantity::Velocity && i % 2 == 0,
        });
    }
    let model = likelihood.model().clone();
    let track = likelihood.track().clone().with_measurements(&measurements);
    StreamLikelihood::new(model, track.expect("measurements"), Q)
}

fn seen(theta: Theta, v_host_km_s: f64, distance_factor: f64, phi0_deg: f64) -> Theta {
    let mut params = StreamParams::from_array(theta);
    params.v_host_km_s = v_host_km_s;
    params.distance_factor = distance_factor;
    params.phi0_deg = phi0_deg;
    params.log10_n_stars = 0.05;
    params.to_array()
}

#[test]
fn gradients_with_measurements_match_duals_and_central_differences() {
    let hard = LikelihoodSettings {
        edges: BinEdges::Hard,
        coverage: Coverage::Reject,
        min_fraction: 0.0,
        ..LikelihoodSettings::default()
    };
    let smooth = LikelihoodSettings::default();
    let adaptive = ModelSettings {
        step_rule: StepRule::Adaptive,
        steps: 3,
        ..small()
    };
    let unsmeared = ModelSettings {
        releases: TableSettings {
            sampling_scheme: SamplingScheme::Sobol,
            ..small().releases
        },
        ..small()
    };
    for (model_settings, settings, theta) in [
        (small(), smooth, BASE),
        (small(), smooth, seen(BASE, -12.0, 1.04, 1.5)),
        (adaptive, smooth, BASE),
        (unsmeared, smooth, BASE),
        (small(), hard, BASE),
    ] {
        let of_track = likelihood_at(&BASE, &model(model_settings), &settings).expect("a stream");
        let likelihood = measured(&of_track, &BASE, true);
        let (value, fast) = likelihood.gradient(&theta).expect("a gradient");
        let (reference, slow) = gradient_by_duals(&likelihood, &theta).expect("a gradient");
        assert!((value.ln_likelihood - reference).abs() < 1e-9 * reference.abs());
        for (i, (a, b)) in fast.iter().zip(&slow).enumerate() {
            assert!(
                (a - b).abs() < 1e-9 * largest(&slow),
                "{i}: {fast:?} {slow:?}"
            );
        }
        let v_host = index_of("v_host_km_s").expect("a parameter");
        assert!(fast[v_host].abs() > 0.0);
        matches_differences(&likelihood, &theta, ("v_host_km_s", 1e-3), fast[v_host]);
        let n_stars = index_of("log10_n_stars").expect("a parameter");
        matches_differences(&likelihood, &theta, ("log10_n_stars", 1e-6), fast[n_stars]);
        if settings.edges != BinEdges::Hard {
            for (name, step) in [("vz0_km_s", 1e-4), ("distance_factor", 1e-6)] {
                let i = index_of(name).expect("a parameter");
                matches_differences(&likelihood, &theta, (name, step), fast[i]);
            }
        }
        // One thread and all give the same bits.
        let all = likelihood.gradient_in_parallel(&theta).expect("a gradient");
        assert_eq!(
            (value, fast.map(f64::to_bits)),
            (all.0, all.1.map(f64::to_bits))
        );
    }
}

#[test]
fn residuals_have_one_for_each_datum_and_sum_to_ln_likelihood() {
    let quiet = LikelihoodSettings {
        model_noise: false,
        ..LikelihoodSettings::default()
    };
    let of_track = likelihood_at(&BASE, &model(small()), &quiet).expect("a stream");
    let likelihood = measured(&of_track, &BASE, false);
    let mut residuals = Vec::new();
    let value = likelihood.ln_likelihood_and_residuals(&BASE, &mut residuals);
    let value = value.expect("a value").ln_likelihood;
    let track = likelihood.track();
    let data = track.data().count() + track.measurements().count();
    assert_eq!(residuals.len(), data);
    assert!(BinQuantity::ALL.iter().all(|quantity| track.has(*quantity)));
    // All bins are covered, so that ln L is its bound less half of the sum of squares.
    let squares: f64 = residuals.iter().map(|r| r * r).sum();
    let expected = track.ln_likelihood_bound() - 0.5 * squares;
    assert!((value - expected).abs() < 1e-5, "{value} {expected}");
}

/// Signs and units: the progenitor's own particles move with it.
#[test]
fn velocities_are_positive_away_from_the_observer() {
    let likelihood = likelihood_at(&BASE, &model(small()), &LikelihoodSettings::default());
    let likelihood = likelihood.expect("a stream");
    let at = |theta: Theta| {
        let params = StreamParams::from_array(theta);
        let (track, particles) = likelihood.track_at(&params).expect("a track");
        let bin = track.bins.into_iter().find(|b| b.bin == 0);
        (bin.expect("at the progenitor").v_km_s, particles)
    };
    let (v, particles) = at(BASE);
    // vz is -29 km/s: it moves away from the observer.
    let params = StreamParams::from_array(BASE);
    assert!((v + params.vz0_km_s).abs() < 30.0, "{v}");
    // The mean over all particles within 5 degrees of it, in other units.
    let near: Vec<f64> = (0..particles.len())
        .filter(|i| (0.0..10.0).contains(&particles.angle(*i).to_degrees()))
        .map(|i| -particles.v[2][i] * 0.977_792_221)
        .collect();
    let mean = near.iter().sum::<f64>() / near.len() as f64;
    assert!((mean - v).abs() < 5.0, "{mean} {v}");
    assert!((at(seen(BASE, 40.0, 1.0, 0.0)).0 - v - 40.0).abs() < 1e-9);
}
