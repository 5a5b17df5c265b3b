//! The rate at which stars leave the progenitor: weights of release times, and exact derivatives.

use crate::haloes::{THETA, likelihood_is_that_of, small};
use oblate::params::{PriorSettings, QRange, StreamParams, StreamPrior};
use oblate::potential::{Galaxy, HaloKind};
use oblate::spray::SamplingScheme;
use oblate::stream::{
    MassLoss, Model, ModelSettings, Particles, ProgenitorSolution, ReleaseRate, System,
};
use oblate::track::{BinEdges, Track};
use oblate::units::KM_S_IN_KPC_PER_GYR;

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

/// The numbers of a track are sums and means by weight in its bins, here of particles that are not smeared, in hard bins; and release times
/// after the dissolution change nothing but the mean weight.
#[test]
fn tracks_are_means_by_weight() {
    let mut settings = with(ReleaseRate::Tidal, Some(MassLoss::Complete));
    settings.releases.sampling_scheme = SamplingScheme::Sobol;
    let model = Model::new(&settings).expect("a model");
    let all = model.stream(&params(1.5, 0.6)).expect("a stream");
    let track = |particles: &Particles| {
        Track::new(particles, 20.0, BinEdges::Hard, 1e-9)
            .expect("a track")
            .bins
    };
    let bins = track(&all);
    let weights: f64 = all.weights.iter().sum();
    assert!((weights - all.len() as f64).abs() < 1e-9);
    // Mean radius, width and velocity of a bin by these weights.
    let by_hand = |bin: i64, weight: &dyn Fn(usize) -> f64| {
        let inside = |i: &usize| (all.angle(*i).to_degrees() / 20.0).floor() as i64 == bin;
        let mean = |of: &dyn Fn(usize) -> f64| {
            let inside = (0..all.len()).filter(inside);
            let (sum, n) = inside.fold((0.0, 0.0), |(sum, n), i| {
                (sum + weight(i) * of(i), n + weight(i))
            });
            (sum / n, n)
        };
        let r = |i: usize| all.x[i].hypot(all.y[i]);
        let (mean_r, n) = mean(&r);
        let (variance, _) = mean(&|i| (r(i) - mean_r).powi(2));
        let (v, _) = mean(&|i| -all.v[2][i] / KM_S_IN_KPC_PER_GYR);
        [n, mean_r, variance.sqrt(), v]
    };
    let mut without = 0.0_f64;
    for bin in &bins {
        let ours = [bin.n, bin.r_kpc, bin.width_kpc, bin.v_km_s];
        let exact = by_hand(bin.bin, &|i| all.weight(i));
        for (ours, exact) in ours.iter().zip(exact) {
            assert!(
                (ours - exact).abs() < 1e-5 * exact.abs().max(1.0),
                "{bin:?} {exact}"
            );
        }
        let unweighted = by_hand(bin.bin, &|_| 1.0)[1];
        without = without.max((unweighted / bin.r_kpc - 1.0).abs());
    }
    // Means without weights are others.
    assert!(
        bins.len() >= 8 && without > 0.05,
        "{} {without}",
        bins.len()
    );
    let released = all.weights.iter().take_while(|w| **w > 0.0).count();
    assert!(released < all.len() && all.weights[released..].iter().all(|w| *w <= 0.0));
    let earlier = |column: &Vec<f64>| column[..released].to_vec();
    let alone = Particles {
        x: earlier(&all.x),
        y: earlier(&all.y),
        z: earlier(&all.z),
        v: all.v.each_ref().map(earlier),
        winding_numbers: earlier(&all.winding_numbers),
        weights: earlier(&all.weights),
        ..Particles::default()
    };
    let alone = track(&alone);
    assert_eq!(alone.len(), bins.len());
    for (a, b) in alone.iter().zip(&bins) {
        assert_eq!(a.bin, b.bin);
        assert!((a.r_kpc / b.r_kpc - 1.0).abs() < 1e-12, "{a:?} {b:?}");
        assert!((a.n / b.n - 1.0).abs() < 1e-12, "{a:?} {b:?}");
    }
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
