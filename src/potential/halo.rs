//! The interface of a halo in which streams and their gradients are computed.

use super::Potential;
use crate::scalar::{Scalar, Tangent, Vec3};
use crate::units::{CRITICAL_DENSITY, G};
use std::f64::consts::PI;
use std::fmt::Debug;

/// The parameters of a halo.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HaloParameters<S> {
    /// Mass scale in Msun; each kind of halo defines its own.
    pub mass: S,
    /// Scale radius in kpc.
    pub r_s: S,
    /// 1/q^2 - 1, with the axis ratio q.
    pub flattening: S,
    /// Unit vector of the axis of q: the symmetry axis, unless the halo is triaxial.
    pub axis: Vec3<S>,
    /// The second axis of a triaxial halo.
    pub second: SecondAxis<S>,
}

/// The second axis of a halo: its axis ratio p and its direction, perpendicular to the axis of q.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SecondAxis<S> {
    /// 1/p^2 - 1; 0 of a halo that is symmetric around the axis of q.
    pub flattening: S,
    /// Its unit vector; the zero vector of a halo without one.
    pub axis: Vec3<S>,
}

impl<S: Scalar> SecondAxis<S> {
    /// That of a symmetric halo; as derivatives, all zero.
    #[inline(always)]
    #[must_use]
    pub fn none() -> Self {
        Self {
            flattening: S::zero(),
            axis: Vec3::zero(),
        }
    }

    /// The same with each number converted by `f`.
    #[inline(always)]
    pub fn map<T: Scalar>(&self, f: impl Fn(S) -> T) -> SecondAxis<T> {
        SecondAxis {
            flattening: f(self.flattening),
            axis: self.axis.map(&f),
        }
    }
}

impl<S: Scalar> HaloParameters<S> {
    /// Those of a symmetric halo, from the axis ratio q.
    #[inline(always)]
    pub fn from_q(mass: S, r_s: S, q: S, axis: Vec3<S>) -> Self {
        Self {
            mass,
            r_s,
            flattening: S::one() / (q * q) - 1.0,
            axis,
            second: SecondAxis::none(),
        }
    }

    /// The same parameters in another number type, each converted by `f`.
    #[inline(always)]
    pub fn map<T: Scalar>(&self, f: impl Fn(S) -> T) -> HaloParameters<T> {
        HaloParameters {
            mass: f(self.mass),
            r_s: f(self.r_s),
            flattening: f(self.flattening),
            axis: self.axis.map(&f),
            second: self.second.map(&f),
        }
    }
}

/// Derivatives of a result with respect to the parameters of a halo, summed over force evaluations.
#[derive(Clone, Copy, Debug)]
pub struct HaloCotangent<S> {
    /// With respect to ln mass.
    pub ln_mass: S,
    /// With respect to ln `r_s`.
    pub ln_r_s: S,
    /// With respect to 1/q^2 - 1.
    pub flattening: S,
    /// With respect to the axis, its three components taken as independent.
    pub axis: Vec3<S>,
    /// With respect to the second axis, in the same way.
    pub second: SecondAxis<S>,
}

impl<S: Scalar> HaloCotangent<S> {
    /// All derivatives zero.
    #[inline(always)]
    #[must_use]
    pub fn zero() -> Self {
        Self {
            ln_mass: S::zero(),
            ln_r_s: S::zero(),
            flattening: S::zero(),
            axis: Vec3::zero(),
            second: SecondAxis::none(),
        }
    }

    /// The same with each number converted by `f`, such as its sum over lanes.
    #[inline(always)]
    pub fn map<T: Scalar>(&self, f: impl Fn(S) -> T) -> HaloCotangent<T> {
        HaloCotangent {
            ln_mass: f(self.ln_mass),
            ln_r_s: f(self.ln_r_s),
            flattening: f(self.flattening),
            axis: self.axis.map(&f),
            second: self.second.map(&f),
        }
    }
}

/// The square of an axis ratio q, from 1/q^2 - 1.
#[inline(always)]
pub(crate) fn squared_axis_ratio<S: Scalar>(flattening: S) -> S {
    S::one() / (flattening + 1.0)
}

/// log10 of the radius, in scale radii, inside which the mean density is 200 times the critical one, between -8 and 8. It decreases outwards, and
/// `denser` says whether it is larger inside a radius.
pub(super) fn log10_radius_200(denser: impl Fn(f64) -> bool) -> f64 {
    let (mut lo, mut hi) = (-8.0_f64, 8.0_f64);
    for _ in 0..60 {
        let middle = 0.5 * (lo + hi);
        if denser(10_f64.powf(middle)) {
            lo = middle;
        } else {
            hi = middle;
        }
    }
    0.5 * (lo + hi)
}

/// Number of directions of the derivatives in the default [`Halo::vjp`]: `lambda`, and the six numbers of the parameters.
const DIRECTIONS: usize = 7;

/// A kind of halo: a potential of four parameters on every number type.
///
/// To add one, implement [`Potential`] for a struct, with an acceleration on all number types, and this trait for a marker type.
/// Derivatives follow from the acceleration by dual numbers. For streams implement [`CompiledHost`](crate::stream::CompiledHost) as
/// well; `examples/own_halo.rs` is an example.
pub trait Halo: Copy + Debug + Default + Send + Sync + 'static {
    /// The potential in the number type `S`.
    type In<S: Scalar>: Potential<S> + Copy + Debug + Send + Sync;

    /// The potential of these parameters.
    fn new<S: Scalar>(parameters: HaloParameters<S>) -> Self::In<S>;

    /// The parameters of a potential.
    fn parameters<S: Scalar>(halo: &Self::In<S>) -> HaloParameters<S>;

    /// log10 of M200 in Msun (docs/physics.md, section 1) of a spherical halo with the mass `10^log10_mass` Msun and the scale radius `r_s` kpc.
    ///
    /// This default solves for the radius by bisection between 10^-8 and 10^8 scale radii, by the acceleration of a halo whose mean density
    /// decreases outwards. If it is nowhere 200 times the critical one, the result is the mass inside the smallest of these radii.
    #[must_use]
    fn log10_m200(log10_mass: f64, r_s: f64) -> f64 {
        let axis = Vec3::new(0.0, 0.0, 1.0);
        let halo = Self::new(HaloParameters::from_q(
            10_f64.powf(log10_mass),
            r_s,
            1.0,
            axis,
        ));
        let enclosed = |r: f64| -halo.acceleration(Vec3::new(r, 0.0, 0.0)).x * r * r / G;
        let density_200 = 200.0 * CRITICAL_DENSITY * 4.0 * PI / 3.0;
        let log10_radius = log10_radius_200(|scaled| {
            let r = r_s * scaled;
            enclosed(r) > density_200 * r * r * r
        });
        enclosed(r_s * 10_f64.powf(log10_radius)).log10()
    }

    /// The same potential in another number type, as constants.
    #[inline(always)]
    fn broadcast<S: Scalar>(halo: &Self::In<f64>) -> Self::In<S> {
        Self::new(Self::parameters(halo).map(S::from_f64))
    }

    /// Reverse mode of the acceleration (kpc/Gyr^2). `lambda` is the derivative of a result with respect to the acceleration at `x`
    /// (kpc); the derivatives with respect to the parameters are added to `cotangent`. Returns the acceleration and the derivative with
    /// respect to `x`.
    ///
    /// This default evaluates the acceleration once on [`Tangent`] numbers: because the Hessian of the potential is symmetric, the
    /// derivative with respect to `x` is the derivative of the acceleration along `lambda`. A formula may replace it for speed.
    #[inline(always)]
    fn vjp<S: Scalar>(
        halo: &Self::In<S>,
        x: Vec3<S>,
        lambda: Vec3<S>,
        cotangent: &mut HaloCotangent<S>,
    ) -> (Vec3<S>, Vec3<S>) {
        let HaloParameters {
            mass,
            r_s,
            flattening,
            axis,
            second,
        } = Self::parameters(halo);
        let variable = |value: S, direction: usize, slope: S| {
            Tangent::<S, DIRECTIONS>::along(value, direction, slope)
        };
        let one = S::one();
        let lifted = Self::new(HaloParameters {
            mass: variable(mass, 1, mass),
            r_s: variable(r_s, 2, r_s),
            flattening: variable(flattening, 3, one),
            axis: Vec3::new(
                variable(axis.x, 4, one),
                variable(axis.y, 5, one),
                variable(axis.z, 6, one),
            ),
            // A triaxial kind has a formula.
            second: second.map(Tangent::constant),
        });
        let a = lifted.acceleration(Vec3::new(
            variable(x.x, 0, lambda.x),
            variable(x.y, 0, lambda.y),
            variable(x.z, 0, lambda.z),
        ));
        let slope = |k: usize| Vec3::new(a.x.eps[k], a.y.eps[k], a.z.eps[k]);
        cotangent.ln_mass += lambda.dot(slope(1));
        cotangent.ln_r_s += lambda.dot(slope(2));
        cotangent.flattening += lambda.dot(slope(3));
        cotangent.axis += Vec3::new(
            lambda.dot(slope(4)),
            lambda.dot(slope(5)),
            lambda.dot(slope(6)),
        );
        (Vec3::new(a.x.re, a.y.re, a.z.re), slope(0))
    }

    /// (grad grad Phi) v at `x` by the acceleration on [`Tangent`] numbers, for a [`Potential::hessian_product`] without a formula.
    #[inline(always)]
    fn hessian_product<S: Scalar>(halo: &Self::In<S>, x: Vec3<S>, v: Vec3<S>) -> Vec3<S> {
        let lifted = Self::new(Self::parameters(halo).map(Tangent::<S, 1>::constant));
        let a = lifted.acceleration(Vec3::new(
            Tangent::along(x.x, 0, v.x),
            Tangent::along(x.y, 0, v.y),
            Tangent::along(x.z, 0, v.z),
        ));
        -Vec3::new(a.x.eps[0], a.y.eps[0], a.z.eps[0])
    }
}
