//! AVX-512 and AVX2 by their intrinsics. This file has no closures or iterators: they are functions that may not be inlined, and would be
//! compiled without the instructions of the instruction set.

use super::{Isa, Kernel, LANES, MANTISSA, SHIFT, TWO_52_AND_BIAS, TWO_52_BITS};
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

/// AVX-512 (F, DQ, VL) with fused multiply-add.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Avx512;

impl Isa for Avx512 {
    type Vector = __m512d;
    type Mask = __mmask8;

    #[inline(always)]
    fn call<K: Kernel>(kernel: K) -> K::Output {
        #[inline(never)]
        #[target_feature(enable = "avx512f,avx512dq,avx512vl,fma")]
        fn compiled<K: Kernel>(kernel: K) -> K::Output {
            kernel.run::<Avx512>()
        }
        cpu! { compiled(kernel) }
    }

    #[inline(always)]
    fn splat(a: f64) -> __m512d {
        cpu! { _mm512_set1_pd(a) }
    }
    #[inline(always)]
    fn load(a: &[f64; LANES]) -> __m512d {
        cpu! { _mm512_loadu_pd(a.as_ptr()) }
    }
    #[inline(always)]
    fn store(a: __m512d) -> [f64; LANES] {
        let mut out = [0.0; LANES];
        cpu! { _mm512_storeu_pd(out.as_mut_ptr(), a) };
        out
    }
    #[inline(always)]
    fn add(a: __m512d, b: __m512d) -> __m512d {
        cpu! { _mm512_add_pd(a, b) }
    }
    #[inline(always)]
    fn sub(a: __m512d, b: __m512d) -> __m512d {
        cpu! { _mm512_sub_pd(a, b) }
    }
    #[inline(always)]
    fn mul(a: __m512d, b: __m512d) -> __m512d {
        cpu! { _mm512_mul_pd(a, b) }
    }
    #[inline(always)]
    fn div(a: __m512d, b: __m512d) -> __m512d {
        cpu! { _mm512_div_pd(a, b) }
    }
    #[inline(always)]
    fn neg(a: __m512d) -> __m512d {
        cpu! { _mm512_xor_pd(a, _mm512_set1_pd(-0.0)) }
    }
    #[inline(always)]
    fn sqrt(a: __m512d) -> __m512d {
        cpu! { _mm512_sqrt_pd(a) }
    }
    #[inline(always)]
    fn mul_add(a: __m512d, b: __m512d, c: __m512d) -> __m512d {
        cpu! { _mm512_fmadd_pd(a, b, c) }
    }
    #[inline(always)]
    fn lt(a: __m512d, b: __m512d) -> __mmask8 {
        cpu! { _mm512_cmp_pd_mask::<_CMP_LT_OQ>(a, b) }
    }
    #[inline(always)]
    fn both(a: __mmask8, b: __mmask8) -> __mmask8 {
        a & b
    }
    #[inline(always)]
    fn any(mask: __mmask8) -> bool {
        mask != 0
    }
    #[inline(always)]
    fn select(mask: __mmask8, a: __m512d, b: __m512d) -> __m512d {
        cpu! { _mm512_mask_blend_pd(mask, b, a) }
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

/// AVX2 with fused multiply-add: two registers for eight numbers.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Avx2;

/// Eight numbers, or a mask, in two registers.
type Two = [__m256d; 2];

impl Avx2 {
    /// [`Isa::split_exponent`] of one register.
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

impl Isa for Avx2 {
    type Vector = Two;
    type Mask = Two;

    #[inline(always)]
    fn call<K: Kernel>(kernel: K) -> K::Output {
        #[inline(never)]
        #[target_feature(enable = "avx2,fma")]
        fn compiled<K: Kernel>(kernel: K) -> K::Output {
            kernel.run::<Avx2>()
        }
        cpu! { compiled(kernel) }
    }

    #[inline(always)]
    fn splat(a: f64) -> Two {
        cpu! { [_mm256_set1_pd(a); 2] }
    }
    #[inline(always)]
    fn load(a: &[f64; LANES]) -> Two {
        let (low, high) = a.split_at(LANES / 2);
        cpu! { [_mm256_loadu_pd(low.as_ptr()), _mm256_loadu_pd(high.as_ptr())] }
    }
    #[inline(always)]
    fn store(a: Two) -> [f64; LANES] {
        let mut out = [0.0; LANES];
        let (low, high) = out.split_at_mut(LANES / 2);
        cpu! {
            _mm256_storeu_pd(low.as_mut_ptr(), a[0]);
            _mm256_storeu_pd(high.as_mut_ptr(), a[1]);
        }
        out
    }
    #[inline(always)]
    fn add(a: Two, b: Two) -> Two {
        cpu! { [_mm256_add_pd(a[0], b[0]), _mm256_add_pd(a[1], b[1])] }
    }
    #[inline(always)]
    fn sub(a: Two, b: Two) -> Two {
        cpu! { [_mm256_sub_pd(a[0], b[0]), _mm256_sub_pd(a[1], b[1])] }
    }
    #[inline(always)]
    fn mul(a: Two, b: Two) -> Two {
        cpu! { [_mm256_mul_pd(a[0], b[0]), _mm256_mul_pd(a[1], b[1])] }
    }
    #[inline(always)]
    fn div(a: Two, b: Two) -> Two {
        cpu! { [_mm256_div_pd(a[0], b[0]), _mm256_div_pd(a[1], b[1])] }
    }
    #[inline(always)]
    fn neg(a: Two) -> Two {
        cpu! {
            let sign = _mm256_set1_pd(-0.0);
            [_mm256_xor_pd(a[0], sign), _mm256_xor_pd(a[1], sign)]
        }
    }
    #[inline(always)]
    fn sqrt(a: Two) -> Two {
        cpu! { [_mm256_sqrt_pd(a[0]), _mm256_sqrt_pd(a[1])] }
    }
    #[inline(always)]
    fn mul_add(a: Two, b: Two, c: Two) -> Two {
        cpu! { [_mm256_fmadd_pd(a[0], b[0], c[0]), _mm256_fmadd_pd(a[1], b[1], c[1])] }
    }
    #[inline(always)]
    fn lt(a: Two, b: Two) -> Two {
        cpu! {
            [
                _mm256_cmp_pd::<_CMP_LT_OQ>(a[0], b[0]),
                _mm256_cmp_pd::<_CMP_LT_OQ>(a[1], b[1]),
            ]
        }
    }
    #[inline(always)]
    fn both(a: Two, b: Two) -> Two {
        cpu! { [_mm256_and_pd(a[0], b[0]), _mm256_and_pd(a[1], b[1])] }
    }
    #[inline(always)]
    fn any(mask: Two) -> bool {
        cpu! { _mm256_movemask_pd(_mm256_or_pd(mask[0], mask[1])) != 0 }
    }
    #[inline(always)]
    fn select(mask: Two, a: Two, b: Two) -> Two {
        cpu! {
            [
                _mm256_blendv_pd(b[0], a[0], mask[0]),
                _mm256_blendv_pd(b[1], a[1], mask[1]),
            ]
        }
    }
    #[inline(always)]
    fn sum(a: Two) -> f64 {
        cpu! { sum_of_four(_mm256_add_pd(a[0], a[1])) }
    }
    #[inline(always)]
    fn split_exponent(a: Two) -> (Two, Two) {
        let (low, high) = (
            Self::split_exponent_of_four(a[0]),
            Self::split_exponent_of_four(a[1]),
        );
        ([low.0, high.0], [low.1, high.1])
    }
}
