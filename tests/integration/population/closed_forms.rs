//! The likelihood of every family against closed forms and a quadrature, written without the library.

use super::{MEASURED, synthetic};
use oblate::population::{FamilyName, FamilySettings, PopulationSettings};
use oblate_samplers::Outcome;
use statrs::distribution::{Beta, Continuous};

/// The mass of a normal distribution between two bounds.
fn mass(mean: f64, sd: f64, lo: f64, hi: f64) -> f64 {
    let z = |x: f64| (x - mean) / (sd * std::f64::consts::SQRT_2);
    0.5 * (libm::erf(z(hi)) - libm::erf(z(lo)))
}

/// `integral L(q) pi(q) dq` over the support for a truncated normal pi, where L is a normal: the product of two normals is a normal.
pub fn with_normal((measured, error): (f64, f64), mean: f64, sd: f64) -> f64 {
    let variance = error * error + sd * sd;
    let centre = (measured * sd * sd + mean * error * error) / variance;
    let narrow = error * sd / variance.sqrt();
    let density = (-0.5 * (measured - mean).powi(2) / variance).exp()
        / (std::f64::consts::TAU * variance).sqrt();
    density * mass(centre, narrow, 0.5, 1.5) / mass(mean, sd, 0.5, 1.5)
}

/// The same for the Beta distribution, by Simpson's rule.
fn with_beta((measured, error): (f64, f64), a: f64, b: f64) -> f64 {
    const CELLS: u32 = 20_000;
    let law = Beta::new(a, b).expect("exponents");
    let step = 1.0 / f64::from(CELLS);
    let f = |i: u32| {
        let x = f64::from(i) * step;
        let z = (0.5 + x - measured) / error;
        let likelihood = (-0.5 * z * z).exp() / (error * std::f64::consts::TAU.sqrt());
        likelihood * law.pdf(x)
    };
    let inner: f64 = (1..CELLS)
        .map(|i| f(i) * if i % 2 == 1 { 4.0 } else { 2.0 })
        .sum();
    (f(0) + inner + f(CELLS)) * step / 3.0
}

/// `sum_n ln [ integral L_n(q) pi(q | alpha) dq / integral L_n(q) pi(q) dq ]` of the measured streams, where `integral` is that of the numerator.
pub fn ln_product(integral: impl Fn((f64, f64)) -> f64) -> f64 {
    MEASURED
        .iter()
        .map(|&(measured, error)| {
            (integral((measured, error)) / mass(measured, error, 0.5, 1.5)).ln()
        })
        .sum()
}

/// The library's product equals that of `integral`. Draws are on a grid of `CELLS` cells.
fn agree(family: FamilyName, alpha: &[f64], tolerance: f64, integral: impl Fn((f64, f64)) -> f64) {
    const CELLS: u32 = 20_000;
    let settings = FamilySettings {
        name: family,
        ..FamilySettings::default()
    };
    let population = PopulationSettings { max_draws: 100_000 };
    let target = settings
        .target(&synthetic(CELLS), population, None)
        .expect("a population");
    let Outcome::Value(found) = target.ln_likelihood(alpha) else {
        panic!("{}: {alpha:?} is rejected", family.name());
    };
    let exact = ln_product(integral);
    assert!(
        (found - exact).abs() < tolerance,
        "{} {alpha:?}: {found} {exact}",
        family.name()
    );
}

/// Places of a step over which a ramp is averaged.
const SHIFTS: u32 = 400;

/// Smooth densities to the error of a midpoint sum; those with edges to that of a cell at each edge.
#[test]
fn the_likelihood_of_every_family_is_that_of_its_closed_form() {
    for (mu, sigma) in [(0.9, 0.1), (1.3, 0.04), (0.6, 0.5)] {
        agree(FamilyName::TruncatedGaussian, &[mu, sigma], 1e-5, |datum| {
            with_normal(datum, mu, sigma)
        });
    }
    for (weight, centre, distance, sd) in
        [(0.3, 1.0, 0.4, [0.1, 0.05]), (0.8, 0.9, 0.1, [0.2, 0.3])]
    {
        let alpha = [weight, centre, distance, sd[0], sd[1]];
        agree(FamilyName::Mixture, &alpha, 1e-5, |datum| {
            let lower = with_normal(datum, centre - 0.5 * distance, sd[0]);
            let upper = with_normal(datum, centre + 0.5 * distance, sd[1]);
            weight * lower + (1.0 - weight) * upper
        });
    }
    for (a, b) in [(6.0, 14.0), (3.0, 3.0), (40.0, 25.0)] {
        agree(FamilyName::Beta, &[f64::ln(a), f64::ln(b)], 1e-5, |datum| {
            with_beta(datum, a, b)
        });
    }
    for (centre, width) in [(0.9, 0.6), (1.1, 0.4)] {
        let alpha = [centre, width];
        agree(FamilyName::Uniform, &alpha, 1e-4, |(measured, error)| {
            // A ramp of a twentieth of the width is the mean of steps at all of its places.
            let moved = (0..SHIFTS).map(|k| {
                let shift = 0.05 * width * ((f64::from(k) + 0.5) / f64::from(SHIFTS) - 0.5);
                let wider = 0.5 * width + shift;
                mass(measured, error, centre - wider, centre + wider)
            });
            moved.sum::<f64>() / f64::from(SHIFTS) / width
        });
    }
    let steps = [0.9, -0.4, 1.2, 0.3, -1.1, 0.5, 0.2, -0.8, 0.7];
    let roughness = 0.8;
    let mut alpha = vec![roughness];
    alpha.extend(steps);
    agree(FamilyName::Histogram, &alpha, 1e-4, |(measured, error)| {
        let mut ln_height = 0.0;
        let mut heights = vec![1.0];
        for step in steps {
            ln_height += roughness * step;
            heights.push(f64::exp(ln_height));
        }
        let total: f64 = heights.iter().sum::<f64>() * 0.1;
        heights
            .iter()
            .enumerate()
            .map(|(k, height)| {
                let lo = 0.5 + 0.1 * k as f64;
                height * mass(measured, error, lo, lo + 0.1) / total
            })
            .sum()
    });
}
