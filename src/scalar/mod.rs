//! What physics may ask of a number, so that one source runs on `f64`, on SIMD lanes and on dual numbers.
//!
//! The law: no branch on the value of a scalar. A comparison gives a mask, [`Scalar::select`] merges, and a loop's
//! length never depends on a scalar. On dual numbers comparisons look at the real part only, so the path through the
//! code is the same for every number type.

mod dual;
mod isa;
mod lanes;
mod vec3;

pub use dual::{Dual, LaneDual, gradient_of, lift, variable};
#[cfg(target_arch = "x86_64")]
pub(crate) use isa::{Avx2, Avx512};
pub use isa::{Eights, Isa, LANES, Portable};
pub use lanes::Lanes;
pub use vec3::Vec3;

use num_dual::DualNum;
use std::fmt::Debug;
use std::ops::{Add, AddAssign, BitAnd, Div, Mul, MulAssign, Neg, Sub, SubAssign};

/// What the hot loops may ask of a number: arithmetic, a square root, masks.
pub trait Scalar:
    Copy
    + Debug
    + 'static
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
    + MulAssign
    + Add<f64, Output = Self>
    + Sub<f64, Output = Self>
    + Mul<f64, Output = Self>
    + Div<f64, Output = Self>
{
    /// The result of a comparison.
    type Mask: Copy + BitAnd<Output = Self::Mask>;

    /// A constant.
    fn from_f64(value: f64) -> Self;

    /// Square root.
    fn sqrt(self) -> Self;

    /// `self * a + b`, fused where the hardware does that for free.
    fn mul_add(self, a: Self, b: Self) -> Self;

    /// `self < other`, on the real parts.
    fn lt(self, other: Self) -> Self::Mask;

    /// `a` where the mask is set, `b` elsewhere.
    fn select(mask: Self::Mask, a: Self, b: Self) -> Self;

    /// For a positive normal number, the constants `(2^k, k ln 2)` with `self / 2^k` in [sqrt(1/2), sqrt(2)).
    fn binade(self) -> (Self, Self);

    /// Zero.
    #[must_use]
    fn zero() -> Self {
        Self::from_f64(0.0)
    }

    /// One.
    #[must_use]
    fn one() -> Self {
        Self::from_f64(1.0)
    }

    /// The larger of two, on the real parts.
    #[must_use]
    fn max(self, other: Self) -> Self {
        Self::select(self.lt(other), other, self)
    }

    /// The smaller of two, on the real parts.
    #[must_use]
    fn min(self, other: Self) -> Self {
        Self::select(other.lt(self), other, self)
    }
}

/// What the cold code may ask besides: special functions, and the real part.
pub trait Real: Scalar {
    /// The real part.
    fn re(self) -> f64;
    /// Exponential.
    fn exp(self) -> Self;
    /// Natural logarithm.
    fn ln(self) -> Self;
    /// Cube root.
    fn cbrt(self) -> Self;
    /// Hyperbolic tangent.
    fn tanh(self) -> Self;
    /// The angle of the point (`x`, `self`).
    fn atan2(self, x: Self) -> Self;
    /// The value at the real part with the given first derivative: how a function without a formula in dual numbers
    /// (the error function) enters them.
    fn with_derivative(self, value: f64, derivative: f64) -> Self;
}

impl<T> Scalar for T
where
    T: DualNum<Primitive = f64> + Copy,
{
    type Mask = bool;

    #[inline(always)]
    fn from_f64(value: f64) -> Self {
        Self::from(value)
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        DualNum::sqrt(&self)
    }

    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        self * a + b
    }

    #[inline(always)]
    fn lt(self, other: Self) -> bool {
        self < other
    }

    #[inline(always)]
    fn select(mask: bool, a: Self, b: Self) -> Self {
        if mask { a } else { b }
    }

    #[inline(always)]
    fn binade(self) -> (Self, Self) {
        let (power, ln) = isa::binade(Real::re(self));
        (Self::from(power), Self::from(ln))
    }
}

impl<T> Real for T
where
    T: DualNum<Primitive = f64> + Copy,
{
    #[inline(always)]
    fn re(self) -> f64 {
        num_dual::DualStruct::re(&self)
    }

    fn exp(self) -> Self {
        DualNum::exp(&self)
    }

    fn ln(self) -> Self {
        DualNum::ln(&self)
    }

    fn cbrt(self) -> Self {
        DualNum::cbrt(&self)
    }

    fn tanh(self) -> Self {
        DualNum::tanh(&self)
    }

    fn atan2(self, x: Self) -> Self {
        DualNum::atan2(&self, x)
    }

    fn with_derivative(self, value: f64, derivative: f64) -> Self {
        // The derivative part of `self - re`, scaled; the real part is replaced.
        (self - Real::re(self)) * derivative + value
    }
}

/// `ln(1 + s)` for `s > -1`, to the last digits for small `s` too: with `1 + s = 2^k (1 + u) / (1 - u)` it is
/// `k ln 2 + 2 atanh u`, and `|u| < 0.172`.
#[inline(always)]
pub fn ln_1p<S: Scalar>(s: S) -> S {
    let (power, ln_power) = (s + 1.0).binade();
    let u = (s + (S::one() - power)) / (s + (S::one() + power));
    let z = u * u;
    ln_power + (u * 2.0 + u * z * two_atanh_tail(z))
}

/// `(2 atanh u - 2 u) / u^3` at `z = u^2 <= 0.0295`: the series 2/3 + 2 z/5 + 2 z^2/7 + .., cut where the next term is
/// below 1e-18 of the logarithm.
#[inline(always)]
pub fn two_atanh_tail<S: Scalar>(z: S) -> S {
    // By pairs (Estrin's scheme): the hot loop waits for this sum, and Horner's is one long chain.
    let z2 = z * z;
    let z4 = z2 * z2;
    let low = tail_pair(1, z).mul_add(z2, tail_pair(0, z));
    let high = tail_pair(3, z).mul_add(z2, tail_pair(2, z));
    tail_pair(4, z).mul_add(z4, high).mul_add(z4, low)
}

/// Terms 2 `j` and 2 `j` + 1 of the series, over z^(2j).
#[inline(always)]
fn tail_pair<S: Scalar>(j: usize, z: S) -> S {
    let even = 2.0 / (4 * j + 3) as f64;
    let odd = 2.0 / (4 * j + 5) as f64;
    S::from_f64(odd).mul_add(z, S::from_f64(even))
}

/// The C2 step that is 0 below `x = 0`, 1 above `x = 1` and `x^3 (10 - 15 x + 6 x^2)` between.
#[inline(always)]
pub fn smooth_step<S: Scalar>(x: S) -> S {
    let x = x.max(S::zero()).min(S::one());
    x * x * x * (x * (x * 6.0 - 15.0) + 10.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ln_1p_is_within_two_ulp_of_the_library() {
        let mut s = 1e-300;
        while s < 1e300 {
            let (ours, theirs) = (ln_1p(s), f64::ln_1p(s));
            let ulp = f64::from_bits(theirs.to_bits() + 1) - theirs;
            assert!((ours - theirs).abs() <= 2.0 * ulp, "{s}: {ours} {theirs}");
            s *= 1.000_7;
        }
    }

    #[test]
    fn smooth_step_has_two_continuous_derivatives_at_its_ends() {
        let at = |x: f64| smooth_step(x);
        for edge in [0.0, 1.0] {
            let h = 1e-3;
            let second = (at(edge + h) - 2.0 * at(edge) + at(edge - h)) / (h * h);
            assert!(second.abs() < 0.07, "{second}");
        }
        assert!(
            (at(0.5) - 0.5).abs() < 1e-15
                && at(-1.0).abs() < 1e-300
                && (at(2.0) - 1.0).abs() < 1e-300
        );
    }
}
