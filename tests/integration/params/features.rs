//! The parameters as a track depends on them: the same numbers for the same track, and their derivatives.

use super::{default_prior, rng};
use oblate::data::ObservedTrack;
use oblate::inference::StreamTarget;
use oblate::params::symmetry::MassVelocityAge;
use oblate::params::{FEATURES, StreamParams, features};
use oblate_samplers::rng::standard_normal;
use oblate_samplers::target::Orbit;
use oblate_samplers::{Marginal, Target};
use std::path::Path;

fn at(z: &[f64; 13]) -> [f64; FEATURES] {
    let prior = default_prior();
    let mut theta = [0.0; 13];
    prior.prior().theta_from_z(z, &mut theta);
    features(&StreamParams::from(theta), prior.q_range())
}

fn largest_difference(a: &[f64], b: &[f64]) -> f64 {
    let relative = a
        .iter()
        .zip(b)
        .map(|(a, b)| (a - b).abs() / (1.0 + a.abs()));
    relative.fold(0.0, f64::max)
}

#[test]
fn they_are_the_same_along_the_orbit_of_mass_velocity_and_age() {
    let orbit = MassVelocityAge::new(&default_prior()).unwrap();
    let mut rng = rng(60);
    for _ in 0..100 {
        let mut z: [f64; 13] = std::array::from_fn(|_| standard_normal(&mut rng));
        let (before, from) = (at(&z), z);
        orbit.refresh(&mut z, &mut rng);
        assert!(largest_difference(&from, &z) > 1e-6);
        // Coordinates in a tail of the prior keep fewer digits.
        let change = largest_difference(&before, &at(&z));
        assert!(change < 1e-6, "{change}");
    }
}

#[test]
fn opposite_axes_are_the_same_halo() {
    let prior = default_prior();
    let mut rng = rng(61);
    let z: [f64; 13] = std::array::from_fn(|_| standard_normal(&mut rng));
    let mut theta = [0.0; 13];
    prior.prior().theta_from_z(&z, &mut theta);
    let mut params = StreamParams::from(theta);
    let one = features(&params, prior.q_range());
    params.dir_x = -params.dir_x;
    params.dir_y = -params.dir_y;
    let turned = features(&params, prior.q_range());
    params.dir_z = -params.dir_z;
    let opposite = features(&params, prior.q_range());
    assert!(largest_difference(&one, &turned) > 1e-3);
    assert!(largest_difference(&one, &opposite) <= 0.0);
}

#[test]
fn their_derivatives_are_those_of_differences() {
    let track = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/tracks/s2_spherical.ecsv");
    let track = ObservedTrack::read(&track).unwrap();
    for (fixed, optional, free) in [
        (&[][..], 0, 13),
        (&[("log10_m_halo", 12.3), ("dir_z", 0.4)][..], 0, 11),
        (&[("log10_m_halo", 12.3), ("jitter", 0.1)][..], 2, 14),
    ] {
        let mut settings = oblate::FitSettings::default();
        if optional > 0 {
            let marginals = &mut settings.prior.marginals;
            marginals.jitter = Some(Marginal::HalfNormal { sd: 0.1 });
            marginals.distance_factor = Some(Marginal::Normal { mean: 1.0, sd: 0.1 });
            marginals.phi0_deg = Some(Marginal::Uniform { lo: -9.0, hi: 9.0 });
        }
        for (name, value) in fixed {
            settings.prior.fix(name, *value).unwrap();
        }
        let target = StreamTarget::from_track(&track, &settings).unwrap();
        let (dim, mut rng) = (target.dim(), rng(62));
        assert_eq!(dim, free);
        let count = target.feature_count();
        assert_eq!(count, FEATURES + optional);
        let features = |z: &[f64]| {
            let (mut theta, mut features) = (vec![0.0; dim], vec![0.0; count]);
            target.prior().theta_from_z(z, &mut theta);
            target.features(z, &theta, &mut features);
            (theta, features)
        };
        for _ in 0..20 {
            let z: Vec<f64> = (0..dim).map(|_| standard_normal(&mut rng)).collect();
            let bar: Vec<f64> = (0..count).map(|_| standard_normal(&mut rng)).collect();
            let mut z_bar = vec![0.0; dim];
            target.features_vjp(&z, &features(&z).0, &bar, &mut z_bar);
            for i in 0..dim {
                let along = |step: f64| -> f64 {
                    let mut z = z.clone();
                    z[i] += step;
                    features(&z).1.iter().zip(&bar).map(|(f, b)| f * b).sum()
                };
                let difference = (along(1e-4) - along(-1e-4)) / 2e-4;
                assert!(
                    (z_bar[i] - difference).abs() < 1e-4 * (1.0 + difference.abs()),
                    "{i}: {} {difference}",
                    z_bar[i]
                );
            }
        }
    }
}
