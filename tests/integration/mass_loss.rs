//! Progenitors that lose mass: releases and forces by the law, and exact derivatives.

use crate::haloes::{THETA, likelihood_is_that_of, small};
use oblate::params::{PriorSettings, QRange, StreamParams, StreamPrior};
use oblate::potential::{
    Galaxy, HaloKind, MassFraction, Nfw, Plummer, PlummerCotangent, Potential,
};
use oblate::scalar::{Dual, Real, Vec3, gradient_of, lift};
use oblate::stream::{
    MassLoss, Model, ModelSettings, ProgenitorSolution, StepRule, StepsPer, System,
};

const LAWS: [MassLoss; 2] = [MassLoss::Linear, MassLoss::Exponential];

fn with(law: Option<MassLoss>) -> ModelSettings {
    ModelSettings {
        mass_loss: law,
        ..small(HaloKind::Nfw)
    }
}

fn left(fraction: f64) -> StreamParams<f64> {
    let mut params = StreamParams::from_array(THETA);
    params.m_prog_left = fraction;
    params
}

fn solution(law: Option<MassLoss>, fraction: f64) -> ProgenitorSolution<f64, Galaxy> {
    let settings = with(law);
    let system = System::with_host(&left(fraction), QRange::default(), &settings);
    let model = Model::new(&settings).expect("a model");
    model.progenitor_solution(&system).expect("a solution")
}

/// The tidal radius, in which offsets are measured, is in proportion to the root of third order of the mass.
#[test]
fn offsets_of_releases_follow_the_mass() {
    let whole = solution(None, 1.0);
    let taus = Model::new(&with(None))
        .expect("a model")
        .table()
        .taus
        .clone();
    assert!(taus.len() > 4, "{taus:?}");
    for law in LAWS {
        let lost = solution(Some(law), 0.2);
        for ((tau, lost), whole) in
            (taus.iter().zip(&lost.release_frames)).zip(&whole.release_frames)
        {
            let fraction = match law {
                MassLoss::Linear => 1.0 - 0.8 * (1.0 + tau),
                MassLoss::Exponential => 0.2_f64.powf(1.0 + tau),
            };
            let lengths = [lost, whole].map(|frame| frame.position[0].norm2().sqrt());
            let ratio = lengths[0] / lengths[1];
            assert!(
                (ratio / fraction.cbrt() - 1.0).abs() < 1e-9,
                "{law:?} {tau}"
            );
            assert_eq!(lost.state.x, whole.state.x);
        }
    }
}

/// The kernels of a halo alone have a constant mass, and so have its releases.
#[test]
fn a_host_that_is_no_galaxy_loses_no_mass() {
    let settings = with(Some(MassLoss::Linear));
    let system = System::<f64, Nfw>::with_host(&left(0.2), QRange::default(), &settings);
    let model = Model::new(&settings).expect("a model");
    let ours = model.progenitor_solution(&system).expect("a solution");
    for (ours, whole) in (ours.release_frames.iter()).zip(&solution(None, 1.0).release_frames) {
        let lengths = [ours, whole].map(|frame| frame.position[0].norm2().sqrt());
        assert!((lengths[0] / lengths[1] - 1.0).abs() < 1e-9);
    }
}

#[test]
fn a_fraction_of_the_mass_has_this_fraction_of_the_force() {
    let progenitor = Plummer {
        mass: 3e8,
        r_s: 1.3,
    };
    let (x, lambda) = ([0.7, -1.1, 2.0], Vec3::new(0.3, -1.1, 0.7));
    let (value, slope) = (0.4, 0.7);
    let by_hand = progenitor.acceleration(Vec3::from(x)) * value;
    let of = progenitor.add_acceleration(value, Vec3::from(x), Vec3::zero());
    assert!((of - by_hand).norm2() < 1e-24 * by_hand.norm2());
    let mut cotangent = PlummerCotangent::zero();
    let fraction = MassFraction { value, slope };
    let (a, x_bar) = progenitor.vjp_of(fraction, Vec3::from(x), lambda, &mut cotangent);
    assert!((a - by_hand).norm2() < 1e-24 * by_hand.norm2());
    // With the fraction as a function of what is left, whose derivative is the slope.
    let v: [Dual<6>; 6] = lift(&[x[0], x[1], x[2], 0.0, 1.3, 0.0]);
    let dual = Plummer {
        mass: v[3].exp() * 3e8,
        r_s: v[4],
    };
    let a = dual.acceleration(Vec3::new(v[0], v[1], v[2])) * (v[5] * slope + value);
    let slopes = gradient_of(&a.dot(Vec3::from_f64(lambda)));
    let ours = [
        x_bar.x,
        x_bar.y,
        x_bar.z,
        cotangent.ln_mass,
        cotangent.r_s,
        cotangent.mass_left,
    ];
    for (ours, dual) in ours.iter().zip(slopes) {
        assert!((ours - dual).abs() < 1e-12 * dual.abs(), "{ours} {dual}");
    }
}

#[test]
fn a_progenitor_with_all_its_mass_left_loses_none() {
    let stream = |law: Option<MassLoss>, fraction: f64| {
        let model = Model::new(&ModelSettings {
            halo: HaloKind::Logarithmic,
            ..with(law)
        });
        let particles = model.expect("a model").stream(&left(fraction));
        particles.expect("a stream").x
    };
    for law in LAWS {
        assert_eq!(stream(Some(law), 1.0), stream(None, 1.0));
        assert_ne!(stream(Some(law), 0.5), stream(None, 1.0));
    }
}

#[test]
fn gradients_with_mass_loss_are_exact() {
    for law in LAWS {
        let adaptive = with(Some(law));
        let uniform = ModelSettings {
            step_rule: StepRule::Uniform,
            steps: 40,
            steps_per: StepsPer::Particle,
            ..adaptive
        };
        for settings in [adaptive, uniform] {
            likelihood_is_that_of::<Galaxy>(&settings, &left(0.3).to_array());
        }
    }
}

#[test]
fn what_is_left_belongs_to_a_law() {
    let prior = |fraction: Option<f64>| {
        let mut settings = PriorSettings::default();
        settings.fixed.m_prog_left = fraction;
        StreamPrior::new(&settings).expect("a prior")
    };
    for (law, fraction, words) in [
        (Some(MassLoss::Linear), None, "prior.fixed.m_prog_left"),
        (None, Some(0.5), "model.mass_loss"),
    ] {
        let refused = with(law).check_prior(&prior(fraction));
        let error = refused.expect_err("refused").to_string();
        assert!(error.contains(words), "{error}");
    }
    for (law, fraction) in [(None, None), (Some(MassLoss::Linear), Some(0.5))] {
        with(law).check_prior(&prior(fraction)).expect("accepted");
    }
    assert!(!with(None).has_host_of(&with(Some(MassLoss::Linear))));
    let text = with(Some(MassLoss::Exponential)).host_in_words();
    assert!(text.contains("losing mass exponentially"), "{text}");
}
