//! Dynamical friction on the progenitor: golden forces and orbits, and exact derivatives.

use crate::golden::{json, number, numbers};
use crate::haloes::{THETA, likelihood_is_that_of, small};
use oblate::orbit::OrbitMethod;
use oblate::orbit::State;
use oblate::params::{PriorSettings, QRange, StreamParams, StreamPrior};
use oblate::potential::{Baryons, Galaxy, HaloKind, HaloParameters, Host, HostParts, Plummer};
use oblate::scalar::Vec3;
use oblate::stream::{
    MassLoss, Model, ModelSettings, ReleaseRate, StreamInput, System, Threads, host_of,
};
use serde_json::Value;

fn with(halo: HaloKind) -> ModelSettings {
    ModelSettings {
        dynamical_friction: true,
        ..small(halo)
    }
}

/// The system of a case whose progenitor is at `x` with the velocity `v`.
fn system(
    case: &Value,
    kind: HaloKind,
    halo: HaloParameters<f64>,
    [x, v]: [Vec3<f64>; 2],
    left: f64,
    age_gyr: f64,
) -> System<f64, Galaxy> {
    System {
        host: Galaxy::from_parts(HostParts {
            halo,
            kind,
            baryons: Baryons::none(),
            has_baryons: false,
        }),
        progenitor: Plummer {
            mass: number(&case["m_msun"]),
            r_s: 1.0,
        },
        mass_loss: left,
        release_peaking: 0.0,
        coulomb_logarithm: number(&case["coulomb_logarithm"]),
        today: State { x, v },
        age_gyr,
    }
}

fn vector(case: &Value, key: &str) -> Vec3<f64> {
    Vec3::from(numbers::<3>(&case[key]))
}

/// The acceleration at the latest node of an orbit, less that of the halo alone.
#[test]
fn forces_are_those_of_the_golden_values() {
    let file = json("friction.json");
    let golden = file["forces"].as_array().expect("forces");
    assert!(golden.len() > 20);
    for case in golden {
        let kind = match case["kind"].as_str() {
            Some("nfw") => HaloKind::Nfw,
            _ => HaloKind::Logarithmic,
        };
        let parameters = HaloParameters::from_q(
            number(&case["mass_msun"]),
            number(&case["r_s_kpc"]),
            1.0,
            Vec3::new(0.0, 0.0, 1.0),
        );
        let (x, v) = (vector(case, "x_kpc"), vector(case, "v_kpc_per_gyr"));
        // So short an age that the orbit stays where it is.
        let age_gyr = 1e-4 * (x.norm2() / (v.norm2() + 1.0)).sqrt();
        let node = |friction: bool| {
            let settings = ModelSettings {
                dynamical_friction: friction,
                ..small(kind)
            };
            let model = Model::new(&settings).expect("a model");
            let solution = model
                .progenitor_solution(&system(case, kind, parameters, [x, v], 1.0, age_gyr))
                .expect("an orbit");
            // Each block has one interval, with two nodes.
            let step = age_gyr * 2.0 / solution.orbit.nodes.len() as f64;
            solution.orbit.nodes.last().expect("a node").vector(2) * (1.0 / (step * step))
        };
        let ours = node(true) - node(false);
        let expected = vector(case, "acceleration");
        let of_halo = node(false).norm2().sqrt();
        let apart = (ours - expected).norm2().sqrt();
        // Friction is the difference of two accelerations, of which the larger is rounded.
        assert!(
            apart < 1e-11 * expected.norm2().sqrt() + 1e-14 * of_halo,
            "{case} {ours:?}"
        );
    }
}

#[test]
fn orbits_are_those_of_the_golden_values() {
    let file = json("friction.json");
    let golden = file["orbits"].as_array().expect("orbits");
    assert_eq!(golden.len(), 2);
    let mut ends = Vec::new();
    for case in golden {
        let halo = HaloParameters::from_q(
            number(&case["mass_msun"]),
            number(&case["r_s_kpc"]),
            number(&case["q"]),
            vector(case, "axis"),
        );
        let (left, age_gyr) = (number(&case["left"]), number(&case["age_gyr"]));
        let today = [
            vector(case, "today_x_kpc"),
            vector(case, "today_v_kpc_per_gyr"),
        ];
        let mut worst = Vec::new();
        for step_phase in [0.85, 0.425, 0.2] {
            let settings = ModelSettings {
                mass_loss: Some(MassLoss::Linear),
                step_phase,
                ..with(HaloKind::Nfw)
            };
            let model = Model::new(&settings).expect("a model");
            let system = system(case, HaloKind::Nfw, halo, today, left, age_gyr);
            let solution = model.progenitor_solution(&system).expect("an orbit");
            let times = case["times_gyr"].as_array().expect("times");
            let places = case["x_kpc"].as_array().expect("places");
            let apart = times.iter().zip(places).map(|(time, place)| {
                let (state, _) = solution.orbit.at(number(time) / age_gyr);
                let expected = Vec3::from(numbers::<3>(place));
                ((state.x - expected).norm2() / expected.norm2()).sqrt()
            });
            worst.push(apart.fold(0.0, f64::max));
            if step_phase > 0.5 {
                ends.push(solution.orbit.at(-1.0).0.x);
            }
        }
        assert!(worst[0] < 1e-4, "{left} {worst:?}");
        assert!(
            worst[1] < 0.2 * worst[0] && worst[2] < 0.1 * worst[0],
            "{left} {worst:?}"
        );
    }
    // A progenitor of constant mass has lost more energy.
    assert!((ends[0] - ends[1]).norm2().sqrt() > 1.0, "{ends:?}");
}

/// The error of the orbit's end falls by four with steps of half the length.
#[test]
fn the_leapfrog_is_of_second_order_with_friction() {
    let mut params = StreamParams::from_array(THETA);
    params.coulomb_logarithm = 3.0;
    params.log10_m_prog = 10.0;
    let end = |orbit: OrbitMethod, orbit_steps: usize| {
        let settings = ModelSettings {
            orbit,
            orbit_steps,
            ..with(HaloKind::Nfw)
        };
        let model = Model::new(&settings).expect("a model");
        let system = System::<f64, Galaxy>::with_host(&params, QRange::default(), &settings);
        let solution = model.progenitor_solution(&system).expect("an orbit");
        solution.orbit.at(-1.0).0.x
    };
    let exact = end(OrbitMethod::Accurate, 4_000);
    let errors =
        [500, 1_000].map(|steps| (end(OrbitMethod::Leapfrog, steps) - exact).norm2().sqrt());
    let ratio = errors[0] / errors[1];
    assert!((3.4..4.6).contains(&ratio), "{errors:?}");
}

/// Friction takes energy from the orbit, which is no error.
#[test]
fn an_orbit_with_friction_has_no_energy_error() {
    let mut params = StreamParams::from_array(THETA);
    params.coulomb_logarithm = 3.0;
    for friction in [false, true] {
        let settings = ModelSettings {
            dynamical_friction: friction,
            ..small(HaloKind::Nfw)
        };
        let model = Model::new(&settings).expect("a model");
        let input = StreamInput {
            params: &params,
            q_range: QRange::default(),
            threads: Threads::One,
        };
        let error = host_of(&settings).orbit_energy_error(&model, &input);
        let error = error.expect("an orbit");
        assert!(
            error.is_none() == friction && error.is_none_or(|e| e < 1e-4),
            "{error:?}"
        );
    }
}

#[test]
fn gradients_with_friction_are_exact() {
    let mut params = StreamParams::from_array(THETA);
    params.coulomb_logarithm = 2.5;
    params.log10_m_prog = 9.2;
    params.m_prog_left = 0.4;
    for halo in [HaloKind::Nfw, HaloKind::Logarithmic] {
        for mass_loss in [None, Some(MassLoss::Linear)] {
            let settings = ModelSettings {
                mass_loss,
                ..with(halo)
            };
            likelihood_is_that_of::<Galaxy>(&settings, &params.to_array());
        }
    }
}

#[test]
fn the_coulomb_logarithm_belongs_to_friction() {
    let prior = |value: Option<f64>| {
        let mut settings = PriorSettings::default();
        settings.fixed.coulomb_logarithm = value;
        StreamPrior::new(&settings).expect("a prior")
    };
    for (settings, value, words) in [
        (with(HaloKind::Nfw), None, "prior.fixed.coulomb_logarithm"),
        (small(HaloKind::Nfw), Some(2.0), "model.dynamical_friction"),
    ] {
        let error = settings
            .check_prior(&prior(value))
            .expect_err("refused")
            .to_string();
        assert!(error.contains(words), "{error}");
    }
    with(HaloKind::Nfw)
        .check_prior(&prior(Some(2.0)))
        .expect("accepted");
    let text = with(HaloKind::Nfw).host_in_words();
    assert!(text.contains("friction"), "{text}");
}

/// Masses times a factor, velocities times its root and the age over its root leave the track as it is, also with friction and weights: this
/// is a move of the samplers.
#[test]
fn the_scaling_of_masses_velocities_and_age_keeps_the_stream() {
    let settings = ModelSettings {
        mass_loss: Some(MassLoss::Complete),
        release_rate: ReleaseRate::Tidal,
        ..with(HaloKind::Nfw)
    };
    let model = Model::new(&settings).expect("a model");
    let mut params = StreamParams::from_array(THETA);
    params.coulomb_logarithm = 2.0;
    params.release_peaking = 1.2;
    params.dissolved_at = 0.7;
    params.log10_m_prog = 9.0;
    let before = model.stream(&params).expect("a stream");
    let factor = 1.7_f64;
    params.log10_m_halo += factor.log10();
    params.log10_m_prog += factor.log10();
    for velocity in [
        &mut params.vx0_km_s,
        &mut params.vy0_km_s,
        &mut params.vz0_km_s,
    ] {
        *velocity *= factor.sqrt();
    }
    params.age_gyr /= factor.sqrt();
    let after = model.stream(&params).expect("a stream");
    let mut bent = 0.0_f64;
    for i in 0..before.len() {
        assert!((before.weight(i) - after.weight(i)).abs() < 1e-9);
        let apart = (before.x[i] - after.x[i]).hypot(before.y[i] - after.y[i]);
        bent = bent.max(apart / before.x[i].hypot(before.y[i]));
    }
    // Steps are chosen alike; rounding grows along orbits.
    assert!(bent < 1e-6, "{bent}");
}
