//! The NFW halo, flattened in its potential along one axis (docs/physics.md, section 2).

use super::Potential;
use super::halo::{Halo, HaloCotangent, HaloParameters};
use crate::scalar::{Scalar, Vec3, ln_1p, two_atanh_tail};
use crate::units::{CRITICAL_DENSITY, G};
use std::f64::consts::PI;

/// `Phi = -(G M / m) ln(1 + m / Rs)` with `m^2 = |x|^2 + (1/q^2 - 1) (n.x)^2`.
///
/// M = 4 pi rho0 Rs^3 is the mass scale, not M200. With `y = x + (1/q^2 - 1) (n.x) n` the gradient is `k y`,
/// `k = Phi'(m) / m`: no rotation is needed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlattenedNfw<S> {
    /// Mass scale in Msun.
    pub mass: S,
    /// Scale radius in kpc.
    pub r_s: S,
    /// 1/q^2 - 1.
    pub flattening: S,
    /// Unit vector of the symmetry axis.
    pub axis: Vec3<S>,
    /// G M / Rs^3, so that the loops need no division for it.
    strength: S,
    /// 1 / Rs.
    inverse_r_s: S,
}

/// The kind of halo whose potential is a [`FlattenedNfw`]: that of Chemaly et al. (2026).
#[derive(Clone, Copy, Debug, Default)]
pub struct Nfw;

/// Added to m^2 in kpc^2: keeps the exact centre finite and is below rounding everywhere else.
const TINY_M2: f64 = 1e-40;

/// `g(s) / s^3` with `g = ln(1+s) - s/(1+s)`, which is proportional to the enclosed mass.
///
/// With `1 + s = 2^k (1+u)/(1-u)` the logarithm is `k ln 2 + 2 u + u^3 tail(u^2)`, and
/// `2 u - s/(1+s) = (s^2 + (1 - 2^k)(2 + 3 s)) / ((1+s) (1+s+2^k))` exactly. Below s = sqrt(2) - 1, where k is 0, every
/// term left is positive and nothing cancels: one formula for the centre and the rest.
#[inline(always)]
fn profile<S: Scalar>(s: S) -> S {
    let one_plus = s + 1.0;
    let (power, ln_power) = one_plus.split_exponent();
    let below = s + (S::one() + power);
    let short = S::one() - power;
    // One division for the two reciprocals.
    let both = S::one() / (one_plus * below);
    let u = (s + short) * (both * one_plus);
    let z = u * u;
    let rest = s.mul_add(s, short * s.mul_add(S::from_f64(3.0), S::from_f64(2.0)));
    let g = rest.mul_add(both, (u * z).mul_add(two_atanh_tail(z), ln_power));
    g / (s * s * s)
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

    /// `n.x`, the vector `y` and `s = m / Rs`.
    #[inline(always)]
    fn geometry(&self, x: Vec3<S>) -> (S, Vec3<S>, S) {
        let along = self.axis.dot(x);
        let y = x.add_scaled(self.axis, self.flattening * along);
        // m^2 = x.y, summed so that it stays positive for q > 1 too.
        let m2 = (x.dot(y)).max(S::zero()) + TINY_M2;
        (along, y, m2.sqrt() * self.inverse_r_s)
    }

    /// `k = Phi'(m)/m` and `k'(m)/m`.
    #[inline(always)]
    fn slopes(&self, s: S) -> (S, S) {
        let f = profile(s);
        // f' = 1/(s (1+s))^2 - 3 f/s.
        let inverse = S::one() / (s * (s + 1.0));
        let inverse_s = inverse * (s + 1.0);
        let df = inverse * inverse - f * inverse_s * 3.0;
        let k = self.strength * f;
        let dk = self.strength * df * inverse_s * (self.inverse_r_s * self.inverse_r_s);
        (k, dk)
    }
}

impl<S: Scalar> Potential<S> for FlattenedNfw<S> {
    #[inline(always)]
    fn value(&self, x: Vec3<S>) -> S {
        let (_, _, s) = self.geometry(x);
        -(self.strength * self.r_s * self.r_s * (ln_1p(s) / s))
    }

    #[inline(always)]
    fn acceleration(&self, x: Vec3<S>) -> Vec3<S> {
        let (_, y, s) = self.geometry(x);
        y * (-self.strength * profile(s))
    }

    #[inline(always)]
    fn hessian_product(&self, x: Vec3<S>, v: Vec3<S>) -> Vec3<S> {
        let (_, y, s) = self.geometry(x);
        let (k, dk) = self.slopes(s);
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

    /// By hand: the gradient of ln L spends most of its time here.
    #[inline(always)]
    fn vjp<S: Scalar>(
        halo: &FlattenedNfw<S>,
        x: Vec3<S>,
        lambda: Vec3<S>,
        cotangent: &mut HaloCotangent<S>,
    ) -> (Vec3<S>, Vec3<S>) {
        let (along, y, s) = halo.geometry(x);
        let (k, dk) = halo.slopes(s);
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

/// log10 of M200 in Msun, the mass inside the sphere of 200 critical densities, of a spherical NFW halo with mass scale
/// `10^log10_mass` Msun (4 pi rho0 Rs^3, this library's parameter) and scale radius `r_s` kpc.
///
/// With the concentration c, `M g(c) = 200 rho_c (4 pi / 3) (c Rs)^3`: `g(c)/c^3` falls monotonically, and is bisected.
#[must_use]
pub fn log10_m200(log10_mass: f64, r_s: f64) -> f64 {
    let mass = 10.0_f64.powf(log10_mass);
    let volume_mass = 200.0 * CRITICAL_DENSITY * 4.0 * PI / 3.0 * r_s * r_s * r_s;
    let wanted = volume_mass / mass;
    let (mut lo, mut hi) = (-8.0_f64, 8.0_f64);
    for _ in 0..60 {
        let middle = 0.5 * (lo + hi);
        if profile(10.0_f64.powf(middle)) > wanted {
            lo = middle;
        } else {
            hi = middle;
        }
    }
    volume_mass.log10() + 3.0 * 0.5 * (lo + hi)
}
