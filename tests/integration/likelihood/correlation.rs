//! Correlated errors: the same density as that of a multivariate normal, and its gradient.

use super::*;
use nalgebra::{DMatrix, DVector};
use oblate_samplers::normal::LN_SQRT_2PI;

const ERRORS: ErrorCorrelation = ErrorCorrelation {
    angle_deg: 25.0,
    fraction: 0.7,
};

/// A default likelihood with correlated errors.
fn settings(error_correlation: Option<ErrorCorrelation>) -> LikelihoodSettings {
    LikelihoodSettings {
        error_correlation,
        ..LikelihoodSettings::default()
    }
}

/// Data with a gap, and of each bin of the grid the weight, mean and scatter of a model.
fn case() -> (Vec<DataBin>, Vec<[f64; 3]>) {
    let bins = [-3, -2, -1, 1, 2, 5];
    let data = bins.map(|bin| DataBin::symmetric(bin, 50.0 + bin as f64, 1.0 + 0.1 * bin as f64));
    let model = (-3..=5).map(|bin| {
        let bin = f64::from(bin);
        [100.0 + 7.0 * bin, 51.0 + bin + (3.0 * bin).sin(), 4.0]
    });
    (data.to_vec(), model.collect())
}

fn sums(model: &[[f64; 3]]) -> Sums<f64> {
    Sums {
        weight: model.iter().map(|[n, ..]| *n).collect(),
        r: model.iter().map(|[n, r, _]| n * r).collect(),
        r2: model.iter().map(|[n, r, s]| n * (r * r + s * s)).collect(),
        ..Sums::default()
    }
}

fn track(data: &[DataBin], settings: &LikelihoodSettings) -> TrackLikelihood {
    let releases = TableSettings {
        particles: 1_000,
        ..TableSettings::default()
    };
    TrackLikelihood::new(settings, 10.0, data, &releases).expect("a track")
}

#[test]
fn ln_l_is_that_of_a_multivariate_normal() {
    let (data, model) = case();
    let observation = Observation {
        jitter: 0.01,
        ..Observation::default()
    };
    for errors in [
        ERRORS,
        ErrorCorrelation {
            angle_deg: 300.0,
            fraction: 1.0,
        },
        ErrorCorrelation {
            fraction: 0.0,
            ..ERRORS
        },
    ] {
        let track = track(&data, &settings(Some(errors)));
        let residual = DVector::from_fn(data.len(), |k, _| {
            model[(data[k].bin + 3) as usize][1] - data[k].r_kpc
        });
        let covariance = DMatrix::from_fn(data.len(), data.len(), |i, j| {
            let apart = 10.0 * (data[i].bin - data[j].bin).abs() as f64;
            let correlated = errors.fraction * (-apart / errors.angle_deg).exp();
            let product = data[i].r_err_lo_kpc * data[j].r_err_lo_kpc;
            let [n, _, scatter] = model[(data[i].bin + 3) as usize];
            // 0.35 is the error of smeared Sobol particles over that of random ones.
            let alone = (1.0 - errors.fraction) * product
                + (0.01 * data[i].r_kpc).powi(2)
                + 0.35 * scatter * scatter / n;
            correlated * product + if i == j { alone } else { 0.0 }
        });
        let cholesky = covariance.cholesky().expect("positive");
        let chi2 = residual.dot(&cholesky.solve(&residual));
        let expected =
            -0.5 * (chi2 + cholesky.determinant().ln()) - data.len() as f64 * LN_SQRT_2PI;
        let here = track.ln_likelihood(&sums(&model), &observation);
        let here = here.expect("finite");
        assert!((here - expected).abs() < 1e-9, "{here} {expected}");
        // The squares of the residuals are those of all bins together.
        let mut residuals = Vec::new();
        let done = track.residuals(&sums(&model), &observation, &mut residuals);
        done.expect("finite");
        let sum: f64 = residuals.iter().map(|r| r * r).sum();
        assert!((sum - chi2).abs() < 1e-9, "{sum} {chi2}");
        assert!(here < track.ln_likelihood_bound());
    }
}

#[test]
fn over_a_small_angle_errors_are_independent() {
    let (data, model) = case();
    let short = ErrorCorrelation {
        angle_deg: 0.1,
        fraction: 1.0,
    };
    let [a, b] = [Some(short), None].map(|errors| {
        let value =
            track(&data, &settings(errors)).ln_likelihood(&sums(&model), &Observation::default());
        value.expect("finite")
    });
    assert!((a - b).abs() < 1e-12 * a.abs(), "{a} {b}");
}

#[test]
fn a_bin_without_cover_says_nothing_about_the_others() {
    let (data, mut model) = case();
    let place = 4;
    model[place][0] = 0.0;
    let without: Vec<DataBin> = data.iter().copied().filter(|d| d.bin != 1).collect();
    let free = LikelihoodSettings {
        coverage: Coverage::Penalty {
            z_miss: 10.0,
            lambda: 0.0,
        },
        ..settings(Some(ERRORS))
    };
    let value = |data: &[DataBin], model: &[[f64; 3]]| {
        let value = track(data, &free).ln_likelihood(&sums(model), &Observation::default());
        value.expect("finite")
    };
    let missed = -50.0 - data[3].r_err_lo_kpc.ln() - LN_SQRT_2PI;
    let (a, b) = (value(&data, &model), value(&without, &model) + missed);
    assert!((a - b).abs() < 1e-9 * a.abs(), "{a} {b}");
    // In between ln L changes without a step.
    let steps: Vec<f64> = (0..=1_000)
        .map(|k| {
            model[place][0] = 0.01 * f64::from(k);
            value(&data, &model)
        })
        .collect();
    let largest = steps.windows(2).map(|w| (w[1] - w[0]).abs());
    let largest = largest.fold(0.0, f64::max);
    assert!(
        largest < 0.02 * (steps[1_000] - steps[0]).abs(),
        "{largest}"
    );
}

/// A model through the datum has no residual, however few of its particles are in the bin.
#[test]
fn a_bin_with_few_particles_has_their_mean() {
    let (data, mut model) = case();
    let place = 4;
    let datum = data[3];
    model[place] = [0.0, datum.r_kpc, 0.0];
    let track = track(&data, &settings(None));
    let value = |model: &[[f64; 3]]| {
        let value = track.ln_likelihood(&sums(model), &Observation::default());
        value.expect("finite")
    };
    let uncovered = value(&model);
    for part in [0.01, 0.1, 0.24, 0.26, 0.6, 1.0] {
        model[place][0] = part * track.threshold();
        let x = part;
        let cover = x * x * x * (x * (6.0 * x - 15.0) + 10.0);
        // A residual of 10 where the bin is missed; the penalty of the mean over six bins.
        let missing = (1.0 - cover) / 6.0;
        let expected = cover * 50.0 + 1_000.0 * (1.0 / 36.0 - missing * missing);
        let gained = value(&model) - uncovered;
        assert!(
            (gained - expected).abs() < 1e-9,
            "{part} {gained} {expected}"
        );
    }
}

#[test]
fn the_gradient_matches_duals_and_central_differences() {
    let settings = settings(Some(ERRORS));
    let likelihood = likelihood_at(&BASE, &model(small()), &settings).expect("a stream");
    let mut params = StreamParams::from_array(BASE);
    (params.jitter, params.distance_factor) = (0.01, 1.03);
    // In the second, bins at an end are covered in part.
    for phi0_deg in [1.5, -16.0] {
        params.phi0_deg = phi0_deg;
        let theta = params.to_array();
        let (value, fast) = likelihood.gradient(&theta).expect("a gradient");
        assert_eq!(likelihood.ln_likelihood(&theta), Ok(value));
        let (_, slow) = gradient_by_duals(&likelihood, &theta).expect("a gradient");
        for (a, b) in fast.iter().zip(&slow) {
            assert!((a - b).abs() < 1e-9 * largest(&slow), "{fast:?} {slow:?}");
        }
        for (name, step) in [
            ("r_s_halo_kpc", 1e-4),
            ("jitter", 1e-6),
            ("distance_factor", 1e-6),
            ("phi0_deg", 1e-5),
        ] {
            let i = index_of(name).expect("a parameter");
            matches_differences(&likelihood, &theta, (name, step), fast[i]);
        }
    }
}

#[test]
fn correlated_errors_that_differ_to_both_sides_are_refused() {
    let (mut data, _) = case();
    data[2].r_err_hi_kpc = 9.0;
    let releases = TableSettings::default();
    let error = TrackLikelihood::new(&settings(Some(ERRORS)), 10.0, &data, &releases);
    let text = error.expect_err("no normal").to_string();
    assert!(text.contains("likelihood.error_correlation") && text.contains("r_err"));
}
