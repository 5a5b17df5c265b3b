//! The NFW halo, flattened in its potential along one axis (docs/physics.md, section 2).

use super::halo::{Halo, HaloCotangent, HaloParameters, SecondAxis, log10_radius_200};
use super::{Potential, TINY_M2};
use crate::scalar::{Scalar, Vec3, ln_1p, two_atanh_tail};
use crate::units::{CRITICAL_DENSITY, G};
use std::f64::consts::PI;

/// The host of docs/physics.md, section 2, whose symbols M, Rs, q, n, e, m, s, y and k the comments here use.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlattenedNfw<S> {
    /// The NFW mass scale M in Msun; this is not M200.
    pub mass: S,
    /// Scale radius in kpc.
    pub r_s: S,
    /// e = 1/q^2 - 1.
    pub flattening: S,
    /// Unit vector of the symmetry axis.
    pub axis: Vec3<S>,
    /// G M / Rs^3, divided once and not at each evaluation.
    strength: S,
    /// 1 / Rs.
    inverse_r_s: S,
}

/// A position in the halo.
#[derive(Clone, Copy)]
struct Geometry<S> {
    /// `n.x`
    along: S,
    y: Vec3<S>,
    /// `m / Rs`
    s: S,
    /// `1 / s`
    inverse_s: S,
}

/// The kind of halo of Chemaly et al. (2026), with the potential [`FlattenedNfw`].
#[derive(Clone, Copy, Debug, Default)]
pub struct Nfw;

/// `g(s)` (docs/physics.md, section 2), which is near `s^2 / 2` at small s, and `1/(1+s)`.
///
/// With `1 + s = 2^k (1+u)/(1-u)` the logarithm is `k ln 2 + 2 u + u^3 tail(u^2)`, and
/// `2 u - s/(1+s) = (s^2 + (1 - 2^k)(2 + 3 s)) / ((1+s) (1+s+2^k))` exactly. Where k is 0, below s = sqrt(2) - 1, all terms are positive
/// and none cancel, so that the formula holds at any s.
#[inline(always)]
fn enclosed<S: Scalar>(s: S) -> (S, S) {
    let one_plus = s + 1.0;
    let (power, ln_power) = one_plus.split_exponent();
    let below = s + (S::one() + power);
    let short = S::one() - power;
    // One division for the two reciprocals.
    let inverse_product = S::one() / (one_plus * below);
    let u = (s + short) * (inverse_product * one_plus);
    let z = u * u;
    let rest = s.mul_add(s, short * s.mul_add(S::from_f64(3.0), S::from_f64(2.0)));
    let g = rest.mul_add(
        inverse_product,
        (u * z).mul_add(two_atanh_tail(z), ln_power),
    );
    (g, inverse_product * below)
}

impl<S: Scalar> FlattenedNfw<S> {
    /// A halo of mass scale `mass` (Msun), scale radius `r_s` (kpc), flattening `q` along the unit vector `axis`.
    #[inline(always)]
    pub fn new(mass: S, r_s: S, q: S, axis: Vec3<S>) -> Self {
        Self::from_flattening(mass, r_s, S::one() / (q * q) - 1.0, axis)
    }

    /// As [`new`](Self::new), from 1/q^2 - 1.
    #[inline(always)]
    pub fn from_flattening(mass: S, r_s: S, flattening: S, axis: Vec3<S>) -> Self {
        let inverse_r_s = S::one() / r_s;
        Self {
            mass,
            r_s,
            flattening,
            axis,
            strength: mass * G * (inverse_r_s * inverse_r_s * inverse_r_s),
            inverse_r_s,
        }
    }

    /// Where `x` is in the halo.
    #[inline(always)]
    fn geometry(&self, x: Vec3<S>) -> Geometry<S> {
        let along = self.axis.dot(x);
        let pull = self.flattening * along;
        // Not x.y, which waits for y.
        let m2 = pull.mul_add(along, x.norm2());
        let m2 = m2.max(S::from_f64(TINY_M2));
        let inverse_m = m2.inverse_sqrt();
        Geometry {
            along,
            y: x.add_scaled(self.axis, pull),
            s: m2 * inverse_m * self.inverse_r_s,
            inverse_s: inverse_m * self.r_s,
        }
    }

    /// `k = Phi'(m)/m` and `k'(m)/m`.
    #[inline(always)]
    fn slopes(&self, s: S, inverse_s: S) -> (S, S) {
        let (g, inverse_one_plus) = enclosed(s);
        let f = g * (inverse_s * inverse_s * inverse_s);
        // f' = 1/(s (1+s))^2 - 3 f/s.
        let inverse = inverse_s * inverse_one_plus;
        let df = inverse * inverse - f * inverse_s * 3.0;
        let k = self.strength * f;
        let dk = self.strength * df * inverse_s * (self.inverse_r_s * self.inverse_r_s);
        (k, dk)
    }
}

impl<S: Scalar> Potential<S> for FlattenedNfw<S> {
    #[inline(always)]
    fn value(&self, x: Vec3<S>) -> S {
        let Geometry { s, inverse_s, .. } = self.geometry(x);
        -(self.strength * self.r_s * self.r_s * (ln_1p(s) * inverse_s))
    }

    #[inline(always)]
    fn acceleration(&self, x: Vec3<S>) -> Vec3<S> {
        let Geometry {
            y, s, inverse_s, ..
        } = self.geometry(x);
        y * (-self.strength * (inverse_s * inverse_s * inverse_s) * enclosed(s).0)
    }

    #[inline(always)]
    fn hessian_product(&self, x: Vec3<S>, v: Vec3<S>) -> Vec3<S> {
        let Geometry {
            y, s, inverse_s, ..
        } = self.geometry(x);
        let (k, dk) = self.slopes(s, inverse_s);
        v.add_scaled(self.axis, self.flattening * self.axis.dot(v)) * k + y * (dk * y.dot(v))
    }
}

impl Halo for Nfw {
    type In<S: Scalar> = FlattenedNfw<S>;

    #[inline(always)]
    fn new<S: Scalar>(parameters: HaloParameters<S>) -> FlattenedNfw<S> {
        let HaloParameters {
            mass,
            r_s,
            flattening,
            axis,
            ..
        } = parameters;
        FlattenedNfw::from_flattening(mass, r_s, flattening, axis)
    }

    #[inline(always)]
    fn parameters<S: Scalar>(halo: &FlattenedNfw<S>) -> HaloParameters<S> {
        HaloParameters {
            mass: halo.mass,
            r_s: halo.r_s,
            flattening: halo.flattening,
            axis: halo.axis,
            second: SecondAxis::none(),
        }
    }

    #[inline(always)]
    fn broadcast<S: Scalar>(halo: &FlattenedNfw<f64>) -> FlattenedNfw<S> {
        FlattenedNfw {
            mass: S::from_f64(halo.mass),
            r_s: S::from_f64(halo.r_s),
            flattening: S::from_f64(halo.flattening),
            axis: Vec3::from_f64(halo.axis),
            strength: S::from_f64(halo.strength),
            inverse_r_s: S::from_f64(halo.inverse_r_s),
        }
    }

    fn log10_m200(log10_mass: f64, r_s: f64) -> f64 {
        log10_m200(log10_mass, r_s)
    }

    /// A formula instead of the default, because the gradient of ln L takes most of its time here.
    #[inline(always)]
    fn vjp<S: Scalar>(
        halo: &FlattenedNfw<S>,
        x: Vec3<S>,
        lambda: Vec3<S>,
        cotangent: &mut HaloCotangent<S>,
    ) -> (Vec3<S>, Vec3<S>) {
        let Geometry {
            along,
            y,
            s,
            inverse_s,
        } = halo.geometry(x);
        let (k, dk) = halo.slopes(s, inverse_s);
        let y_lambda = y.dot(lambda);
        let n_lambda = halo.axis.dot(lambda);
        let m2 = s * s * (halo.r_s * halo.r_s);
        let dk_y = dk * y_lambda;
        cotangent.ln_mass -= k * y_lambda;
        cotangent.ln_r_s += (k * 3.0 + dk * m2) * y_lambda;
        let pull = dk_y * along + k * n_lambda;
        cotangent.flattening -= (pull + k * n_lambda) * along * 0.5;
        cotangent.axis = cotangent
            .axis
            .add_scaled(x, -(pull * halo.flattening))
            .add_scaled(lambda, -(k * along * halo.flattening));
        let x_bar =
            (lambda.add_scaled(halo.axis, halo.flattening * n_lambda) * (-k)).add_scaled(y, -dk_y);
        (y * (-k), x_bar)
    }
}

/// log10 of M200 in Msun (docs/physics.md, section 1) of a spherical NFW halo with the mass scale `10^log10_mass` Msun and the scale radius
/// `r_s` kpc.
///
/// With the concentration c, `M g(c) = 200 rho_c (4 pi / 3) (c Rs)^3`, which is solved by bisection: `g(c)/c^3` decreases with c.
#[must_use]
pub fn log10_m200(log10_mass: f64, r_s: f64) -> f64 {
    let mass = 10.0_f64.powf(log10_mass);
    let volume_mass = 200.0 * CRITICAL_DENSITY * 4.0 * PI / 3.0 * r_s * r_s * r_s;
    let wanted = volume_mass / mass;
    let log10_c = log10_radius_200(|c| enclosed(c).0 / (c * c * c) > wanted);
    volume_mass.log10() + 3.0 * log10_c
}
