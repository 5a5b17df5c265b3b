//! Dual numbers: those of `num-dual`, which are the reference, and faster ones whose derivatives are in lanes.

use super::isa::{Isa, LANES, LaneArray, Subroutine, round_ties_even, split_exponent};
use super::{Lanes, Real, Scalar};
use num_dual::DualSVec64;
use std::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

/// A number with its derivatives with respect to `N` variables.
pub type Dual<const N: usize> = DualSVec64<N>;

/// The variable `index` at `value`.
#[must_use]
pub fn variable<const N: usize>(value: f64, index: usize) -> Dual<N> {
    Dual::from_re(value).derivative(index)
}

/// All `N` variables at their values.
#[must_use]
pub fn lift<const N: usize>(values: &[f64; N]) -> [Dual<N>; N] {
    std::array::from_fn(|i| variable(values[i], i))
}

/// The derivatives of a number.
#[must_use]
pub fn gradient_of<const N: usize>(result: &Dual<N>) -> [f64; N] {
    result.eps.0.map_or([0.0; N], |eps| eps.data.0[0])
}

/// As [`Dual`], with `K` times eight derivatives in lanes. Real parts have the same bits as on `f64`.
#[derive(Clone, Copy, Debug)]
pub struct LaneDual<I: Isa, const K: usize> {
    /// The number.
    pub re: f64,
    /// Its derivatives.
    pub eps: Lanes<I, K>,
}

impl<I: Isa, const K: usize> LaneDual<I, K> {
    /// The variable `index` at `value`.
    #[inline(always)]
    #[must_use]
    pub fn variable(value: f64, index: usize) -> Self {
        let mut eps = LaneArray([[0.0; LANES]; K]);
        eps.0[index / LANES][index % LANES] = 1.0;
        Self {
            re: value,
            eps: Lanes::load(&eps),
        }
    }

    /// The chain rule: `re` with `slope` times these derivatives.
    #[inline(always)]
    fn chain(self, re: f64, slope: f64) -> Self {
        Self {
            re,
            eps: self.eps * slope,
        }
    }

    /// The chain rule of two arguments.
    #[inline(always)]
    fn chain2(self, other: Self, re: f64, slope: f64, other_slope: f64) -> Self {
        Self {
            re,
            eps: self
                .eps
                .mul_add(Lanes::from_f64(slope), other.eps * other_slope),
        }
    }
}

impl<I: Isa, const K: usize> Add for LaneDual<I, K> {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        Self {
            re: self.re + o.re,
            eps: self.eps + o.eps,
        }
    }
}

impl<I: Isa, const K: usize> Sub for LaneDual<I, K> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        Self {
            re: self.re - o.re,
            eps: self.eps - o.eps,
        }
    }
}

impl<I: Isa, const K: usize> Mul for LaneDual<I, K> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        self.chain2(o, self.re * o.re, o.re, self.re)
    }
}

impl<I: Isa, const K: usize> Div for LaneDual<I, K> {
    type Output = Self;
    #[inline(always)]
    fn div(self, o: Self) -> Self {
        let (re, inverse) = (self.re / o.re, 1.0 / o.re);
        self.chain2(o, re, inverse, -re * inverse)
    }
}

impl<I: Isa, const K: usize> Neg for LaneDual<I, K> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self {
            re: -self.re,
            eps: -self.eps,
        }
    }
}

macro_rules! assigning {
    ($($trait:ident $method:ident $op:tt),*) => {$(
        impl<I: Isa, const K: usize> $trait for LaneDual<I, K> {
            #[inline(always)]
            fn $method(&mut self, other: Self) {
                *self = *self $op other;
            }
        }
    )*};
}
assigning!(AddAssign add_assign +, SubAssign sub_assign -, MulAssign mul_assign *);

impl<I: Isa, const K: usize> Add<f64> for LaneDual<I, K> {
    type Output = Self;
    #[inline(always)]
    fn add(self, c: f64) -> Self {
        Self {
            re: self.re + c,
            ..self
        }
    }
}

impl<I: Isa, const K: usize> Sub<f64> for LaneDual<I, K> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, c: f64) -> Self {
        Self {
            re: self.re - c,
            ..self
        }
    }
}

impl<I: Isa, const K: usize> Mul<f64> for LaneDual<I, K> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, c: f64) -> Self {
        self.chain(self.re * c, c)
    }
}

impl<I: Isa, const K: usize> Div<f64> for LaneDual<I, K> {
    type Output = Self;
    #[inline(always)]
    fn div(self, c: f64) -> Self {
        self.chain(self.re / c, 1.0 / c)
    }
}

impl<I: Isa, const K: usize> Scalar for LaneDual<I, K> {
    type Mask = bool;

    #[inline(always)]
    fn call<C: Subroutine>(subroutine: C) -> C::Output {
        I::call(subroutine)
    }

    #[inline(always)]
    fn from_f64(value: f64) -> Self {
        Self {
            re: value,
            eps: Lanes::from_f64(0.0),
        }
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        let root = self.re.sqrt();
        self.chain(root, 0.5 / root)
    }

    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        Self {
            re: self.re * a.re + b.re,
            eps: self.eps.mul_add(
                Lanes::from_f64(a.re),
                a.eps.mul_add(Lanes::from_f64(self.re), b.eps),
            ),
        }
    }

    #[inline(always)]
    fn lt(self, other: Self) -> bool {
        self.re < other.re
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
        let (power, ln) = split_exponent(self.re);
        (Self::from_f64(power), Self::from_f64(ln))
    }

    #[inline(always)]
    fn round_ties_even(self) -> Self {
        Self::from_f64(round_ties_even(self.re))
    }
}

impl<I: Isa, const K: usize> Real for LaneDual<I, K> {
    #[inline(always)]
    fn re(self) -> f64 {
        self.re
    }

    #[inline(always)]
    fn exp(self) -> Self {
        let e = self.re.exp();
        self.chain(e, e)
    }

    #[inline(always)]
    fn ln(self) -> Self {
        self.chain(self.re.ln(), 1.0 / self.re)
    }

    #[inline(always)]
    fn cbrt(self) -> Self {
        let root = self.re.cbrt();
        self.chain(root, root / (3.0 * self.re))
    }

    #[inline(always)]
    fn with_derivative(self, value: f64, derivative: f64) -> Self {
        self.chain(value, derivative)
    }
}
