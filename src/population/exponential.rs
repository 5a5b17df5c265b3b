//! One term of a sum of exponentials, on any number type.

use crate::scalar::Real;

/// Below this a term is zero in doubles. It must not be computed: its derivative may be an infinity, and zero times infinity is not zero.
const LN_SMALLEST: f64 = -745.0;

/// Adds `exp(ln_term)` to a sum. A NaN is added, so that the sum is one.
pub(super) fn add_exponential<S: Real>(sum: &mut S, ln_term: S) {
    if ln_term.re().is_nan() || ln_term.re() >= LN_SMALLEST {
        *sum += ln_term.exp();
    }
}
