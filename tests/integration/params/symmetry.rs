//! The symmetry moves: they leave the prior invariant, and are offered only under priors for which that holds.

use super::{DRAWS, default_prior, rng};
use crate::ks;
use oblate::params::symmetry::{
    HalfTurn, MassVelocityAge, QuarterTurnTwin, symmetries, truncated_exponential,
};
use oblate::params::{PARAMETERS, PriorSettings, StreamPrior, index_of};
use oblate_samplers::Marginal;
use oblate_samplers::difference_pool::DifferencePool;
use oblate_samplers::hmc::{Evaluator, Metric, Point, slice};
use oblate_samplers::normal;
use oblate_samplers::rng::{RandomStream, standard_normal, unit_open};
use oblate_samplers::target::{Involution, Orbit, Outcome, Symmetry, Target};

/// Prior draws in standard normals, each moved by `step`: per coordinate, and for products of pairs that the move
/// couples, still the prior.
fn assert_leaves_the_prior_alone(task: u64, mut step: impl FnMut(&mut [f64], &mut RandomStream)) {
    let mut rng = rng(task);
    let moved: Vec<[f64; 13]> = (0..DRAWS)
        .map(|_| {
            let mut z: [f64; 13] = std::array::from_fn(|_| standard_normal(&mut rng));
            step(&mut z, &mut rng);
            assert!(z.iter().all(|z| z.is_finite()));
            z
        })
        .collect();
    for i in 0..13 {
        let u = moved.iter().map(|z| normal::cdf(z[i])).collect();
        let d = ks::distance_from_uniform(u);
        assert!(d < ks::LIMIT, "{}: {d}", PARAMETERS[i].name);
        for j in 0..i {
            // The sum of two independent standard normals, over sqrt 2, is one again; a correlation is not.
            let u = moved
                .iter()
                .map(|z| normal::cdf((z[i] + z[j]) / std::f64::consts::SQRT_2))
                .collect();
            let d = ks::distance_from_uniform(u);
            assert!(
                d < ks::LIMIT,
                "{} and {}: {d}",
                PARAMETERS[i].name,
                PARAMETERS[j].name
            );
        }
    }
}

#[test]
fn the_refresh_of_mass_velocity_and_age_leaves_the_prior_alone() {
    let orbit = MassVelocityAge::new(&default_prior()).unwrap();
    assert_leaves_the_prior_alone(3, |z, rng| orbit.refresh(z, rng));
}

#[test]
fn a_refresh_without_the_jacobian_would_be_noticed() {
    // The wrong move: s from the prior along the orbit with respect to ds / s, without the factor s of the Jacobian.
    // Drawn by rejection: ln s uniform over more than every interval, accepted with the prior there over its bound.
    let prior = default_prior();
    let orbit = MassVelocityAge::new(&prior).unwrap();
    let mut rng = rng(4);
    let mass = index_of("log10_m_halo").unwrap();
    let mut u = Vec::new();
    for _ in 0..DRAWS {
        let z: [f64; 13] = std::array::from_fn(|_| standard_normal(&mut rng));
        let mut still = [0.0; 13];
        prior.prior().theta_from_z(&z, &mut still);
        let mut slow = still;
        slow[9..12].fill(0.0);
        let bound = prior.prior().ln_pdf(&slow);
        loop {
            let mut theta = still;
            orbit.scale(&mut theta, 10_f64.powf(3.0 * unit_open(&mut rng) - 1.5));
            if unit_open(&mut rng).ln() < prior.prior().ln_pdf(&theta) - bound {
                u.push(prior.prior().marginals()[mass].u_from_theta(theta[mass]));
                break;
            }
        }
    }
    let d = ks::distance_from_uniform(u);
    assert!(d > 2.0 * ks::LIMIT, "{d}");
}

#[test]
fn a_refresh_scales_masses_velocities_and_age_exactly_and_nothing_else() {
    let prior = default_prior();
    let orbit = MassVelocityAge::new(&prior).unwrap();
    let mut rng = rng(5);
    let mut largest = 0.0_f64;
    for _ in 0..2_000 {
        let mut z: [f64; 13] = std::array::from_fn(|_| standard_normal(&mut rng));
        let still = z;
        let theta = |z: &[f64]| {
            let mut theta = [0.0; 13];
            prior.prior().theta_from_z(z, &mut theta);
            prior.fill(&theta)
        };
        let before = theta(&z);
        orbit.refresh(&mut z, &mut rng);
        let after = theta(&z);
        let ln_s = (after.age_gyr / before.age_gyr).ln() * -2.0;
        let ln_10 = std::f64::consts::LN_10;
        for (change, name) in [
            ((after.log10_m_halo - before.log10_m_halo) * ln_10, "halo"),
            (
                (after.log10_m_prog - before.log10_m_prog) * ln_10,
                "progenitor",
            ),
            ((after.vx0_km_s / before.vx0_km_s).ln() * 2.0, "vx"),
            ((after.vy0_km_s / before.vy0_km_s).ln() * 2.0, "vy"),
            ((after.vz0_km_s / before.vz0_km_s).ln() * 2.0, "vz"),
        ] {
            // log10 M = 14 has a grain of 2e-15, times ln 10; the tails of z cost one digit more.
            assert!((change - ln_s).abs() < 1e-12, "{name}: {change} {ln_s}");
        }
        for name in [
            "r_s_halo_kpc",
            "dir_x",
            "dir_y",
            "dir_z",
            "r_s_prog_kpc",
            "x0_kpc",
            "z0_kpc",
        ] {
            let i = index_of(name).unwrap();
            assert_eq!(z[i].to_bits(), still[i].to_bits(), "{name}");
        }
        largest = largest.max(ln_s.abs());
    }
    // It moves: the age's bounds allow a factor of 16 in mass, and the largest of 2,000 comes near.
    assert!(largest > 2.0, "{largest}");
}

/// The prior and its symmetries, with a constant likelihood.
struct Blind {
    prior: StreamPrior,
    symmetries: Vec<Symmetry>,
}

impl Target for Blind {
    fn prior(&self) -> &oblate_samplers::Prior {
        self.prior.prior()
    }
    fn ln_likelihood(&self, _: &[f64]) -> Outcome {
        Outcome::Value(0.0)
    }
    fn symmetries(&self) -> &[Symmetry] {
        &self.symmetries
    }
}

#[test]
fn an_aligned_point_has_the_same_mass_to_the_bit_and_lies_on_its_orbit() {
    let prior = default_prior();
    let orbit = MassVelocityAge::new(&prior).unwrap();
    let mut rng = rng(8);
    let (mut level, mut refused) = (0, 0);
    for _ in 0..2_000 {
        let to: [f64; 13] = std::array::from_fn(|_| standard_normal(&mut rng));
        let before: [f64; 13] = std::array::from_fn(|_| standard_normal(&mut rng));
        let mut z = before;
        if !orbit.align(&mut z, &to) {
            assert_eq!(
                z.map(f64::to_bits),
                before.map(f64::to_bits),
                "refused, so left alone"
            );
            refused += 1;
            continue;
        }
        level += 1;
        let mass = index_of("log10_m_halo").unwrap();
        assert_eq!(z[mass].to_bits(), to[mass].to_bits());
        // And back: only a point on the same orbit can come back to where it was.
        assert!(orbit.align(&mut z, &before));
        for (a, b) in z.iter().zip(&before) {
            assert!((a - b).abs() < 1e-9 * b.abs().max(1.0), "{a} {b}");
        }
    }
    assert!(level > 300 && refused > 300, "{level} {refused}");
}

#[test]
fn points_on_one_orbit_have_the_same_invariants_and_others_do_not() {
    let prior = default_prior();
    let orbit = MassVelocityAge::new(&prior).unwrap();
    let mut draws = rng(12);
    let normals = |draws: &mut RandomStream| -> Vec<f64> {
        (0..13).map(|_| standard_normal(draws)).collect()
    };
    let place = |z: &[f64]| {
        let mut out = vec![0.0; 13];
        orbit.invariants(z, &mut out);
        out
    };
    for _ in 0..50 {
        let z = normals(&mut draws);
        let mut moved = z.clone();
        orbit.refresh(&mut moved, &mut draws);
        let far = |a: &[f64], b: &[f64]| {
            let parts = a
                .iter()
                .zip(b)
                .map(|(a, b)| (a - b).abs() / (a.abs() + b.abs() + 1e-3));
            parts.fold(0.0, f64::max)
        };
        assert!(far(&z, &moved) > 1e-6);
        assert!(far(&place(&z), &place(&moved)) < 1e-9);
        assert!(far(&place(&z), &place(&normals(&mut draws))) > 1e-3);
    }
}

#[test]
fn slices_along_aligned_differences_leave_the_prior_alone() {
    let prior = default_prior();
    let orbit = MassVelocityAge::new(&prior).unwrap();
    let target = Blind {
        symmetries: vec![Symmetry::Orbit(Box::new(orbit))],
        prior,
    };
    let mut draws = rng(9);
    let rows: Vec<f64> = (0..13 * 60).map(|_| standard_normal(&mut draws)).collect();
    let pool = DifferencePool::new(&rows, 13, Symmetry::first_orbit(target.symmetries()));
    let metric = Metric::identity(13);
    assert_leaves_the_prior_alone(10, |z, rng| {
        let mut evaluator = Evaluator::new(&target);
        let mut at = Point::new(13);
        at.z.copy_from_slice(z);
        at.ln_likelihood = 0.0;
        for _ in 0..4 {
            slice(&mut evaluator, 1.0, &metric, &pool, &mut at, rng).unwrap();
        }
        z.copy_from_slice(&at.z);
    });
}

/// Twice is the identity, the Jacobian is the numerical one, and Metropolis on the prior accepts always.
fn assert_involution(task: u64, involution: &dyn Involution) {
    let mut rng = rng(task);
    for _ in 0..300 {
        let z: Vec<f64> = (0..13).map(|_| standard_normal(&mut rng)).collect();
        let mut image = z.clone();
        let ln_jacobian = involution.apply(&mut image).unwrap();
        let mut back = image.clone();
        let inverse = involution.apply(&mut back).unwrap();
        // A shape vector whose twin is far out in the tail comes back with the digits that the tail kept.
        let error = z
            .iter()
            .zip(&back)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max);
        assert!(error < 1e-11, "{}: {error}", involution.name());
        assert!((ln_jacobian + inverse).abs() < 1e-10);
        let norm2 = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>();
        assert!((ln_jacobian - 0.5 * (norm2(&image) - norm2(&z))).abs() < 1e-10);

        // The determinant over the three components of the shape vector, which are neighbours.
        let first = index_of("dir_x").unwrap();
        let jacobian = nalgebra::Matrix3::from_fn(|row, column| {
            let h = 1e-6 * z[first + column].abs();
            let at = |dz: f64| {
                let mut moved = z.clone();
                moved[first + column] += dz;
                involution.apply(&mut moved).unwrap();
                moved[first + row]
            };
            (at(h) - at(-h)) / (2.0 * h)
        });
        let numerical = jacobian.determinant().abs().ln();
        // Steps of 1e-6 of the coordinate leave a relative 1e-9 each; near the origin the twin's slope is steep.
        assert!(
            (numerical - ln_jacobian).abs() < 1e-4,
            "{}: {numerical} {ln_jacobian} at {z:?}",
            involution.name()
        );
    }
}

#[test]
fn the_half_turn_is_an_involution_with_its_jacobian() {
    let prior = default_prior();
    let turn = HalfTurn::new(&prior).unwrap();
    assert_involution(6, &turn);
    assert_leaves_the_prior_alone(7, |z, _| {
        turn.apply(z).unwrap();
    });
}

#[test]
fn the_quarter_turn_with_the_twin_is_an_involution_with_its_jacobian() {
    let prior = default_prior();
    let twin = QuarterTurnTwin::new(&prior).unwrap();
    assert_involution(8, &twin);
    assert_leaves_the_prior_alone(9, |z, _| {
        twin.apply(z).unwrap();
    });
    let mut rng = rng(10);
    for _ in 0..200 {
        let mut z: Vec<f64> = (0..13).map(|_| standard_normal(&mut rng)).collect();
        let shape = |z: &[f64]| {
            let mut theta = [0.0; 13];
            prior.prior().theta_from_z(z, &mut theta);
            prior.shape(&prior.fill(&theta))
        };
        let before = shape(&z);
        twin.apply(&mut z).unwrap();
        let after = shape(&z);
        assert!((before.q + after.q - 2.0).abs() < 1e-12);
        assert!((before.axis.z - after.axis.z).abs() < 1e-12);
        let across = before.axis.x * after.axis.x + before.axis.y * after.axis.y;
        assert!(across.abs() < 1e-12, "{across}");
    }
}

#[test]
fn the_truncated_exponential_has_the_right_distribution_function() {
    for (rate, lo, hi) in [
        (0.0, 1.0, 3.0),
        (1e-9, 0.1, 4.0),
        (2.0, 0.5, 9.0),
        (1e3, 0.2, 7.0),
    ] {
        for i in 1..10 {
            let u = 0.1 * f64::from(i);
            let s = truncated_exponential(u, rate, lo, hi);
            let cdf = if rate > 0.0 {
                f64::exp_m1(-rate * (s - lo)) / f64::exp_m1(-rate * (hi - lo))
            } else {
                (s - lo) / (hi - lo)
            };
            // s carries a rounding of 2e-16 s, worth rate times that in u, and (s - lo) loses digits alike.
            let tolerance = 1e-14 + 1e-15 * (rate + 1.0);
            assert!((cdf - u).abs() < tolerance, "{rate} {u}: {cdf}");
        }
    }
}

#[test]
fn moves_are_offered_only_under_a_prior_that_they_fit() {
    let offered = |change: &dyn Fn(&mut PriorSettings)| {
        let mut settings = PriorSettings::default();
        change(&mut settings);
        symmetries(&StreamPrior::new(&settings).unwrap(), false).len()
    };
    assert_eq!(offered(&|_| {}), 3);
    assert_eq!(offered(&|s| s.fixed.age_gyr = Some(2.0)), 2);
    assert_eq!(
        offered(&|s| s.marginals.vx0_km_s = Some(Marginal::Normal { mean: 1.0, sd: 9.0 })),
        2
    );
    assert_eq!(
        offered(&|s| s.marginals.log10_m_prog = Some(Marginal::Normal { mean: 8.0, sd: 1.0 })),
        2
    );
    assert_eq!(
        offered(&|s| s.marginals.dir_y = Some(Marginal::Normal { mean: 0.0, sd: 2.0 })),
        2
    );
    assert_eq!(offered(&|s| s.fixed.dir_z = Some(1.0)), 2);
    assert_eq!(offered(&|s| s.fixed.dir_x = Some(0.0)), 1);
    // Parameters of the observation leave the moves as they are.
    assert_eq!(
        offered(&|s| {
            s.marginals.jitter = Some(Marginal::HalfNormal { sd: 0.1 });
            s.marginals.distance_factor = Some(Marginal::Normal { mean: 1.0, sd: 0.1 });
            s.marginals.phi0_deg = Some(Marginal::Uniform { lo: -9.0, hi: 9.0 });
        }),
        3
    );
    // Other widths and half-spaces are derived for, and stay.
    assert_eq!(
        offered(&|s| s.marginals.vy0_km_s = Some(Marginal::Normal {
            mean: 0.0,
            sd: 90.0
        })),
        3
    );
}
