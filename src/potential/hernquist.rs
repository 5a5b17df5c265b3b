//! The bulge of Hernquist (1990, Astrophysical Journal 356, 359).

use super::{Potential, TINY_M2};
use crate::scalar::{Scalar, Vec3};
use crate::units::G;

/// `Phi = -G M / (r + a)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hernquist<S> {
    /// Mass in Msun.
    pub mass: S,
    /// Scale radius a in kpc.
    pub r_s: S,
}

/// Derivatives of a result with respect to the parameters of a bulge, summed over force evaluations.
#[derive(Clone, Copy, Debug)]
pub struct HernquistCotangent<S> {
    /// With respect to ln mass.
    pub ln_mass: S,
    /// With respect to ln `r_s`.
    pub ln_r_s: S,
}

impl<S: Scalar> Hernquist<S> {
    /// A bulge without mass.
    #[inline(always)]
    #[must_use]
    pub fn none() -> Self {
        Self {
            mass: S::zero(),
            r_s: S::one(),
        }
    }

    /// The same bulge with numbers of another type, each converted by `f`.
    #[inline(always)]
    pub fn map<T: Scalar>(&self, f: impl Fn(S) -> T) -> Hernquist<T> {
        Hernquist {
            mass: f(self.mass),
            r_s: f(self.r_s),
        }
    }

    /// The distance from the centre, at least a tiny one.
    #[inline(always)]
    fn radius(x: Vec3<S>) -> S {
        x.norm2().max(S::from_f64(TINY_M2)).sqrt()
    }

    /// `k = Phi'(r) / r`, and `k'(r) / r`.
    #[inline(always)]
    fn slopes(&self, x: Vec3<S>) -> (S, S) {
        let r = Self::radius(x);
        let reach = r + self.r_s;
        let inverse = S::one() / (r * reach);
        let inverse_reach = inverse * r;
        let k = self.mass * G * inverse * inverse_reach;
        // k' = -k (3 r + a) / (r (r + a)).
        let dk = -(k * inverse * ((r * 3.0 + self.r_s) * (inverse * reach)));
        (k, dk)
    }

    /// Reverse mode of the acceleration, as [`Halo::vjp`](super::Halo::vjp).
    #[inline(always)]
    pub fn vjp(
        &self,
        x: Vec3<S>,
        lambda: Vec3<S>,
        cotangent: &mut HernquistCotangent<S>,
    ) -> (Vec3<S>, Vec3<S>) {
        let (k, dk) = self.slopes(x);
        let x_lambda = x.dot(lambda);
        let x_bar = (lambda * -k).add_scaled(x, -(dk * x_lambda));
        cotangent.ln_mass -= k * x_lambda;
        // The acceleration at c x with the scale radius c a is 1/c^2 times that at x with a.
        cotangent.ln_r_s += k * x_lambda * 2.0 - x.dot(x_bar);
        (x * -k, x_bar)
    }
}

impl<S: Scalar> Potential<S> for Hernquist<S> {
    #[inline(always)]
    fn value(&self, x: Vec3<S>) -> S {
        -(self.mass * G / (Self::radius(x) + self.r_s))
    }

    #[inline(always)]
    fn acceleration(&self, x: Vec3<S>) -> Vec3<S> {
        x * -self.slopes(x).0
    }

    #[inline(always)]
    fn hessian_product(&self, x: Vec3<S>, v: Vec3<S>) -> Vec3<S> {
        let (k, dk) = self.slopes(x);
        v * k + x * (dk * x.dot(v))
    }
}

impl<S: Scalar> HernquistCotangent<S> {
    /// All derivatives zero.
    #[inline(always)]
    #[must_use]
    pub fn zero() -> Self {
        Self {
            ln_mass: S::zero(),
            ln_r_s: S::zero(),
        }
    }
}
