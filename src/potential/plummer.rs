//! The Plummer sphere: the potential of the progenitor (Plummer 1911, MNRAS 71, 460).

use super::Potential;
use crate::scalar::{Scalar, Vec3};
use crate::units::G;

/// `Phi = -G m / sqrt(r^2 + a^2)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plummer<S> {
    /// Mass in Msun.
    pub mass: S,
    /// Scale radius in kpc.
    pub r_s: S,
}

/// Derivatives of a result with respect to the parameters of a Plummer sphere, summed over force evaluations.
#[derive(Clone, Copy, Debug)]
pub struct PlummerCotangent<S> {
    /// With respect to ln m.
    pub ln_mass: S,
    /// With respect to the scale radius in kpc.
    pub r_s: S,
    /// With respect to the parameter of the law of mass loss.
    pub mass_loss: S,
}

/// The fraction of its mass that a progenitor has at some time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MassFraction<S> {
    /// The fraction.
    pub value: S,
    /// Its derivative with respect to the parameter of the law of mass loss.
    pub slope: S,
}

impl<S: Scalar> MassFraction<S> {
    /// That of a progenitor that keeps its mass.
    #[inline(always)]
    #[must_use]
    pub fn whole() -> Self {
        Self {
            value: S::one(),
            slope: S::zero(),
        }
    }
}

impl<S: Scalar> PlummerCotangent<S> {
    /// All derivatives zero.
    #[inline(always)]
    #[must_use]
    pub fn zero() -> Self {
        Self {
            ln_mass: S::zero(),
            r_s: S::zero(),
            mass_loss: S::zero(),
        }
    }
}

impl<S: Scalar> Plummer<S> {
    /// The same sphere in another number type, as constants.
    #[inline(always)]
    #[must_use]
    pub fn broadcast(progenitor: &Plummer<f64>) -> Self {
        Self {
            mass: S::from_f64(progenitor.mass),
            r_s: S::from_f64(progenitor.r_s),
        }
    }

    /// `1 / (r^2 + a^2)` and `G m / (r^2 + a^2)^(3/2)`.
    #[inline(always)]
    fn slopes(&self, x: Vec3<S>) -> (S, S) {
        // Not by `inverse_sqrt` as in the halo, because that is slower on some processors (docs/validation.md, section 6).
        let inverse = S::one() / (x.norm2() + self.r_s * self.r_s);
        (inverse, self.mass * G * (inverse * inverse.sqrt()))
    }

    /// `a` plus the acceleration at `x` by a sphere that has this fraction of its mass; both in kpc/Gyr^2.
    #[inline(always)]
    pub fn add_acceleration(&self, fraction: S, x: Vec3<S>, a: Vec3<S>) -> Vec3<S> {
        a.add_scaled(x, -(self.slopes(x).1 * fraction))
    }

    /// As [`vjp`](Self::vjp), of a sphere that has this fraction of its mass.
    #[inline(always)]
    pub fn vjp_of(
        &self,
        fraction: MassFraction<S>,
        x: Vec3<S>,
        lambda: Vec3<S>,
        cotangent: &mut PlummerCotangent<S>,
    ) -> (Vec3<S>, Vec3<S>) {
        let (a, x_bar) = self.vjp(x, lambda * fraction.value, cotangent);
        cotangent.mass_loss += lambda.dot(a) * fraction.slope;
        (a * fraction.value, x_bar)
    }

    /// Reverse mode of the acceleration, as [`Halo::vjp`](super::Halo::vjp).
    #[inline(always)]
    pub fn vjp(
        &self,
        x: Vec3<S>,
        lambda: Vec3<S>,
        cotangent: &mut PlummerCotangent<S>,
    ) -> (Vec3<S>, Vec3<S>) {
        let (inverse, k) = self.slopes(x);
        let x_lambda = x.dot(lambda);
        let pull = inverse * k * x_lambda * 3.0;
        cotangent.ln_mass -= k * x_lambda;
        cotangent.r_s += pull * self.r_s;
        (x * (-k), (x * pull).add_scaled(lambda, -k))
    }
}

impl<S: Scalar> Potential<S> for Plummer<S> {
    #[inline(always)]
    fn value(&self, x: Vec3<S>) -> S {
        -(self.mass * G / (x.norm2() + self.r_s * self.r_s).sqrt())
    }

    #[inline(always)]
    fn acceleration(&self, x: Vec3<S>) -> Vec3<S> {
        self.add_acceleration(S::one(), x, Vec3::zero())
    }

    #[inline(always)]
    fn hessian_product(&self, x: Vec3<S>, v: Vec3<S>) -> Vec3<S> {
        let (inverse, k) = self.slopes(x);
        v * k - x * (inverse * k * x.dot(v) * 3.0)
    }
}
