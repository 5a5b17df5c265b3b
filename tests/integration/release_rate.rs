//! The rate at which stars leave the progenitor: weights of release times, and exact derivatives.

use crate::haloes::{THETA, likelihood_is_that_of, small};
use oblate::params::{PriorSettings, QRange, StreamParams, StreamPrior};
use oblate::potential::{Galaxy, HaloKind};
use oblate::stream::{MassLoss, Model, ModelSettings, ProgenitorSolution, ReleaseRate, System};

fn with(rate: ReleaseRate, mass_loss: Option<MassLoss>) -> ModelSettings {
    ModelSettings {
        release_rate: rate,
        mass_loss,
        ..small(HaloKind::Nfw)
    }
}

fn params(peaking: f64, dissolved_at: f64) -> StreamParams<f64> {
    let mut params = StreamParams::from_array(THETA);
    params.release_peaking = peaking;
    params.dissolved_at = dissolved_at;
    params
}

fn solution(
    settings: &ModelSettings,
    params: &StreamParams<f64>,
) -> ProgenitorSolution<f64, Galaxy> {
    let system = System::with_host(params, QRange::default(), settings);
    let model = Model::new(settings).expect("a model");
    model.progenitor_solution(&system).expect("a solution")
}

fn mean(weights: &[f64]) -> f64 {
    weights.iter().sum::<f64>() / weights.len() as f64
}

/// With the power 1 the weight is the frequency at the tidal radius, `(G m / r_j^3)^(1/2)`, which is highest at pericentres.
#[test]
fn the_tidal_rate_follows_the_tidal_radius() {
    let settings = with(ReleaseRate::Tidal, None);
    for power in [0.7, 1.0, 2.0] {
        let releases = solution(&settings, &params(power, 1.0)).releases;
        assert!((mean(&releases.weights) - 1.0).abs() < 1e-12);
        let squares: Vec<f64> = releases.weights.iter().map(|w| w * w).collect();
        assert!((releases.mean_square_weight - mean(&squares)).abs() < 1e-12);
        assert!(releases.mean_square_weight > 1.01);
        let product = |k: usize| {
            let r_j = releases.frames[k].position[0].norm2().sqrt();
            releases.weights[k] * r_j.powf(1.5 * power)
        };
        for k in 1..releases.weights.len() {
            assert!((product(k) / product(0) - 1.0).abs() < 1e-9, "{power} {k}");
        }
    }
    let even = solution(&settings, &params(0.0, 1.0)).releases;
    assert!(
        even.weights
            .iter()
            .all(|weight| (weight - 1.0).abs() < 1e-12)
    );
}

/// Stars leave at an even rate until nothing is left: the weights are as long as that is.
#[test]
fn stars_leave_until_nothing_is_left() {
    let settings = with(ReleaseRate::Even, Some(MassLoss::Complete));
    for dissolved_at in [0.3, 0.55, 1.0] {
        let weights = solution(&settings, &params(0.0, dissolved_at))
            .releases
            .weights;
        let count = weights.len() as f64;
        for (k, weight) in weights.iter().enumerate() {
            let before = (dissolved_at * count - k as f64).clamp(0.0, 1.0);
            assert!(
                (weight - before / dissolved_at).abs() < 1e-12,
                "{dissolved_at} {k}"
            );
        }
    }
}

/// Radii of a bin are means by weight: with the release times after the dissolution left out they are those of the earlier ones alone.
#[test]
fn tracks_are_means_by_weight() {
    let settings = with(ReleaseRate::Tidal, Some(MassLoss::Complete));
    let params = params(1.5, 0.6);
    let particles = Model::new(&settings).expect("a model").stream(&params);
    let particles = particles.expect("a stream");
    let track = particles.track(120.0).expect("a track");
    let total: f64 = track.bins.iter().map(|bin| bin.n).sum();
    let all: f64 = (0..particles.len()).map(|i| particles.weight(i)).sum();
    assert!((all - particles.len() as f64).abs() < 1e-9);
    assert!((total - all).abs() < 0.05 * all, "{total} {all}");
    let sum_of = |number: &dyn Fn(usize) -> f64| {
        (0..particles.len())
            .map(|i| particles.weight(i) * number(i))
            .sum::<f64>()
    };
    let radius = |i: usize| particles.x[i].hypot(particles.y[i]);
    let by_bins: f64 = track.bins.iter().map(|bin| bin.n * bin.r_kpc).sum::<f64>() / total;
    let by_hand = sum_of(&radius) / all;
    assert!(
        (by_bins / by_hand - 1.0).abs() < 0.02,
        "{by_bins} {by_hand}"
    );
}

#[test]
fn gradients_with_weights_are_exact() {
    for (rate, law) in [
        (ReleaseRate::Tidal, None),
        (ReleaseRate::Tidal, Some(MassLoss::Linear)),
        (ReleaseRate::Tidal, Some(MassLoss::Complete)),
        (ReleaseRate::Even, Some(MassLoss::Complete)),
    ] {
        likelihood_is_that_of::<Galaxy>(&with(rate, law), &params(1.3, 0.61).to_array());
    }
}

#[test]
fn the_power_belongs_to_the_tidal_rate() {
    let prior = |power: Option<f64>| {
        let mut settings = PriorSettings::default();
        settings.fixed.release_peaking = power;
        StreamPrior::new(&settings).expect("a prior")
    };
    for (rate, power, words) in [
        (ReleaseRate::Tidal, None, "prior.fixed.release_peaking"),
        (ReleaseRate::Even, Some(1.0), "model.release_rate"),
    ] {
        let refused = with(rate, None).check_prior(&prior(power));
        let error = refused.expect_err("refused").to_string();
        assert!(error.contains(words), "{error}");
    }
    with(ReleaseRate::Tidal, None)
        .check_prior(&prior(Some(1.0)))
        .expect("accepted");
    let text = with(ReleaseRate::Tidal, None).host_in_words();
    assert!(text.contains("tidal rate"), "{text}");
}
