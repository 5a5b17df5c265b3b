//! AVX-512 and AVX2 by their intrinsics. This file has no closures or iterators: they are functions that may not be inlined, and would be
//! compiled without the instructions of the instruction set.

use super::{
    Isa, LANES, MANTISSA, NO_FRACTION, SHIFT, SINGLE_BIAS, SINGLE_MANTISSA, SINGLE_NO_FRACTION,
    SINGLE_SHIFT, Subroutine, TWO_52_AND_BIAS, TWO_52_BITS, Vectors,
};
use std::arch::x86_64::*;
use std::f64::consts::LN_2;

/// Intrinsics of the instruction set of the enclosing implementation.
macro_rules! cpu {
    ($($instructions:tt)*) => {
        // SAFETY: only `scalar::dispatch` names the marker types, and runs code with them only on a CPU that has reported their
        // features.
        unsafe { $($instructions)* }
    };
}

/// A subroutine with these features of the CPU.
macro_rules! call_with {
    ($features:literal) => {
        #[inline(always)]
        fn call<C: Subroutine>(subroutine: C) -> C::Output {
            #[inline(never)]
            #[target_feature(enable = $features)]
            fn compiled<C: Subroutine>(subroutine: C) -> C::Output {
                subroutine.run()
            }
            cpu! { compiled(subroutine) }
        }
    };
}

/// The operations of [`Vectors`] that are one intrinsic each, on vectors of one register, with masks in mask registers.
macro_rules! one_register {
    ($vector:ty, $mask:ty: $($name:ident $intrinsic:ident),*; $sqrt:ident $max:ident $min:ident $mul_add:ident $xor:ident $set1:ident $compare:ident $blend:ident) => {
        type Vector = $vector;
        type Mask = $mask;
        $(
            #[inline(always)]
            fn $name(a: $vector, b: $vector) -> $vector {
                cpu! { $intrinsic(a, b) }
            }
        )*
        #[inline(always)]
        fn neg(a: $vector) -> $vector {
            cpu! { $xor(a, $set1(-0.0)) }
        }
        #[inline(always)]
        fn sqrt(a: $vector) -> $vector {
            cpu! { $sqrt(a) }
        }
        // The instructions give their second operand if one is NaN.
        #[inline(always)]
        fn max(a: $vector, b: $vector) -> $vector {
            cpu! { $max(b, a) }
        }
        #[inline(always)]
        fn min(a: $vector, b: $vector) -> $vector {
            cpu! { $min(b, a) }
        }
        #[inline(always)]
        fn mul_add(a: $vector, b: $vector, c: $vector) -> $vector {
            cpu! { $mul_add(a, b, c) }
        }
        #[inline(always)]
        fn lt(a: $vector, b: $vector) -> $mask {
            cpu! { $compare::<_CMP_LT_OQ>(a, b) }
        }
        #[inline(always)]
        fn any(mask: $mask) -> bool {
            mask != 0
        }
        #[inline(always)]
        fn select(mask: $mask, a: $vector, b: $vector) -> $vector {
            cpu! { $blend(mask, b, a) }
        }
    };
}

/// As `one_register`, on vectors of two registers, with masks in registers of the same type.
macro_rules! two_registers {
    ($register:ty: $($name:ident $intrinsic:ident),*; $sqrt:ident $max:ident $min:ident $mul_add:ident $xor:ident $set1:ident $compare:ident $blend:ident $or:ident $signs:ident) => {
        type Vector = [$register; 2];
        type Mask = [$register; 2];
        $(
            #[inline(always)]
            fn $name(a: [$register; 2], b: [$register; 2]) -> [$register; 2] {
                cpu! { [$intrinsic(a[0], b[0]), $intrinsic(a[1], b[1])] }
            }
        )*
        #[inline(always)]
        fn neg(a: [$register; 2]) -> [$register; 2] {
            cpu! { [$xor(a[0], $set1(-0.0)), $xor(a[1], $set1(-0.0))] }
        }
        #[inline(always)]
        fn sqrt(a: [$register; 2]) -> [$register; 2] {
            cpu! { [$sqrt(a[0]), $sqrt(a[1])] }
        }
        // The instructions give their second operand if one is NaN.
        #[inline(always)]
        fn max(a: [$register; 2], b: [$register; 2]) -> [$register; 2] {
            cpu! { [$max(b[0], a[0]), $max(b[1], a[1])] }
        }
        #[inline(always)]
        fn min(a: [$register; 2], b: [$register; 2]) -> [$register; 2] {
            cpu! { [$min(b[0], a[0]), $min(b[1], a[1])] }
        }
        #[inline(always)]
        fn mul_add(a: [$register; 2], b: [$register; 2], c: [$register; 2]) -> [$register; 2] {
            cpu! { [$mul_add(a[0], b[0], c[0]), $mul_add(a[1], b[1], c[1])] }
        }
        #[inline(always)]
        fn lt(a: [$register; 2], b: [$register; 2]) -> [$register; 2] {
            cpu! { [$compare::<_CMP_LT_OQ>(a[0], b[0]), $compare::<_CMP_LT_OQ>(a[1], b[1])] }
        }
        #[inline(always)]
        fn any(mask: [$register; 2]) -> bool {
            cpu! { $signs($or(mask[0], mask[1])) != 0 }
        }
        #[inline(always)]
        fn select(mask: [$register; 2], a: [$register; 2], b: [$register; 2]) -> [$register; 2] {
            cpu! { [$blend(b[0], a[0], mask[0]), $blend(b[1], a[1], mask[1])] }
        }
    };
}

/// The same bits as a signed integer, the type that intrinsics take.
#[inline(always)]
const fn signed(bits: u64) -> i64 {
    i64::from_ne_bytes(bits.to_ne_bytes())
}

/// [`Isa::sum`] of four numbers.
#[inline(always)]
fn sum_of_four(a: __m256d) -> f64 {
    cpu! {
        let two = _mm_add_pd(_mm256_castpd256_pd128(a), _mm256_extractf128_pd::<1>(a));
        _mm_cvtsd_f64(_mm_add_sd(two, _mm_unpackhi_pd(two, two)))
    }
}

/// The transpose of a matrix of four rows.
#[inline(always)]
fn transposed_4_by_4([a, b, c, d]: [__m256d; 4]) -> [__m256d; 4] {
    cpu! {
        let (even, odd) = (_mm256_unpacklo_pd(a, b), _mm256_unpackhi_pd(a, b));
        let (later_even, later_odd) = (_mm256_unpacklo_pd(c, d), _mm256_unpackhi_pd(c, d));
        [
            _mm256_permute2f128_pd::<0x20>(even, later_even),
            _mm256_permute2f128_pd::<0x20>(odd, later_odd),
            _mm256_permute2f128_pd::<0x31>(even, later_even),
            _mm256_permute2f128_pd::<0x31>(odd, later_odd),
        ]
    }
}

/// As [`transposed_4_by_4`], of two matrices, one in each half of the registers.
#[inline(always)]
fn transposed([a, b, c, d]: [__m512d; 4]) -> [__m512d; 4] {
    cpu! {
        let (even, odd) = (_mm512_unpacklo_pd(a, b), _mm512_unpackhi_pd(a, b));
        let (later_even, later_odd) = (_mm512_unpacklo_pd(c, d), _mm512_unpackhi_pd(c, d));
        let low = _mm512_setr_epi64(0, 1, 8, 9, 4, 5, 12, 13);
        let high = _mm512_setr_epi64(2, 3, 10, 11, 6, 7, 14, 15);
        [
            _mm512_permutex2var_pd(even, low, later_even),
            _mm512_permutex2var_pd(odd, low, later_odd),
            _mm512_permutex2var_pd(even, high, later_even),
            _mm512_permutex2var_pd(odd, high, later_odd),
        ]
    }
}

/// AVX-512 (F, DQ, VL) with fused multiply-add.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Avx512;

/// Its vectors of singles.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Avx512Singles;

impl Isa for Avx512 {
    type Singles = Avx512Singles;

    #[inline(always)]
    fn columns(rows: [&[f64; 4]; LANES]) -> [__m512d; 4] {
        cpu! {
            let mut pairs = [_mm512_setzero_pd(); 4];
            for k in 0..4 {
                let (low, high) = (rows[k].as_ptr(), rows[k + 4].as_ptr());
                let low = _mm512_castpd256_pd512(_mm256_loadu_pd(low));
                pairs[k] = _mm512_insertf64x4::<1>(low, _mm256_loadu_pd(high));
            }
            transposed(pairs)
        }
    }
    #[inline(always)]
    fn rows(columns: [__m512d; 4]) -> [[f64; 4]; LANES] {
        let mut rows = [[0.0; 4]; LANES];
        cpu! {
            let pairs = transposed(columns);
            for k in 0..4 {
                _mm256_storeu_pd(rows[k].as_mut_ptr(), _mm512_castpd512_pd256(pairs[k]));
                let high = _mm512_extractf64x4_pd::<1>(pairs[k]);
                _mm256_storeu_pd(rows[k + 4].as_mut_ptr(), high);
            }
        }
        rows
    }
    #[inline(always)]
    fn sum(a: __m512d) -> f64 {
        cpu! {
            sum_of_four(_mm256_add_pd(
                _mm512_castpd512_pd256(a),
                _mm512_extractf64x4_pd::<1>(a),
            ))
        }
    }
}

impl Vectors for Avx512 {
    call_with!("avx512f,avx512dq,avx512vl,fma");
    one_register! {
        __m512d, __mmask8: add _mm512_add_pd, sub _mm512_sub_pd, mul _mm512_mul_pd, div _mm512_div_pd;
        _mm512_sqrt_pd _mm512_max_pd _mm512_min_pd _mm512_fmadd_pd _mm512_xor_pd _mm512_set1_pd _mm512_cmp_pd_mask _mm512_mask_blend_pd
    }

    const GROUPS: usize = 1;
    const MIN_POSITIVE: f64 = f64::MIN_POSITIVE;
    const EPSILON: f64 = f64::EPSILON;
    const NO_FRACTION: f64 = NO_FRACTION;
    const NEWTON_STEPS: usize = 2;

    /// To 14 bits.
    #[inline(always)]
    fn near_inverse_sqrt(a: __m512d) -> __m512d {
        cpu! { _mm512_rsqrt14_pd(a) }
    }
    #[inline(always)]
    fn splat(a: f64) -> __m512d {
        cpu! { _mm512_set1_pd(a) }
    }
    #[inline(always)]
    fn splat_groups(groups: &[f64]) -> __m512d {
        Self::splat(groups[0])
    }
    #[inline(always)]
    fn load(groups: &[[f64; LANES]]) -> __m512d {
        cpu! { _mm512_loadu_pd(groups[0].as_ptr()) }
    }
    #[inline(always)]
    fn store(a: __m512d, groups: &mut [[f64; LANES]]) {
        cpu! { _mm512_storeu_pd(groups[0].as_mut_ptr(), a) }
    }
    #[inline(always)]
    fn split_exponent(a: __m512d) -> (__m512d, __m512d) {
        cpu! {
            let bits = _mm512_add_epi64(_mm512_castpd_si512(a), _mm512_set1_epi64(signed(SHIFT)));
            let exponent = _mm512_and_si512(bits, _mm512_set1_epi64(signed(!MANTISSA)));
            let integer = _mm512_or_si512(
                _mm512_srli_epi64::<52>(exponent),
                _mm512_set1_epi64(signed(TWO_52_BITS)),
            );
            let k = _mm512_sub_pd(_mm512_castsi512_pd(integer), _mm512_set1_pd(TWO_52_AND_BIAS));
            (_mm512_castsi512_pd(exponent), _mm512_mul_pd(k, _mm512_set1_pd(LN_2)))
        }
    }
}

impl Vectors for Avx512Singles {
    call_with!("avx512f,avx512dq,avx512vl,fma");
    one_register! {
        __m512, __mmask16: add _mm512_add_ps, sub _mm512_sub_ps, mul _mm512_mul_ps, div _mm512_div_ps;
        _mm512_sqrt_ps _mm512_max_ps _mm512_min_ps _mm512_fmadd_ps _mm512_xor_ps _mm512_set1_ps _mm512_cmp_ps_mask _mm512_mask_blend_ps
    }

    const GROUPS: usize = 2;
    const MIN_POSITIVE: f64 = f32::MIN_POSITIVE as f64;
    const EPSILON: f64 = f32::EPSILON as f64;
    const NO_FRACTION: f64 = SINGLE_NO_FRACTION;
    const NEWTON_STEPS: usize = 1;

    /// To 14 bits.
    #[inline(always)]
    fn near_inverse_sqrt(a: __m512) -> __m512 {
        cpu! { _mm512_rsqrt14_ps(a) }
    }
    #[inline(always)]
    fn splat(a: f64) -> __m512 {
        cpu! { _mm512_set1_ps(single(a)) }
    }
    #[inline(always)]
    fn splat_groups(groups: &[f64]) -> __m512 {
        cpu! { _mm512_mask_blend_ps(0xff00, Self::splat(groups[0]), Self::splat(groups[1])) }
    }
    #[inline(always)]
    fn load(groups: &[[f64; LANES]]) -> __m512 {
        cpu! {
            _mm512_insertf32x8::<1>(
                _mm512_castps256_ps512(_mm512_cvtpd_ps(_mm512_loadu_pd(groups[0].as_ptr()))),
                _mm512_cvtpd_ps(_mm512_loadu_pd(groups[1].as_ptr())),
            )
        }
    }
    #[inline(always)]
    fn store(a: __m512, groups: &mut [[f64; LANES]]) {
        cpu! {
            let (low, high) = (_mm512_castps512_ps256(a), _mm512_extractf32x8_ps::<1>(a));
            _mm512_storeu_pd(groups[0].as_mut_ptr(), _mm512_cvtps_pd(low));
            _mm512_storeu_pd(groups[1].as_mut_ptr(), _mm512_cvtps_pd(high));
        }
    }
    #[inline(always)]
    fn split_exponent(a: __m512) -> (__m512, __m512) {
        cpu! {
            let shift = _mm512_set1_epi32(SINGLE_SHIFT.cast_signed());
            let bits = _mm512_add_epi32(_mm512_castps_si512(a), shift);
            let exponent = _mm512_and_si512(bits, _mm512_set1_epi32((!SINGLE_MANTISSA).cast_signed()));
            let k = _mm512_cvtepi32_ps(_mm512_sub_epi32(
                _mm512_srli_epi32::<23>(exponent),
                _mm512_set1_epi32(SINGLE_BIAS),
            ));
            (_mm512_castsi512_ps(exponent), _mm512_mul_ps(k, Self::splat(LN_2)))
        }
    }
}

/// The nearest number in single precision.
#[inline(always)]
#[allow(clippy::cast_possible_truncation, reason = "rounding is meant")]
const fn single(a: f64) -> f32 {
    a as f32
}

/// AVX2 with fused multiply-add: two registers for a vector.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Avx2;

/// Its vectors of singles.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Avx2Singles;

impl Isa for Avx2 {
    type Singles = Avx2Singles;

    #[inline(always)]
    fn columns(rows: [&[f64; 4]; LANES]) -> [[__m256d; 2]; 4] {
        let mut columns = [[Self::splat(0.0)[0]; 2]; 4];
        for half in 0..2 {
            let mut of_half = [columns[0][0]; 4];
            for k in 0..4 {
                of_half[k] = cpu! { _mm256_loadu_pd(rows[4 * half + k].as_ptr()) };
            }
            of_half = transposed_4_by_4(of_half);
            for k in 0..4 {
                columns[k][half] = of_half[k];
            }
        }
        columns
    }
    #[inline(always)]
    fn rows(columns: [[__m256d; 2]; 4]) -> [[f64; 4]; LANES] {
        let mut rows = [[0.0; 4]; LANES];
        for half in 0..2 {
            let [a, b, c, d] = columns;
            let of_half = transposed_4_by_4([a[half], b[half], c[half], d[half]]);
            for k in 0..4 {
                cpu! { _mm256_storeu_pd(rows[4 * half + k].as_mut_ptr(), of_half[k]) }
            }
        }
        rows
    }
    #[inline(always)]
    fn sum(a: [__m256d; 2]) -> f64 {
        cpu! { sum_of_four(_mm256_add_pd(a[0], a[1])) }
    }
}

impl Avx2 {
    /// [`Vectors::split_exponent`] of one register.
    #[inline(always)]
    fn split_exponent_of_four(a: __m256d) -> (__m256d, __m256d) {
        cpu! {
            let bits = _mm256_add_epi64(_mm256_castpd_si256(a), _mm256_set1_epi64x(signed(SHIFT)));
            let exponent = _mm256_and_si256(bits, _mm256_set1_epi64x(signed(!MANTISSA)));
            let integer = _mm256_or_si256(
                _mm256_srli_epi64::<52>(exponent),
                _mm256_set1_epi64x(signed(TWO_52_BITS)),
            );
            let k = _mm256_sub_pd(_mm256_castsi256_pd(integer), _mm256_set1_pd(TWO_52_AND_BIAS));
            (_mm256_castsi256_pd(exponent), _mm256_mul_pd(k, _mm256_set1_pd(LN_2)))
        }
    }
}

impl Vectors for Avx2 {
    call_with!("avx2,fma");
    two_registers! {
        __m256d: add _mm256_add_pd, sub _mm256_sub_pd, mul _mm256_mul_pd, div _mm256_div_pd;
        _mm256_sqrt_pd _mm256_max_pd _mm256_min_pd _mm256_fmadd_pd _mm256_xor_pd _mm256_set1_pd _mm256_cmp_pd _mm256_blendv_pd
        _mm256_or_pd _mm256_movemask_pd
    }

    const GROUPS: usize = 1;
    const MIN_POSITIVE: f64 = f64::MIN_POSITIVE;
    const EPSILON: f64 = f64::EPSILON;
    const NO_FRACTION: f64 = NO_FRACTION;
    const NEWTON_STEPS: usize = 3;

    /// To 11 bits, in single precision: there is no such instruction for doubles.
    #[inline(always)]
    fn near_inverse_sqrt(a: [__m256d; 2]) -> [__m256d; 2] {
        cpu! {
            [
                _mm256_cvtps_pd(_mm_rsqrt_ps(_mm256_cvtpd_ps(a[0]))),
                _mm256_cvtps_pd(_mm_rsqrt_ps(_mm256_cvtpd_ps(a[1]))),
            ]
        }
    }
    #[inline(always)]
    fn splat(a: f64) -> [__m256d; 2] {
        cpu! { [_mm256_set1_pd(a); 2] }
    }
    #[inline(always)]
    fn splat_groups(groups: &[f64]) -> [__m256d; 2] {
        Self::splat(groups[0])
    }
    #[inline(always)]
    fn load(groups: &[[f64; LANES]]) -> [__m256d; 2] {
        let (low, high) = groups[0].split_at(LANES / 2);
        cpu! { [_mm256_loadu_pd(low.as_ptr()), _mm256_loadu_pd(high.as_ptr())] }
    }
    #[inline(always)]
    fn store(a: [__m256d; 2], groups: &mut [[f64; LANES]]) {
        let (low, high) = groups[0].split_at_mut(LANES / 2);
        cpu! {
            _mm256_storeu_pd(low.as_mut_ptr(), a[0]);
            _mm256_storeu_pd(high.as_mut_ptr(), a[1]);
        }
    }
    #[inline(always)]
    fn split_exponent(a: [__m256d; 2]) -> ([__m256d; 2], [__m256d; 2]) {
        let (low, high) = (
            Self::split_exponent_of_four(a[0]),
            Self::split_exponent_of_four(a[1]),
        );
        ([low.0, high.0], [low.1, high.1])
    }
}

impl Avx2Singles {
    /// One group.
    #[inline(always)]
    fn load_group(group: &[f64; LANES]) -> __m256 {
        let [low, high] = Avx2::load(std::slice::from_ref(group));
        cpu! { _mm256_set_m128(_mm256_cvtpd_ps(high), _mm256_cvtpd_ps(low)) }
    }

    /// One group.
    #[inline(always)]
    fn store_group(a: __m256, group: &mut [f64; LANES]) {
        let halves = cpu! {
            [
                _mm256_cvtps_pd(_mm256_castps256_ps128(a)),
                _mm256_cvtps_pd(_mm256_extractf128_ps::<1>(a)),
            ]
        };
        Avx2::store(halves, std::slice::from_mut(group));
    }

    /// [`Vectors::split_exponent`] of one register.
    #[inline(always)]
    fn split_exponent_of_eight(a: __m256) -> (__m256, __m256) {
        cpu! {
            let shift = _mm256_set1_epi32(SINGLE_SHIFT.cast_signed());
            let bits = _mm256_add_epi32(_mm256_castps_si256(a), shift);
            let exponent = _mm256_and_si256(bits, _mm256_set1_epi32((!SINGLE_MANTISSA).cast_signed()));
            let k = _mm256_cvtepi32_ps(_mm256_sub_epi32(
                _mm256_srli_epi32::<23>(exponent),
                _mm256_set1_epi32(SINGLE_BIAS),
            ));
            (_mm256_castsi256_ps(exponent), _mm256_mul_ps(k, _mm256_set1_ps(single(LN_2))))
        }
    }
}

impl Vectors for Avx2Singles {
    call_with!("avx2,fma");
    two_registers! {
        __m256: add _mm256_add_ps, sub _mm256_sub_ps, mul _mm256_mul_ps, div _mm256_div_ps;
        _mm256_sqrt_ps _mm256_max_ps _mm256_min_ps _mm256_fmadd_ps _mm256_xor_ps _mm256_set1_ps _mm256_cmp_ps _mm256_blendv_ps
        _mm256_or_ps _mm256_movemask_ps
    }

    const GROUPS: usize = 2;
    const MIN_POSITIVE: f64 = f32::MIN_POSITIVE as f64;
    const EPSILON: f64 = f32::EPSILON as f64;
    const NO_FRACTION: f64 = SINGLE_NO_FRACTION;
    const NEWTON_STEPS: usize = 1;

    /// To 11 bits.
    #[inline(always)]
    fn near_inverse_sqrt(a: [__m256; 2]) -> [__m256; 2] {
        cpu! { [_mm256_rsqrt_ps(a[0]), _mm256_rsqrt_ps(a[1])] }
    }
    #[inline(always)]
    fn splat(a: f64) -> [__m256; 2] {
        cpu! { [_mm256_set1_ps(single(a)); 2] }
    }
    #[inline(always)]
    fn splat_groups(groups: &[f64]) -> [__m256; 2] {
        cpu! { [_mm256_set1_ps(single(groups[0])), _mm256_set1_ps(single(groups[1]))] }
    }
    #[inline(always)]
    fn load(groups: &[[f64; LANES]]) -> [__m256; 2] {
        [Self::load_group(&groups[0]), Self::load_group(&groups[1])]
    }
    #[inline(always)]
    fn store(a: [__m256; 2], groups: &mut [[f64; LANES]]) {
        Self::store_group(a[0], &mut groups[0]);
        Self::store_group(a[1], &mut groups[1]);
    }
    #[inline(always)]
    fn split_exponent(a: [__m256; 2]) -> ([__m256; 2], [__m256; 2]) {
        let (low, high) = (
            Self::split_exponent_of_eight(a[0]),
            Self::split_exponent_of_eight(a[1]),
        );
        ([low.0, high.0], [low.1, high.1])
    }
}
