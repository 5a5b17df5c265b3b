//! A halo that stands in one file outside this crate: its stream, and the gradient of its likelihood.

use oblate::likelihood::{DataBin, LikelihoodSettings, StreamLikelihood, TrackLikelihood};
use oblate::params::{DIM, QRange, StreamParams, without_optional};
use oblate::scalar::{gradient_of, lift};
use oblate::stream::{Model, ModelSettings, Precision, System};

#[path = "../../examples/own_halo.rs"]
mod example;

use example::NfwWithDisc;

const THETA: [f64; DIM] = without_optional([
    12.0, 15.0, 0.3, 0.0, 1.2, 8.0, 1.0, 60.0, 30.0, 30.0, 140.0, 45.0, 3.0,
]);

#[test]
fn a_likelihood_in_an_own_halo_has_an_exact_gradient() {
    let mut settings = ModelSettings::default();
    settings.releases.particles = 256;
    settings.precision = Precision::Double;
    let model = Model::new(&settings).unwrap();
    let system =
        System::<f64, NfwWithDisc>::with_halo(&StreamParams::from_array(THETA), QRange::default());
    let with_disc = model.stream_of(&system).unwrap().track(10.0).unwrap();
    let without = model
        .stream(&StreamParams::from_array(THETA))
        .unwrap()
        .track(10.0)
        .unwrap();
    assert_ne!(with_disc, without);

    let data: Vec<DataBin> = with_disc
        .bins
        .iter()
        .enumerate()
        .map(|(i, bin)| {
            DataBin::symmetric(
                bin.bin,
                bin.r_kpc * (1.0 + 0.03 * (i as f64).sin()),
                0.02 * bin.r_kpc,
            )
        })
        .collect();
    let track = TrackLikelihood::new(
        &LikelihoodSettings::default(),
        10.0,
        &data,
        &settings.releases,
    )
    .unwrap();
    let likelihood = StreamLikelihood::with_halo(model, &NfwWithDisc, track, QRange::default());
    let (value, gradient) = likelihood.gradient(&THETA).unwrap();
    let alone = likelihood.ln_likelihood(&THETA).unwrap();
    assert!((value.ln_likelihood - alone.ln_likelihood).abs() < 1e-12 * alone.ln_likelihood.abs());
    let by_duals = gradient_of(
        &likelihood
            .ln_likelihood_on::<NfwWithDisc, _>(&StreamParams::from_array(lift(&THETA)))
            .unwrap(),
    );
    // Rounding differs between lanes with fused operations and duals: 1e-9 is the bound of the other gradient tests on regular
    // streams, relative to each component.
    for (k, (ours, reference)) in gradient.iter().zip(by_duals).enumerate() {
        assert!(
            (ours - reference).abs() <= 1e-9 * reference.abs().max(1.0),
            "{k}: {ours} {reference}"
        );
    }
}
