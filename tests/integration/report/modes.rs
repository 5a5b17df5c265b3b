//! The figure of orientation modes, and the outlines of haloes in it.

use super::{sound, track};
use crate::runs;
use oblate::posterior::{mode_weights, modes_of_draws};
use oblate::potential::{HaloParameters, SecondAxis};
use oblate::report::{ModePicture, modes, outline};
use oblate::scalar::Vec3;

#[test]
fn the_outline_of_a_halo_is_that_of_the_projected_ellipsoid() {
    let extent_of = |halo: HaloParameters<f64>| {
        let points = outline(&halo, 10.0);
        let largest = |f: fn(&(f64, f64)) -> f64| points.iter().map(f).fold(0.0, f64::max);
        [largest(|p| p.0.abs()), largest(|p| p.1.abs())]
    };
    let of = |axis: [f64; 3], q: f64| HaloParameters::from_q(1e12, 15.0, q, Vec3::from(axis));
    let extent = |axis: [f64; 3], q: f64| extent_of(of(axis, q));
    let near = |a: [f64; 2], b: [f64; 2]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 0.01);
    // Edge-on: the axis ratio itself, along the axis. Face-on: a circle. Between: by the inclination.
    assert!(near(extent([1.0, 0.0, 0.0], 0.5), [5.0, 10.0]));
    assert!(near(extent([0.0, 1.0, 0.0], 1.4), [10.0, 14.0]));
    assert!(near(extent([0.0, 0.0, 1.0], 0.5), [10.0, 10.0]));
    let inclined = extent([0.6, 0.0, 0.8], 0.5);
    assert!(
        near(inclined, [10.0 * 0.73_f64.sqrt(), 10.0]),
        "{inclined:?}"
    );
    // Three axes, p along x and q along the line of sight.
    let halo = HaloParameters {
        second: SecondAxis {
            flattening: 1.0 / (0.8 * 0.8) - 1.0,
            axis: Vec3::new(1.0, 0.0, 0.0),
        },
        ..of([0.0, 0.0, 1.0], 0.5)
    };
    assert!(near(extent_of(halo), [8.0, 10.0]));
}

#[test]
fn every_orientation_mode_is_a_panel_with_its_data() {
    let run = runs::nested(2000, 4);
    let of_draws = modes_of_draws(&run).unwrap();
    let weights = mode_weights(&run).unwrap();
    let each = run.draws.weights();
    for (index, mode) in weights.iter().enumerate() {
        let rows = (0..each.len()).filter(|row| of_draws[*row] == index);
        let weight: f64 = rows.map(|row| each[row]).sum();
        assert!((weight - mode.probability.weight).abs() < 1e-9);
    }
    let (data, best, _) = track();
    let pictures: Vec<ModePicture> = weights[..4]
        .iter()
        .map(|weight| ModePicture {
            weight: *weight,
            halo: HaloParameters::from_q(1e12, 15.0, 0.7, Vec3::new(0.6, 0.0, 0.8)),
            particles: vec![(50.0, 3.0); 20],
            curve: best.clone(),
            phi_zero_deg: 10.0,
        })
        .collect();
    let svg = sound("modes", modes(&data, &pictures).unwrap());
    assert_eq!(svg.matches("class=\"sky-datum\"").count(), 4 * 12);
    assert_eq!(svg.matches("class=\"particle\"").count(), 4 * 20);
    assert_eq!(svg.matches("stroke-dasharray=\"3 2\"").count(), 4 * 3);
    assert_eq!(modes(&data, &[]), None);
}
