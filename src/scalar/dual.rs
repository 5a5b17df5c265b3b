//! Dual numbers of 13 parts: the reference gradient.

use num_dual::DualSVec64;

/// A number with its derivatives with respect to `N` variables.
pub type Dual<const N: usize> = DualSVec64<N>;

/// The variable `index` at `value`.
#[must_use]
pub fn variable<const N: usize>(value: f64, index: usize) -> Dual<N> {
    Dual::from_re(value).derivative(index)
}

/// All `N` variables at their values.
#[must_use]
pub fn lift<const N: usize>(values: &[f64; N]) -> [Dual<N>; N] {
    std::array::from_fn(|i| variable(values[i], i))
}

/// The derivatives of a result.
#[must_use]
pub fn gradient_of<const N: usize>(result: &Dual<N>) -> [f64; N] {
    result.eps.0.map_or([0.0; N], |eps| eps.data.0[0])
}
