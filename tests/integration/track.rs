//! Tracks against gala's, hard against soft bins, and the bins' derivatives.

use crate::gala::{NAMES, galaxy, track};
use oblate::orbit::{Arrival, Level, State};
use oblate::scalar::{Dual, Vec3, gradient_of, lift};
use oblate::spray::{Design, TableSettings};
use oblate::stream::{Arrivals, Flights, Model, ModelSettings};
use oblate::track::{BinEdges, BinGrid, Sums, Track};
use proptest::prelude::*;

fn arrivals(name: &str, settings: &ModelSettings) -> Arrivals {
    let model = Model::new(settings).expect("a model");
    let setup = model.setup(&galaxy(name)).expect("a setup");
    let (mut flights, mut out) = (Flights::default(), Arrivals::default());
    model
        .carry(&setup, &mut flights, &mut out)
        .expect("particles");
    out
}

/// gala's release times (2000 epochs), independent random numbers, and steps so fine that only noise is left.
fn converged(name: &str) -> Arrivals {
    let releases = TableSettings {
        particles: 80_000,
        epochs: 2_000,
        design: Design::Random,
        ..TableSettings::default()
    };
    arrivals(
        name,
        &ModelSettings {
            releases,
            steps: 2_400,
            orbit_steps: 4_000,
            ..ModelSettings::default()
        },
    )
}

#[test]
fn tracks_reproduce_galas_within_their_noise() {
    for name in NAMES {
        let ours = converged(name);
        let n = ours.len() as f64;
        let hard = Track::of(&ours, 10.0, BinEdges::Hard, 100.0);
        let mut z = Vec::new();
        let mut chi2_counts = 0.0;
        for golden in track(name).iter().filter(|b| b.count >= 500.0) {
            let Some(bin) = hard
                .bins
                .iter()
                .find(|b| (b.bin as f64 * 10.0 - golden.lo_deg).abs() < 1e-9)
            else {
                continue;
            };
            z.push((bin.r_kpc - golden.mean_r_kpc) / bin.r_err_kpc.hypot(golden.se_r_kpc));
            // Poisson errors of both counts, as fractions of all particles.
            let error = (bin.n / (n * n) + golden.count / (200_000.0 * 200_000.0)).sqrt();
            chi2_counts += ((bin.n / n - golden.count / 200_000.0) / error).powi(2);
        }
        let rms = (z.iter().map(|z| z * z).sum::<f64>() / z.len() as f64).sqrt();
        let worst = z.iter().fold(0.0_f64, |m, z| m.max(z.abs()));
        let counts = chi2_counts / z.len() as f64;
        println!(
            "{name}: {} bins, rms z {rms:.2}, worst {worst:.2}, chi2 of counts {counts:.2}",
            z.len()
        );
        assert!(z.len() >= 15, "{name}: only {} bins", z.len());
        // The golden README's limits: rms 0.7-1.4, |z| < 5.
        assert!(
            (0.7..1.4).contains(&rms) && worst < 5.0,
            "{name}: rms {rms}, worst {worst}, {z:?}"
        );
        // Mean of z.len() chi-squares: four standard errors.
        assert!(
            (counts - 1.0).abs() < 4.0 * (2.0 / z.len() as f64).sqrt(),
            "{name}: counts {counts}"
        );
    }
}

#[test]
fn soft_bins_become_hard_ones_as_their_edges_narrow() {
    let ours = arrivals("s0_oblate_tilted", &ModelSettings::default());
    let hard = Track::of(&ours, 10.0, BinEdges::Hard, 40.0);
    let difference = |half_width_deg: f64| {
        let soft = Track::of(&ours, 10.0, BinEdges::Soft { half_width_deg }, 1.0);
        hard.bins
            .iter()
            .map(|h| {
                let s = soft
                    .bins
                    .iter()
                    .find(|s| s.bin == h.bin)
                    .expect("the bin is there too");
                (s.r_kpc / h.r_kpc - 1.0).abs().max((s.n - h.n).abs() / h.n)
            })
            .fold(0.0, f64::max)
    };
    assert!(difference(1e-9) < 1e-12, "{}", difference(1e-9));
    assert!(difference(0.1) < 0.02 && difference(0.1) > 0.0);
}

/// The default, and the same on strands.
fn designs() -> [ModelSettings; 2] {
    let strands = TableSettings {
        design: Design::Strands,
        ..TableSettings::default()
    };
    [TableSettings::default(), strands].map(|releases| ModelSettings {
        releases,
        ..ModelSettings::default()
    })
}

#[test]
fn the_shares_of_all_particles_add_up_to_their_number() {
    for (name, settings) in NAMES.iter().flat_map(|name| designs().map(|d| (name, d))) {
        let ours = arrivals(name, &settings);
        for edges in [BinEdges::Hard, BinEdges::default()] {
            let total: f64 = Track::of(&ours, 10.0, edges, 0.0)
                .bins
                .iter()
                .map(|b| b.n)
                .sum();
            assert!(
                (total - ours.len() as f64).abs() < 1e-9 * total,
                "{name} {edges:?} {total}"
            );
        }
    }
}

#[test]
fn a_strand_is_a_line_between_its_particles() {
    // One strand of three particles, 0, 40 and 80 degrees from the progenitor at radii of 10, 14 and 14. The first and the last
    // keep half of themselves, the lines have the rest.
    let at = |degrees: f64, r: f64| {
        (
            r * degrees.to_radians().cos(),
            r * degrees.to_radians().sin(),
        )
    };
    let places = [at(2.0, 10.0), at(42.0, 14.0), at(82.0, 14.0)];
    let strand = Arrivals {
        x: places.iter().map(|p| p.0).collect(),
        y: places.iter().map(|p| p.1).collect(),
        turns: vec![0.0; 3],
        strands: 1,
        ..Arrivals::default()
    };
    let track = Track::of(&strand, 10.0, BinEdges::Hard, 0.0);
    let bins: Vec<(i64, f64, f64)> = track.bins.iter().map(|b| (b.bin, b.n, b.r_kpc)).collect();
    // Spots every 5 degrees, from 4.5 on, in each bin two of an eighth each; the first line climbs by half a kpc per spot.
    let expected = [
        (0, 0.75, (0.5 * 10.0 + 0.125 * (10.25 + 10.75)) / 0.75),
        (1, 0.25, 11.5),
        (2, 0.25, 12.5),
        (3, 0.25, 13.5),
        (4, 0.25, 14.0),
        (5, 0.25, 14.0),
        (6, 0.25, 14.0),
        (7, 0.25, 14.0),
        (8, 0.5, 14.0),
    ];
    assert_eq!(bins.len(), expected.len());
    for ((bin, n, r), (e_bin, e_n, e_r)) in bins.into_iter().zip(expected) {
        assert_eq!(bin, e_bin);
        assert!(
            (n - e_n).abs() < 1e-12 && (r - e_r).abs() < 1e-12,
            "{bin} {n} {r}"
        );
    }
}

#[test]
fn every_level_bins_as_the_reference_does() {
    for (name, settings) in NAMES.iter().flat_map(|name| designs().map(|d| (name, d))) {
        let ours = arrivals(name, &settings);
        let reference: Vec<_> = (0..ours.len())
            .map(|i| Arrival {
                state: State {
                    x: Vec3::new(ours.x[i], ours.y[i], ours.z[i]),
                    v: Vec3::zero(),
                },
                turns: ours.turns[i],
                unsafe_turns: 0.0,
            })
            .collect();
        for edges in [BinEdges::Hard, BinEdges::default()] {
            let grid = BinGrid {
                width_deg: 10.0,
                first: -20,
                len: 40,
                edges,
            };
            let (mut by_reference, mut by_level) = (Sums::default(), Sums::default());
            grid.sum_arrivals(&reference, ours.strands, &mut by_reference);
            for level in Level::available() {
                grid.sum_at(*level, &ours, &mut by_level, &mut Sums::default());
                for (a, b) in [
                    (&by_level.weight, &by_reference.weight),
                    (&by_level.r, &by_reference.r),
                    (&by_level.r2, &by_reference.r2),
                ] {
                    let apart = a.iter().zip(b).map(|(a, b)| (a - b).abs() / (1.0 + b));
                    assert!(
                        apart.fold(0.0, f64::max) < 1e-11,
                        "{name} {edges:?} {level:?}"
                    );
                }
            }
        }
    }
}

proptest! {
    /// Reverse mode of lines between particles against duals.
    #[test]
    fn pulling_back_sums_of_a_strand_matches_duals(places in prop::array::uniform3((1.0..80.0_f64, -3.0..3.0_f64)), strands in 0..3_usize) {
        let n = places.len();
        let numbers: [f64; 6] = std::array::from_fn(|k| {
            let (r, angle) = places[k / 2];
            if k % 2 == 0 { r * angle.cos() } else { r * angle.sin() }
        });
        let duals: [Dual<6>; 6] = lift(&numbers);
        let grid = BinGrid { width_deg: 10.0, first: -90, len: 180, edges: BinEdges::default() };
        let zero = Dual::<6>::from_re(0.0);
        let reference: Vec<Arrival<Dual<6>>> = (0..n)
            .map(|i| Arrival {
                state: State { x: Vec3::new(duals[2 * i], duals[2 * i + 1], zero), v: Vec3::from_f64(Vec3::zero()) },
                turns: zero,
                unsafe_turns: zero,
            })
            .collect();
        let mut sums = Sums::default();
        grid.sum_arrivals(&reference, strands, &mut sums);
        let mut total = zero;
        let mut by = Sums { weight: vec![0.0; 180], r: vec![0.0; 180], r2: vec![0.0; 180] };
        for i in 0..180 {
            let (a, b, c) = (0.3 + i as f64 * 0.01, 1.7 - i as f64 * 0.02, 0.001 * i as f64);
            total += sums.weight[i] * a + sums.r[i] * b + sums.r2[i] * c;
            (by.weight[i], by.r[i], by.r2[i]) = (a, b, c);
        }
        let arrivals = Arrivals {
            x: numbers.iter().step_by(2).copied().collect(),
            y: numbers.iter().skip(1).step_by(2).copied().collect(),
            turns: vec![0.0; n],
            strands,
            ..Arrivals::default()
        };
        let (mut by_x, mut by_y) = (Vec::new(), Vec::new());
        grid.pull_back(&arrivals, &by, &mut by_x, &mut by_y);
        let expected: [f64; 6] = gradient_of(&total);
        let scale = expected.iter().fold(1e-3_f64, |m, g| m.max(g.abs()));
        for i in 0..n {
            prop_assert!((expected[2 * i] - by_x[i]).abs() < 1e-11 * scale, "{expected:?} {by_x:?}");
            prop_assert!((expected[2 * i + 1] - by_y[i]).abs() < 1e-11 * scale, "{expected:?} {by_y:?}");
        }
    }

    /// Reverse mode of the bins against duals, particles anywhere, at edges too.
    #[test]
    fn pulling_back_sums_matches_duals(x in -80.0..80.0_f64, y in -80.0..80.0_f64, turns in -1..2_i32,
                                       soft in any::<bool>(), at_edge in any::<bool>()) {
        let edges = if soft { BinEdges::default() } else { BinEdges::Hard };
        let (x, y) = if at_edge {
            // On the edge between two bins, to rounding. A hard edge has another derivative on each side, and duals
            // round otherwise than numbers do: there just above it.
            let r = x.hypot(y).max(1.0);
            let edge = (y.atan2(x).to_degrees() / 10.0).round().to_radians() * 10.0;
            let angle = if soft { edge } else { edge + 1e-9 };
            (r * angle.cos(), r * angle.sin())
        } else {
            (x, y)
        };
        prop_assume!(x.hypot(y) > 0.1);
        let grid = BinGrid { width_deg: 10.0, first: -90, len: 180, edges };
        let [dx, dy]: [Dual<2>; 2] = lift(&[x, y]);
        let turns = f64::from(turns);
        let arrival = Arrival {
            state: State {
                x: Vec3::new(dx, dy, Dual::from_re(0.0)),
                v: Vec3::from_f64(Vec3::zero()),
            },
            turns: Dual::from_re(turns),
            unsafe_turns: Dual::from_re(0.0),
        };
        let mut duals = Sums::default();
        grid.sum_arrivals(&[arrival], 0, &mut duals);
        // A scalar that weighs every sum differently.
        let weigh = |i: usize| (0.3 + i as f64 * 0.01, 1.7 - i as f64 * 0.02, 0.001 * i as f64);
        let mut total = Dual::<2>::from_re(0.0);
        let mut by = Sums { weight: vec![0.0; 180], r: vec![0.0; 180], r2: vec![0.0; 180] };
        for i in 0..180 {
            let (a, b, c) = weigh(i);
            total += duals.weight[i] * a + duals.r[i] * b + duals.r2[i] * c;
            (by.weight[i], by.r[i], by.r2[i]) = (a, b, c);
        }
        let arrivals = Arrivals { x: vec![x], y: vec![y], turns: vec![turns], ..Arrivals::default() };
        let (mut by_x, mut by_y) = (Vec::new(), Vec::new());
        grid.pull_back(&arrivals, &by, &mut by_x, &mut by_y);
        let [gx, gy] = gradient_of(&total);
        let scale = gx.abs().max(gy.abs()).max(1e-3);
        prop_assert!((gx - by_x[0]).abs() < 1e-11 * scale, "{gx} {}", by_x[0]);
        prop_assert!((gy - by_y[0]).abs() < 1e-11 * scale, "{gy} {}", by_y[0]);
    }
}
