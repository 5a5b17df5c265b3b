//! Orbits against quad-precision Taylor series, and the integrators' own laws.

use crate::golden::{cases, json, number, numbers};
use oblate::orbit::{Conservative, DenseOrbit, HermiteWeights, OrbitMethod, Resolution, State};
use oblate::potential::FlattenedNfw;
use oblate::scalar::{Portable, Vec3};
use oblate::units::KM_S_IN_KPC_PER_GYR;
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
fn the_accurate_orbit_converges_at_sixth_order_and_the_leapfrog_at_second() {
    let file = json("orbits.json");
    // The asymptotic range: resolved, and above rounding. The sixth order is approached from above.
    for (method, order, within, steps, resolved, rounding) in [
        (OrbitMethod::Accurate, 6.0, 0.75, 400, 1e-5, 2e-11),
        (OrbitMethod::Leapfrog, 2.0, 0.3, 8_000, 1e-2, 1e-9),
    ] {
        let measured: Vec<f64> = cases(&file)
            .iter()
            .filter(|c| !is_nearly_radial(c))
            .map(|case| {
                (
                    errors(case, steps, method).0,
                    errors(case, 2 * steps, method).0,
                )
            })
            .filter(|(coarse, fine)| *coarse < resolved && *fine > rounding)
            .map(|(coarse, fine)| (coarse / fine).log2())
            .collect();
        assert!(measured.len() >= 8, "{method:?}: {measured:?}");
        for m in &measured {
            assert!((m - order).abs() < within, "{method:?}: {measured:?}");
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

#[test]
fn winding_numbers_do_not_depend_on_the_intervals_near_the_projected_centre() {
    // The halo's torque turns the orbit on the sky the other way round where it passes the projected centre within 1 kpc.
    let host = FlattenedNfw::new(
        10.0_f64.powf(11.9248),
        15.0,
        0.7,
        Vec3::new(-0.6816, -0.5782, 0.4484),
    );
    let today = State {
        x: Vec3::new(60.0, 0.0, 30.0),
        v: Vec3::new(30.0, 140.0, 45.0) * KM_S_IN_KPC_PER_GYR,
    };
    let orbit =
        |intervals| DenseOrbit::integrate(&host, today, 3.0, intervals, OrbitMethod::Accurate);
    let exact = orbit(5_000);
    for intervals in [25, 30, 40, 50, 100] {
        let ours = orbit(intervals);
        let others = (0..=1_000)
            .map(|i| -f64::from(i) / 1_000.0)
            .filter(|&tau| (ours.at(tau).1 - exact.at(tau).1).abs() > 0.5)
            .count();
        // The axis is crossed at times that differ by less than one of the thousand.
        assert!(others <= 2, "{intervals} intervals: {others}");
    }
}

/// Today's state and the halo of a golden orbit that runs back in time.
fn golden(case: &Value) -> (FlattenedNfw<f64>, State<f64>) {
    let [x, y, z, vx, vy, vz] = numbers::<6>(&case["states"][0]);
    let today = State {
        x: Vec3::new(x, y, z),
        v: Vec3::new(vx, vy, vz),
    };
    (halo(case), today)
}

/// The orbit of 4 Gyr in this number of blocks, and whether its phase is within the limit.
fn resolved(
    case: &Value,
    blocks: usize,
    max_phase: f64,
    max_age_phase: f64,
) -> (bool, DenseOrbit<f64>) {
    let (halo, today) = golden(case);
    let resolution = Resolution {
        blocks,
        intervals: 1,
        max_phase,
        max_age_phase,
    };
    let mut orbit = DenseOrbit::default();
    let method = OrbitMethod::Accurate;
    let within = orbit.integrate_resolved(&Conservative(&halo), today, 4.0, resolution, method);
    (within, orbit)
}

#[test]
fn an_orbit_in_blocks_is_as_accurate_as_its_phase_and_takes_fewer_intervals_than_equal_ones() {
    let file = json("orbits.json");
    let mut fewer = 0;
    for case in cases(&file).iter().filter(|c| !is_nearly_radial(c)) {
        let (halo, today) = golden(case);
        let (within, orbit) = resolved(case, 16, 0.5, f64::INFINITY);
        assert!(within);
        let truth = DenseOrbit::integrate(&halo, today, 4.0, 20_000, OrbitMethod::Accurate);
        for i in 0..=1_000 {
            let tau = -f64::from(i) / 1_000.0;
            let ((ours, turns), (true_state, true_turns)) = (orbit.at(tau), truth.at(tau));
            let error = (ours.x - true_state.x).norm2() / true_state.x.norm2();
            // One orbit has 1.2e-3, most 1e-6.
            assert!(error.sqrt() < 3e-3, "{} at {tau}: {error:e}", case["id"]);
            assert!((turns - true_turns).abs() < 0.5 || ours.x.y.abs() < 0.1);
        }
        let (_, equal) = resolved(case, 1, 0.5, f64::INFINITY);
        let (_, finer) = resolved(case, 16, 0.25, f64::INFINITY);
        assert!(finer.nodes.len() > orbit.nodes.len());
        fewer += usize::from(orbit.nodes.len() < equal.nodes.len());
    }
    assert!(fewer > 5, "{fewer}");
}

#[test]
fn an_orbit_in_blocks_is_repeated_by_its_times_and_interpolated_in_lanes() {
    let file = json("orbits.json");
    for case in cases(&file).iter().take(6) {
        let (halo, today) = golden(case);
        let (_, orbit) = resolved(case, 16, 0.7, f64::INFINITY);
        let method = OrbitMethod::Accurate;
        let again =
            DenseOrbit::integrate_at(&Conservative(&halo), today, 4.0, orbit.times(), method);
        assert_eq!(orbit.nodes, again.nodes);
        let taus = [-1.0, -0.7, -0.5, -0.3, -1e-9, 0.0];
        let in_lanes = orbit.positions::<Portable, 6>(taus);
        for (tau, position) in taus.into_iter().zip(in_lanes) {
            let weights = HermiteWeights::at(tau, orbit.times());
            assert_eq!(
                position.map(f64::to_bits),
                orbit.position(&weights).map(f64::to_bits)
            );
            let (state, _) = orbit.at(tau);
            assert_eq!(&position[..3], state.x.to_array().as_slice());
        }
    }
}

#[test]
fn an_orbit_whose_age_has_too_large_a_phase_is_not_integrated() {
    let file = json("orbits.json");
    let case = &cases(&file)[0];
    let (_, orbit) = resolved(case, 16, 0.5, f64::INFINITY);
    let largest = 0.5 * orbit.nodes.len() as f64;
    assert!(resolved(case, 16, 0.5, 16.0 * largest).0);
    assert!(!resolved(case, 16, 0.5, 0.05 * largest).0);
}
