//! The truncated Gaussian: golden values, normalisation, and its bounds.

use super::family;
use crate::golden::{cases, json, number};
use oblate::Error;
use oblate::population::{Family, TruncatedGaussian, TruncatedGaussianSettings, gauss_legendre};
use oblate::scalar::{gradient_of, lift};
use oblate_samplers::Marginal;

#[test]
fn truncated_normal_meets_the_golden_values_with_gradient() {
    for case in cases(&json("truncated_normal.json")) {
        let field = |name: &str| number(&case[name]);
        let (lo, hi, mu, sigma, q) = (
            field("lo"),
            field("hi"),
            field("mu"),
            field("sigma"),
            field("q"),
        );
        let family = TruncatedGaussian::new(TruncatedGaussianSettings {
            q_min: lo,
            q_max: hi,
            ..TruncatedGaussianSettings::default()
        })
        .unwrap();
        let ours = family.ln_pdf(lift(&[mu, sigma]))(q);
        let ours_f64 = family.ln_pdf([mu, sigma])(q);
        // Distance in sigmas that is squared, from mu or from the nearest bound, and from mu to that bound; each is
        // a difference of numbers with a rounding of 1e-16, divided by sigma.
        let origin = mu.clamp(lo, hi);
        let (t, c) = ((q - origin).abs() / sigma, (mu - origin).abs() / sigma);
        let grain = 2e-16 * lo.abs().max(hi.abs()).max(mu.abs()) / sigma;
        let terms = 1.0 + t * (0.5 * t + c) + sigma.ln().abs() + c.max(1.0).ln();
        let tolerance = 1e-15 * terms + 4.0 * grain * (t + c + 1.0);
        let value = field("ln_pdf");
        assert!(
            (ours.re - value).abs() < tolerance,
            "{case}: {} {tolerance}",
            ours.re
        );
        assert!((ours_f64 - value).abs() < tolerance, "{case}: {ours_f64}");
        let [d_mu, d_sigma] = gradient_of(&ours);
        let slope = 1e-14 * (t + c + 1.0) / sigma + 10.0 * grain / sigma;
        assert!(
            (d_mu - field("d_mu")).abs() < slope,
            "{case}: {d_mu} {slope}"
        );
        let slope = 1e-14 * (1.0 + t * (t + c) + c) / sigma + 10.0 * grain * (1.0 + t + c) / sigma;
        assert!(
            (d_sigma - field("d_sigma")).abs() < slope,
            "{case}: {d_sigma} {slope}"
        );
    }
}

#[test]
fn the_rule_integrates_polynomials_exactly() {
    let rule = gauss_legendre::<48>();
    for power in [0, 1, 2, 17, 60, 95] {
        let sum: f64 = rule.iter().map(|(x, w)| w * x.powi(power)).sum();
        let exact = 1.0 / f64::from(power + 1);
        assert!((sum / exact - 1.0).abs() < 4e-14, "{power}: {sum}");
    }
}

#[test]
fn every_member_is_normalised_on_the_support() {
    let family = family();
    for (mu, sigma) in [
        (1.0_f64, 0.1),
        (0.5, 0.3),
        (1.5, 1.0),
        (2.5, 0.2),
        (0.3, 0.05),
        (9.0, 40.0),
    ] {
        let ln_pdf = family.ln_pdf([mu, sigma]);
        // Midpoints: error of order h^2 times the second derivative's integral, at most the slope at the ends.
        let n = 200_000;
        let h = 1.0 / f64::from(n);
        let sum: f64 = (0..n)
            .map(|i| h * ln_pdf(0.5 + h * (f64::from(i) + 0.5)).exp())
            .sum();
        assert!((sum - 1.0).abs() < 1e-6, "{mu} {sigma}: {sum}");
    }
}

#[test]
fn value_and_gradient_are_continuous_where_the_mean_crosses_a_bound() {
    let family = family();
    for bound in [0.5, 1.5] {
        let at = |mu: f64| family.ln_pdf(lift(&[mu, 0.2]))(0.9);
        let (inside, outside) = (at(bound - 1e-12), at(bound + 1e-12));
        assert!((inside.re - outside.re).abs() < 1e-10);
        for (a, b) in gradient_of(&inside).iter().zip(gradient_of(&outside)) {
            assert!((a - b).abs() < 1e-9, "{a} {b}");
        }
    }
}

#[test]
fn impossible_hyperpriors_are_refused_with_their_key() {
    let default = TruncatedGaussianSettings::default();
    let uniform = |lo, hi| Marginal::Uniform { lo, hi };
    for (settings, key) in [
        (
            TruncatedGaussianSettings {
                q_min: 1.5,
                ..default
            },
            "family.q_min",
        ),
        (
            TruncatedGaussianSettings {
                mu_pop: uniform(1.0, 0.0),
                ..default
            },
            "family.mu_pop",
        ),
        (
            TruncatedGaussianSettings {
                sigma_pop: uniform(-1.0, 1.0),
                ..default
            },
            "family.sigma_pop.lo",
        ),
    ] {
        match TruncatedGaussian::new(settings).unwrap_err() {
            Error::Setting { key: found, .. } => assert_eq!(found, key),
            Error::OutOfRange(wrong) => assert_eq!(wrong.key, key),
            other => panic!("{other}"),
        }
    }
}
