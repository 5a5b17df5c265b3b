//! Vectors as arrays, compiled for the baseline of the target: they run on every CPU.
//!
//! Functions of closures are not always inlined, and loops take long to compile, so there are none: arrays are computed by a macro.

use super::{
    Isa, LANES, NO_FRACTION, SINGLE_NO_FRACTION, Subroutine, Vectors, split_exponent,
    split_exponent_of_single,
};

/// Arrays of doubles.
#[derive(Clone, Copy, Debug)]
pub struct Portable;

/// Arrays of singles.
#[derive(Clone, Copy, Debug)]
pub struct PortableSingles;

/// An array of `$groups` times eight numbers, computed one by one.
macro_rules! lane_by_lane {
    (1, $i:ident => $value:expr) => {
        lane_by_lane!(@ $i => $value; 0 1 2 3 4 5 6 7)
    };
    (2, $i:ident => $value:expr) => {
        lane_by_lane!(@ $i => $value; 0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15)
    };
    (@ $i:ident => $value:expr; $($number:literal)*) => {
        [$({
            let $i: usize = $number;
            $value
        }),*]
    };
}

macro_rules! arrays {
    ($vectors:ident of $groups:tt groups: $number:ident, $bits:ident, $no_fraction:ident, $split_exponent:ident) => {
        #[allow(
            clippy::cast_possible_truncation,
            clippy::unnecessary_cast,
            reason = "rounding to the precision is meant; doubles are cast to themselves"
        )]
        impl Vectors for $vectors {
            type Vector = [$number; $groups * LANES];
            type Mask = [$bits; $groups * LANES];

            const GROUPS: usize = $groups;
            const MIN_POSITIVE: f64 = $number::MIN_POSITIVE as f64;
            const EPSILON: f64 = $number::EPSILON as f64;
            const NO_FRACTION: f64 = $no_fraction;
            const NEWTON_STEPS: usize = 0;

            #[inline(always)]
            fn near_inverse_sqrt(a: Self::Vector) -> Self::Vector {
                lane_by_lane!($groups, i => 1.0 / a[i].sqrt())
            }
            #[inline(always)]
            fn splat(a: f64) -> Self::Vector {
                [a as $number; $groups * LANES]
            }
            #[inline(always)]
            fn splat_groups(groups: &[f64]) -> Self::Vector {
                lane_by_lane!($groups, i => groups[i / LANES] as $number)
            }
            #[inline(always)]
            fn load(groups: &[[f64; LANES]]) -> Self::Vector {
                lane_by_lane!($groups, i => groups[i / LANES][i % LANES] as $number)
            }
            #[inline(always)]
            fn store(a: Self::Vector, groups: &mut [[f64; LANES]]) {
                for i in 0..$groups * LANES {
                    groups[i / LANES][i % LANES] = a[i] as f64;
                }
            }
            #[inline(never)]
            fn call<C: Subroutine>(subroutine: C) -> C::Output {
                subroutine.run()
            }
            #[inline(always)]
            fn add(a: Self::Vector, b: Self::Vector) -> Self::Vector {
                lane_by_lane!($groups, i => a[i] + b[i])
            }
            #[inline(always)]
            fn sub(a: Self::Vector, b: Self::Vector) -> Self::Vector {
                lane_by_lane!($groups, i => a[i] - b[i])
            }
            #[inline(always)]
            fn mul(a: Self::Vector, b: Self::Vector) -> Self::Vector {
                lane_by_lane!($groups, i => a[i] * b[i])
            }
            #[inline(always)]
            fn div(a: Self::Vector, b: Self::Vector) -> Self::Vector {
                lane_by_lane!($groups, i => a[i] / b[i])
            }
            #[inline(always)]
            fn neg(a: Self::Vector) -> Self::Vector {
                lane_by_lane!($groups, i => -a[i])
            }
            #[inline(always)]
            fn sqrt(a: Self::Vector) -> Self::Vector {
                lane_by_lane!($groups, i => a[i].sqrt())
            }
            #[inline(always)]
            fn max(a: Self::Vector, b: Self::Vector) -> Self::Vector {
                lane_by_lane!($groups, i => if a[i] < b[i] { b[i] } else { a[i] })
            }
            #[inline(always)]
            fn min(a: Self::Vector, b: Self::Vector) -> Self::Vector {
                lane_by_lane!($groups, i => if b[i] < a[i] { b[i] } else { a[i] })
            }
            #[inline(always)]
            fn mul_add(a: Self::Vector, b: Self::Vector, c: Self::Vector) -> Self::Vector {
                lane_by_lane!($groups, i => a[i] * b[i] + c[i])
            }
            #[inline(always)]
            fn lt(a: Self::Vector, b: Self::Vector) -> Self::Mask {
                lane_by_lane!($groups, i => if a[i] < b[i] { $bits::MAX } else { 0 })
            }
            #[inline(always)]
            fn any(mask: Self::Mask) -> bool {
                let mut bits = 0;
                for lane in 0..$groups * LANES {
                    bits |= mask[lane];
                }
                bits != 0
            }
            #[inline(always)]
            fn select(mask: Self::Mask, a: Self::Vector, b: Self::Vector) -> Self::Vector {
                lane_by_lane!($groups, i => $number::from_bits((a[i].to_bits() & mask[i]) | (b[i].to_bits() & !mask[i])))
            }
            #[inline(always)]
            fn split_exponent(a: Self::Vector) -> (Self::Vector, Self::Vector) {
                (
                    lane_by_lane!($groups, i => $split_exponent(a[i]).0),
                    lane_by_lane!($groups, i => $split_exponent(a[i]).1),
                )
            }
        }
    };
}
arrays!(Portable of 1 groups: f64, u64, NO_FRACTION, split_exponent);
arrays!(PortableSingles of 2 groups: f32, u32, SINGLE_NO_FRACTION, split_exponent_of_single);

impl Isa for Portable {
    type Singles = PortableSingles;

    #[inline(always)]
    fn columns(rows: [&[f64; 4]; LANES]) -> [Self::Vector; 4] {
        let mut columns = [[0.0; LANES]; 4];
        for lane in 0..LANES {
            for k in 0..4 {
                columns[k][lane] = rows[lane][k];
            }
        }
        columns
    }
    #[inline(always)]
    fn rows(columns: [Self::Vector; 4]) -> [[f64; 4]; LANES] {
        let mut rows = [[0.0; 4]; LANES];
        for lane in 0..LANES {
            for k in 0..4 {
                rows[lane][k] = columns[k][lane];
            }
        }
        rows
    }
    #[inline(always)]
    fn sum(a: Self::Vector) -> f64 {
        let [a, b, c, d] = [a[0] + a[4], a[1] + a[5], a[2] + a[6], a[3] + a[7]];
        (a + c) + (b + d)
    }
}
