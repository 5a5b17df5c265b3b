//! The order of rows by position angle, and phi modulo a turn.

use super::{assert_refused, csv};

/// A track of rows with these angles and a half, in this order.
fn rows(header: &str, column: &str, angles: impl IntoIterator<Item = i32>) -> String {
    let rows: String = (angles.into_iter())
        .map(|angle| format!("{},60,1\n", f64::from(angle) + 0.5))
        .collect();
    format!("{header}{column},r,r_err\n{rows}")
}

fn pa(angles: impl IntoIterator<Item = i32>) -> String {
    rows("# progenitor_pa: 352.5\n", "PA", angles)
}

/// Position angles of bins of ten degrees at these angles from the progenitor.
fn around(phi: std::ops::RangeInclusive<i32>) -> Vec<i32> {
    phi.step_by(10).map(|x| (x + 352).rem_euclid(360)).collect()
}

fn sorted(mut angles: Vec<i32>) -> Vec<i32> {
    angles.sort_unstable();
    angles
}

#[test]
fn rows_sorted_by_position_angle_are_refused() {
    // A gap of half of a turn or less.
    for phi in [-55..=125, -95..=175] {
        let angles = around(phi.clone());
        let track = csv(&pa(angles.clone()));
        let expected: Vec<f64> = phi.step_by(10).map(f64::from).collect();
        assert_eq!(track.phi_deg, expected);
        let first = sorted(angles);
        let parts = ["widest gap", "in order along the stream", "give `phi`"];
        assert_refused("csv", &pa(first), &parts);
    }
    let parts = ["line 15", "from 117.5 to 297.5 deg"];
    assert_refused("csv", &pa(sorted(around(-55..=125))), &parts);
    // From the progenitor over north to both ends.
    let from_progenitor = [around(5..=125), around(-55..=-5)].concat();
    assert_refused("csv", &pa(from_progenitor), &["widest gap"]);
    // A wider gap looks like a step over north that falls.
    let parts = [
        "line 7",
        "`PA` is 297.5 deg after 37.5 deg",
        "in order along the stream",
    ];
    assert_refused("csv", &pa(sorted(around(-55..=45))), &parts);
    let falling = around(-25..=25).into_iter().rev();
    assert_refused("csv", &pa(falling), &["`PA` is 7.5 deg after 17.5 deg"]);
}

#[test]
fn long_tracks_of_position_angles_in_order_are_read() {
    // Bins are missing, but fewer than between the ends.
    let mut angles = around(-165..=155);
    angles.drain(15..17);
    let track = csv(&pa(angles));
    assert_eq!((track.phi_deg[0], track.phi_deg[30]), (-165.0, 155.0));
    // All bins of a turn: no gap is wider than another, though the file rounds its angles.
    let circle: String = (0..36)
        .map(|k| format!("{}.001,60,1\n", (10 * k + 40) % 360))
        .collect();
    let circle = circle.replace("50.001", "50.004");
    let track = csv(&format!("# progenitor_pa: 220\nPA,r,r_err\n{circle}"));
    assert_eq!(track.len(), 36);
    // More than a turn has `phi`.
    let wound = csv(&rows("", "phi", (-300..=300).step_by(10)));
    assert_eq!(wound.len(), 61);
    assert!(wound.assumptions().is_empty());
}

#[test]
fn a_progenitor_beside_phi_and_angles_without_a_value_are_refused() {
    let both = rows("# progenitor_pa: 352.5\n", "phi", [5, 15, 25]);
    let parts = ["line 1", "`progenitor_pa`", "belongs to a column `PA`"];
    assert_refused("csv", &both, &parts);
    let nan = pa([5, 15, 25]).replace("15.5", "nan");
    assert_refused("csv", &nan, &["line 4", "`PA` is NaN"]);
}

#[test]
fn phi_that_may_be_modulo_a_turn_is_named() {
    let of = |angles: Vec<i32>| csv(&rows("", "phi", angles)).assumptions();
    let range = |lo: i32, hi: i32| (lo..=hi).step_by(10);
    let said = of(range(5, 125).chain(range(305, 355)).collect());
    assert_eq!(said.len(), 1);
    assert!(said[0].contains("a gap of 180 deg"), "{said:?}");
    assert!(said[0].contains("modulo 360"), "{said:?}");
    // The same in the other sense.
    let said = of(range(-355, -305).chain(range(-125, -5)).collect());
    assert_eq!(said.len(), 1);
    for sure in [
        range(-55, 125).collect::<Vec<_>>(),
        // One tail, with bins missing, and two tails around an unseen progenitor.
        range(5, 65).chain(range(205, 225)).collect(),
        range(-155, -105).chain(range(105, 155)).collect(),
    ] {
        assert!(of(sure.clone()).is_empty(), "{sure:?}");
    }
}
