//! Tracks against gala's, hard against soft bins, and the bins' derivatives.

use crate::gala::{NAMES, measured, system, track};
use oblate::orbit::{FinalParticle, State};
use oblate::scalar::{Dual, LANES, Level, Vec3, gradient_of, lift};
use oblate::spray::{Neighbourhood, SamplingScheme, TableSettings};
use oblate::stream::{Model, ModelSettings, Particles, StepSchedules};
use oblate::track::{BinEdges, BinGrid, PartialSums, Sums, Track};
use proptest::prelude::*;
use std::sync::{Arc, LazyLock};

fn particles(name: &str, settings: &ModelSettings) -> Particles {
    let model = Model::new(settings).expect("a model");
    let solution = model
        .progenitor_solution(&system(name))
        .expect("a progenitor solution");
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

/// Those of all streams, which two tests compare with gala's.
static CONVERGED: LazyLock<Vec<Particles>> =
    LazyLock::new(|| NAMES.into_iter().map(converged).collect());

/// Asserts that the mean of the squares of as many normal deviates is 1 within four standard errors, and that none is beyond five.
fn are_noise(what: &str, z: &[f64]) {
    let count = z.len() as f64;
    let mean_square = z.iter().map(|z| z * z).sum::<f64>() / count;
    let worst = z.iter().fold(0.0_f64, |m, z| m.max(z.abs()));
    println!("{what}: {count} bins, mean z^2 {mean_square:.2}, worst {worst:.2}");
    assert!(count >= 15.0, "{what}: only {count} bins");
    assert!(
        (mean_square - 1.0).abs() < 4.0 * (2.0 / count).sqrt() && worst < 5.0,
        "{what}: {z:?}"
    );
}

/// The variance of the scatter of `n` independent radii whose fourth moment is that of these particles in a hard bin of ten degrees,
/// times `n`.
fn variance_of_width(particles: &Particles, bin: i64) -> f64 {
    let of_bin = |i: &usize| (particles.angle(*i).to_degrees() / 10.0).floor() as i64 == bin;
    let radii: Vec<f64> = (0..particles.len())
        .filter(of_bin)
        .map(|i| particles.x[i].hypot(particles.y[i]))
        .collect();
    let average =
        |f: &dyn Fn(f64) -> f64| radii.iter().map(|r| f(*r)).sum::<f64>() / radii.len() as f64;
    let mean = average(&|r| r);
    let [m2, m4] = [2, 4].map(|power| average(&|r| (r - mean).powi(power)));
    (m4 / m2 - m2) / 4.0
}

#[test]
fn tracks_reproduce_galas_within_their_noise() {
    for (name, ours) in NAMES.into_iter().zip(CONVERGED.iter()) {
        let n = ours.len() as f64;
        let hard = Track::new(ours, 10.0, BinEdges::Hard, 100.0).expect("a track");
        let mut z = Vec::new();
        let mut chi2_counts = 0.0;
        for golden in track(name).iter().filter(|b| b.count >= 500.0) {
            // One in 400 of the particles: 200 of ours.
            let bin = hard
                .bins
                .iter()
                .find(|b| (b.bin as f64 * 10.0 - golden.lo_deg).abs() < 1e-9)
                .unwrap_or_else(|| panic!("{name}: no bin at {}", golden.lo_deg));
            z.push((bin.r_kpc - golden.mean_r_kpc) / bin.r_err_kpc.hypot(golden.se_r_kpc));
            // Poisson errors of both counts, as fractions of all particles.
            let error = (bin.n / (n * n) + golden.count / (200_000.0 * 200_000.0)).sqrt();
            chi2_counts += ((bin.n / n - golden.count / 200_000.0) / error).powi(2);
        }
        are_noise(&format!("{name}, radii"), &z);
        let counts = chi2_counts / z.len() as f64;
        println!("chi2 of counts {counts:.2}");
        // Mean of z.len() chi-squares: four standard errors.
        assert!(
            (counts - 1.0).abs() < 4.0 * (2.0 / z.len() as f64).sqrt(),
            "{name}: counts {counts}"
        );
    }
}

#[test]
fn velocities_and_widths_reproduce_galas_within_their_noise() {
    for (name, ours) in NAMES.into_iter().zip(CONVERGED.iter()) {
        let hard = Track::new(ours, 10.0, BinEdges::Hard, 100.0).expect("a track");
        let mut z = [Vec::new(), Vec::new()];
        for golden in measured(name).iter().filter(|b| b.n >= 500.0) {
            let bin = (hard.bins.iter())
                .find(|b| (b.phi_deg - golden.phi_deg).abs() < 1e-9)
                .unwrap_or_else(|| panic!("{name}: no bin at {}", golden.phi_deg));
            let of_mean = golden.sd_of_v_km_s / golden.n.sqrt();
            z[0].push((bin.v_km_s - golden.v_km_s) / bin.v_err_km_s.hypot(of_mean));
            // Radii are not normal, so that the error that a bin has of its width is not that of the scatter.
            let error = (variance_of_width(ours, bin.bin) * (1.0 / bin.n + 1.0 / golden.n)).sqrt();
            z[1].push((bin.width_kpc - golden.sd_of_r_kpc) / error);
        }
        for (what, z) in ["velocities", "widths"].into_iter().zip(&z) {
            are_noise(&format!("{name}, {what}"), z);
        }
    }
}

#[test]
fn soft_bins_become_hard_ones_as_their_edges_narrow() {
    let ours = particles("s0_oblate_tilted", &ModelSettings::default());
    let hard = Track::new(&ours, 10.0, BinEdges::Hard, 40.0).expect("a track");
    let difference = |half_width_deg: f64| {
        let soft =
            Track::new(&ours, 10.0, BinEdges::Soft { half_width_deg }, 1.0).expect("a track");
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

/// The default, smeared particles, and the same particles as points.
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
fn the_weights_of_all_bins_add_up_to_the_number_of_particles() {
    for (name, settings) in NAMES
        .iter()
        .flat_map(|name| sampling_schemes().map(|d| (name, d)))
    {
        let ours = particles(name, &settings);
        for edges in [BinEdges::Hard, BinEdges::default()] {
            let total: f64 = Track::new(&ours, 10.0, edges, 0.0)
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

/// Particles whose neighbours are each other: `count` of them, after the partner, with these weights by neighbour and random number.
fn neighbourhood(n: usize, count: usize, weights: &[[f64; 4]]) -> Neighbourhood {
    let lanes = |offset: usize| std::array::from_fn(|lane| ((lane + offset) % n) as u32);
    Neighbourhood {
        count,
        normals: 4,
        reach: n,
        indices: (0..count).map(|j| lanes(j + 2)).collect(),
        partners: vec![lanes(1)],
        weights: weights
            .iter()
            .take(count)
            .flat_map(|of_one| of_one.map(|weight| [weight; LANES]))
            .collect(),
    }
}

/// Particles at these radii and angles.
fn at_places(places: &[(f64, f64)], neighbourhood: Neighbourhood) -> Particles {
    Particles {
        x: places.iter().map(|(r, angle)| r * angle.cos()).collect(),
        y: places.iter().map(|(r, angle)| r * angle.sin()).collect(),
        winding_numbers: vec![0.0; places.len()],
        neighbourhood: Some(Arc::new(neighbourhood)),
        ..Particles::default()
    }
}

#[test]
fn bins_with_an_offset_are_those_of_particles_turned_back() {
    let places = [(50.0, 0.05), (52.0, 0.2), (47.0, -0.4), (61.0, 1.3)];
    let offset_deg = 3.7_f64;
    let turned = places.map(|(r, angle)| (r, angle - offset_deg.to_radians()));
    for edges in [BinEdges::Hard, BinEdges::default()] {
        let sums = |places: &[(f64, f64); 4], offset_deg| {
            let grid = BinGrid {
                width_deg: 10.0,
                offset_deg,
                first: -9,
                len: 18,
                edges,
            };
            let particles = at_places(places, neighbourhood(4, 0, &[]));
            let mut sums = Sums::default();
            grid.sum(&particles, &mut sums, &mut PartialSums::default());
            assert!((grid.centre_deg(2) - 25.0 - offset_deg).abs() < 1e-12);
            sums
        };
        let (a, b) = (sums(&places, offset_deg), sums(&turned, 0.0));
        let apart = a.weight.iter().zip(&b.weight).chain(a.r.iter().zip(&b.r));
        assert!(apart.clone().any(|(a, _)| *a > 0.1));
        for (a, b) in apart {
            assert!((a - b).abs() < 1e-11, "{edges:?}: {a} {b}");
        }
    }
}

#[test]
fn a_smeared_particle_has_the_width_and_slope_that_its_partner_gives() {
    // Ten degrees and two kpc apart; what is wider than that is bounded.
    let (apart, rise) = (10.0_f64.to_radians(), 2.0);
    let two = at_places(
        &[(50.0, 0.05), (50.0 + rise, 0.05 + apart)],
        neighbourhood(2, 0, &[]),
    );
    let grid = BinGrid {
        width_deg: 10.0,
        offset_deg: 0.0,
        first: -9,
        len: 18,
        edges: BinEdges::Soft {
            half_width_deg: 2.0,
        },
    };
    let mut sums = Sums::default();
    grid.sum(&two, &mut sums, &mut PartialSums::default());
    let mut expected = [[0.0; 18]; 2];
    for (angle, r, rise, apart) in [
        (0.05, 50.0, rise, apart),
        (0.05 + apart, 50.0 + rise, -rise, -apart),
    ] {
        let reach = 30.0_f64.to_radians();
        let far = (2.0 * (apart / 2.0).sin() / reach).powi(2) + (rise / (0.3 * r)).powi(2);
        let (a, b) = (apart.sin() / (1.0 + far).sqrt(), rise / (1.0 + far).sqrt());
        let variance = a * a / 3.0 + 0.1_f64.to_radians().powi(2);
        let width2 = variance / (1.0 + variance / 10.0_f64.to_radians().powi(2));
        let slope = a * b / 3.0 / variance;
        let slope = slope / (1.0 + width2 * (slope / (0.1 * r)).powi(2)).sqrt();
        let half = (7.0 * width2 + 2.0_f64.to_radians().powi(2)).sqrt();
        // The biweight kernel, by the midpoint rule.
        let points = 200_000;
        for k in 0..points {
            let u = (2 * k + 1) as f64 / f64::from(points) - 1.0;
            let weight = 15.0 / 16.0 * (1.0 - u * u).powi(2) * 2.0 / f64::from(points);
            let bin = ((angle + u * half).to_degrees() / 10.0 + 9.0).floor() as usize;
            expected[0][bin] += weight;
            expected[1][bin] += weight * (r + slope * u * half);
        }
    }
    for bin in 0..18 {
        assert!(
            (sums.weight[bin] - expected[0][bin]).abs() < 1e-4,
            "{bin}: {} {}",
            sums.weight[bin],
            expected[0][bin]
        );
        assert!(
            (sums.r[bin] - expected[1][bin]).abs() < 5e-3,
            "{bin}: {} {}",
            sums.r[bin],
            expected[1][bin]
        );
    }
}

#[test]
fn neighbours_half_a_turn_away_do_not_count_and_those_a_whole_turn_away_do() {
    let width = |angle: f64, turns: f64| {
        let mut two = at_places(&[(50.0, 0.0), (50.0, angle)], neighbourhood(2, 0, &[]));
        two.winding_numbers[1] = turns;
        let track = Track::new(&two, 1.0, BinEdges::Hard, 1e-6).expect("a track");
        track.bins.iter().filter(|b| b.bin.abs() < 60).count()
    };
    let (near, turned) = (width(0.1, 0.0), width(0.1, 5.0));
    assert!(near > 10 && turned >= 10, "{near} {turned}");
    assert!(width(std::f64::consts::PI, 0.0) <= 2);
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
                winding_number: ours.winding_numbers[i],
                ambiguous_windings: 0.0,
            })
            .collect();
        for edges in [BinEdges::Hard, BinEdges::default()] {
            let grid = BinGrid {
                width_deg: 10.0,
                offset_deg: 3.7,
                first: -20,
                len: 40,
                edges,
            };
            let (mut by_reference, mut by_level) = (Sums::default(), Sums::default());
            let around = ours.neighbourhood.as_deref();
            let offset_deg = grid.offset_deg;
            grid.sum_final_particles(
                &reference,
                &[],
                around,
                offset_deg,
                false,
                &mut by_reference,
            );
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

/// Sums of `len` bins with velocities, all zero.
fn sums_with_velocities(len: usize) -> Sums<f64> {
    let mut sums = Sums::default();
    sums.reset(len);
    sums.reset_velocities();
    sums
}

proptest! {
    /// Reverse mode of smeared particles against duals.
    #[test]
    fn vjp_of_sums_of_smeared_particles_matches_duals(
        places in prop::array::uniform4((1.0..80.0_f64, -3.0..3.0_f64)),
        velocities in prop::array::uniform4(-200.0..200.0_f64),
        weights in prop::array::uniform2(prop::array::uniform4(-0.5..0.5_f64)),
        of_particles in prop::array::uniform4(0.0..3.0_f64),
        count in 0..3_usize,
        hard: bool,
    ) {
        let edges = if hard { BinEdges::Hard } else { BinEdges::default() };
        let n = places.len();
        let numbers: [f64; 8] = std::array::from_fn(|k| {
            let (r, angle) = places[k / 2];
            if k % 2 == 0 { r * angle.cos() } else { r * angle.sin() }
        });
        let mut variables = [3.7; 17];
        variables[..8].copy_from_slice(&numbers);
        variables[9..13].copy_from_slice(&velocities);
        variables[13..].copy_from_slice(&of_particles);
        let duals: [Dual<17>; 17] = lift(&variables);
        let grid = BinGrid { width_deg: 10.0, offset_deg: 3.7, first: -90, len: 180, edges };
        let around = neighbourhood(n, count, &weights);
        let zero = Dual::<17>::from_re(0.0);
        let reference: Vec<FinalParticle<Dual<17>>> = (0..n)
            .map(|i| FinalParticle {
                state: State {
                    x: Vec3::new(duals[2 * i], duals[2 * i + 1], zero),
                    v: Vec3::new(zero, zero, duals[9 + i]),
                },
                winding_number: zero,
                ambiguous_windings: zero,
            })
            .collect();
        let mut sums = Sums::default();
        grid.sum_final_particles(&reference, &duals[13..], Some(&around), duals[8], true, &mut sums);
        let mut total = zero;
        let mut by = sums_with_velocities(180);
        for i in 0..180 {
            let (a, b, c) = (0.3 + i as f64 * 0.01, 1.7 - i as f64 * 0.02, 0.001 * i as f64);
            let (d, e) = (0.2 + 0.003 * i as f64, 1e-4 * (i as f64 - 40.0));
            total += sums.weight[i] * a + sums.r[i] * b + sums.r2[i] * c;
            total += sums.v[i] * d + sums.v2[i] * e;
            (by.weight[i], by.r[i], by.r2[i], by.v[i], by.v2[i]) = (a, b, c, d, e);
        }
        let mut particles = at_places(&places, around);
        particles.v[2] = velocities.to_vec();
        particles.weights = of_particles.to_vec();
        let [mut x_bar, mut y_bar, mut vz_bar, mut weight_bar] = [const { Vec::new() }; 4];
        let columns = [&mut x_bar, &mut y_bar, &mut vz_bar, &mut weight_bar];
        let offset_bar = grid.vjp(&particles, &by, columns);
        let expected: [f64; 17] = gradient_of(&total);
        let scale = expected.iter().fold(1e-3_f64, |m, g| m.max(g.abs()));
        prop_assert!((expected[8] - offset_bar).abs() < 1e-11 * scale, "{expected:?} {offset_bar}");
        for i in 0..n {
            prop_assert!((expected[2 * i] - x_bar[i]).abs() < 1e-11 * scale, "{expected:?} {x_bar:?}");
            prop_assert!((expected[2 * i + 1] - y_bar[i]).abs() < 1e-11 * scale, "{expected:?} {y_bar:?}");
            prop_assert!((expected[9 + i] - vz_bar[i]).abs() < 1e-11 * scale, "{expected:?} {vz_bar:?}");
            prop_assert!((expected[13 + i] - weight_bar[i]).abs() < 1e-11 * scale, "{expected:?} {weight_bar:?}");
        }
        // The sums in lanes and those of the reference.
        let mut by_particles = Sums::default();
        grid.sum(&particles, &mut by_particles, &mut PartialSums::default());
        prop_assert!(!by_particles.has_velocities());
        grid.sum_velocities(&particles, &mut by_particles);
        for (duals, numbers) in [
            (&sums.weight, &by_particles.weight),
            (&sums.r, &by_particles.r),
            (&sums.r2, &by_particles.r2),
            (&sums.v, &by_particles.v),
            (&sums.v2, &by_particles.v2),
        ] {
            for (dual, number) in duals.iter().zip(numbers) {
                prop_assert!((dual.re - number).abs() < 1e-9 * (1.0 + number.abs()));
            }
        }
        let squares = of_particles.iter().map(|w| w * w).sum::<f64>() / 4.0;
        prop_assert!((by_particles.mean_square_weight - squares).abs() < 1e-12);
    }

    /// Reverse mode of the bins against duals, particles anywhere, at edges too.
    #[test]
    fn vjp_of_sums_matches_duals(x in -80.0..80.0_f64, y in -80.0..80.0_f64, turns in -1..2_i32,
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
        let grid = BinGrid { width_deg: 10.0, offset_deg: 0.0, first: -90, len: 180, edges };
        let vz = 70.0 - x;
        let [dx, dy, offset, dvz]: [Dual<4>; 4] = lift(&[x, y, grid.offset_deg, vz]);
        let turns = f64::from(turns);
        let particle = FinalParticle {
            state: State {
                x: Vec3::new(dx, dy, Dual::from_re(0.0)),
                v: Vec3::new(Dual::from_re(0.0), Dual::from_re(0.0), dvz),
            },
            winding_number: Dual::from_re(turns),
            ambiguous_windings: Dual::from_re(0.0),
        };
        let mut duals = Sums::default();
        grid.sum_final_particles(&[particle], &[], None, offset, true, &mut duals);
        // A scalar with another weight for every sum.
        let weigh = |i: usize| (0.3 + i as f64 * 0.01, 1.7 - i as f64 * 0.02, 0.001 * i as f64);
        let mut total = Dual::<4>::from_re(0.0);
        let mut by = sums_with_velocities(180);
        for i in 0..180 {
            let (a, b, c) = weigh(i);
            total += duals.weight[i] * a + duals.r[i] * b + duals.r2[i] * c;
            total += duals.v[i] * b + duals.v2[i] * a;
            (by.weight[i], by.r[i], by.r2[i], by.v[i], by.v2[i]) = (a, b, c, b, a);
        }
        let particles = Particles {
            x: vec![x],
            y: vec![y],
            v: [vec![0.0], vec![0.0], vec![vz]],
            winding_numbers: vec![turns],
            ..Particles::default()
        };
        let [mut x_bar, mut y_bar, mut vz_bar, mut weight_bar] = [const { Vec::new() }; 4];
        let columns = [&mut x_bar, &mut y_bar, &mut vz_bar, &mut weight_bar];
        let offset_bar = grid.vjp(&particles, &by, columns);
        let [gx, gy, by_offset, gv] = gradient_of(&total);
        let scale = gx.abs().max(gy.abs()).max(1e-3);
        prop_assert!((gv - vz_bar[0]).abs() < 1e-11 * gv.abs().max(1e-3), "{gv} {}", vz_bar[0]);
        prop_assert!((gx - x_bar[0]).abs() < 1e-11 * scale, "{gx} {}", x_bar[0]);
        prop_assert!((gy - y_bar[0]).abs() < 1e-11 * scale, "{gy} {}", y_bar[0]);
        let scale = scale.max(by_offset.abs());
        prop_assert!((by_offset - offset_bar).abs() < 1e-11 * scale, "{by_offset} {offset_bar}");
    }
}
