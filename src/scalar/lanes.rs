//! Several numbers in SIMD registers, which generic code handles as one [`Scalar`].
#![allow(
    clippy::needless_range_loop,
    reason = "adapters of iterators are functions that may not be inlined, and would be compiled without the kernel's instructions"
)]

use super::isa::{Isa, LANES, LaneArray, NO_FRACTION};
use super::{Scalar, Vec3};
use std::ops::{Add, AddAssign, BitAnd, Div, Mul, MulAssign, Neg, Sub, SubAssign};

/// `K` times eight numbers in the registers of an instruction set.
#[derive(Clone, Copy, Debug)]
pub struct Lanes<I: Isa, const K: usize>([I::Vector; K]);

/// The outcome of a comparison, lane by lane.
#[derive(Clone, Copy, Debug)]
pub struct LaneMask<I: Isa, const K: usize>([I::Mask; K]);

impl<I: Isa, const K: usize> BitAnd for LaneMask<I, K> {
    type Output = Self;
    #[inline(always)]
    fn bitand(mut self, other: Self) -> Self {
        for i in 0..K {
            self.0[i] = I::both(self.0[i], other.0[i]);
        }
        self
    }
}

macro_rules! elementwise {
    ($($trait:ident $method:ident),*) => {$(
        impl<I: Isa, const K: usize> $trait for Lanes<I, K> {
            type Output = Self;
            #[inline(always)]
            fn $method(mut self, other: Self) -> Self {
                for i in 0..K {
                    self.0[i] = I::$method(self.0[i], other.0[i]);
                }
                self
            }
        }
        impl<I: Isa, const K: usize> $trait<f64> for Lanes<I, K> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: f64) -> Self {
                self.$method(Self::from_f64(other))
            }
        }
    )*};
}
elementwise!(Add add, Sub sub, Mul mul, Div div);

macro_rules! assigning {
    ($($trait:ident $method:ident $op:tt),*) => {$(
        impl<I: Isa, const K: usize> $trait for Lanes<I, K> {
            #[inline(always)]
            fn $method(&mut self, other: Self) {
                *self = *self $op other;
            }
        }
    )*};
}
assigning!(AddAssign add_assign +, SubAssign sub_assign -, MulAssign mul_assign *);

impl<I: Isa, const K: usize> Neg for Lanes<I, K> {
    type Output = Self;
    #[inline(always)]
    fn neg(mut self) -> Self {
        for vector in &mut self.0 {
            *vector = I::neg(*vector);
        }
        self
    }
}

impl<I: Isa, const K: usize> Scalar for Lanes<I, K> {
    type Mask = LaneMask<I, K>;

    #[inline(always)]
    fn from_f64(value: f64) -> Self {
        Self([I::splat(value); K])
    }

    #[inline(always)]
    fn sqrt(mut self) -> Self {
        for vector in &mut self.0 {
            *vector = I::sqrt(*vector);
        }
        self
    }

    #[inline(always)]
    fn mul_add(mut self, a: Self, b: Self) -> Self {
        for i in 0..K {
            self.0[i] = I::mul_add(self.0[i], a.0[i], b.0[i]);
        }
        self
    }

    #[inline(always)]
    fn lt(self, other: Self) -> LaneMask<I, K> {
        let mut mask = [I::lt(self.0[0], other.0[0]); K];
        for i in 1..K {
            mask[i] = I::lt(self.0[i], other.0[i]);
        }
        LaneMask(mask)
    }

    #[inline(always)]
    fn any(mask: LaneMask<I, K>) -> bool {
        let mut any = false;
        for i in 0..K {
            any |= I::any(mask.0[i]);
        }
        any
    }

    #[inline(always)]
    fn select(mask: LaneMask<I, K>, mut a: Self, b: Self) -> Self {
        for i in 0..K {
            a.0[i] = I::select(mask.0[i], a.0[i], b.0[i]);
        }
        a
    }

    #[inline(always)]
    fn split_exponent(self) -> (Self, Self) {
        let (mut power, mut ln) = (self, self);
        for i in 0..K {
            (power.0[i], ln.0[i]) = I::split_exponent(self.0[i]);
        }
        (power, ln)
    }

    #[inline(always)]
    fn round_ties_even(self) -> Self {
        (self + NO_FRACTION) - NO_FRACTION
    }
}

impl<I: Isa, const K: usize> Lanes<I, K> {
    /// Loads from memory.
    #[inline(always)]
    #[must_use]
    pub fn load(array: &LaneArray<K>) -> Self {
        let mut lanes = Self::from_f64(0.0);
        for i in 0..K {
            lanes.0[i] = I::load(&array.0[i]);
        }
        lanes
    }

    /// Stores to memory.
    #[inline(always)]
    #[must_use]
    pub fn store(self) -> LaneArray<K> {
        let mut array = [[0.0; LANES]; K];
        for i in 0..K {
            array[i] = I::store(self.0[i]);
        }
        LaneArray(array)
    }

    /// The sum of each eight lanes.
    #[inline(always)]
    #[must_use]
    pub fn sums(self) -> [f64; K] {
        let mut sums = [0.0; K];
        for i in 0..K {
            sums[i] = I::sum(self.0[i]);
        }
        sums
    }

    /// The sum of all lanes.
    #[inline(always)]
    #[must_use]
    pub fn sum(self) -> f64 {
        let mut total = self.0[0];
        for i in 1..K {
            total = I::add(total, self.0[i]);
        }
        I::sum(total)
    }
}

impl<I: Isa> Lanes<I, 2> {
    /// `first` in the first eight lanes, `second` in the others.
    #[inline(always)]
    #[must_use]
    pub fn interleave(first: f64, second: f64) -> Self {
        Self([I::splat(first), I::splat(second)])
    }

    /// As [`interleave`](Self::interleave), for each component.
    #[inline(always)]
    #[must_use]
    pub fn interleave_vectors(first: Vec3<f64>, second: Vec3<f64>) -> Vec3<Self> {
        Vec3::new(
            Self::interleave(first.x, second.x),
            Self::interleave(first.y, second.y),
            Self::interleave(first.z, second.z),
        )
    }
}
