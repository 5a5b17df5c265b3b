//! Releases against 60-digit values, and the table of draws.

use crate::golden::{cases, json, number, numbers};
use oblate::orbit::State;
use oblate::potential::{Disc, DiscProfile, DiscShape, FlattenedNfw};
use oblate::scalar::{Dual, LANES, Real, Vec3, gradient_of, lift};
use oblate::spray::{
    Recipe, Release, ReleaseOffset, ReleaseTable, SamplingScheme, TableSettings, Tail, Tidal,
};
use serde_json::Value;

/// The golden files' own tolerance, relative to `r_j` for offsets and to the velocity scale for velocities.
const TOLERANCE: f64 = 1e-11;

fn host(case: &Value) -> FlattenedNfw<f64> {
    let v = Vec3::from(numbers::<3>(&case["v"]));
    let axis = v * (1.0 / f64::sqrt(v.norm2()));
    FlattenedNfw::new(
        number(&case["M"]),
        number(&case["Rs"]),
        number(&case["q"]),
        axis,
    )
}

fn progenitor(case: &Value) -> State<f64> {
    State {
        x: Vec3::from(numbers::<3>(&case["x"])),
        v: Vec3::from(numbers::<3>(&case["vel"])),
    }
}

/// Offset from the progenitor for a release offset, position then velocity.
fn scaled(offset: &ReleaseOffset, tidal: &Tidal<f64>, scales: (f64, f64)) -> [f64; 6] {
    let combine = |c: [f64; 3], scale: f64| {
        tidal
            .frame
            .iter()
            .zip(c)
            .fold(Vec3::zero(), |sum, (e, c)| sum + *e * (c * scale))
    };
    let (x, v) = (
        combine(offset.position, scales.0),
        combine(offset.velocity, scales.1),
    );
    [x.x, x.y, x.z, v.x, v.y, v.z]
}

fn check(case: &Value, recipe: Recipe, xi_names: &[&str], velocity_unit: f64) {
    let id = &case["id"];
    let m = number(&case["m"]);
    let p = progenitor(case);
    let tidal = Tidal::new(&host(case), m, p);
    assert!(
        (tidal.r_j / number(&case["r_j"]) - 1.0).abs() < TOLERANCE,
        "r_j {id}"
    );
    assert!(!tidal.bounded, "{id}");
    let mut xi = [0.0; 5];
    for (slot, name) in xi.iter_mut().zip(xi_names) {
        *slot = number(&case["xi"][*name]);
    }
    let scales = recipe.scales(&tidal, m);
    let progenitor_state = [p.x.to_array(), p.v.to_array()].concat();
    for (tail, key) in [(Tail::Leading, "lead"), (Tail::Trailing, "trail")] {
        let offset = recipe
            .release_offset(&xi, tail)
            .expect("no golden case has a radius below zero");
        let ours = scaled(&offset, &tidal, scales);
        let golden = numbers::<6>(&case[key]);
        for i in 0..6 {
            let unit = if i < 3 { tidal.r_j } else { velocity_unit };
            // The golden state is progenitor plus offset: its last digit limits the difference.
            let rounding = 4e-16 * golden[i].abs();
            let error = (progenitor_state[i] + ours[i] - golden[i]).abs();
            assert!(
                error < TOLERANCE * unit + rounding,
                "{recipe:?} {key} {id} [{i}]: {error:e}"
            );
        }
    }
}

#[test]
fn releases_meet_the_60_digit_values() {
    let file = json("spray_release.json");
    assert_eq!(cases(&file).len(), 40);
    for case in cases(&file) {
        let unit = number(&case["r_j"]) * number(&case["Omega"]);
        check(case, Recipe::Fardal2015, &["r", "z", "vphi", "vz"], unit);
    }
    let file = json("release_variants.json");
    for case in file["fardal2015"].as_array().expect("cases") {
        let unit = number(&case["r_j"]) * number(&case["Omega"]);
        check(
            case,
            Recipe::Fardal2015Published,
            &["r", "z", "vphi", "vz"],
            unit,
        );
    }
    for case in file["chen2025"].as_array().expect("cases") {
        check(
            case,
            Recipe::Chen2025,
            &["r", "phi", "theta", "alpha", "beta"],
            number(&case["v_esc"]),
        );
    }
}

#[test]
fn a_radial_orbit_and_a_negative_bracket_give_finite_releases() {
    let host = FlattenedNfw::<f64>::new(1e12, 15.0, 0.8, Vec3::new(0.0, 0.0, 1.0));
    let radial = State {
        x: Vec3::new(30.0, 0.0, 10.0),
        v: Vec3::new(60.0, 0.0, 20.0),
    };
    let tidal: Tidal<f64> = Tidal::new(&host, 1e8, radial);
    assert!(tidal.r_j.is_finite() && tidal.omega.is_finite());
    assert!(tidal.frame.iter().all(|e| f64::is_finite(e.norm2())));
    // A potential whose radial second derivative exceeds Omega^2: a heavy disc seen from above at rest.
    let shape = DiscShape::new(DiscProfile::MiyamotoNagai, 0.4);
    let [z, vx] = lift::<2>(&[0.5, 1.0]);
    let zero = Dual::from_re(0.0);
    let state = State {
        x: Vec3::new(zero, zero, z),
        v: Vec3::new(vx, zero, zero),
    };
    let normal = Vec3::new(zero, zero, Dual::from_re(1.0));
    let disc = Disc::new(Dual::from_re(1e12), Dual::from_re(5.0), normal, shape);
    let tidal = Tidal::new(&disc, Dual::from_re(1e8), state);
    assert!(tidal.bounded);
    assert!(
        tidal.r_j.re() > 0.0 && tidal.r_j.re() <= 10.0 * 0.5 * (1.0 + 1e-9),
        "{}",
        tidal.r_j.re()
    );
    assert!(gradient_of(&tidal.r_j).iter().all(|g| g.is_finite()));
}

/// Means and standard deviations of all six components, trailing; published are those of Fardal et al. (2015), and the other form has 0.5 for
/// 0.4 and the product of two of the numbers as its velocity.
#[test]
fn release_offsets_have_the_published_moments() {
    let settings = TableSettings {
        particles: 40_000,
        sampling_scheme: SamplingScheme::Random,
        ..TableSettings::default()
    };
    for recipe in [Recipe::Fardal2015, Recipe::Fardal2015Published] {
        let table = ReleaseTable::new(&TableSettings { recipe, ..settings }).expect("a table");
        let trailing: Vec<_> = table
            .releases
            .iter()
            .filter(|p| p.tail == Tail::Trailing)
            .collect();
        let n = trailing.len() as f64;
        let (sd, along) = if recipe == Recipe::Fardal2015 {
            // The product of N(2, 0.5) and N(0.3, 0.5).
            (0.5, (0.6, (4.25_f64 * 0.34 - 0.36).sqrt()))
        } else {
            (0.4, (0.3, 0.4))
        };
        let exact = [
            (2.0, sd),
            (0.0, 0.0),
            (0.0, 0.5),
            (0.0, 0.0),
            along,
            (0.0, 0.5),
        ];
        for (component, (mean, sd)) in exact.into_iter().enumerate() {
            let average = |power: i32| {
                let of = |p: &&Release| {
                    let [x, v] = [p.offset.position, p.offset.velocity];
                    ([x, v].concat()[component] - mean).powi(power)
                };
                trailing.iter().map(of).sum::<f64>() / n
            };
            let [off, variance, fourth] = [1, 2, 4].map(average);
            // Four standard errors, that of the variance by the fourth moment.
            assert!(off.abs() <= 4.0 * sd / n.sqrt(), "{component}: {off}");
            let error = ((fourth - variance * variance) / n).sqrt();
            assert!(
                (variance - sd * sd).abs() <= 4.0 * error,
                "{component}: {variance}"
            );
        }
    }
}

#[test]
fn a_chen_draw_below_zero_radius_is_refused() {
    assert!(
        Recipe::Chen2025
            .release_offset(&[-4.6, 0.0, 0.0, 0.0, 0.0], Tail::Leading)
            .is_none()
    );
    assert!(
        Recipe::Chen2025
            .release_offset(&[-4.5, 0.0, 0.0, 0.0, 0.0], Tail::Leading)
            .is_some()
    );
}

#[test]
fn tables_are_even_and_reproducible() {
    for sampling_scheme in [SamplingScheme::Random, SamplingScheme::Sobol] {
        let settings = TableSettings {
            particles: 1_000,
            sampling_scheme,
            ..TableSettings::default()
        };
        let table = ReleaseTable::new(&settings).expect("a table");
        assert_eq!(table.len(), 1_000);
        assert_eq!(table.len(), table.taus.len() * table.per_release_time);
        assert!(table.taus.windows(2).all(|t| t[0] < t[1]) && table.taus[0] >= -1.0);
        assert_eq!(table, ReleaseTable::new(&settings).expect("a table"));
        let other = ReleaseTable::new(&TableSettings {
            seed: 2,
            ..settings
        })
        .expect("a table");
        assert_ne!(table.releases, other.releases);
        for release_time in table.releases.chunks(table.per_release_time) {
            let leading = release_time
                .iter()
                .filter(|p| p.tail == Tail::Leading)
                .count();
            assert_eq!(2 * leading, table.per_release_time);
        }
    }
    let odd = TableSettings {
        particles: 1_001,
        ..TableSettings::default()
    };
    let message = ReleaseTable::new(&odd)
        .expect_err("1001 is odd")
        .to_string();
    assert!(
        message.contains("1001") && message.contains("multiple"),
        "{message}"
    );
}

#[test]
fn a_smeared_table_has_the_moments_of_its_random_numbers() {
    // What a particle stands for has a variance of its own, and the rest is that of the particles.
    for (recipe, particles) in [(Recipe::default(), 2_560), (Recipe::Chen2025, 512)] {
        let table = ReleaseTable::new(&TableSettings {
            particles,
            recipe,
            ..TableSettings::default()
        })
        .expect("a table");
        assert_eq!(table.per_release_time, 32);
        let around = table.neighbourhood.expect("neighbours");
        assert_eq!((around.count, around.normals), (8, recipe.normals()));
        if recipe == Recipe::default() {
            let k_r: Vec<f64> = table
                .releases
                .iter()
                .map(|p| p.offset.position[0] * p.tail.sign())
                .collect();
            let mean = k_r.iter().sum::<f64>() / k_r.len() as f64;
            let variance = k_r.iter().map(|k| (k - mean).powi(2)).sum::<f64>() / k_r.len() as f64;
            let smearing2 = 1.0 - variance / 0.25;
            assert!((mean - 2.0).abs() < 1e-3, "{mean}");
            assert!((smearing2.sqrt() - 0.3).abs() < 0.02, "{smearing2}");
        }
    }
}

#[test]
fn neighbours_are_near_and_give_linear_maps_exactly_but_for_their_ridge() {
    let table = ReleaseTable::new(&TableSettings::default()).expect("a table");
    let around = table.neighbourhood.as_deref().expect("neighbours");
    let k_r = |i: usize| {
        (table.releases[i].offset.position[0] * table.releases[i].tail.sign() - 2.0) / 0.5
    };
    let mut sums = [0.0; 2];
    for i in 0..table.len() {
        let (block, lane) = (i / LANES, i % LANES);
        let partner = around.partners[block][lane] as usize;
        assert_eq!(table.releases[i].tail, table.releases[partner].tail);
        assert_eq!(partner.abs_diff(i), table.per_release_time);
        let mut along = [0.0; 2];
        for j in 0..around.count {
            let row = block * around.count + j;
            let neighbour = around.indices[row][lane] as usize;
            assert!(neighbour != i);
            assert_eq!(table.releases[i].tail, table.releases[neighbour].tail);
            assert_eq!(
                i / table.per_release_time,
                neighbour / table.per_release_time
            );
            // The derivatives of the first random number by the first and by the second.
            for (k, sum) in along.iter_mut().enumerate() {
                *sum += around.weights[row * around.normals + k][lane] * (k_r(neighbour) - k_r(i));
            }
        }
        for (sum, one) in sums.iter_mut().zip(along) {
            *sum += one / table.len() as f64;
        }
    }
    let [along, across] = sums;
    // s = 0.3, less what the ridge takes.
    assert!(
        (0.25..0.3).contains(&along) && across.abs() < 0.01,
        "{sums:?}"
    );
}

/// Because the time to compare all pairs would grow with the square of their number.
#[test]
fn of_many_particles_of_one_release_time_few_are_compared() {
    let table = ReleaseTable::new(&TableSettings {
        particles: 8_192,
        release_times: 2,
        ..TableSettings::default()
    })
    .expect("a table");
    let around = table.neighbourhood.expect("neighbours");
    assert_eq!((around.reach, table.releases.len()), (4_096, 8_192));
    for i in 0..table.releases.len() {
        for j in 0..around.count {
            let neighbour = around.indices[i / LANES * around.count + j][i % LANES] as usize;
            assert_eq!(table.releases[i].tail, table.releases[neighbour].tail);
            assert!(
                neighbour != i && neighbour.abs_diff(i) < 64,
                "{i} {neighbour}"
            );
        }
    }
}

#[test]
fn one_release_time_has_no_neighbours() {
    let table = ReleaseTable::new(&TableSettings {
        particles: 64,
        release_times: 1,
        ..TableSettings::default()
    })
    .expect("a table");
    assert_eq!(table.neighbourhood, None);
}

#[test]
fn sobol_spreads_better_than_random() {
    // The mean of k_r over 500 particles: random has sd 0.5/sqrt(500) = 0.022; the net is far below it.
    let table = ReleaseTable::new(&TableSettings {
        particles: 1_000,
        ..TableSettings::default()
    })
    .expect("a table");
    for tail in [Tail::Leading, Tail::Trailing] {
        let k_r: Vec<f64> = table
            .releases
            .iter()
            .filter(|p| p.tail == tail)
            .map(|p| p.offset.position[0] * tail.sign())
            .collect();
        let mean = k_r.iter().sum::<f64>() / k_r.len() as f64;
        assert!((mean - 2.0).abs() < 0.005, "{mean}");
    }
}
