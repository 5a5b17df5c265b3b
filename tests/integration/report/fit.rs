//! The figure of a fit: data, residuals, the sky and the legend.

use super::{sound, track};
use oblate::data::ObservedTrack;
use oblate::report::FitPicture;
use oblate_samplers::rng::{Domain, standard_normal, stream};

/// The figure of these data, where the best fit covers those below this angle.
pub(super) fn overlay(data: &ObservedTrack, particles: &[(f64, f64)], covered_deg: f64) -> String {
    let (_, mut best, draws) = track();
    let end = best.phi_deg.partition_point(|phi| *phi < covered_deg);
    best.phi_deg.truncate(end);
    best.values.truncate(end);
    let residual = |row: usize| {
        let at = best
            .phi_deg
            .iter()
            .position(|phi| (phi - data.phi_deg[row]).abs() < 1e-9);
        at.map_or(f64::NAN, |at| {
            (data.r_kpc[row] - best.values[at]) / data.r_err_lo_kpc[row]
        })
    };
    FitPicture {
        track: data,
        draws: &draws,
        best: &best,
        residuals: &(0..data.len()).map(residual).collect::<Vec<_>>(),
        particles,
        phi_zero_deg: 0.0,
        progenitor_kpc: 60.0,
    }
    .svg()
}

fn picture_of(particles: &[(f64, f64)]) -> String {
    overlay(&track().0, particles, 360.0)
}

#[test]
fn fit_overlay_shows_every_datum_and_its_residual() {
    let svg = sound("fit", picture_of(&[]));
    assert_eq!(svg.matches("class=\"datum\"").count(), 12);
    assert_eq!(svg.matches("class=\"residual\"").count(), 12);
    assert!(svg.contains("[kpc]<") && svg.contains("[deg]<") && svg.contains("NGC 0000 south"));
}

/// The centres of the dots of a class.
fn places(svg: &str, class: &str) -> Vec<(f64, f64)> {
    let start = format!("<circle class=\"{class}\" ");
    let number = |text: &str| text.split('"').nth(1).unwrap().parse().unwrap();
    svg.split(&start)
        .skip(1)
        .map(|dot| (number(dot), number(dot.split_once("cy=").unwrap().1)))
        .collect()
}

#[test]
fn the_legend_of_a_fit_overlay_is_above_its_panels() {
    let svg = picture_of(&[(1.0, 2.0)]);
    let legend = places(&svg, "legend");
    assert_eq!(legend.len(), 3);
    let lowest = legend.iter().map(|(_, y)| *y).fold(0.0, f64::max);
    for class in ["datum", "residual", "sky-datum", "progenitor"] {
        let circles = places(&svg, class);
        assert!(!circles.is_empty(), "{class}");
        let highest = circles
            .iter()
            .map(|(_, y)| *y)
            .fold(f64::INFINITY, f64::min);
        assert!(highest > lowest + 5.0, "{class}: {highest}, {lowest}");
    }
}

#[test]
fn fit_overlay_shows_the_sky_when_given_particles() {
    let particles: Vec<(f64, f64)> = (0..1500)
        .map(|i| {
            let mut rng = stream(6, Domain::Test, 0, i);
            let phi = 30.0 * standard_normal(&mut rng);
            let r = 60.0 + 0.2 * phi + phi * phi / 150.0 + 2.5 * standard_normal(&mut rng);
            (r * phi.to_radians().cos(), r * phi.to_radians().sin())
        })
        .collect();
    let svg = sound("fit_sky", picture_of(&particles));
    assert_eq!(svg.matches("class=\"particle\"").count(), 1500);
    assert_eq!(svg.matches("class=\"sky-datum\"").count(), 12);
    assert!(svg.contains(">x</tspan>") && svg.contains(">y</tspan>"));
}

#[test]
fn a_bin_that_the_best_fit_misses_is_crossed_not_drawn() {
    let data = track().0;
    let missed = data.phi_deg.iter().filter(|p| **p > 40.0).count();
    assert!(missed > 0);
    let svg = sound("fit_missed", overlay(&data, &[], 40.0));
    assert_eq!(svg.matches("class=\"residual\"").count(), 12 - missed);
    assert_eq!(svg.matches('\u{d7}').count(), missed);
}
