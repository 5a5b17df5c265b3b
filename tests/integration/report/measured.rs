//! Figures of what is measured beside radii.

use super::{sound, track};
use oblate::data::{Measured, ObservedTrack};
use oblate::report::MeasuredPicture;
use oblate::track::BinQuantity;

#[test]
fn a_figure_of_velocities_shows_those_that_are_measured() {
    let (mut data, best, draws) = track();
    let svg = |data: &ObservedTrack| {
        MeasuredPicture {
            track: data,
            quantity: BinQuantity::Velocity,
            draws: &draws,
            best: &best,
        }
        .svg()
    };
    assert_eq!(svg(&data), None);
    let velocity = |(i, r): (usize, &f64)| {
        (i % 3 == 0).then_some(Measured {
            value: *r,
            error: 2.0,
        })
    };
    let rows = data.r_kpc.iter().enumerate().map(velocity).collect();
    data.measured.insert(BinQuantity::Velocity, rows);
    let svg = sound("velocities", svg(&data).expect("a figure"));
    assert_eq!(svg.matches("class=\"datum\"").count(), 4);
    assert!(svg.contains("velocity") && svg.contains("[deg]<") && svg.contains("NGC 0000 south"));
}
