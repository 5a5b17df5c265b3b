//! Eight numbers in the registers of one instruction set. CPU intrinsics are called only in `x86`.
//!
//! Intrinsics are used because automatic vectorisation is incomplete in large loops: in the leapfrog some operations are compiled for
//! single numbers or for registers of half the width.

#[cfg(target_arch = "x86_64")]
mod x86;

#[cfg(target_arch = "x86_64")]
pub(crate) use x86::{Avx2, Avx512};

use std::fmt::Debug;

/// Number of lanes: numbers in one [`Isa::Vector`].
pub const LANES: usize = 8;

/// `K` times eight numbers in memory, the array form of [`Lanes`](super::Lanes).
///
/// Aligned to cache lines of 64 bytes. The stack frame of a function with a variable of this type is then aligned to cache lines, so that
/// registers that are spilled to the stack do not straddle two of them.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(align(64))]
pub struct LaneArray<const K: usize>(pub [[f64; LANES]; K]);

/// A computation that is compiled for each instruction set: by `compile_kernel` where it is called on a [`Level`](super::Level), by
/// [`Isa::call`] within another kernel.
pub trait Kernel {
    /// The type of the result.
    type Output;
    /// The computation, in lanes of `I`. Mark its implementation `#[inline(always)]`, and every function called in it that uses lanes.
    fn run<I: Isa>(self) -> Self::Output;
}

/// The operations of an instruction set on eight numbers at a time.
///
/// The instruction sets that the present CPU may lack are private to this crate. Inside it only
/// `compile_kernel` names them, and it runs them only where the CPU has reported them.
pub trait Isa: Copy + Debug + Send + Sync + 'static {
    /// Eight numbers.
    type Vector: Copy + Debug + Send + Sync;
    /// The outcome of a comparison.
    type Mask: Copy + Debug + Send + Sync;

    /// Runs a kernel within another one of this instruction set. The function is called and not inlined, so that a computation that is
    /// used in many places is compiled once.
    fn call<K: Kernel>(kernel: K) -> K::Output;
    /// The same number eight times.
    fn splat(a: f64) -> Self::Vector;
    /// From memory.
    fn load(a: &[f64; LANES]) -> Self::Vector;
    /// To memory.
    fn store(a: Self::Vector) -> [f64; LANES];
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
    /// a b + c, fused where there is an instruction for it.
    fn mul_add(a: Self::Vector, b: Self::Vector, c: Self::Vector) -> Self::Vector;
    /// a < b
    fn lt(a: Self::Vector, b: Self::Vector) -> Self::Mask;
    /// The mask that is set where both masks are.
    fn both(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// Whether the mask is set in any lane.
    fn any(mask: Self::Mask) -> bool;
    /// `a` where the mask is set, `b` elsewhere.
    fn select(mask: Self::Mask, a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// The sum of the eight numbers: the last four are added to the first four, of these the last two to the first two, and these two.
    fn sum(a: Self::Vector) -> f64;
    /// `(2^k, k ln 2)` with `a / 2^k` in [sqrt(1/2), sqrt(2)), for positive normal numbers.
    fn split_exponent(a: Self::Vector) -> (Self::Vector, Self::Vector);
}

/// Mantissa bits of a double.
const MANTISSA: u64 = (1 << 52) - 1;
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

/// 1.5 * 2^52: added to a number below 2^51 in magnitude, it rounds the number to an integer.
pub(super) const NO_FRACTION: f64 = 6_755_399_441_055_744.0;

/// The nearest integer, ties to even; for magnitudes below 2^51.
#[inline(always)]
pub(super) fn round_ties_even(x: f64) -> f64 {
    (x + NO_FRACTION) - NO_FRACTION
}

/// An array of eight numbers, computed one by one. A macro and not a function of a closure, because closures are not always inlined.
macro_rules! lane_by_lane {
    ($i:ident => $value:expr) => {{
        let mut lanes = [Default::default(); LANES];
        for $i in 0..LANES {
            lanes[$i] = $value;
        }
        lanes
    }};
}

/// Arrays of numbers, compiled for the baseline of the target: runs on every CPU.
#[derive(Clone, Copy, Debug)]
pub struct Portable;

impl Isa for Portable {
    type Vector = [f64; LANES];
    type Mask = [u64; LANES];

    #[inline(never)]
    fn call<K: Kernel>(kernel: K) -> K::Output {
        kernel.run::<Self>()
    }
    #[inline(always)]
    fn splat(a: f64) -> Self::Vector {
        [a; LANES]
    }
    #[inline(always)]
    fn load(a: &[f64; LANES]) -> Self::Vector {
        *a
    }
    #[inline(always)]
    fn store(a: Self::Vector) -> [f64; LANES] {
        a
    }
    #[inline(always)]
    fn add(a: Self::Vector, b: Self::Vector) -> Self::Vector {
        lane_by_lane!(i => a[i] + b[i])
    }
    #[inline(always)]
    fn sub(a: Self::Vector, b: Self::Vector) -> Self::Vector {
        lane_by_lane!(i => a[i] - b[i])
    }
    #[inline(always)]
    fn mul(a: Self::Vector, b: Self::Vector) -> Self::Vector {
        lane_by_lane!(i => a[i] * b[i])
    }
    #[inline(always)]
    fn div(a: Self::Vector, b: Self::Vector) -> Self::Vector {
        lane_by_lane!(i => a[i] / b[i])
    }
    #[inline(always)]
    fn neg(a: Self::Vector) -> Self::Vector {
        lane_by_lane!(i => -a[i])
    }
    #[inline(always)]
    fn sqrt(a: Self::Vector) -> Self::Vector {
        lane_by_lane!(i => a[i].sqrt())
    }
    #[inline(always)]
    fn mul_add(a: Self::Vector, b: Self::Vector, c: Self::Vector) -> Self::Vector {
        lane_by_lane!(i => a[i] * b[i] + c[i])
    }
    #[inline(always)]
    fn lt(a: Self::Vector, b: Self::Vector) -> Self::Mask {
        lane_by_lane!(i => if a[i] < b[i] { u64::MAX } else { 0 })
    }
    #[inline(always)]
    fn both(a: Self::Mask, b: Self::Mask) -> Self::Mask {
        lane_by_lane!(i => a[i] & b[i])
    }
    #[inline(always)]
    fn any(mask: Self::Mask) -> bool {
        let mut bits = 0;
        for lane in 0..LANES {
            bits |= mask[lane];
        }
        bits != 0
    }
    #[inline(always)]
    fn select(mask: Self::Mask, a: Self::Vector, b: Self::Vector) -> Self::Vector {
        lane_by_lane!(i => f64::from_bits((a[i].to_bits() & mask[i]) | (b[i].to_bits() & !mask[i])))
    }
    #[inline(always)]
    fn sum(a: Self::Vector) -> f64 {
        let [a, b, c, d] = [a[0] + a[4], a[1] + a[5], a[2] + a[6], a[3] + a[7]];
        (a + c) + (b + d)
    }
    #[inline(always)]
    fn split_exponent(a: Self::Vector) -> (Self::Vector, Self::Vector) {
        (
            lane_by_lane!(i => split_exponent(a[i]).0),
            lane_by_lane!(i => split_exponent(a[i]).1),
        )
    }
}
