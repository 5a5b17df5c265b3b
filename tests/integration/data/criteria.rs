//! Lengths of tracks, and the criteria that mocks meet: docs/physics.md, section 11.

use oblate::data::{Mock, MockSettings, Mocks, ObservedTrack, TrackExtent, mocks};
use oblate::params::{PriorSettings, StreamPrior};

fn extent(phi_deg: &[f64], width_deg: f64, r_kpc: &[f64]) -> TrackExtent {
    let errors = vec![1.0; r_kpc.len()];
    let track = ObservedTrack::new("line", phi_deg, width_deg, r_kpc, &errors).unwrap();
    TrackExtent::of(&track)
}

/// Centres of `count` bins from the first one.
fn centres(first_deg: f64, width_deg: f64, count: usize) -> Vec<f64> {
    (0..count)
        .map(|k| first_deg + width_deg * k as f64)
        .collect()
}

fn close(found: f64, expected: f64, relative: f64) {
    assert!(
        (found / expected - 1.0).abs() < relative,
        "{found} {expected}"
    );
}

#[test]
fn lengths_of_arcs_and_lines_are_those_of_geometry() {
    // An arc of 100 degrees at 60 kpc: r times the angle, less 1/24 of the square of a step, of the chords.
    let width_deg = 1.0_f64;
    let phi = centres(-29.5, width_deg, 101);
    let arc = extent(&phi, width_deg, &[60.0; 101]);
    let step = width_deg.to_radians();
    close(
        arc.length_kpc,
        60.0 * 100.0 * step * (1.0 - step * step / 24.0),
        1e-8,
    );
    close(arc.length_deg, 101.0, 1e-12);
    close(arc.mean_kpc, 60.0, 1e-12);
    assert!(arc.spread_kpc < 1e-9);
    // A straight line that passes the centre at 5 kpc, almost along a radius, from 70 to 80 degrees: the difference of the tangents.
    let phi = centres(70.0, 0.5, 21);
    let r: Vec<f64> = phi.iter().map(|phi| 5.0 / phi.to_radians().cos()).collect();
    let line = extent(&phi, 0.5, &r);
    let tangent = |phi: f64| 5.0 * phi.to_radians().tan();
    close(line.length_kpc, tangent(80.0) - tangent(70.0), 1e-12);
    // Along a radius but for bins of a tenth of a degree: 300 kpc outwards.
    let line = extent(&centres(0.05, 0.1, 3), 0.1, &[100.0, 200.0, 400.0]);
    close(line.length_kpc, 300.0, 1e-5);
    close(line.mean_kpc, 700.0 / 3.0, 1e-12);
    // The mean square is 70,000 and the square of the mean 54,444.
    close(line.spread_kpc, (140_000.0_f64 / 9.0).sqrt(), 1e-12);
    // A gap is crossed straight: a right angle at 10 kpc.
    let gap = extent(&[0.0, 90.0, 180.0], 10.0, &[10.0; 3]);
    close(gap.length_kpc, 20.0 * 2.0_f64.sqrt(), 1e-12);
    close(gap.length_deg, 30.0, 1e-12);
}

/// Mocks without noise, whose radii are those that the criteria are applied to, of few particles.
fn settings() -> MockSettings {
    let mut settings = MockSettings {
        noise: 0.0,
        star_scatter: false,
        ..MockSettings::default()
    };
    settings.model.releases.particles = 200;
    settings.model.steps = 60;
    settings
}

fn found(settings: &MockSettings, count: usize) -> Mocks {
    let prior = StreamPrior::new(&PriorSettings::default()).unwrap();
    mocks(&prior, settings, count, 11).unwrap()
}

/// By the law of cosines.
fn length_kpc(track: &ObservedTrack) -> f64 {
    let pairs = track.r_kpc.windows(2).zip(track.phi_deg.windows(2));
    pairs
        .map(|(r, phi)| {
            let cos = (phi[1] - phi[0]).to_radians().cos();
            (r[0] * r[0] + r[1] * r[1] - 2.0 * r[0] * r[1] * cos).sqrt()
        })
        .sum()
}

fn smallest(values: &[f64]) -> f64 {
    values.iter().copied().fold(f64::INFINITY, f64::min)
}

fn largest(values: &[f64]) -> f64 {
    values.iter().copied().fold(0.0, f64::max)
}

#[test]
fn kept_mocks_meet_the_criteria_and_no_other_draw_does() {
    let strict = settings();
    let loose = MockSettings {
        min_angle_deg: 0.0,
        min_length_kpc: 0.0,
        radii_kpc: (1e-3, 1e5),
        ..strict
    };
    // By the criteria of the settings, from the data of a mock.
    let meets = |mock: &Mock| {
        let track = &mock.track;
        assert!((mock.length_kpc / length_kpc(track) - 1.0).abs() < 1e-12);
        let r = &track.r_kpc;
        track.len() as f64 * 10.0 > 90.0
            && length_kpc(track) > 100.0
            && smallest(r) >= 10.0
            && largest(r) <= 500.0
    };
    let all = found(&loose, 120);
    let expected: Vec<&str> = (all.mocks.iter())
        .filter(|mock| meets(mock))
        .map(|mock| mock.track.name.as_str())
        .collect();
    // Both kinds are there.
    assert!(
        expected.len() >= 10 && expected.len() + 10 <= 120,
        "{}",
        expected.len()
    );
    let kept = found(&strict, expected.len());
    let names: Vec<&str> = kept
        .mocks
        .iter()
        .map(|mock| mock.track.name.as_str())
        .collect();
    assert_eq!(names, expected);
}

/// The limits of a mock's own values keep it, and limits that are stricter by a rounding do not.
#[test]
fn each_limit_just_above_or_below_the_value_of_a_mock_decides() {
    let loose = MockSettings {
        min_angle_deg: 0.0,
        min_length_kpc: 0.0,
        radii_kpc: (1e-3, 1e5),
        ..settings()
    };
    let first = found(&loose, 1).mocks.remove(0);
    let r = &first.track.r_kpc;
    let angle_deg = 10.0 * first.track.len() as f64;
    let (length_kpc, lo, hi) = (first.length_kpc, smallest(r), largest(r));
    let angle = |min_angle_deg| MockSettings {
        min_angle_deg,
        ..loose
    };
    let length = |min_length_kpc| MockSettings {
        min_length_kpc,
        ..loose
    };
    let radii = |lo, hi| MockSettings {
        radii_kpc: (lo, hi),
        ..loose
    };
    for (what, keeps, cuts) in [
        ("angle", angle(angle_deg.next_down()), angle(angle_deg)),
        ("length", length(length_kpc.next_down()), length(length_kpc)),
        ("least radius", radii(lo, 1e5), radii(lo.next_up(), 1e5)),
        (
            "largest radius",
            radii(1e-3, hi),
            radii(1e-3, hi.next_down()),
        ),
    ] {
        let name = |settings: &MockSettings| found(settings, 1).mocks[0].track.name.clone();
        assert_eq!(name(&keeps), first.track.name, "{what}");
        assert_ne!(name(&cuts), first.track.name, "{what}");
    }
    // A bin that has fewer particles than the least fraction is left out.
    let n = first.track.n.as_ref().unwrap();
    let particles = 200.0;
    let bins = |min_fraction: f64| {
        let mock = found(
            &MockSettings {
                min_fraction,
                ..loose
            },
            1,
        )
        .mocks
        .remove(0);
        assert_eq!(mock.track.name, first.track.name);
        mock.track.len()
    };
    let least = smallest(n);
    let few = n.iter().filter(|n| **n < least + 0.5).count();
    assert_eq!(bins((least - 0.5) / particles), n.len());
    assert_eq!(bins((least + 0.5) / particles), n.len() - few);
}
