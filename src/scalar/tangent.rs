//! Dual numbers over any number type: of lanes, or of other dual numbers.

use super::{Scalar, Subroutine};
use std::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

/// A number of type `S` with its derivatives in `N` directions.
///
/// As [`Dual`](super::Dual), with the same rounding, but over any number type; its operations are inlined into kernels.
#[derive(Clone, Copy, Debug)]
pub struct Tangent<S, const N: usize> {
    /// The number.
    pub re: S,
    /// Its derivative in each direction.
    pub eps: [S; N],
}

impl<S: Scalar, const N: usize> Tangent<S, N> {
    /// A number without derivatives.
    #[inline(always)]
    pub fn constant(re: S) -> Self {
        Self {
            re,
            eps: [S::zero(); N],
        }
    }

    /// A number with the derivative `slope` in one direction.
    #[inline(always)]
    pub fn along(re: S, direction: usize, slope: S) -> Self {
        let mut number = Self::constant(re);
        number.eps[direction] = slope;
        number
    }

    /// `re`, with `slope` times these derivatives.
    #[inline(always)]
    fn chain(self, re: S, slope: S) -> Self {
        let mut eps = self.eps;
        for k in 0..N {
            eps[k] *= slope;
        }
        Self { re, eps }
    }

    /// `re`, with `slope` times these derivatives and `other_slope` times those of another number.
    #[inline(always)]
    fn chain2(self, other: Self, re: S, slope: S, other_slope: S) -> Self {
        let mut eps = self.eps;
        for k in 0..N {
            eps[k] = eps[k].mul_add(slope, other.eps[k] * other_slope);
        }
        Self { re, eps }
    }
}

impl<S: Scalar, const N: usize> Add for Tangent<S, N> {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        let mut eps = self.eps;
        for k in 0..N {
            eps[k] += o.eps[k];
        }
        Self {
            re: self.re + o.re,
            eps,
        }
    }
}

impl<S: Scalar, const N: usize> Sub for Tangent<S, N> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        let mut eps = self.eps;
        for k in 0..N {
            eps[k] -= o.eps[k];
        }
        Self {
            re: self.re - o.re,
            eps,
        }
    }
}

impl<S: Scalar, const N: usize> Mul for Tangent<S, N> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        self.chain2(o, self.re * o.re, o.re, self.re)
    }
}

impl<S: Scalar, const N: usize> Div for Tangent<S, N> {
    type Output = Self;
    #[inline(always)]
    fn div(self, o: Self) -> Self {
        let inverse = S::one() / o.re;
        let mut eps = self.eps;
        for k in 0..N {
            eps[k] = (eps[k] * o.re - o.eps[k] * self.re) * inverse * inverse;
        }
        Self {
            re: self.re * inverse,
            eps,
        }
    }
}

impl<S: Scalar, const N: usize> Neg for Tangent<S, N> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.chain(-self.re, -S::one())
    }
}

macro_rules! assigning {
    ($($trait:ident $method:ident $op:tt),*) => {$(
        impl<S: Scalar, const N: usize> $trait for Tangent<S, N> {
            #[inline(always)]
            fn $method(&mut self, other: Self) {
                *self = *self $op other;
            }
        }
    )*};
}
assigning!(AddAssign add_assign +, SubAssign sub_assign -, MulAssign mul_assign *);

impl<S: Scalar, const N: usize> Add<f64> for Tangent<S, N> {
    type Output = Self;
    #[inline(always)]
    fn add(self, c: f64) -> Self {
        Self {
            re: self.re + c,
            ..self
        }
    }
}

impl<S: Scalar, const N: usize> Sub<f64> for Tangent<S, N> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, c: f64) -> Self {
        Self {
            re: self.re - c,
            ..self
        }
    }
}

impl<S: Scalar, const N: usize> Mul<f64> for Tangent<S, N> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, c: f64) -> Self {
        self.chain(self.re * c, S::from_f64(c))
    }
}

impl<S: Scalar, const N: usize> Div<f64> for Tangent<S, N> {
    type Output = Self;
    #[inline(always)]
    fn div(self, c: f64) -> Self {
        let mut eps = self.eps;
        for k in 0..N {
            eps[k] = eps[k] / c;
        }
        Self {
            re: self.re / c,
            eps,
        }
    }
}

impl<S: Scalar, const N: usize> Scalar for Tangent<S, N> {
    type Mask = S::Mask;

    const MIN_POSITIVE: f64 = S::MIN_POSITIVE;
    const EPSILON: f64 = S::EPSILON;

    #[inline(always)]
    fn call<C: Subroutine>(subroutine: C) -> C::Output {
        S::call(subroutine)
    }

    #[inline(always)]
    fn from_f64(value: f64) -> Self {
        Self::constant(S::from_f64(value))
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        let root = self.re.sqrt();
        self.chain(root, S::one() / self.re * root * 0.5)
    }

    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        let mut number = self.chain2(a, self.re.mul_add(a.re, b.re), a.re, self.re);
        for k in 0..N {
            number.eps[k] += b.eps[k];
        }
        number
    }

    #[inline(always)]
    fn lt(self, other: Self) -> S::Mask {
        self.re.lt(other.re)
    }

    #[inline(always)]
    fn any(mask: S::Mask) -> bool {
        S::any(mask)
    }

    #[inline(always)]
    fn select(mask: S::Mask, a: Self, b: Self) -> Self {
        let mut eps = a.eps;
        for k in 0..N {
            eps[k] = S::select(mask, eps[k], b.eps[k]);
        }
        Self {
            re: S::select(mask, a.re, b.re),
            eps,
        }
    }

    #[inline(always)]
    fn split_exponent(self) -> (Self, Self) {
        let (power, ln_power) = self.re.split_exponent();
        (Self::constant(power), Self::constant(ln_power))
    }

    #[inline(always)]
    fn round_ties_even(self) -> Self {
        Self::constant(self.re.round_ties_even())
    }
}
