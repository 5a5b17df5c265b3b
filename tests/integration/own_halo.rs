//! A halo that stands in one file outside this crate: its stream, and the gradient of its likelihood.

use crate::haloes::{THETA, has_an_exact_gradient, near, small};
use oblate::likelihood::StreamLikelihood;
use oblate::params::{QRange, StreamParams};
use oblate::potential::HaloKind;
use oblate::stream::{Model, System};

#[path = "../../examples/own_halo.rs"]
mod example;

use example::NfwWithDisc;

#[test]
fn a_likelihood_in_an_own_halo_has_an_exact_gradient() {
    let settings = small(HaloKind::Nfw);
    let model = Model::new(&settings).unwrap();
    let params = StreamParams::from_array(THETA);
    let system = System::<f64, NfwWithDisc>::with_host(&params, QRange::default(), &settings);
    let with_disc = model.stream_of(&system).unwrap().track(10.0).unwrap();
    let without = model.stream(&params).unwrap().track(10.0).unwrap();
    assert_ne!(with_disc, without);
    let track = near(&with_disc, &settings);
    let likelihood = StreamLikelihood::with_host(model, &NfwWithDisc, track, QRange::default());
    has_an_exact_gradient::<NfwWithDisc>(&likelihood, &THETA);
}
