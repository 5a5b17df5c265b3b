//! The logarithmic halo, flattened in its potential along one axis (docs/physics.md, section 2).

use super::Potential;
use super::halo::{Halo, HaloCotangent, HaloParameters};
use crate::scalar::{Scalar, Vec3, ln_1p};
use crate::units::G;

/// `Phi = v0^2 ln(1 + m^2 / Rc^2) / 2` with `v0^2 = G M / Rc`: the circular velocity is v0 far out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LogarithmicHalo<S> {
    /// The mass `v0^2 Rc / G`, the core radius Rc, the flattening of the potential and its axis.
    pub parameters: HaloParameters<S>,
}

/// The kind of halo with the potential [`LogarithmicHalo`].
#[derive(Clone, Copy, Debug, Default)]
pub struct Logarithmic;

impl<S: Scalar> LogarithmicHalo<S> {
    /// The vector `y`, and `m^2`.
    #[inline(always)]
    fn geometry(&self, x: Vec3<S>) -> (Vec3<S>, S) {
        let along = self.parameters.axis.dot(x);
        let pull = self.parameters.flattening * along;
        (
            x.add_scaled(self.parameters.axis, pull),
            pull.mul_add(along, x.norm2()),
        )
    }

    #[inline(always)]
    fn v0_squared(&self) -> S {
        self.parameters.mass * G / self.parameters.r_s
    }
}

impl<S: Scalar> Potential<S> for LogarithmicHalo<S> {
    #[inline(always)]
    fn value(&self, x: Vec3<S>) -> S {
        let (_, m2) = self.geometry(x);
        self.v0_squared() * 0.5 * ln_1p(m2 / (self.parameters.r_s * self.parameters.r_s))
    }

    #[inline(always)]
    fn acceleration(&self, x: Vec3<S>) -> Vec3<S> {
        let (y, m2) = self.geometry(x);
        y * (-(self.v0_squared() / self.parameters.r_s.mul_add(self.parameters.r_s, m2)))
    }

    #[inline(always)]
    fn hessian_product(&self, x: Vec3<S>, v: Vec3<S>) -> Vec3<S> {
        let (y, m2) = self.geometry(x);
        let inverse = S::one() / self.parameters.r_s.mul_add(self.parameters.r_s, m2);
        let dy = v.add_scaled(
            self.parameters.axis,
            self.parameters.flattening * self.parameters.axis.dot(v),
        );
        (dy - y * (y.dot(v) * inverse * 2.0)) * (self.v0_squared() * inverse)
    }
}

impl Halo for Logarithmic {
    type In<S: Scalar> = LogarithmicHalo<S>;

    #[inline(always)]
    fn new<S: Scalar>(parameters: HaloParameters<S>) -> LogarithmicHalo<S> {
        LogarithmicHalo { parameters }
    }

    #[inline(always)]
    fn parameters<S: Scalar>(halo: &LogarithmicHalo<S>) -> HaloParameters<S> {
        halo.parameters
    }

    /// A formula instead of the default, for speed.
    #[inline(always)]
    fn vjp<S: Scalar>(
        halo: &LogarithmicHalo<S>,
        x: Vec3<S>,
        lambda: Vec3<S>,
        cotangent: &mut HaloCotangent<S>,
    ) -> (Vec3<S>, Vec3<S>) {
        let HaloParameters {
            r_s,
            flattening,
            axis,
            ..
        } = halo.parameters;
        let along = axis.dot(x);
        let n_lambda = axis.dot(lambda);
        let (y, m2) = halo.geometry(x);
        let y_lambda = y.dot(lambda);
        let r_s2 = r_s * r_s;
        let inverse = S::one() / (r_s2 + m2);
        let k = halo.v0_squared() * inverse;
        // The derivative with respect to m^2.
        let pull = k * inverse * y_lambda;
        cotangent.ln_mass -= k * y_lambda;
        cotangent.ln_r_s += (r_s2 * inverse * 2.0 + 1.0) * (k * y_lambda);
        cotangent.flattening += (pull * along - k * n_lambda) * along;
        cotangent.axis = cotangent
            .axis
            .add_scaled(x, flattening * (pull * along * 2.0 - k * n_lambda))
            .add_scaled(lambda, -(k * along * flattening));
        let x_bar = (lambda * -k)
            .add_scaled(axis, -(k * flattening * n_lambda))
            .add_scaled(y, pull * 2.0);
        (y * -k, x_bar)
    }
}
