//! What the shape vector means: its direction is the halo's axis, its length the flattening.
//!
//! With three standard normal components (the last one its positive half) the axis is isotropic over the hemisphere
//! towards the observer, and `F(|r|)`, the distribution function of the length, is uniform: so is q.

use crate::error::{Error, Result};
use crate::scalar::{Real, Vec3};
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_1_SQRT_2, FRAC_2_SQRT_PI};

/// `sqrt(2 / pi)`.
const SQRT_2_OVER_PI: f64 = FRAC_2_SQRT_PI * FRAC_1_SQRT_2;

/// Below this length of the shape vector the axis has no direction left and is set to the line of sight. The prior
/// gives it a probability of 3e-37.
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

/// The prior that a fit put on q: what a population needs to know in order to divide it out.
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

impl QRange {
    /// The shape that a shape vector stands for: `q = q_min + (q_max - q_min) F(|r|)` with
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

/// `F(r)`, the probability that three standard normals have a length below `r >= 0`; accurate relative to itself down
/// to the origin, where it is `sqrt(2 / pi) r^3 / 3`.
pub(super) fn length_cdf(r: f64) -> f64 {
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

/// `1 - F(r)` with digits in the far tail.
pub(super) fn length_sf(r: f64) -> f64 {
    libm::erfc(r * FRAC_1_SQRT_2) + SQRT_2_OVER_PI * r * (-0.5 * r * r).exp()
}

/// The length below which lies the probability `lower`, given together with `upper = 1 - lower` so that neither
/// tail loses digits: Newton's method on the logarithm of the smaller one, kept inside a bracket.
pub(super) fn length_quantile(lower: f64, upper: f64) -> f64 {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scalar::{gradient_of, lift};
    use proptest::prelude::*;

    const RANGE: QRange = QRange {
        q_min: 0.5,
        q_max: 1.5,
    };

    #[test]
    fn series_and_closed_form_join() {
        // On both sides of the joint against the closed form, whose rounding error is 2e-16 / F(1) = 1e-15.
        for r in [0.9, 0.99, 0.999_999, 1.0, 1.000_001, 1.1] {
            let closed = libm::erf(r * FRAC_1_SQRT_2) - SQRT_2_OVER_PI * r * (-0.5 * r * r).exp();
            let f = length_cdf(r);
            assert!((f / closed - 1.0).abs() < 3e-15, "{r}: {f} {closed}");
        }
    }

    #[test]
    fn the_origin_follows_the_cubic_law_to_the_last_digits() {
        for r in [1e-100, 1e-30, 1e-9] {
            let law = SQRT_2_OVER_PI * r * r * r / 3.0;
            assert!((length_cdf(r) / law - 1.0).abs() < 1e-15, "{r}");
        }
    }

    #[test]
    fn the_two_tails_add_up_to_one() {
        for i in 0..80 {
            let r = 0.1 * f64::from(i);
            assert!((length_cdf(r) + length_sf(r) - 1.0).abs() < 4e-16, "{r}");
        }
    }

    #[test]
    fn q_and_its_gradient_are_finite_at_and_near_the_origin() {
        for dir in [
            [0.0, 0.0, 0.0],
            [1e-200, 0.0, 0.0],
            [0.0, -1e-13, 1e-13],
            [1e-11, 2e-11, 3e-11],
            [1e-5, 0.0, 0.0],
        ] {
            let shape = RANGE.shape(Vec3::from(lift(&dir)));
            assert!((shape.q.re - 0.5).abs() < 1e-14);
            assert!((shape.axis.map(|a| a.re).norm2() - 1.0).abs() < 1e-15);
            for part in [shape.q, shape.axis.x, shape.axis.y, shape.axis.z] {
                assert!(gradient_of(&part).iter().all(|g| g.is_finite()), "{dir:?}");
            }
            assert!(gradient_of(&shape.q).iter().all(|g| g.abs() < 1e-9));
        }
    }

    #[test]
    fn derivative_of_the_fraction_matches_central_differences_across_the_joint() {
        for i in 1..=60 {
            let r = 0.1 * f64::from(i) + 1e-4;
            let h = 1e-5 * r;
            let central = (length_cdf(r + h) - length_cdf(r - h)) / (2.0 * h);
            let dual = RANGE.shape(Vec3::from(lift(&[r, 0.0, 0.0]))).q;
            let exact = SQRT_2_OVER_PI * r * r * (-0.5 * r * r).exp();
            assert!((gradient_of(&dual)[0] / exact - 1.0).abs() < 1e-14, "{r}");
            // Truncation h^2 F'''/6 and rounding 2e-16 F / h.
            let tolerance = h * h + 2e-16 / h;
            assert!(
                (central - exact).abs() < tolerance,
                "{r}: {central} {exact}"
            );
        }
    }

    #[test]
    fn gradient_of_q_and_axis_matches_central_differences() {
        for dir in [[0.3, -0.4, 0.2], [1.5, 0.7, 2.0], [-0.01, 0.02, 0.005]] {
            let dual = RANGE.shape(Vec3::from(lift(&dir)));
            let parts = |s: Shape<f64>| [s.q, s.axis.x, s.axis.y, s.axis.z];
            let exact = [dual.q, dual.axis.x, dual.axis.y, dual.axis.z].map(|d| gradient_of(&d));
            for j in 0..3 {
                let h = 1e-6 * dir[j].abs();
                let at = |sign: f64| {
                    let mut moved = dir;
                    moved[j] += sign * h;
                    parts(RANGE.shape(Vec3::from(moved)))
                };
                let (up, down) = (at(1.0), at(-1.0));
                for i in 0..4 {
                    let central = (up[i] - down[i]) / (2.0 * h);
                    // Rounding 2e-16 / h dominates; the derivatives of the axis are of the order 1 / |dir|.
                    let tolerance = 4e-16 / h + 1e-9 * (1.0 + 1.0 / dir[j].abs());
                    assert!((central - exact[i][j]).abs() < tolerance, "{dir:?} {i} {j}");
                }
            }
        }
    }

    #[test]
    fn impossible_shapes_are_refused_by_name() {
        let axis = Vec3::new(0.0, 0.0, 1.0);
        for q in [0.49, 1.5, f64::NAN] {
            let error = RANGE.dir(q, axis).unwrap_err();
            assert!(matches!(error, Error::OutsidePrior { ref name, .. } if name == "q"));
        }
        assert!(matches!(
            RANGE.dir(1.0, Vec3::zero()),
            Err(Error::Setting { .. })
        ));
    }

    proptest! {
        #[test]
        fn shape_and_dir_invert_each_other(
            q in 0.5_f64..1.5, x in -1.0_f64..1.0, y in -1.0_f64..1.0, z in 0.0_f64..1.0, size in -3.0_f64..3.0
        ) {
            prop_assume!(x * x + y * y + z * z > 1e-6);
            let axis = Vec3::new(x, y, z) * 10_f64.powf(size);
            let dir = RANGE.dir(q, axis).unwrap();
            let back = RANGE.shape(dir);
            prop_assert!((back.q - q).abs() < 1e-15 * 4.0);
            let unit = axis * (1.0 / axis.norm2().sqrt());
            // At q_min exactly the direction is lost by nature.
            prop_assume!(q > 0.5);
            prop_assert!((back.axis - unit).norm2().sqrt() < 1e-15 * 4.0);
        }

        #[test]
        fn length_and_probability_invert_each_other(r in 1e-9_f64..30.0) {
            let back = length_quantile(length_cdf(r), length_sf(r));
            prop_assert!((back / r - 1.0).abs() < 1e-14, "{} {}", r, back);
        }
    }
}
