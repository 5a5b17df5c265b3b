//! Orbits against quad-precision Taylor series, and the integrators' own laws.

use crate::golden::{cases, json, number, numbers};
use oblate::orbit::{DenseOrbit, OrbitMethod, State};
use oblate::potential::FlattenedNfw;
use oblate::scalar::Vec3;
use serde_json::Value;

fn halo(case: &Value) -> FlattenedNfw<f64> {
    let axis = Vec3::from(numbers::<3>(&case["n"]));
    FlattenedNfw::new(
        number(&case["M"]),
        number(&case["Rs"]),
        number(&case["q"]),
        axis,
    )
}

/// Largest error in position (kpc) and velocity (kpc/Gyr) of the dense orbit at the golden times.
fn errors(case: &Value, steps: usize, method: OrbitMethod) -> (f64, f64) {
    let states: Vec<[f64; 6]> = case["states"]
        .as_array()
        .expect("states")
        .iter()
        .map(numbers::<6>)
        .collect();
    let times: Vec<f64> = case["t"]
        .as_array()
        .expect("times")
        .iter()
        .map(number)
        .collect();
    let [x, y, z, vx, vy, vz] = states[0];
    // Our orbits run back in time; a golden orbit that runs forward is the same with its velocity turned round.
    let sign = if times[8] < 0.0 { 1.0 } else { -1.0 };
    let today = State {
        x: Vec3::new(x, y, z),
        v: Vec3::new(vx, vy, vz) * sign,
    };
    let orbit = DenseOrbit::integrate(&halo(case), today, times[8].abs(), steps, method);
    let mut worst = (0.0_f64, 0.0_f64);
    for (t, golden) in times.iter().zip(&states) {
        let (state, _) = orbit.at(-(t / times[8]));
        let ours = [state.x.to_array(), (state.v * sign).to_array()].concat();
        for i in 0..3 {
            worst.0 = worst.0.max((ours[i] - golden[i]).abs());
            worst.1 = worst.1.max((ours[i + 3] - golden[i + 3]).abs());
        }
    }
    worst
}

/// Orbits that come within a kpc or so of the centre, where fixed steps do not resolve the passage.
fn is_nearly_radial(case: &Value) -> bool {
    matches!(case["id"].as_u64(), Some(12..=15 | 23))
}

#[test]
fn the_accurate_orbit_meets_quad_precision_states() {
    let file = json("orbits.json");
    for case in cases(&file) {
        let factor = if is_nearly_radial(case) { 10.0 } else { 1.0 };
        let (dx, dv) = errors(case, 100_000, OrbitMethod::Accurate);
        assert!(
            dx < 1e-8 * factor && dv < 1e-6 * factor,
            "{} {dx:e} {dv:e}",
            case["id"]
        );
    }
}

#[test]
fn the_accurate_orbit_converges_at_fourth_order_and_the_leapfrog_at_second() {
    let file = json("orbits.json");
    for (method, order, steps) in [
        (OrbitMethod::Accurate, 4.0, 1_000),
        (OrbitMethod::Leapfrog, 2.0, 8_000),
    ] {
        // The asymptotic range: resolved, and above rounding.
        let measured: Vec<f64> = cases(&file)
            .iter()
            .filter(|c| !is_nearly_radial(c))
            .map(|case| {
                (
                    errors(case, steps, method).0,
                    errors(case, 2 * steps, method).0,
                )
            })
            .filter(|(coarse, fine)| {
                *coarse < if order > 3.0 { 1e-5 } else { 1e-2 } && *fine > 1e-9
            })
            .map(|(coarse, fine)| (coarse / fine).log2())
            .collect();
        assert!(measured.len() >= 8, "{method:?}: {measured:?}");
        for m in &measured {
            assert!((m - order).abs() < 0.3, "{method:?}: {measured:?}");
        }
    }
}

#[test]
fn an_orbit_conserves_energy_and_says_so() {
    let file = json("orbits.json");
    let case = &cases(&file)[0];
    let [x, y, z, vx, vy, vz] = numbers::<6>(&case["states"][0]);
    let today = State {
        x: Vec3::new(x, y, z),
        v: Vec3::new(vx, vy, vz),
    };
    let halo = halo(case);
    let orbit = DenseOrbit::integrate(&halo, today, 4.0, 512, OrbitMethod::Accurate);
    let error = orbit.energy_error(&halo);
    assert!(error > 0.0 && error < 1e-5, "{error}");
}

#[test]
fn the_winding_count_follows_the_angle() {
    let host = FlattenedNfw::new(1e12, 15.0, 0.8, Vec3::new(0.0, 0.6, 0.8));
    let today = State {
        x: Vec3::new(40.0, 0.0, 20.0),
        v: Vec3::new(10.0, 150.0, 30.0),
    };
    let orbit = DenseOrbit::integrate(&host, today, 4.0, 2_000, OrbitMethod::Accurate);
    let mut last = 0.0_f64;
    for i in 0..=20_000 {
        let tau = -f64::from(i) / 20_000.0;
        let (state, winding_number) = orbit.at(tau);
        let angle = f64::atan2(state.x.y, state.x.x) + std::f64::consts::TAU * winding_number;
        assert!(
            (angle - last).abs() < 0.2,
            "a jump at {tau}: {last} to {angle}"
        );
        last = angle;
    }
    assert!(last < -2.0 * std::f64::consts::TAU, "{last}");
}
