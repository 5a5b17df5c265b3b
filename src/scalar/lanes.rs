//! Several numbers side by side: an array that the compiler turns into vector registers.

use super::Scalar;
use std::ops::{Add, AddAssign, BitAnd, Div, Mul, MulAssign, Neg, Sub, SubAssign};

/// `N` numbers side by side; `FMA` says whether the code around it is compiled for a CPU with fused multiply-add.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(64))]
pub struct Lanes<const N: usize, const FMA: bool>(pub [f64; N]);

/// The outcome of a comparison, lane by lane: all bits set, or none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LaneMask<const N: usize>([u64; N]);

impl<const N: usize> BitAnd for LaneMask<N> {
    type Output = Self;
    #[inline(always)]
    fn bitand(self, other: Self) -> Self {
        Self(std::array::from_fn(|i| self.0[i] & other.0[i]))
    }
}

/// `(2^k, k ln 2)` with `x / 2^k` in [sqrt(1/2), sqrt(2)), for positive normal `x`: by the bits of the number, without
/// a branch.
#[inline(always)]
pub(super) fn binade(x: f64) -> (f64, f64) {
    const MANTISSA: u64 = (1 << 52) - 1;
    // Adding the distance from sqrt(1/2) to 1 in mantissa bits carries into the exponent exactly above sqrt(2).
    const SHIFT: u64 = 0x3ff0_0000_0000_0000 - 0x3fe6_a09e_667f_3bcd;
    let exponent = (x.to_bits() + SHIFT) & !MANTISSA;
    // The exponent as a double: its biased integer in the low bits of 2^52, less 2^52 and the bias.
    let k = f64::from_bits((exponent >> 52) | 0x4330_0000_0000_0000)
        - (4_503_599_627_370_496.0 + 1023.0);
    (f64::from_bits(exponent), k * std::f64::consts::LN_2)
}

macro_rules! elementwise {
    ($($trait:ident $method:ident $op:tt),*) => {$(
        impl<const N: usize, const FMA: bool> $trait for Lanes<N, FMA> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(std::array::from_fn(|i| self.0[i] $op other.0[i]))
            }
        }
        impl<const N: usize, const FMA: bool> $trait<f64> for Lanes<N, FMA> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: f64) -> Self {
                Self(std::array::from_fn(|i| self.0[i] $op other))
            }
        }
    )*};
}
elementwise!(Add add +, Sub sub -, Mul mul *, Div div /);

macro_rules! assigning {
    ($($trait:ident $method:ident $op:tt),*) => {$(
        impl<const N: usize, const FMA: bool> $trait for Lanes<N, FMA> {
            #[inline(always)]
            fn $method(&mut self, other: Self) {
                *self = *self $op other;
            }
        }
    )*};
}
assigning!(AddAssign add_assign +, SubAssign sub_assign -, MulAssign mul_assign *);

impl<const N: usize, const FMA: bool> Neg for Lanes<N, FMA> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(std::array::from_fn(|i| -self.0[i]))
    }
}

impl<const N: usize, const FMA: bool> Scalar for Lanes<N, FMA> {
    type Mask = LaneMask<N>;

    #[inline(always)]
    fn from_f64(value: f64) -> Self {
        Self([value; N])
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(std::array::from_fn(|i| self.0[i].sqrt()))
    }

    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        if FMA {
            Self(std::array::from_fn(|i| self.0[i].mul_add(a.0[i], b.0[i])))
        } else {
            self * a + b
        }
    }

    #[inline(always)]
    fn lt(self, other: Self) -> LaneMask<N> {
        LaneMask(std::array::from_fn(|i| {
            if self.0[i] < other.0[i] { u64::MAX } else { 0 }
        }))
    }

    #[inline(always)]
    fn select(mask: LaneMask<N>, a: Self, b: Self) -> Self {
        Self(std::array::from_fn(|i| {
            let (a, b) = (a.0[i].to_bits(), b.0[i].to_bits());
            f64::from_bits((a & mask.0[i]) | (b & !mask.0[i]))
        }))
    }

    #[inline(always)]
    fn binade(self) -> (Self, Self) {
        let both: [(f64, f64); N] = std::array::from_fn(|i| binade(self.0[i]));
        (
            Self(std::array::from_fn(|i| both[i].0)),
            Self(std::array::from_fn(|i| both[i].1)),
        )
    }
}

impl<const N: usize, const FMA: bool> Lanes<N, FMA> {
    /// Adds up the lanes by halves: the other order would be one long chain of waits. `N` is a power of two.
    #[inline(always)]
    #[must_use]
    pub fn sum(self) -> f64 {
        let mut lanes = self.0;
        let mut width = N;
        while width > 1 {
            width /= 2;
            for i in 0..width {
                lanes[i] += lanes[i + width];
            }
        }
        lanes[0]
    }
}
