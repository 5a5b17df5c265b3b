//! Progenitors that lose mass: releases and forces by the law, and exact derivatives.

use crate::golden::{cases, json, number, numbers};
use crate::haloes::{THETA, likelihood_is_that_of, small};
use oblate::orbit::State;
use oblate::params::{PriorSettings, QRange, StreamParams, StreamPrior};
use oblate::potential::{
    Baryons, Galaxy, Halo, HaloKind, Host, HostParts, MassFraction, Nfw, Plummer, PlummerCotangent,
    Potential,
};
use oblate::scalar::{Dual, Real, Vec3, gradient_of, lift};
use oblate::spray::TableSettings;
use oblate::stream::{
    MassLoss, Model, ModelSettings, ProgenitorSolution, StepRule, StepsPer, System,
};
use oblate::units::G;

const LAWS: [MassLoss; 3] = [MassLoss::Linear, MassLoss::Exponential, MassLoss::Complete];

fn with(law: Option<MassLoss>) -> ModelSettings {
    ModelSettings {
        mass_loss: law,
        ..small(HaloKind::Nfw)
    }
}

/// Parameters with this fraction of the mass left, and this fraction of the age until nothing is.
fn left(fraction: f64) -> StreamParams<f64> {
    let mut params = StreamParams::from_array(THETA);
    params.m_prog_left = fraction;
    params.dissolved_at = fraction;
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
    let count = taus.len() as f64;
    // An interval of release times ends with the progenitor, or the progenitor within its first half.
    let within = (count - 2.0 + 0.3) / count;
    for (law, left) in LAWS.into_iter().flat_map(|law| [(law, 0.2), (law, within)]) {
        let lost = solution(Some(law), left);
        let frames = lost.releases.frames.iter().zip(&whole.releases.frames);
        for ((k, tau), (lost, whole)) in taus.iter().enumerate().zip(frames) {
            let end = (k as f64 + 1.0).min(left * count);
            let middle = 0.5 * (k as f64 + end) / count;
            // The tidal radius has a derivative at this fraction and not at zero.
            let fraction = match law {
                MassLoss::Complete => fraction(Some(law), left, middle - 1.0).max(1e-6),
                _ => fraction(Some(law), left, *tau),
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

/// The fraction of its mass that a progenitor has at a time from -1 at the first release to 0 today.
fn fraction(law: Option<MassLoss>, parameter: f64, tau: f64) -> f64 {
    let since = 1.0 + tau;
    match law {
        None => 1.0,
        Some(MassLoss::Linear) => 1.0 - (1.0 - parameter) * since,
        Some(MassLoss::Exponential) => parameter.powf(since),
        Some(MassLoss::Complete) => (1.0 - since / parameter).max(0.0),
    }
}

/// Positions and velocities of progenitor and particle.
type Pair = [Vec3<f64>; 4];

/// Their derivatives: the particle feels the host and a Plummer sphere of this mass.
fn derivative(system: &System<f64, Galaxy>, mass: f64, [x, v, p, w]: Pair) -> Pair {
    let apart = p - x;
    let cubed = (apart.norm2() + system.progenitor.r_s.powi(2)).powf(1.5);
    let own = apart * (-G * mass / cubed);
    let host = [x, p].map(|at| system.host.acceleration(at));
    [v, host[0], w, host[1] + own]
}

/// Where both are after the time from `from` to `to`, over the age, in equal steps of the classical Runge-Kutta method.
fn runge_kutta(
    system: &System<f64, Galaxy>,
    mass: impl Fn(f64) -> f64,
    mut pair: Pair,
    [from, to]: [f64; 2],
    steps: u32,
) -> Pair {
    let length = (to - from) / f64::from(steps);
    let h = length * system.age_gyr;
    let moved = |pair: Pair, slope: Pair, h: f64| -> Pair {
        std::array::from_fn(|i| pair[i].add_scaled(slope[i], h))
    };
    for step in 0..steps {
        let at = |part: f64| mass(from + length * (f64::from(step) + part));
        let a = derivative(system, at(0.0), pair);
        let b = derivative(system, at(0.5), moved(pair, a, 0.5 * h));
        let c = derivative(system, at(0.5), moved(pair, b, 0.5 * h));
        let d = derivative(system, at(1.0), moved(pair, c, h));
        for (slope, weight) in [(a, 1.0), (b, 2.0), (c, 2.0), (d, 1.0)] {
            pair = moved(pair, slope, h * weight / 6.0);
        }
    }
    pair
}

/// Particles that were released early, by a Runge-Kutta method of the test's own with every law written out, at the accuracy of Richardson's
/// step. Of the model's solution only the released state is used.
#[test]
fn particles_feel_the_mass_that_the_progenitor_still_has() {
    const PARAMETER: f64 = 0.4;
    for law in [None].into_iter().chain(LAWS.map(Some)) {
        let mut adaptive = ModelSettings {
            step_phase: 0.1,
            max_halvings: 12,
            ..with(law)
        };
        (adaptive.releases.particles, adaptive.releases.release_times) = (64, 8);
        let uniform = ModelSettings {
            step_rule: StepRule::Uniform,
            steps: 10_000,
            steps_per: StepsPer::Particle,
            orbit_steps: 4_000,
            ..adaptive
        };
        // Steps of fourth and of second order, and a thousandth or less of what the law changes.
        for (settings, tolerance_kpc) in [(adaptive, 1e-5), (uniform, 3e-4)] {
            let system = System::with_host(&left(PARAMETER), QRange::default(), &settings);
            let model = Model::new(&settings).expect("a model");
            let solution = model.progenitor_solution(&system).expect("a solution");
            let stream = model.stream_of(&system).expect("a stream");
            let table = model.table();
            for i in [2, 19] {
                let k = i / table.per_release_time;
                let (offset, tau) = (table.releases[i].offset, table.taus[k]);
                let (start, _) =
                    solution.releases.frames[k].release(offset.position, offset.velocity);
                let State { x, v } = system.today;
                let end = |law: Option<MassLoss>| {
                    let mass = |tau: f64| system.progenitor.mass * fraction(law, PARAMETER, tau);
                    let [coarse, fine] = [4_000, 8_000].map(|steps| {
                        let [x, v, ..] =
                            runge_kutta(&system, |_| 0.0, [x, v, x, v], [0.0, tau], steps);
                        let pair = [x, v, start.x, start.v];
                        runge_kutta(&system, mass, pair, [tau, 0.0], steps)[2]
                    });
                    fine + (fine - coarse) * (1.0 / 15.0)
                };
                let ours = Vec3::new(stream.x[i], stream.y[i], stream.z[i]);
                let apart = |law| (ours - end(law)).norm2().sqrt();
                let (found, constant) = (apart(law), apart(None));
                assert!(found < tolerance_kpc, "{law:?} {i}: {found}");
                assert!(law.is_none() || constant > 0.1, "{law:?} {i}: {constant}");
            }
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
    for (ours, whole) in (ours.releases.frames.iter()).zip(&solution(None, 1.0).releases.frames) {
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
        cotangent.mass_loss,
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
    for law in [MassLoss::Linear, MassLoss::Exponential] {
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
            likelihood_is_that_of::<Galaxy>(&settings, &left(0.37).to_array());
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
        (
            Some(MassLoss::Complete),
            Some(0.5),
            "prior.marginals.m_prog_left",
        ),
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

/// A half-normal prior of what is left reaches beyond the whole mass.
#[test]
fn a_progenitor_that_gains_mass_is_rejected() {
    let settings = with(Some(MassLoss::Linear));
    let model = Model::new(&settings).expect("a model");
    for (fraction, rejected) in [(1.0, false), (1.01, true)] {
        let system =
            System::<f64, Galaxy>::with_host(&left(fraction), QRange::default(), &settings);
        let solution = model.progenitor_solution(&system);
        let cause = solution.err().map(|cause| cause.name());
        assert_eq!(cause, rejected.then_some("bad_parameter"));
    }
}

/// gala's releases from a progenitor of a mass that falls, at nine times by two laws: the mean distance outwards is two tidal radii, but for
/// the noise of gala's 40,000 releases of each tail.
#[test]
fn releases_are_those_of_gala() {
    let file = json("mass_loss.json");
    let system = crate::gala::system("s2_spherical");
    let mut squares = Vec::new();
    for case in cases(&file) {
        let law = match case["law"].as_str() {
            Some("linear") => MassLoss::Linear,
            _ => MassLoss::Exponential,
        };
        // A release at the time of the case alone: the age is that since this time, and the progenitor has the mass of it.
        let since = number(&case["since_over_age"]);
        let left = number(&file["left"]);
        let mass = match law {
            MassLoss::Linear => 1.0 - (1.0 - left) * since,
            _ => left.powf(since),
        };
        let settings = with(Some(law));
        let host = HostParts {
            halo: Nfw::parameters(&system.host),
            kind: HaloKind::Nfw,
            baryons: Baryons::none(),
            has_baryons: false,
        };
        let galaxy = System::<f64, Galaxy> {
            host: Galaxy::from_parts(host),
            progenitor: system.progenitor,
            mass_loss: left,
            release_peaking: 0.0,
            coulomb_logarithm: 0.0,
            today: system.today,
            age_gyr: system.age_gyr,
        };
        let releases = TableSettings {
            particles: 16_000,
            release_times: 1_000,
            ..settings.releases
        };
        let model = Model::new(&ModelSettings {
            releases,
            ..settings
        })
        .expect("a model");
        let solution = model.progenitor_solution(&galaxy).expect("a solution");
        let length = |k: usize| solution.releases.frames[k].position[0].norm2().sqrt();
        // Between the two release times around it.
        let place = since * 1_000.0 - 0.5;
        let k = (place.max(0.0) as usize).min(998);
        let ours = length(k) + (length(k + 1) - length(k)) * (place - k as f64);
        assert!((number(&case["mass_msun"]) / (system.progenitor.mass * mass) - 1.0).abs() < 1e-9);
        for (tail, sign) in [("leading", -1.0), ("trailing", 1.0)] {
            let [mean, error] = numbers::<2>(&case[tail]);
            let z = (sign * mean - 2.0 * ours) / error;
            // Four standard errors; gala cuts what is on the other side of the progenitor, which is 3 % of one.
            assert!(
                z.abs() < 4.0,
                "{law:?} {since} {tail}: {mean} {ours} {error}"
            );
            squares.push(z * z);
        }
    }
    let count = squares.len() as f64;
    assert_eq!(squares.len(), 36);
    let mean = squares.iter().sum::<f64>() / count;
    assert!((mean - 1.0).abs() < 4.0 * (2.0 / count).sqrt(), "{mean}");
}
