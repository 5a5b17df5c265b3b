//! The logarithmic halo, flattened in its potential along one axis (docs/physics.md, section 2).

use super::Potential;
use super::halo::{Halo, HaloCotangent, HaloParameters};
use crate::scalar::{Scalar, Vec3, ln_1p};
use crate::units::G;

/// `Phi = v0^2 ln(1 + m^2 / Rc^2) / 2` with `v0^2 = G M / Rc`: the circular velocity is v0 far out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LogarithmicHalo<S> {
    /// `v0^2 Rc / G` in Msun.
    pub mass: S,
    /// Core radius Rc in kpc.
    pub r_s: S,
    /// 1/q^2 - 1, with the axis ratio q of the potential.
    pub flattening: S,
    /// Unit vector of the symmetry axis.
    pub axis: Vec3<S>,
}

/// The kind of halo with the potential [`LogarithmicHalo`].
#[derive(Clone, Copy, Debug, Default)]
pub struct Logarithmic;

impl<S: Scalar> LogarithmicHalo<S> {
    /// The vector `y`, and `m^2`.
    #[inline(always)]
    fn geometry(&self, x: Vec3<S>) -> (Vec3<S>, S) {
        let along = self.axis.dot(x);
        let pull = self.flattening * along;
        (
            x.add_scaled(self.axis, pull),
            pull.mul_add(along, x.norm2()),
        )
    }

    #[inline(always)]
    fn v0_squared(&self) -> S {
        self.mass * G / self.r_s
    }
}

impl<S: Scalar> Potential<S> for LogarithmicHalo<S> {
    #[inline(always)]
    fn value(&self, x: Vec3<S>) -> S {
        let (_, m2) = self.geometry(x);
        self.v0_squared() * 0.5 * ln_1p(m2 / (self.r_s * self.r_s))
    }

    #[inline(always)]
    fn acceleration(&self, x: Vec3<S>) -> Vec3<S> {
        let (y, m2) = self.geometry(x);
        y * (-(self.v0_squared() / self.r_s.mul_add(self.r_s, m2)))
    }

    #[inline(always)]
    fn hessian_product(&self, x: Vec3<S>, v: Vec3<S>) -> Vec3<S> {
        let (y, m2) = self.geometry(x);
        let inverse = S::one() / self.r_s.mul_add(self.r_s, m2);
        let dy = v.add_scaled(self.axis, self.flattening * self.axis.dot(v));
        (dy - y * (y.dot(v) * inverse * 2.0)) * (self.v0_squared() * inverse)
    }
}

impl Halo for Logarithmic {
    type In<S: Scalar> = LogarithmicHalo<S>;

    #[inline(always)]
    fn new<S: Scalar>(parameters: HaloParameters<S>) -> LogarithmicHalo<S> {
        let HaloParameters {
            mass,
            r_s,
            flattening,
            axis,
        } = parameters;
        LogarithmicHalo {
            mass,
            r_s,
            flattening,
            axis,
        }
    }

    #[inline(always)]
    fn parameters<S: Scalar>(halo: &LogarithmicHalo<S>) -> HaloParameters<S> {
        HaloParameters {
            mass: halo.mass,
            r_s: halo.r_s,
            flattening: halo.flattening,
            axis: halo.axis,
        }
    }

    /// A formula instead of the default, for speed.
    #[inline(always)]
    fn vjp<S: Scalar>(
        halo: &LogarithmicHalo<S>,
        x: Vec3<S>,
        lambda: Vec3<S>,
        cotangent: &mut HaloCotangent<S>,
    ) -> (Vec3<S>, Vec3<S>) {
        let along = halo.axis.dot(x);
        let n_lambda = halo.axis.dot(lambda);
        let (y, m2) = halo.geometry(x);
        let y_lambda = y.dot(lambda);
        let r_s2 = halo.r_s * halo.r_s;
        let inverse = S::one() / (r_s2 + m2);
        let k = halo.v0_squared() * inverse;
        // The derivative with respect to m^2.
        let pull = k * inverse * y_lambda;
        cotangent.ln_mass -= k * y_lambda;
        cotangent.ln_r_s += (r_s2 * inverse * 2.0 + 1.0) * (k * y_lambda);
        cotangent.flattening += (pull * along - k * n_lambda) * along;
        cotangent.axis = cotangent
            .axis
            .add_scaled(x, halo.flattening * (pull * along * 2.0 - k * n_lambda))
            .add_scaled(lambda, -(k * along * halo.flattening));
        let x_bar = (lambda * -k)
            .add_scaled(halo.axis, -(k * halo.flattening * n_lambda))
            .add_scaled(y, pull * 2.0);
        (y * -k, x_bar)
    }
}
