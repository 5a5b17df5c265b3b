//! The traits [`Scalar`] and [`Real`]: operations on numbers, so that one source of the physics is computed on `f64`, on SIMD lanes and
//! on dual numbers.
//!
//! Generic code must not branch on the value of a scalar: a comparison gives a mask, [`Scalar::select`] chooses by it, and
//! the number of iterations of a loop does not depend on a scalar. The exceptions are the length of adaptive steps, which is common to all
//! lanes, and the steps that pass near the projected centre ([`Scalar::any`]). Comparisons of dual numbers use the real parts only, so that every number type executes the same operations.

mod dispatch;
mod dual;
mod isa;
mod lanes;
mod tangent;
mod vec3;

pub use dispatch::Level;
pub(crate) use dispatch::compile_kernel;
pub use dual::{Dual, LaneDual, gradient_of, lift, variable};
#[cfg(target_arch = "x86_64")]
pub(crate) use isa::{Avx2, Avx512};
pub use isa::{Isa, Kernel, LANES, LaneArray, Portable, Subroutine, Vectors};
pub use lanes::Lanes;
pub use tangent::Tangent;
pub use vec3::Vec3;

use num_dual::DualNum;
use std::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_2, FRAC_PI_4, FRAC_PI_8, PI};
use std::fmt::Debug;
use std::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

/// The operations of the inner loops: arithmetic, square root, comparison and selection. Implement them with `#[inline(always)]`: outside
/// of kernels they would be compiled without the kernel's instructions.
pub trait Scalar:
    Copy
    + Debug
    + Send
    + Sync
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
    type Mask: Copy;

    /// The smallest positive normal number.
    const MIN_POSITIVE: f64 = f64::MIN_POSITIVE;
    /// The distance from 1 to the next larger number.
    const EPSILON: f64 = f64::EPSILON;

    /// A number with derivatives of zero, the same in every lane.
    fn from_f64(value: f64) -> Self;

    /// Runs a computation on numbers of this type. In lanes it is called and not inlined, so that a long one that is used in many places is
    /// compiled once; others are short.
    #[inline(always)]
    fn call<C: Subroutine>(subroutine: C) -> C::Output {
        subroutine.run()
    }

    /// Square root.
    fn sqrt(self) -> Self;

    /// 1/sqrt, for numbers from 1e-37 to 1e38: some instruction sets begin with an approximation in single precision.
    #[inline(always)]
    #[must_use]
    fn inverse_sqrt(self) -> Self {
        Self::one() / self.sqrt()
    }

    /// `self * a + b`, fused where the hardware does that for free.
    fn mul_add(self, a: Self, b: Self) -> Self;

    /// `self < other`, on the real parts.
    fn lt(self, other: Self) -> Self::Mask;

    /// Whether the mask is set in any lane.
    fn any(mask: Self::Mask) -> bool;

    /// `a` where the mask is set, `b` elsewhere.
    fn select(mask: Self::Mask, a: Self, b: Self) -> Self;

    /// `(2^k, k ln 2)` with `self / 2^k` in [sqrt(1/2), sqrt(2)) and derivatives of zero; for positive normal numbers.
    fn split_exponent(self) -> (Self, Self);

    /// The nearest integer, ties to even, with derivatives of zero; for magnitudes below 2^51, in single precision 2^22.
    fn round_ties_even(self) -> Self;

    /// Zero.
    #[inline(always)]
    #[must_use]
    fn zero() -> Self {
        Self::from_f64(0.0)
    }

    /// One.
    #[inline(always)]
    #[must_use]
    fn one() -> Self {
        Self::from_f64(1.0)
    }

    /// The larger of two, on the real parts.
    #[inline(always)]
    #[must_use]
    fn max(self, other: Self) -> Self {
        Self::select(self.lt(other), other, self)
    }

    /// The smaller of two, on the real parts.
    #[inline(always)]
    #[must_use]
    fn min(self, other: Self) -> Self {
        Self::select(other.lt(self), other, self)
    }
}

/// Further operations, outside the inner loops: elementary functions and the real part. Lanes do not have them.
pub trait Real: Scalar {
    /// The real part.
    fn re(self) -> f64;
    /// Exponential.
    fn exp(self) -> Self;
    /// Natural logarithm.
    fn ln(self) -> Self;
    /// Cube root.
    fn cbrt(self) -> Self;
    /// The number `value` with `derivative` times the derivatives of `self` (the chain rule). For functions that dual
    /// numbers do not provide, such as the error function.
    fn with_derivative(self, value: f64, derivative: f64) -> Self;
}

impl<T> Scalar for T
where
    T: DualNum<Primitive = f64> + Copy + Send + Sync,
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
    fn any(mask: bool) -> bool {
        mask
    }

    #[inline(always)]
    fn select(mask: bool, a: Self, b: Self) -> Self {
        if mask { a } else { b }
    }

    #[inline(always)]
    fn split_exponent(self) -> (Self, Self) {
        let (power, ln) = isa::split_exponent(Real::re(self));
        (Self::from(power), Self::from(ln))
    }

    #[inline(always)]
    fn round_ties_even(self) -> Self {
        Self::from(isa::round_ties_even(Real::re(self)))
    }
}

impl<T> Real for T
where
    T: DualNum<Primitive = f64> + Copy + Send + Sync,
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

    fn with_derivative(self, value: f64, derivative: f64) -> Self {
        // `self - re` has the derivatives of `self` and the real part 0.
        (self - Real::re(self)) * derivative + value
    }
}

/// `ln(1 + s)` for `s > -1`, accurate also for small `s`: with `1 + s = 2^k (1 + u) / (1 - u)` it is
/// `k ln 2 + 2 atanh u`, and `|u| < 0.172`.
#[inline(always)]
pub fn ln_1p<S: Scalar>(s: S) -> S {
    let (power, ln_power) = (s + 1.0).split_exponent();
    let u = (s + (S::one() - power)) / (s + (S::one() + power));
    let z = u * u;
    ln_power + (u * 2.0 + u * z * two_atanh_tail(z))
}

/// `(2 atanh u - 2 u) / u^3` at `z = u^2 <= 0.0295`: the series 2/3 + 2 z/5 + 2 z^2/7 + .., cut where the next term is
/// below 1e-18 of the logarithm, in single precision 1e-8.
#[inline(always)]
pub fn two_atanh_tail<S: Scalar>(z: S) -> S {
    // Estrin's scheme has shorter dependency chains than Horner's: the latency of this sum matters in the inner loop.
    let z2 = z * z;
    let low = tail_pair(1, z).mul_add(z2, tail_pair(0, z));
    if S::EPSILON > f64::EPSILON {
        return low;
    }
    let z4 = z2 * z2;
    let high = tail_pair(3, z).mul_add(z2, tail_pair(2, z));
    tail_pair(4, z).mul_add(z4, high).mul_add(z4, low)
}

/// Terms 2 `j` and 2 `j` + 1 of the series, divided by z^(2j).
#[inline(always)]
fn tail_pair<S: Scalar>(j: usize, z: S) -> S {
    let even = 2.0 / (4 * j + 3) as f64;
    let odd = 2.0 / (4 * j + 5) as f64;
    S::from_f64(odd).mul_add(z, S::from_f64(even))
}

/// The angle of the point (`x`, `y`) in radians, above -pi and up to pi, to 4e-16; 0 at the origin.
#[inline(always)]
pub fn angle<S: Scalar>(y: S, x: S) -> S {
    // Reflect the point into the first octant, then rotate it by minus the nearest of 0, pi/8 and pi/4.
    let (width, height) = (x.max(-x), y.max(-y));
    let (far, near) = (width.max(height), width.min(height));
    // Tangents of pi/16 and 3 pi/16.
    let beyond_first = (far * 0.198_912_367_379_658).lt(near);
    let beyond_second = (far * 0.668_178_637_919_298_9).lt(near);
    let turn = |zeroth: f64, first: f64, second: f64| {
        let below = S::select(beyond_first, S::from_f64(first), S::from_f64(zeroth));
        S::select(beyond_second, S::from_f64(second), below)
    };
    let cos = turn(1.0, 0.923_879_532_511_286_7, FRAC_1_SQRT_2);
    let sin = turn(0.0, 0.382_683_432_365_089_8, FRAC_1_SQRT_2);
    let along = far.mul_add(cos, near * sin);
    let across = near.mul_add(cos, -(far * sin));
    let tangent = across / along.max(S::from_f64(S::MIN_POSITIVE));
    let eighth = turn(0.0, FRAC_PI_8, FRAC_PI_4) + small_angle(tangent);
    let upright = width.lt(height);
    let quarter = S::select(upright, -eighth + FRAC_PI_2, eighth);
    let half = S::select(x.lt(S::zero()), -quarter + PI, quarter);
    S::select(y.lt(S::zero()), -half, half)
}

/// The angle with this tangent, of at most pi/16: the series t - t^3/3 + t^5/5 - .., cut where the next term is below 2e-17
/// of the angle.
#[inline(always)]
fn small_angle<S: Scalar>(tangent: S) -> S {
    let z = tangent * tangent;
    let mut sum = S::from_f64(1.0 / 21.0);
    for odd in [19, 17, 15, 13, 11, 9, 7, 5, 3] {
        sum = sum.mul_add(-z, S::from_f64(1.0 / f64::from(odd)));
    }
    (tangent * z).mul_add(-sum, tangent)
}

/// The C2 step that is 0 below `x = 0`, 1 above `x = 1` and `x^3 (10 - 15 x + 6 x^2)` between.
#[inline(always)]
pub fn smooth_step<S: Scalar>(x: S) -> S {
    let x = x.max(S::zero()).min(S::one());
    x * x * x * (x * (x * 6.0 - 15.0) + 10.0)
}
