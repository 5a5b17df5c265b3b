//! The normal distribution truncated to the range of q, with its normalisation computed from the side of the tail.

use super::family::Family;
use super::hyperprior::{self, ANY, POSITIVE};
use crate::error::{Error, Result};
use crate::params::AXIS_RATIOS;
use crate::scalar::Real;
use oblate_samplers::Marginal;
use oblate_samplers::limits::in_range;
use oblate_samplers::normal::LN_SQRT_2PI;
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_1_SQRT_2, PI};
use std::ops::RangeInclusive;

/// Means before truncation that a hyperprior may name.
pub(super) const MEANS: RangeInclusive<f64> = -100.0..=100.0;

/// Standard deviations before truncation that a hyperprior may name.
pub(super) const DEVIATIONS: RangeInclusive<f64> = 0.0..=100.0;

/// Nodes of the quadrature over a tail; see [`ln_tail_mass`].
const NODES: usize = 48;

/// The tail's integrand is cut where it has fallen to `e^-40 = 4e-18`.
const CUT: f64 = 40.0;

/// Support and hyperpriors of the family, as the user writes them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TruncatedGaussianSettings {
    /// Lower end of the support; 0.5.
    pub q_min: f64,
    /// Upper end of the support; 1.5.
    pub q_max: f64,
    /// Prior of the mean before truncation; uniform on [0.5, 1.5].
    pub mu_pop: Marginal,
    /// Prior of the standard deviation before truncation; uniform on [0, 1].
    pub sigma_pop: Marginal,
}

impl Default for TruncatedGaussianSettings {
    fn default() -> Self {
        Self {
            q_min: 0.5,
            q_max: 1.5,
            mu_pop: Marginal::Uniform { lo: 0.5, hi: 1.5 },
            sigma_pop: Marginal::Uniform { lo: 0.0, hi: 1.0 },
        }
    }
}

impl TruncatedGaussianSettings {
    /// Checks every number by itself: the ranges of docs/limits.md. Checks then that the support has a width, and that the hyperpriors
    /// are distributions, that of `sigma_pop` of positive numbers.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] or [`Error::Setting`] with the first key that is at fault.
    pub fn check(&self) -> Result<()> {
        let Self {
            q_min,
            q_max,
            mu_pop,
            sigma_pop,
        } = self;
        in_range("family.q_min", *q_min, 0.0..=*AXIS_RATIOS.end())?;
        in_range("family.q_max", *q_max, AXIS_RATIOS)?;
        hyperprior::check("mu_pop", mu_pop, &MEANS, &ANY)?;
        hyperprior::check("sigma_pop", sigma_pop, &DEVIATIONS, &POSITIVE)?;
        if q_min >= q_max {
            return Err(Error::Setting {
                key: "family.q_min".to_owned(),
                value: q_min.to_string(),
                remedy: "give a number below q_max".to_owned(),
            });
        }
        Ok(())
    }
}

/// `N(mu, sigma)` truncated to `[q_min, q_max]`: hyperparameters `mu_pop` and `sigma_pop`, the mean and the standard
/// deviation of the normal before truncation.
#[derive(Clone, Debug)]
pub struct TruncatedGaussian {
    settings: TruncatedGaussianSettings,
    /// Gauss-Legendre nodes and weights on [0, 1].
    rule: [(f64, f64); NODES],
}

impl TruncatedGaussian {
    /// The family on its support.
    ///
    /// # Errors
    /// Those of [`TruncatedGaussianSettings::check`].
    pub fn new(settings: TruncatedGaussianSettings) -> Result<Self> {
        settings.check()?;
        Ok(Self {
            settings,
            rule: gauss_legendre(),
        })
    }
}

impl Family<2> for TruncatedGaussian {
    fn support(&self) -> (f64, f64) {
        (self.settings.q_min, self.settings.q_max)
    }

    fn hyperparameters(&self) -> [(&'static str, Marginal); 2] {
        [
            ("mu_pop", self.settings.mu_pop),
            ("sigma_pop", self.settings.sigma_pop),
        ]
    }

    /// `-x^2 / 2 - ln sigma - ln integral`, with x the distance in sigmas from mu where mu is inside the support.
    /// Where it is outside, from the nearest bound: with `c` sigmas from mu to that bound, `-c t - t^2 / 2` and the
    /// integral of the same, so that the huge `c^2 / 2` of both never appears. Finite for any mu, and as sigma goes to
    /// zero for as long as the squared distances are (sigma above 1e-150).
    fn ln_pdf<S: Real>(&self, [mu, sigma]: [S; 2]) -> impl Fn(f64) -> S {
        let (lo, hi) = self.support();
        let below = (-mu + lo) / sigma;
        let above = (-mu + hi) / sigma;
        // Origin of the distances and their direction; c; ln of the integral.
        let (origin, sign, c, ln_mass) = if below.re() > 0.0 {
            let mass = self.ln_tail_mass(below, above - below);
            (S::from_f64(lo), 1.0, below, mass)
        } else if above.re() < 0.0 {
            let mass = self.ln_tail_mass(-above, above - below);
            (S::from_f64(hi), -1.0, -above, mass)
        } else {
            (mu, 1.0, S::zero(), ln_central_mass(below, above))
        };
        let scale = S::one() / sigma * sign;
        let constant = -sigma.ln() - ln_mass;
        move |q| {
            let t = (-origin + q) * scale;
            constant - t * (t * 0.5 + c)
        }
    }
}

/// `ln` of the integral of `exp(-x^2 / 2)` from `a <= 0` to `b >= 0`, with its derivatives: two error functions of
/// one sign, which do not cancel.
fn ln_central_mass<S: Real>(a: S, b: S) -> S {
    let (x, y) = (a.re(), b.re());
    let sum = libm::erf(y * FRAC_1_SQRT_2) + libm::erf(-x * FRAC_1_SQRT_2);
    let mass = sum * 0.5 * (2.0 * PI).sqrt();
    let (da, db) = (-(-0.5 * x * x).exp() / mass, (-0.5 * y * y).exp() / mass);
    a.with_derivative(sum.ln() + LN_SQRT_2PI - std::f64::consts::LN_2, da)
        + b.with_derivative(0.0, db)
}

impl TruncatedGaussian {
    /// `ln` of the integral of `exp(-c t - t^2 / 2)` over t from 0 to `d`, with its derivatives: the mass of a tail
    /// that begins `c >= 0` sigmas from the mean, relative to the density there.
    ///
    /// All terms are positive, and the range ends where the integrand has fallen to `e^-40`. The rule's error, `L^97
    /// (48!)^4 / (97 (96!)^3)` times the 96th derivative, is 1e-52 for the exponential of a large `c` (L = 40); the
    /// other extreme, the normal of `c = 0` (L = 9), is compared with its golden values by a test.
    fn ln_tail_mass<S: Real>(&self, c: S, d: S) -> S {
        let (c0, d0) = (c.re(), d.re());
        // Where c t + t^2 / 2 = CUT, without cancellation for large c.
        let end = d0.min(2.0 * CUT / (c0 + (c0 * c0 + 2.0 * CUT).sqrt()));
        let (mut mass, mut first_moment) = (0.0, 0.0);
        for (node, weight) in self.rule {
            let t = end * node;
            let term = weight * end * (-t * (c0 + 0.5 * t)).exp();
            mass += term;
            first_moment += term * t;
        }
        let last = (-d0 * (c0 + 0.5 * d0)).exp();
        c.with_derivative(mass.ln(), -first_moment / mass) + d.with_derivative(0.0, last / mass)
    }
}

/// The `N` nodes and weights of the Gauss-Legendre rule on [0, 1], as pairs (node, weight), by Newton's method on the
/// Legendre polynomial.
#[must_use]
pub fn gauss_legendre<const N: usize>() -> [(f64, f64); N] {
    let n = N as f64;
    std::array::from_fn(|i| {
        // Tricomi's first guess is good to 1e-4 of the spacing; five steps are two more than needed.
        let mut x = -(PI * (i as f64 + 0.75) / (n + 0.5)).cos();
        let mut slope = 1.0;
        for _ in 0..5 {
            let (mut p, mut previous) = (x, 1.0);
            for k in 2..=N {
                let k = k as f64;
                (p, previous) = (((2.0 * k - 1.0) * x * p - (k - 1.0) * previous) / k, p);
            }
            slope = n * (x * p - previous) / (x * x - 1.0);
            x -= p / slope;
        }
        (0.5 * (1.0 + x), 1.0 / ((1.0 - x * x) * slope * slope))
    })
}
