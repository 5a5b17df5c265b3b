//! Single precision, in which networks compute.

/// The nearest number in single precision.
#[allow(clippy::cast_possible_truncation, reason = "single precision")]
pub(crate) fn single(x: f64) -> f32 {
    x as f32
}
