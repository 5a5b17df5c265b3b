//! Several numbers in SIMD registers, which generic code handles as one [`Scalar`].
#![allow(
    clippy::needless_range_loop,
    reason = "adapters of iterators are functions that may not be inlined, and would be compiled without the kernel's instructions"
)]

use super::isa::{Isa, LANES, LaneArray, MAX_GROUPS, Subroutine, Vectors};
use super::{Scalar, Vec3};
use std::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

/// Runs the block for each `$i` below `$k`, which is at most four. Loops give the same instructions, but a kernel has thousands of them, and
/// the compiler takes most of its time to undo them.
macro_rules! each_vector {
    ($i:ident < $k:ident, $block:block) => {
        const { assert!($k <= 4) };
        each_vector!(@ $i < $k, $block; 0 1 2 3);
    };
    (@ $i:ident < $k:ident, $block:block; $($number:literal)*) => {
        $(if $number < $k {
            let $i: usize = $number;
            $block
        })*
    };
}

/// `K` vectors in the registers of an instruction set: of eight doubles if `V` is an [`Isa`], of sixteen singles if it is
/// [`Isa::Singles`].
#[derive(Clone, Copy, Debug)]
pub struct Lanes<V: Vectors, const K: usize>([V::Vector; K]);

/// The outcome of a comparison, lane by lane.
#[derive(Clone, Copy, Debug)]
pub struct LaneMask<V: Vectors, const K: usize>([V::Mask; K]);

macro_rules! elementwise {
    ($($trait:ident $method:ident),*) => {$(
        impl<V: Vectors, const K: usize> $trait for Lanes<V, K> {
            type Output = Self;
            #[inline(always)]
            fn $method(mut self, other: Self) -> Self {
                each_vector!(i < K, {
                    self.0[i] = V::$method(self.0[i], other.0[i]);
                });
                self
            }
        }
        impl<V: Vectors, const K: usize> $trait<f64> for Lanes<V, K> {
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
        impl<V: Vectors, const K: usize> $trait for Lanes<V, K> {
            #[inline(always)]
            fn $method(&mut self, other: Self) {
                *self = *self $op other;
            }
        }
    )*};
}
assigning!(AddAssign add_assign +, SubAssign sub_assign -, MulAssign mul_assign *);

impl<V: Vectors, const K: usize> Neg for Lanes<V, K> {
    type Output = Self;
    #[inline(always)]
    fn neg(mut self) -> Self {
        each_vector!(i < K, {
            self.0[i] = V::neg(self.0[i]);
        });
        self
    }
}

impl<V: Vectors, const K: usize> Scalar for Lanes<V, K> {
    type Mask = LaneMask<V, K>;

    const MIN_POSITIVE: f64 = V::MIN_POSITIVE;
    const EPSILON: f64 = V::EPSILON;

    #[inline(always)]
    fn from_f64(value: f64) -> Self {
        Self([V::splat(value); K])
    }

    #[inline(always)]
    fn call<C: Subroutine>(subroutine: C) -> C::Output {
        V::call(subroutine)
    }

    #[inline(always)]
    fn sqrt(mut self) -> Self {
        each_vector!(i < K, {
            self.0[i] = V::sqrt(self.0[i]);
        });
        self
    }

    #[inline(always)]
    fn inverse_sqrt(mut self) -> Self {
        each_vector!(i < K, {
            self.0[i] = V::inverse_sqrt(self.0[i]);
        });
        self
    }

    #[inline(always)]
    fn mul_add(mut self, a: Self, b: Self) -> Self {
        each_vector!(i < K, {
            self.0[i] = V::mul_add(self.0[i], a.0[i], b.0[i]);
        });
        self
    }

    #[inline(always)]
    fn lt(self, other: Self) -> LaneMask<V, K> {
        let mut mask = [V::lt(self.0[0], other.0[0]); K];
        each_vector!(i < K, {
            mask[i] = V::lt(self.0[i], other.0[i]);
        });
        LaneMask(mask)
    }

    #[inline(always)]
    fn any(mask: LaneMask<V, K>) -> bool {
        let mut any = false;
        each_vector!(i < K, {
            any |= V::any(mask.0[i]);
        });
        any
    }

    #[inline(always)]
    fn select(mask: LaneMask<V, K>, mut a: Self, b: Self) -> Self {
        each_vector!(i < K, {
            a.0[i] = V::select(mask.0[i], a.0[i], b.0[i]);
        });
        a
    }

    #[inline(always)]
    fn max(mut self, other: Self) -> Self {
        each_vector!(i < K, {
            self.0[i] = V::max(self.0[i], other.0[i]);
        });
        self
    }

    #[inline(always)]
    fn min(mut self, other: Self) -> Self {
        each_vector!(i < K, {
            self.0[i] = V::min(self.0[i], other.0[i]);
        });
        self
    }

    #[inline(always)]
    fn split_exponent(self) -> (Self, Self) {
        let (mut power, mut ln) = (self, self);
        each_vector!(i < K, {
            (power.0[i], ln.0[i]) = V::split_exponent(self.0[i]);
        });
        (power, ln)
    }

    #[inline(always)]
    fn round_ties_even(self) -> Self {
        (self + V::NO_FRACTION) - V::NO_FRACTION
    }
}

impl<V: Vectors, const K: usize> Lanes<V, K> {
    /// Number of groups of eight lanes.
    pub const GROUPS: usize = K * V::GROUPS;

    /// Loads the first [`GROUPS`](Self::GROUPS) groups.
    #[inline(always)]
    #[must_use]
    pub fn load_groups(groups: &[[f64; LANES]]) -> Self {
        let mut lanes = Self::from_f64(0.0);
        each_vector!(i < K, {
            lanes.0[i] = V::load(&groups[i * V::GROUPS..(i + 1) * V::GROUPS]);
        });
        lanes
    }

    /// Stores the groups to the first of these.
    #[inline(always)]
    pub fn store_groups(self, groups: &mut [[f64; LANES]]) {
        each_vector!(i < K, {
            V::store(self.0[i], &mut groups[i * V::GROUPS..(i + 1) * V::GROUPS]);
        });
    }

    /// One number for each group, in all of its lanes.
    #[inline(always)]
    #[must_use]
    pub fn splat_groups(numbers: &[f64]) -> Self {
        let mut lanes = Self::from_f64(0.0);
        each_vector!(i < K, {
            lanes.0[i] = V::splat_groups(&numbers[i * V::GROUPS..(i + 1) * V::GROUPS]);
        });
        lanes
    }

    /// As [`splat_groups`](Self::splat_groups), for each component of one vector for each group.
    #[inline(always)]
    #[must_use]
    pub fn splat_vectors(vectors: &[Vec3<f64>]) -> Vec3<Self> {
        let mut lanes = Vec3::<Self>::zero();
        each_vector!(i < K, {
            let mut components = [[0.0; MAX_GROUPS]; 3];
            for group in 0..V::GROUPS {
                let vector = vectors[i * V::GROUPS + group];
                components[0][group] = vector.x;
                components[1][group] = vector.y;
                components[2][group] = vector.z;
            }
            lanes.x.0[i] = V::splat_groups(&components[0]);
            lanes.y.0[i] = V::splat_groups(&components[1]);
            lanes.z.0[i] = V::splat_groups(&components[2]);
        });
        lanes
    }
}

impl<I: Isa, const K: usize> Lanes<I, K> {
    /// Loads from memory.
    #[inline(always)]
    #[must_use]
    pub fn load(array: &LaneArray<K>) -> Self {
        Self::load_groups(&array.0)
    }

    /// Stores to memory.
    #[inline(always)]
    #[must_use]
    pub fn store(self) -> LaneArray<K> {
        let mut array = [[0.0; LANES]; K];
        self.store_groups(&mut array);
        LaneArray(array)
    }

    /// The sum of each eight lanes.
    #[inline(always)]
    #[must_use]
    pub fn sums(self) -> [f64; K] {
        let mut sums = [0.0; K];
        each_vector!(i < K, {
            sums[i] = I::sum(self.0[i]);
        });
        sums
    }

    /// The sum of all lanes.
    #[inline(always)]
    #[must_use]
    pub fn sum(self) -> f64 {
        let mut total = self.0[0];
        each_vector!(i < K, {
            if i > 0 {
                total = I::add(total, self.0[i]);
            }
        });
        I::sum(total)
    }
}

impl<I: Isa> Lanes<I, 1> {
    /// The columns of a matrix of eight rows.
    #[inline(always)]
    #[must_use]
    pub fn columns(rows: [&[f64; 4]; LANES]) -> [Self; 4] {
        let [a, b, c, d] = I::columns(rows);
        [Self([a]), Self([b]), Self([c]), Self([d])]
    }

    /// The rows of a matrix of eight rows, from its columns.
    #[inline(always)]
    #[must_use]
    pub fn rows([a, b, c, d]: [Self; 4]) -> [[f64; 4]; LANES] {
        I::rows([a.0[0], b.0[0], c.0[0], d.0[0]])
    }
}
