//! Tracks against gala's, hard against soft bins, and the bins' derivatives.

use crate::gala::{NAMES, system, track};
use oblate::orbit::{FinalParticle, State};
use oblate::scalar::Level;
use oblate::scalar::{Dual, Vec3, gradient_of, lift};
use oblate::spray::{SamplingScheme, TableSettings};
use oblate::stream::{Model, ModelSettings, Particles, StepSchedules};
use oblate::track::{BinEdges, BinGrid, PartialSums, Sums, Track};
use proptest::prelude::*;

fn particles(name: &str, settings: &ModelSettings) -> Particles {
    let model = Model::new(settings).expect("a model");
    let solution = model.progenitor_solution(&system(name)).expect("a setup");
    let (mut schedules, mut out) = (StepSchedules::default(), Particles::default());
    model
        .integrate(&solution, &mut schedules, &mut out)
        .expect("particles");
    out
}

/// gala's release times (2,000), independent random numbers, and steps so fine that only noise is left.
fn converged(name: &str) -> Particles {
    let releases = TableSettings {
        particles: 80_000,
        release_times: 2_000,
        sampling_scheme: SamplingScheme::Random,
        ..TableSettings::default()
    };
    particles(
        name,
        &ModelSettings {
            releases,
            step_phase: 0.4,
            max_halvings: 9,
            ..ModelSettings::default()
        },
    )
}

#[test]
fn tracks_reproduce_galas_within_their_noise() {
    for name in NAMES {
        let ours = converged(name);
        let n = ours.len() as f64;
        let hard = Track::of(&ours, 10.0, BinEdges::Hard, 100.0).expect("a track");
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
    let ours = particles("s0_oblate_tilted", &ModelSettings::default());
    let hard = Track::of(&ours, 10.0, BinEdges::Hard, 40.0).expect("a track");
    let difference = |half_width_deg: f64| {
        let soft = Track::of(&ours, 10.0, BinEdges::Soft { half_width_deg }, 1.0).expect("a track");
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

/// The default, particles smeared along segments, and the same as points.
fn sampling_schemes() -> [ModelSettings; 2] {
    let alone = TableSettings {
        sampling_scheme: SamplingScheme::Sobol,
        ..TableSettings::default()
    };
    [TableSettings::default(), alone].map(|releases| ModelSettings {
        releases,
        ..ModelSettings::default()
    })
}

#[test]
fn the_shares_of_all_particles_add_up_to_their_number() {
    for (name, settings) in NAMES
        .iter()
        .flat_map(|name| sampling_schemes().map(|d| (name, d)))
    {
        let ours = particles(name, &settings);
        for edges in [BinEdges::Hard, BinEdges::default()] {
            let total: f64 = Track::of(&ours, 10.0, edges, 0.0)
                .expect("a track")
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
fn a_linked_particle_is_spread_along_the_way_to_its_partner() {
    // From (5 degrees, 10 kpc) the neighbour is the root of two half-lengths away in angle, and one half-length in radius: half
    // of the distance is kept, and the same on the other side. The neighbour is too far to reach the bins below 10 degrees.
    let across: f64 = 15.0 * 2.0_f64.sqrt();
    let at = |degrees: f64, r: f64| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        (r * cos, r * sin)
    };
    let places = [at(5.0, 10.0), at(5.0 + across, 13.0)];
    let two = Particles {
        x: places.iter().map(|p| p.0).collect(),
        y: places.iter().map(|p| p.1).collect(),
        turns: vec![0.0; 2],
        neighbour_offset: 1,
        ..Particles::default()
    };
    let track = Track::of(&two, 10.0, BinEdges::Hard, 0.0).expect("a track");
    // At 5 -+ 2.65 and 7.95 degrees, 10 -+ 0.375 and 1.125 kpc.
    for (bin, n, r) in [(-1, 0.25, 8.875), (0, 0.5, 10.0)] {
        let there = track.bins.iter().find(|b| b.bin == bin).expect("a bin");
        assert!((there.n - n).abs() < 1e-12, "{there:?}");
        assert!((there.r_kpc - r).abs() < 1e-12, "{there:?}");
    }
    // The neighbour of the last particle is the one before it: it is smeared as well.
    let last = track.bins.iter().find(|b| b.bin == 3).expect("a bin");
    assert!(last.r_kpc > 13.0 && last.n < 0.5, "{last:?}");
}

proptest! {
    /// However far their neighbours are, particles stay within two bins and a third of their radius.
    #[test]
    fn links_do_not_reach_far(places in prop::array::uniform2((1.0..200.0_f64, -3.1..3.1_f64)), turns in -3..4_i32) {
        let two = Particles {
            x: places.iter().map(|(r, angle)| r * angle.cos()).collect(),
            y: places.iter().map(|(r, angle)| r * angle.sin()).collect(),
            turns: vec![0.0, f64::from(turns)],
            neighbour_offset: 1,
            ..Particles::default()
        };
        let track = Track::of(&two, 10.0, BinEdges::Hard, 0.0).expect("a track");
        let total: f64 = track.bins.iter().map(|b| b.n).sum();
        prop_assert!((total - 2.0).abs() < 1e-12);
        let of = |i: usize| (two.angle(i).to_degrees() / 10.0, places[i].0);
        for bin in &track.bins {
            let near = [of(0), of(1)].iter().any(|(position, r)| {
                (bin.bin as f64 + 0.5 - position).abs() < 2.0 && (bin.r_kpc / r - 1.0).abs() < 0.3
            });
            let both = bin.n > 0.25 - 1e-9 && {
                let (lo, hi) = (places[0].0.min(places[1].0), places[0].0.max(places[1].0));
                bin.r_kpc > 0.7 * lo && bin.r_kpc < 1.3 * hi
            };
            prop_assert!(near || both, "{bin:?}");
        }
    }
}

#[test]
fn every_level_bins_as_the_reference_does() {
    for (name, settings) in NAMES
        .iter()
        .flat_map(|name| sampling_schemes().map(|d| (name, d)))
    {
        let ours = particles(name, &settings);
        let reference: Vec<_> = (0..ours.len())
            .map(|i| FinalParticle {
                state: State {
                    x: Vec3::new(ours.x[i], ours.y[i], ours.z[i]),
                    v: Vec3::zero(),
                },
                turns: ours.turns[i],
                ambiguous_windings: 0.0,
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
            grid.sum_final_particles(&reference, ours.neighbour_offset, &mut by_reference);
            for level in Level::available() {
                grid.sum_at(*level, &ours, &mut by_level, &mut PartialSums::default());
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
    /// Reverse mode of particles smeared along segments, against dual numbers.
    #[test]
    fn pulling_back_sums_of_linked_particles_matches_duals(places in prop::array::uniform4((1.0..80.0_f64, -3.0..3.0_f64)), neighbour_offset in 0..3_usize) {
        let n = places.len();
        let numbers: [f64; 8] = std::array::from_fn(|k| {
            let (r, angle) = places[k / 2];
            if k % 2 == 0 { r * angle.cos() } else { r * angle.sin() }
        });
        let duals: [Dual<8>; 8] = lift(&numbers);
        let grid = BinGrid { width_deg: 10.0, first: -90, len: 180, edges: BinEdges::default() };
        let zero = Dual::<8>::from_re(0.0);
        let reference: Vec<FinalParticle<Dual<8>>> = (0..n)
            .map(|i| FinalParticle {
                state: State { x: Vec3::new(duals[2 * i], duals[2 * i + 1], zero), v: Vec3::from_f64(Vec3::zero()) },
                turns: zero,
                ambiguous_windings: zero,
            })
            .collect();
        let mut sums = Sums::default();
        grid.sum_final_particles(&reference, neighbour_offset, &mut sums);
        let mut total = zero;
        let mut by = Sums { weight: vec![0.0; 180], r: vec![0.0; 180], r2: vec![0.0; 180] };
        for i in 0..180 {
            let (a, b, c) = (0.3 + i as f64 * 0.01, 1.7 - i as f64 * 0.02, 0.001 * i as f64);
            total += sums.weight[i] * a + sums.r[i] * b + sums.r2[i] * c;
            (by.weight[i], by.r[i], by.r2[i]) = (a, b, c);
        }
        let particles = Particles {
            x: numbers.iter().step_by(2).copied().collect(),
            y: numbers.iter().skip(1).step_by(2).copied().collect(),
            turns: vec![0.0; n],
            neighbour_offset,
            ..Particles::default()
        };
        let (mut x_bar, mut y_bar) = (Vec::new(), Vec::new());
        grid.vjp(&particles, &by, &mut x_bar, &mut y_bar);
        let expected: [f64; 8] = gradient_of(&total);
        let scale = expected.iter().fold(1e-3_f64, |m, g| m.max(g.abs()));
        for i in 0..n {
            prop_assert!((expected[2 * i] - x_bar[i]).abs() < 1e-11 * scale, "{expected:?} {x_bar:?}");
            prop_assert!((expected[2 * i + 1] - y_bar[i]).abs() < 1e-11 * scale, "{expected:?} {y_bar:?}");
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
        let particle = FinalParticle {
            state: State {
                x: Vec3::new(dx, dy, Dual::from_re(0.0)),
                v: Vec3::from_f64(Vec3::zero()),
            },
            turns: Dual::from_re(turns),
            ambiguous_windings: Dual::from_re(0.0),
        };
        let mut duals = Sums::default();
        grid.sum_final_particles(&[particle], 0, &mut duals);
        // A scalar that weighs every sum differently.
        let weigh = |i: usize| (0.3 + i as f64 * 0.01, 1.7 - i as f64 * 0.02, 0.001 * i as f64);
        let mut total = Dual::<2>::from_re(0.0);
        let mut by = Sums { weight: vec![0.0; 180], r: vec![0.0; 180], r2: vec![0.0; 180] };
        for i in 0..180 {
            let (a, b, c) = weigh(i);
            total += duals.weight[i] * a + duals.r[i] * b + duals.r2[i] * c;
            (by.weight[i], by.r[i], by.r2[i]) = (a, b, c);
        }
        let particles = Particles { x: vec![x], y: vec![y], turns: vec![turns], ..Particles::default() };
        let (mut x_bar, mut y_bar) = (Vec::new(), Vec::new());
        grid.vjp(&particles, &by, &mut x_bar, &mut y_bar);
        let [gx, gy] = gradient_of(&total);
        let scale = gx.abs().max(gy.abs()).max(1e-3);
        prop_assert!((gx - x_bar[0]).abs() < 1e-11 * scale, "{gx} {}", x_bar[0]);
        prop_assert!((gy - y_bar[0]).abs() < 1e-11 * scale, "{gy} {}", y_bar[0]);
    }
}
