//! The parameters of the observation: what each does to ln L, and its gradients by them.

use super::*;

/// A likelihood with asymmetric errors, of the track at [`BASE`].
fn likelihood(settings: &LikelihoodSettings) -> StreamLikelihood {
    let of_track = likelihood_at(&BASE, &model(small()), settings).expect("a stream");
    let data: Vec<DataBin> = of_track
        .track()
        .data()
        .map(|d| DataBin {
            r_err_hi_kpc: 1.7 * d.r_err_lo_kpc,
            ..*d
        })
        .collect();
    with_data(&of_track, settings, &data)
}

/// The same model with other data.
fn with_data(
    likelihood: &StreamLikelihood,
    settings: &LikelihoodSettings,
    data: &[DataBin],
) -> StreamLikelihood {
    let model = likelihood.model().clone();
    let releases = model.settings().releases;
    let track = TrackLikelihood::new(settings, 10.0, data, &releases).expect("a track");
    StreamLikelihood::new(model, track, Q)
}

fn changed(likelihood: &StreamLikelihood, change: impl Fn(DataBin) -> DataBin) -> StreamLikelihood {
    let data: Vec<DataBin> = likelihood.track().data().map(|d| change(*d)).collect();
    with_data(likelihood, &LikelihoodSettings::default(), &data)
}

/// [`BASE`] with these optional parameters.
fn observed(jitter: f64, distance_factor: f64, phi0_deg: f64) -> Theta {
    let mut params = StreamParams::from_array(BASE);
    params.jitter = jitter;
    params.distance_factor = distance_factor;
    params.phi0_deg = phi0_deg;
    params.to_array()
}

fn value(likelihood: &StreamLikelihood, theta: &Theta) -> f64 {
    let evaluation = likelihood.ln_likelihood(theta);
    evaluation.expect("a likelihood").ln_likelihood
}

#[test]
fn jitter_does_what_larger_errors_do() {
    let plain = likelihood(&LikelihoodSettings::default());
    let jitter = 0.03;
    let larger = changed(&plain, |d| DataBin {
        r_err_lo_kpc: d.r_err_lo_kpc.hypot(jitter * d.r_kpc),
        r_err_hi_kpc: d.r_err_hi_kpc.hypot(jitter * d.r_kpc),
        ..d
    });
    // Partly covered bins too.
    for turn in [0.0, 2.5, 8.0] {
        let (a, b) = (
            value(&plain, &observed(jitter, 1.0, turn)),
            value(&larger, &observed(0.0, 1.0, turn)),
        );
        assert!((a - b).abs() < 1e-9 * a.abs(), "{turn}: {a} {b}");
        assert!((a - value(&plain, &observed(0.0, 1.0, turn))).abs() > 0.1);
    }
}

#[test]
fn data_converted_with_another_distance_have_its_factor() {
    let truth = likelihood(&LikelihoodSettings::default());
    // The distance was taken too small by ten per cent, with which all radii and errors scale.
    let factor = 1.1;
    let converted = changed(&truth, |d| DataBin {
        r_kpc: d.r_kpc / factor,
        r_err_lo_kpc: d.r_err_lo_kpc / factor,
        r_err_hi_kpc: d.r_err_hi_kpc / factor,
        ..d
    });
    // A density of the data as they are given: each radius is a smaller number.
    let expected = value(&truth, &BASE) + truth.track().data().count() as f64 * factor.ln();
    let here = value(&converted, &observed(0.0, factor, 0.0));
    assert!(
        (here - expected).abs() < 1e-9 * here.abs(),
        "{here} {expected}"
    );
    // Among all factors the right one is the likeliest, to the noise of the data.
    let at = |factor: f64| value(&converted, &observed(0.0, factor, 0.0));
    let best = (800..1_400)
        .map(|k| 1e-3 * f64::from(k))
        .max_by(|a, b| at(*a).total_cmp(&at(*b)));
    let best = best.expect("a maximum");
    assert!((best / factor - 1.0).abs() < 0.02, "{best}");
    assert!(at(best) > at(1.0) + 20.0);
}

#[test]
fn data_that_are_turned_have_the_angle_as_phi0() {
    let plain = likelihood(&LikelihoodSettings::default());
    let turned = changed(&plain, |d| DataBin {
        bin: d.bin + 3,
        ..d
    });
    let (a, b) = (
        value(&plain, &BASE),
        value(&turned, &observed(0.0, 1.0, 30.0)),
    );
    assert!((a - b).abs() < 1e-9 * a.abs(), "{a} {b}");
    assert!(value(&turned, &BASE) < a - 10.0);
    // By a fraction of a bin.
    let offset = plain.track().clone().with_offset_deg(4.0);
    let offset = StreamLikelihood::new(plain.model().clone(), offset.expect("an offset"), Q);
    let b = value(&offset, &observed(0.0, 1.0, 4.0));
    assert!((a - b).abs() < 1e-9 * a.abs(), "{a} {b}");
}

#[test]
fn a_track_is_given_as_it_would_be_measured() {
    let likelihood = likelihood(&LikelihoodSettings::default());
    let track = |theta: Theta| {
        let params = StreamParams::from_array(theta);
        likelihood.track_at(&params).expect("a track").0
    };
    let (plain, seen) = (track(BASE), track(observed(0.02, 1.25, 20.0)));
    assert!(plain.bins.len() > 5);
    for bin in &plain.bins {
        let same = seen.bins.iter().find(|b| b.bin == bin.bin + 2);
        let same = same.expect("a bin");
        assert!((same.phi_deg - bin.phi_deg - 20.0).abs() < 1e-9);
        assert!((1.25 * same.r_kpc / bin.r_kpc - 1.0).abs() < 1e-12);
        assert!((1.25 * same.r_err_kpc / bin.r_err_kpc - 1.0).abs() < 1e-6);
    }
}

#[test]
fn gradients_by_the_observation_match_duals_and_central_differences() {
    let hard = LikelihoodSettings {
        edges: BinEdges::Hard,
        coverage: Coverage::Reject,
        min_fraction: 0.0,
        ..LikelihoodSettings::default()
    };
    for (settings, theta) in [
        (LikelihoodSettings::default(), BASE),
        (LikelihoodSettings::default(), observed(0.02, 1.04, 1.5)),
        // Some bins are not covered.
        (LikelihoodSettings::default(), observed(0.3, 0.9, -17.0)),
        (hard, observed(0.02, 1.04, 0.3)),
    ] {
        let likelihood = likelihood(&settings);
        let (_, fast) = likelihood.gradient(&theta).expect("a gradient");
        let (_, slow) = gradient_by_duals(&likelihood, &theta).expect("a gradient");
        for (i, (a, b)) in fast.iter().zip(&slow).enumerate() {
            assert!(
                (a - b).abs() < 1e-9 * largest(&slow),
                "{i}: {fast:?} {slow:?}"
            );
        }
        let truncated = likelihood.truncated_gradient(&theta).expect("a gradient").1;
        // At an absent jitter ln L has a minimum or a maximum; with hard edges it has steps in phi0.
        for (name, step) in [
            ("jitter", 1e-5),
            ("distance_factor", 1e-6),
            ("phi0_deg", 1e-4),
        ] {
            let i = index_of(name).expect("a parameter");
            assert_eq!(truncated[i].to_bits(), fast[i].to_bits());
            if name == "phi0_deg" && settings.edges == BinEdges::Hard {
                continue;
            }
            matches_differences(&likelihood, &theta, (name, step), fast[i]);
        }
    }
}

#[test]
fn scaling_masses_velocities_and_age_leaves_observed_tracks_alone() {
    let likelihood = likelihood(&LikelihoodSettings::default());
    let theta = observed(0.02, 1.04, 1.5);
    let (a, b) = (
        value(&likelihood, &theta),
        value(&likelihood, &gradient::scaled(&theta, 1.7)),
    );
    assert!((a - b).abs() < 1e-9 * a.abs(), "{a} {b}");
}

#[test]
fn an_impossible_observation_is_a_counted_rejection() {
    let likelihood = likelihood(&LikelihoodSettings::default());
    for theta in [
        observed(-1e-9, 1.0, 0.0),
        observed(f64::INFINITY, 1.0, 0.0),
        observed(0.0, 0.0, 0.0),
        observed(0.0, -1.0, 0.0),
        observed(0.0, 1.0, 1e300),
    ] {
        assert_eq!(
            likelihood.ln_likelihood(&theta),
            Err(Rejection::BadParameter)
        );
        let gradient = likelihood.gradient(&theta).map(|(value, _)| value);
        assert_eq!(gradient, Err(Rejection::BadParameter));
        let params = StreamParams::from_array(theta);
        assert!(likelihood.track_at(&params).is_err());
        assert!(likelihood.ln_likelihood_on::<Nfw, _>(&params).is_err());
    }
    // Far out, but possible: finite, or a rejection by name.
    for theta in [
        observed(1e200, 1.0, 0.0),
        observed(0.0, 1e-300, 0.0),
        observed(0.0, 1e300, 7_000.0),
    ] {
        if let Ok(evaluation) = likelihood.ln_likelihood(&theta) {
            assert!(evaluation.ln_likelihood.is_finite());
        }
    }
}
