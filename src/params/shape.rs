//! The shape vector: its direction is the symmetry axis of the halo, its length determines the flattening q.
//!
//! With three standard normal components (the last one its positive half) the axis is isotropic over the hemisphere
//! towards the observer, and `F(|r|)`, the distribution function of the length, is uniform: so is q.

use crate::error::{Error, Result};
use crate::scalar::{Real, Vec3};
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_1_SQRT_2, FRAC_2_SQRT_PI};
use std::ops::RangeInclusive;

/// Axis ratios that the range of q may end at.
pub const AXIS_RATIOS: RangeInclusive<f64> = 0.01..=100.0;

/// `sqrt(2 / pi)`.
const SQRT_2_OVER_PI: f64 = FRAC_2_SQRT_PI * FRAC_1_SQRT_2;

/// A shape vector shorter than this has no usable direction; its axis is set to the line of sight. The prior probability of
/// such a vector is 3e-37.
const MIN_LENGTH: f64 = 1e-12;

/// Below this length the series replaces the difference of error function and exponential.
const SERIES_BELOW: f64 = 1.0;

/// The range of the flattening q: the shape vector's length maps (0, infinity) onto it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct QRange {
    /// q of a shape vector of length zero.
    pub q_min: f64,
    /// The limit of q for an infinitely long shape vector.
    pub q_max: f64,
}

/// The prior of q in a fit, which the population model divides out.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum QPrior {
    /// Uniform between `lo` and `hi`.
    Uniform {
        /// Lower bound.
        lo: f64,
        /// Upper bound.
        hi: f64,
    },
    /// Not known in closed form: the shape vector was fixed, or its marginals were changed.
    Unknown,
}

/// Flattening and symmetry axis of the halo.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shape<S> {
    /// Axis ratio: below 1 oblate, above 1 prolate.
    pub q: S,
    /// Unit vector along the symmetry axis.
    pub axis: Vec3<S>,
}

impl Default for QRange {
    /// 0.5 to 1.5, as in the paper.
    fn default() -> Self {
        Self {
            q_min: 0.5,
            q_max: 1.5,
        }
    }
}

impl QRange {
    /// Flattening and axis of a shape vector: `q = q_min + (q_max - q_min) F(|r|)` with
    /// `F(r) = erf(r / sqrt 2) - sqrt(2 / pi) r exp(-r^2 / 2)`, and `axis = r / |r|`.
    ///
    /// Everything is written in `|r|^2`, whose derivative exists at the origin, so q has finite derivatives there
    /// (they vanish). A vector shorter than 1e-12 has no direction: its axis is the line of sight, with derivative
    /// zero. Never fails; first derivatives are exact.
    pub fn shape<S: Real>(&self, dir: Vec3<S>) -> Shape<S> {
        let norm2 = dir.norm2();
        let r = norm2.re().sqrt();
        let slope = 0.5 * SQRT_2_OVER_PI * r * (-0.5 * r * r).exp();
        let fraction = norm2.with_derivative(length_cdf(r), slope);
        let short = norm2.lt(S::from_f64(MIN_LENGTH * MIN_LENGTH));
        let inverse = S::one() / S::select(short, S::one(), norm2).sqrt();
        let axis = dir * inverse;
        Shape {
            q: fraction * (self.q_max - self.q_min) + self.q_min,
            axis: Vec3::new(
                S::select(short, S::zero(), axis.x),
                S::select(short, S::zero(), axis.y),
                S::select(short, S::one(), axis.z),
            ),
        }
    }

    /// The inverse: the shape vector of a given flattening and axis (of any length), in the hemisphere towards the
    /// observer.
    ///
    /// # Errors
    /// [`Error::OutsidePrior`] if q is not in `[q_min, q_max)`, [`Error::Setting`] if the axis has no direction.
    pub fn dir(&self, q: f64, axis: Vec3<f64>) -> Result<Vec3<f64>> {
        if !(q >= self.q_min && q < self.q_max) {
            return Err(Error::OutsidePrior {
                name: "q".to_owned(),
                value: q,
                lo: self.q_min,
                hi: self.q_max,
            });
        }
        let length = axis.norm2().sqrt();
        if !(length.is_finite() && length > 0.0) {
            return Err(Error::Setting {
                key: "axis".to_owned(),
                value: format!("{:?}", axis.to_array()),
                remedy: "give three finite numbers, not all zero".to_owned(),
            });
        }
        let width = self.q_max - self.q_min;
        let r = length_quantile((q - self.q_min) / width, (self.q_max - q) / width);
        let sign = if axis.z < 0.0 { -1.0 } else { 1.0 };
        Ok(axis * (sign * r / length))
    }
}

/// `F(r)`, the probability that a vector of three standard normals is shorter than `r >= 0`. Its relative error is a few
/// roundings for any `r`, also near the origin, where it is `sqrt(2 / pi) r^3 / 3`.
#[must_use]
pub fn length_cdf(r: f64) -> f64 {
    let density = SQRT_2_OVER_PI * (-0.5 * r * r).exp();
    if r >= SERIES_BELOW {
        return libm::erf(r * FRAC_1_SQRT_2) - density * r;
    }
    // exp(-r^2/2) sum_k r^(2k+3) / (2k+3)!!: all terms positive; the 16th is below 1e-17 of the first at r = 1.
    let (mut term, mut sum) = (r * r * r / 3.0, 0.0);
    for k in 0..16 {
        sum += term;
        term *= r * r / f64::from(2 * k + 5);
    }
    density * sum
}

/// `1 - F(r)` for `r >= 0`, see [`length_cdf`], without loss of relative precision at large `r`.
#[must_use]
pub fn length_sf(r: f64) -> f64 {
    libm::erfc(r * FRAC_1_SQRT_2) + SQRT_2_OVER_PI * r * (-0.5 * r * r).exp()
}

/// The inverse of [`length_cdf`]: the length `r` with `F(r) = lower`. `upper = 1 - lower` is a second argument so that
/// neither tail loses precision. 0 for `lower <= 0`, infinite for `upper <= 0`.
///
/// Newton's method on the logarithm of the smaller of the two, kept inside a bracket.
#[must_use]
pub fn length_quantile(lower: f64, upper: f64) -> f64 {
    if lower <= 0.0 {
        return 0.0;
    }
    if upper <= 0.0 {
        return f64::INFINITY;
    }
    // 1 - F(40) = 1e-346 is zero in doubles.
    let (mut left, mut right) = (0.0, 40.0);
    let mut r = (3.0 * lower / SQRT_2_OVER_PI).cbrt().min(2.0);
    for _ in 0..200 {
        // Positive where r is too long.
        let excess = if lower < 0.5 {
            (length_cdf(r) / lower).ln()
        } else {
            (upper / length_sf(r)).ln()
        };
        if excess > 0.0 {
            right = r;
        } else {
            left = r;
        }
        let density = SQRT_2_OVER_PI * r * r * (-0.5 * r * r).exp();
        let slope = if lower < 0.5 {
            density / length_cdf(r)
        } else {
            density / length_sf(r)
        };
        let newton = r - excess / slope;
        let next = if newton > left && newton < right {
            newton
        } else {
            0.5 * (left + right)
        };
        let done = (next - r).abs() <= 2.0 * f64::EPSILON * r;
        r = next;
        if done {
            break;
        }
    }
    r
}
