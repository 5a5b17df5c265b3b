//! A product prior of named one-dimensional marginals, with three exact coordinate systems: physical `theta`, unit
//! cube `u` and standard normals `z = Phi^-1(u)`.

use crate::limits::{OutOfRange, in_range};
use crate::normal;
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_1_SQRT_2, SQRT_2};
use std::ops::RangeInclusive;

/// Smallest standard deviation, as a fraction of the range in which a parameter may lie.
const MIN_SD: f64 = 1e-9;

/// One marginal of a product prior.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum Marginal {
    /// Uniform between `lo` and `hi`.
    Uniform {
        /// Lower bound.
        lo: f64,
        /// Upper bound.
        hi: f64,
    },
    /// Normal.
    Normal {
        /// Mean.
        mean: f64,
        /// Standard deviation.
        sd: f64,
    },
    /// The positive half of a normal of mean zero.
    HalfNormal {
        /// Standard deviation of the whole normal.
        sd: f64,
    },
}

impl Marginal {
    /// The physical value at the standard-normal coordinate `z`; digits are kept in both tails.
    #[must_use]
    pub fn theta_from_z(&self, z: f64) -> f64 {
        match *self {
            Self::Uniform { lo, hi } => {
                if z < 0.0 {
                    lo + (hi - lo) * normal::cdf(z)
                } else {
                    hi - (hi - lo) * normal::sf(z)
                }
            }
            Self::Normal { mean, sd } => mean + sd * z,
            Self::HalfNormal { sd } => sd * half_normal_from_z(z),
        }
    }

    /// The physical value at the cube coordinate `u` in (0, 1).
    #[must_use]
    pub fn theta_from_u(&self, u: f64) -> f64 {
        match *self {
            Self::Uniform { lo, hi } => lo + (hi - lo) * u,
            Self::Normal { mean, sd } => mean + sd * normal::quantile(u),
            Self::HalfNormal { .. } => self.theta_from_z(normal::quantile(u)),
        }
    }

    /// The standard-normal coordinate of a physical value; infinite at and beyond the bounds.
    #[must_use]
    pub fn z_from_theta(&self, theta: f64) -> f64 {
        let (lower, upper) = self.tails(theta);
        if let Self::Normal { mean, sd } = *self {
            (theta - mean) / sd
        } else if lower < 0.5 {
            normal::quantile(lower)
        } else {
            -normal::quantile(upper)
        }
    }

    /// The cube coordinate of a physical value: its cumulative probability.
    #[must_use]
    pub fn u_from_theta(&self, theta: f64) -> f64 {
        self.tails(theta).0
    }

    /// Probability below and above `theta`, each with its own digits.
    fn tails(&self, theta: f64) -> (f64, f64) {
        match *self {
            Self::Uniform { lo, hi } => {
                let w = hi - lo;
                (
                    ((theta - lo) / w).clamp(0.0, 1.0),
                    ((hi - theta) / w).clamp(0.0, 1.0),
                )
            }
            Self::Normal { mean, sd } => {
                let t = (theta - mean) / sd;
                (normal::cdf(t), normal::sf(t))
            }
            Self::HalfNormal { sd } => {
                let t = (theta / sd).max(0.0) * FRAC_1_SQRT_2;
                (libm::erf(t), libm::erfc(t))
            }
        }
    }

    /// `d theta / d z = phi(z) / f(theta)`.
    #[must_use]
    pub fn dtheta_dz(&self, z: f64) -> f64 {
        match *self {
            Self::Uniform { lo, hi } => (hi - lo) * normal::ln_pdf(z).exp(),
            Self::Normal { sd, .. } => sd,
            Self::HalfNormal { sd } => {
                let t = half_normal_from_z(z);
                sd * 0.5 * (0.5 * (t * t - z * z)).exp()
            }
        }
    }

    /// `d theta / d u = 1 / f(theta)`.
    #[must_use]
    pub fn dtheta_du(&self, u: f64) -> f64 {
        let z = normal::quantile(u);
        self.dtheta_dz(z) / normal::ln_pdf(z).exp()
    }

    /// Log density at `theta`; minus infinity outside the support.
    #[must_use]
    pub fn ln_pdf(&self, theta: f64) -> f64 {
        match *self {
            Self::Uniform { lo, hi } => {
                if theta >= lo && theta <= hi {
                    -(hi - lo).ln()
                } else {
                    f64::NEG_INFINITY
                }
            }
            Self::Normal { mean, sd } => normal::ln_pdf((theta - mean) / sd) - sd.ln(),
            Self::HalfNormal { sd } => {
                if theta >= 0.0 {
                    normal::ln_pdf(theta / sd) - sd.ln() + std::f64::consts::LN_2
                } else {
                    f64::NEG_INFINITY
                }
            }
        }
    }

    /// The closed support, with infinities where there is no bound.
    #[must_use]
    pub fn support(&self) -> (f64, f64) {
        match *self {
            Self::Uniform { lo, hi } => (lo, hi),
            Self::Normal { .. } => (f64::NEG_INFINITY, f64::INFINITY),
            Self::HalfNormal { .. } => (0.0, f64::INFINITY),
        }
    }

    /// Checks that the numbers called `lo`, `hi` and `mean` lie in a range, and that `sd` is at most its width and at least 1e-9 of it.
    /// The distribution itself may reach beyond the range.
    ///
    /// # Errors
    /// [`OutOfRange`] with the key `KEY.lo` (or `.hi`, `.mean`, `.sd`) of the first one that does not.
    pub fn check_range(&self, key: &str, range: &RangeInclusive<f64>) -> Result<(), OutOfRange> {
        let place =
            |name: &str, value: f64| in_range(&format!("{key}.{name}"), value, range.clone());
        let width = range.end() - range.start();
        let sd = |value: f64| in_range(&format!("{key}.sd"), value, MIN_SD * width..=width);
        match *self {
            Self::Uniform { lo, hi } => place("lo", lo).and_then(|()| place("hi", hi)),
            Self::Normal { mean, sd: value } => place("mean", mean).and_then(|()| sd(value)),
            Self::HalfNormal { sd: value } => sd(value),
        }
    }

    /// Whether the numbers define a distribution.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        match *self {
            Self::Uniform { lo, hi } => lo.is_finite() && hi.is_finite() && lo < hi,
            Self::Normal { mean, sd } => mean.is_finite() && sd.is_finite() && sd > 0.0,
            Self::HalfNormal { sd } => sd.is_finite() && sd > 0.0,
        }
    }
}

/// |N(0,1)| at the standard-normal coordinate z: `erf(t / sqrt 2) = Phi(z)`.
fn half_normal_from_z(z: f64) -> f64 {
    if z > 0.0 {
        // Q(t) = Q(z) / 2. Beyond 38 standard deviations Q(z) is zero as a number.
        -normal::quantile(0.5 * normal::sf(z.min(38.0)))
    } else {
        // Near zero the quantile of 1/2 + p/2 has no digits of p left; invert the error function and polish it.
        let p = normal::cdf(z);
        let t = SQRT_2 * statrs::function::erf::erf_inv(p);
        let slope = 2.0 * normal::ln_pdf(t).exp();
        t - (libm::erf(t * FRAC_1_SQRT_2) - p) / slope
    }
}

/// A product of named marginals.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Prior {
    names: Vec<String>,
    units: Vec<String>,
    marginals: Vec<Marginal>,
}

impl Prior {
    /// A prior from (name, unit, marginal) triples.
    ///
    /// # Errors
    /// [`Error::Setting`](crate::Error::Setting) if there is none, or if one of them is not a distribution.
    pub fn new<N, U, I>(parameters: I) -> crate::Result<Self>
    where
        N: Into<String>,
        U: Into<String>,
        I: IntoIterator<Item = (N, U, Marginal)>,
    {
        let mut prior = Self {
            names: Vec::new(),
            units: Vec::new(),
            marginals: Vec::new(),
        };
        for (name, unit, marginal) in parameters {
            let name = name.into();
            if !marginal.is_valid() {
                return Err(crate::Error::Setting {
                    name: "prior",
                    value: format!("{marginal:?} for {name}"),
                    remedy: "give finite numbers with lo < hi, and standard deviations above zero",
                });
            }
            prior.names.push(name);
            prior.units.push(unit.into());
            prior.marginals.push(marginal);
        }
        if prior.marginals.is_empty() {
            return Err(crate::Error::Setting {
                name: "prior",
                value: "empty".to_owned(),
                remedy: "leave at least one parameter free",
            });
        }
        Ok(prior)
    }

    /// Number of parameters.
    #[must_use]
    pub fn dim(&self) -> usize {
        self.marginals.len()
    }

    /// Parameter names.
    #[must_use]
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Parameter units, empty where there is none.
    #[must_use]
    pub fn units(&self) -> &[String] {
        &self.units
    }

    /// The marginals.
    #[must_use]
    pub fn marginals(&self) -> &[Marginal] {
        &self.marginals
    }

    /// Physical parameters at standard-normal coordinates.
    pub fn theta_from_z(&self, z: &[f64], theta: &mut [f64]) {
        for ((m, z), t) in self.marginals.iter().zip(z).zip(theta) {
            *t = m.theta_from_z(*z);
        }
    }

    /// Physical parameters at cube coordinates.
    pub fn theta_from_u(&self, u: &[f64], theta: &mut [f64]) {
        for ((m, u), t) in self.marginals.iter().zip(u).zip(theta) {
            *t = m.theta_from_u(*u);
        }
    }

    /// Standard-normal coordinates of physical parameters.
    pub fn z_from_theta(&self, theta: &[f64], z: &mut [f64]) {
        for ((m, t), z) in self.marginals.iter().zip(theta).zip(z) {
            *z = m.z_from_theta(*t);
        }
    }

    /// Turns a gradient in physical parameters, taken at the point with standard-normal coordinates `z`, into one in
    /// `z`, in place.
    pub fn gradient_to_z(&self, z: &[f64], gradient: &mut [f64]) {
        for ((m, z), g) in self.marginals.iter().zip(z).zip(gradient) {
            *g *= m.dtheta_dz(*z);
        }
    }

    /// Turns a gradient in physical parameters, taken at the point `u` of the cube, into one in `u`, in place.
    pub fn gradient_to_u(&self, u: &[f64], gradient: &mut [f64]) {
        for ((m, u), g) in self.marginals.iter().zip(u).zip(gradient) {
            *g *= m.dtheta_du(*u);
        }
    }

    /// Log density at physical parameters.
    #[must_use]
    pub fn ln_pdf(&self, theta: &[f64]) -> f64 {
        self.marginals
            .iter()
            .zip(theta)
            .map(|(m, t)| m.ln_pdf(*t))
            .sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [Marginal; 3] = [
        Marginal::Uniform { lo: -2.0, hi: 5.0 },
        Marginal::Normal { mean: 1.0, sd: 3.0 },
        Marginal::HalfNormal { sd: 150.0 },
    ];

    #[test]
    fn every_coordinate_has_a_parameter() {
        for m in ALL {
            for z in [-1e3, -40.0, 40.0, 1e3] {
                assert!(m.theta_from_z(z).is_finite(), "{m:?} {z}");
            }
        }
    }

    #[test]
    fn transforms_invert_each_other() {
        for m in ALL {
            for i in -60..=60 {
                let z = f64::from(i) * 0.1;
                let theta = m.theta_from_z(z);
                // In the tail of a uniform the last digits are lost beside the bound.
                let tolerance = 1e-12 + 4e-16 * 7.0 / m.dtheta_dz(z).min(1.0);
                assert!((m.z_from_theta(theta) - z).abs() < tolerance, "{m:?} {z}");
                let u = m.u_from_theta(theta);
                assert!((u - normal::cdf(z)).abs() < 1e-14, "{m:?} {z}");
                // Close to 1 the cube has no digits left: half a unit in its last place moves theta by this much.
                let grain = 2.3e-16 * m.dtheta_dz(z) / normal::ln_pdf(z).exp();
                assert!(
                    (m.theta_from_u(u) - theta).abs() < 1e-12 * theta.abs().max(1.0) + 2.0 * grain,
                    "{m:?} {z}"
                );
            }
        }
    }

    #[test]
    fn gradients_by_the_cube_match_a_central_difference() {
        let prior = Prior::new(ALL.map(|m| ("x", "", m))).unwrap();
        let h = 1e-6;
        for u in [0.01, 0.3, 0.5, 0.9, 0.999] {
            // Of the sum of theta.
            let mut gradient = [1.0; 3];
            prior.gradient_to_u(&[u; 3], &mut gradient);
            for (m, slope) in ALL.iter().zip(gradient) {
                let numeric = (m.theta_from_u(u + h) - m.theta_from_u(u - h)) / (2.0 * h);
                assert!((numeric / slope - 1.0).abs() < 1e-6, "{m:?} {u}");
            }
        }
    }

    #[test]
    fn slope_of_theta_matches_a_central_difference_and_the_density() {
        for m in ALL {
            for i in -50..=50 {
                let z = f64::from(i) * 0.1;
                let h = 1e-5;
                let numeric = (m.theta_from_z(z + h) - m.theta_from_z(z - h)) / (2.0 * h);
                let slope = m.dtheta_dz(z);
                assert!(
                    (numeric - slope).abs() < 1e-7 * slope + 1e-8,
                    "{m:?} {z} {numeric} {slope}"
                );
                let from_density = (normal::ln_pdf(z) - m.ln_pdf(m.theta_from_z(z))).exp();
                assert!((from_density - slope).abs() < 1e-11 * slope, "{m:?} {z}");
            }
        }
    }
}
