//! Angles in degrees on number types with derivatives.

use crate::scalar::Real;
use std::f64::consts::PI;

/// Sine and cosine of an angle in degrees.
pub(super) fn sin_cos_deg<S: Real>(angle_deg: S) -> (S, S) {
    let angle = angle_deg * (PI / 180.0);
    let (sin, cos) = angle.re().sin_cos();
    (
        angle.with_derivative(sin, cos),
        angle.with_derivative(cos, -sin),
    )
}
