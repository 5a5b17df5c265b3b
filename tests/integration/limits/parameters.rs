//! The ranges of parameters, and the likelihood at their ends.

use super::rows;
use oblate::Error;
use oblate::likelihood::{DataBin, LikelihoodSettings, StreamLikelihood, TrackLikelihood};
use oblate::params::{DIM, NAMES, PARAMETERS, PriorSettings, QRange};
use oblate::potential::log10_m200;
use oblate::samplers::Marginal;
use oblate::samplers::limits::OutOfRange;
use oblate::stream::{Model, ModelSettings};
use proptest::prelude::*;
use proptest::test_runner::TestRunner;
use std::cell::Cell;

#[test]
fn the_ranges_of_parameters_are_those_of_the_page() {
    let rows = rows("2. Parameters");
    assert_eq!(rows.len(), NAMES.len());
    for (row, parameter) in rows.iter().zip(&PARAMETERS) {
        assert_eq!(row.key, parameter.name);
        assert_eq!(row.lo..=row.hi, parameter.range, "{}", row.key);
    }
    let out_of_range = |settings: &PriorSettings| match settings.check() {
        Err(Error::OutOfRange(OutOfRange { key, .. })) => Some(key),
        _ => None,
    };
    for (i, parameter) in PARAMETERS.iter().enumerate() {
        let name = parameter.name;
        let (lo, hi) = (*parameter.range.start(), *parameter.range.end());
        let fixed = |value: f64| {
            let mut settings = PriorSettings::default();
            settings.fix(name, value).expect("a parameter");
            out_of_range(&settings)
        };
        let free = |marginal: Marginal| {
            let mut settings = PriorSettings::default();
            *settings.marginals.get_mut(i).expect("a parameter") = Some(marginal);
            out_of_range(&settings)
        };
        for end in [lo, hi] {
            assert_eq!(fixed(end), None);
            assert_eq!(
                free(Marginal::Normal {
                    mean: end,
                    sd: 1e-3
                }),
                None
            );
        }
        assert_eq!(free(Marginal::Uniform { lo, hi }), None);
        assert_eq!(free(Marginal::HalfNormal { sd: hi - lo }), None);
        let key = |part: &str| Some(format!("prior.marginals.{name}.{part}"));
        for wrong in [lo.next_down(), hi.next_up(), f64::NAN, f64::INFINITY] {
            assert_eq!(fixed(wrong), Some(format!("prior.fixed.{name}")));
            assert_eq!(free(Marginal::Uniform { lo: wrong, hi }), key("lo"));
            assert_eq!(free(Marginal::Uniform { lo, hi: wrong }), key("hi"));
            assert_eq!(
                free(Marginal::Normal {
                    mean: wrong,
                    sd: 1.0
                }),
                key("mean")
            );
        }
        for sd in [0.0, -1.0, f64::NAN, (hi - lo).next_up(), f64::INFINITY] {
            assert_eq!(free(Marginal::HalfNormal { sd }), key("sd"));
        }
    }
}

#[test]
fn at_the_ends_of_all_ranges_a_point_has_a_likelihood_or_a_cause() {
    let points = (
        prop::array::uniform30(0.0_f64..=1.0),
        prop::array::uniform30(0..4),
    );
    let (values, gradients) = (Cell::new(0), Cell::new(0));
    let mut runner = TestRunner::new(ProptestConfig {
        failure_persistence: None,
        ..ProptestConfig::with_cases(64)
    });
    let found = runner.run(&points, |(ends, corners)| {
        let params: [f64; DIM] = std::array::from_fn(|i| {
            let (lo, hi) = (*PARAMETERS[i].range.start(), *PARAMETERS[i].range.end());
            match corners[i] {
                0 => lo,
                1 => hi,
                _ => lo + (hi - lo) * ends[i],
            }
        });
        let mut settings = ModelSettings::default();
        settings.releases.particles = 64;
        let data = [-1, 0, 1].map(|bin| DataBin::symmetric(bin, 60.0, 1e-9));
        let model = Model::new(&settings).unwrap();
        let track = TrackLikelihood::new(
            &LikelihoodSettings::default(),
            10.0,
            &data,
            &settings.releases,
        )
        .unwrap();
        let likelihood = StreamLikelihood::new(model, track, QRange::default());
        if let Ok(value) = likelihood.ln_likelihood(&params) {
            values.set(values.get() + 1);
            prop_assert!(value.ln_likelihood.is_finite());
        }
        if let Ok((value, gradient)) = likelihood.gradient(&params) {
            gradients.set(gradients.get() + 1);
            prop_assert!(value.ln_likelihood.is_finite());
            prop_assert!(gradient.iter().all(|g| g.is_finite()));
        }
        prop_assert!(log10_m200(params[0], params[1]).is_finite());
        Ok(())
    });
    found.unwrap_or_else(|error| panic!("{error}"));
    // Of half of the points the progenitor is on the side of the sky that is rejected; nearly all others have a likelihood.
    assert!(values.get() >= 16, "{} values", values.get());
    assert!(gradients.get() >= 16, "{} gradients", gradients.get());
}
