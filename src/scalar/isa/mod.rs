//! Vectors of numbers in the registers of one instruction set, in double and in single precision. CPU intrinsics are called only in `x86`.
//!
//! Intrinsics are used because automatic vectorisation is incomplete in large loops: in the leapfrog some operations are compiled for
//! single numbers or for registers of half the width.

mod portable;
#[cfg(target_arch = "x86_64")]
mod x86;

pub use portable::Portable;
#[cfg(target_arch = "x86_64")]
pub(crate) use x86::{Avx2, Avx512};

use std::fmt::Debug;

/// Number of lanes in a group: a vector of an instruction set has one group in double precision, two in single precision.
pub const LANES: usize = 8;

/// Largest [`Vectors::GROUPS`].
pub const MAX_GROUPS: usize = 2;

/// `K` times eight numbers in memory, the array form of [`Lanes`](super::Lanes).
///
/// Aligned to cache lines of 64 bytes. The stack frame of a function with a variable of this type is then aligned to cache lines, so that
/// registers that are spilled to the stack do not straddle two of them.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(align(64))]
pub struct LaneArray<const K: usize>(pub [[f64; LANES]; K]);

/// A computation that is compiled for each instruction set, by `compile_kernel` where it is called on a [`Level`](super::Level).
pub trait Kernel {
    /// The type of the result.
    type Output;
    /// The computation, in lanes of `I`. Mark its implementation `#[inline(always)]`, and every function called in it that uses lanes.
    fn run<I: Isa>(self) -> Self::Output;
}

/// A long computation within a kernel that is compiled once and called, see [`Scalar::call`](super::Scalar::call). Mark its implementation
/// `#[inline(always)]`.
pub trait Subroutine {
    /// The type of the result.
    type Output;
    /// The computation.
    fn run(self) -> Self::Output;
}

/// The operations of an instruction set on vectors of one precision. A vector has [`GROUPS`](Self::GROUPS) times eight lanes; in memory
/// its numbers are doubles.
pub trait Vectors: Copy + Debug + Send + Sync + 'static {
    /// The lanes.
    type Vector: Copy + Debug + Send + Sync;
    /// The outcome of a comparison.
    type Mask: Copy + Debug + Send + Sync;

    /// Number of groups of eight lanes: one or two.
    const GROUPS: usize;
    /// The smallest positive normal number.
    const MIN_POSITIVE: f64;
    /// The distance from 1 to the next larger number.
    const EPSILON: f64;
    /// Added to a number of at most a third of it in magnitude, it rounds the number to an integer.
    const NO_FRACTION: f64;
    /// Number of Newton steps that [`inverse_sqrt`](Self::inverse_sqrt) needs.
    const NEWTON_STEPS: usize;

    /// Runs a subroutine of a kernel of this instruction set.
    fn call<C: Subroutine>(subroutine: C) -> C::Output;
    /// The same number in all lanes.
    fn splat(a: f64) -> Self::Vector;
    /// One number for each group, in all of its lanes.
    fn splat_groups(groups: &[f64]) -> Self::Vector;
    /// From memory, group by group.
    fn load(groups: &[[f64; LANES]]) -> Self::Vector;
    /// To memory, group by group.
    fn store(a: Self::Vector, groups: &mut [[f64; LANES]]);
    /// a + b
    fn add(a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// a - b
    fn sub(a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// a b
    fn mul(a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// a / b
    fn div(a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// -a
    fn neg(a: Self::Vector) -> Self::Vector;
    /// Square root.
    fn sqrt(a: Self::Vector) -> Self::Vector;
    /// An approximation of 1/sqrt(a), which [`NEWTON_STEPS`](Self::NEWTON_STEPS) steps make one to a few units in the last place.
    fn near_inverse_sqrt(a: Self::Vector) -> Self::Vector;
    /// 1/sqrt(a) to a few units in the last place, for numbers from 1e-37 to 1e38.
    #[inline(always)]
    fn inverse_sqrt(a: Self::Vector) -> Self::Vector {
        let (half, minus_half_a) = (Self::splat(0.5), Self::mul(a, Self::splat(-0.5)));
        let mut inverse = Self::near_inverse_sqrt(a);
        for _ in 0..Self::NEWTON_STEPS {
            let error = Self::mul_add(Self::mul(minus_half_a, inverse), inverse, half);
            inverse = Self::mul_add(inverse, error, inverse);
        }
        inverse
    }
    /// The larger of two; `a` if one is NaN.
    fn max(a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// The smaller of two; `a` if one is NaN.
    fn min(a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// a b + c, fused where there is an instruction for it.
    fn mul_add(a: Self::Vector, b: Self::Vector, c: Self::Vector) -> Self::Vector;
    /// a < b
    fn lt(a: Self::Vector, b: Self::Vector) -> Self::Mask;
    /// Whether the mask is set in any lane.
    fn any(mask: Self::Mask) -> bool;
    /// `a` where the mask is set, `b` elsewhere.
    fn select(mask: Self::Mask, a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// `(2^k, k ln 2)` with `a / 2^k` in [sqrt(1/2), sqrt(2)), for positive normal numbers.
    fn split_exponent(a: Self::Vector) -> (Self::Vector, Self::Vector);
}

/// An instruction set: its vectors of eight doubles, and of sixteen singles.
///
/// The instruction sets that the present CPU may lack are private to this crate. Inside it only
/// `compile_kernel` names them, and it runs them only where the CPU has reported them.
pub trait Isa: Vectors {
    /// Vectors of sixteen numbers in single precision.
    type Singles: Vectors;

    /// The columns of a matrix of eight rows.
    fn columns(rows: [&[f64; 4]; LANES]) -> [Self::Vector; 4];
    /// The rows of a matrix of eight rows, from its columns.
    fn rows(columns: [Self::Vector; 4]) -> [[f64; 4]; LANES];
    /// The sum of eight doubles: the last four are added to the first four, of these the last two to the first two, and these two.
    fn sum(a: Self::Vector) -> f64;
}

/// Mantissa bits of a double.
const MANTISSA: u64 = (1 << 52) - 1;
/// Mantissa bits of a single.
const SINGLE_MANTISSA: u32 = (1 << 23) - 1;
/// Bias of a single's exponent.
const SINGLE_BIAS: i32 = 127;
/// As [`SHIFT`], for singles.
const SINGLE_SHIFT: u32 = 0x3f80_0000 - 0x3f35_04f3;
/// Added to a double's bits, the distance from sqrt(1/2) to 1 increments the exponent exactly for numbers above sqrt(2).
const SHIFT: u64 = 0x3ff0_0000_0000_0000 - 0x3fe6_a09e_667f_3bcd;
/// The bits of 2^52: an integer below 2^52 in the mantissa makes the double 2^52 + integer.
const TWO_52_BITS: u64 = 0x4330_0000_0000_0000;
/// 2^52, and the bias of exponents.
const TWO_52_AND_BIAS: f64 = 4_503_599_627_370_496.0 + 1023.0;

/// `(2^k, k ln 2)` with `x / 2^k` in [sqrt(1/2), sqrt(2)), for positive normal `x`, without a branch.
#[inline(always)]
pub(super) fn split_exponent(x: f64) -> (f64, f64) {
    let exponent = (x.to_bits() + SHIFT) & !MANTISSA;
    let k = f64::from_bits((exponent >> 52) | TWO_52_BITS) - TWO_52_AND_BIAS;
    (f64::from_bits(exponent), k * std::f64::consts::LN_2)
}

/// As [`split_exponent`], in single precision.
#[inline(always)]
fn split_exponent_of_single(x: f32) -> (f32, f32) {
    let exponent = (x.to_bits() + SINGLE_SHIFT) & !SINGLE_MANTISSA;
    let k = ((exponent >> 23).cast_signed() - SINGLE_BIAS) as f32;
    (f32::from_bits(exponent), k * std::f32::consts::LN_2)
}

/// 1.5 * 2^52: added to a number below 2^51 in magnitude, it rounds the number to an integer.
const NO_FRACTION: f64 = 6_755_399_441_055_744.0;
/// 1.5 * 2^23, the same for singles.
const SINGLE_NO_FRACTION: f64 = 12_582_912.0;

/// The nearest integer, ties to even; for magnitudes below 2^51.
#[inline(always)]
pub(super) fn round_ties_even(x: f64) -> f64 {
    (x + NO_FRACTION) - NO_FRACTION
}
