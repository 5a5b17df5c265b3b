//! Gravitational potentials and their derivatives (docs/physics.md, section 2).
//!
//! Units: kpc, Gyr, solar masses; a potential is in (kpc/Gyr)^2.

mod baryons;
mod called;
mod disc;
mod ellipsoidal_nfw;
mod galaxy;
mod halo;
mod hernquist;
mod host;
mod kind;
mod logarithmic;
mod nfw;
mod plummer;
mod sum;

pub use baryons::{Baryons, BaryonsCotangent};
pub use called::Called;
pub use disc::{Disc, DiscCotangent, DiscProfile, DiscShape};
pub use ellipsoidal_nfw::{EllipsoidalNfw, NfwDensity};
pub use galaxy::{Galaxy, GalaxyPotential};
pub(crate) use halo::squared_axis_ratio;
pub use halo::{Halo, HaloCotangent, HaloParameters, SecondAxis};
pub use hernquist::{Hernquist, HernquistCotangent};
pub use host::{Host, HostCotangent, HostParts};
pub use kind::HaloKind;
pub use logarithmic::{Logarithmic, LogarithmicHalo};
pub use nfw::{FlattenedNfw, Nfw, log10_m200};
pub use plummer::{MassFraction, Plummer, PlummerCotangent};
pub use sum::Sum;

use crate::scalar::{Scalar, Vec3};
use crate::units::G;
use std::f64::consts::PI;

/// Smallest m^2, kpc^2, so that the centre is finite. The cube of its root is a normal number of either precision.
const TINY_M2: f64 = 1e-20;

/// A potential, centred on the origin. The other functions follow from value, acceleration and the product of the Hessian with a vector.
pub trait Potential<S: Scalar> {
    /// Phi at `x`, in (kpc/Gyr)^2.
    fn value(&self, x: Vec3<S>) -> S;

    /// -grad Phi at `x`, in kpc/Gyr^2.
    fn acceleration(&self, x: Vec3<S>) -> Vec3<S>;

    /// (grad grad Phi) v at `x`; in 1/Gyr^2 times the unit of `v`.
    fn hessian_product(&self, x: Vec3<S>, v: Vec3<S>) -> Vec3<S>;

    /// The mass density by Poisson's equation, in Msun/kpc^3. It can be negative for a flattened potential (docs/physics.md, section 2).
    fn density(&self, x: Vec3<S>) -> S {
        let unit = |i: usize| {
            let mut e = [S::zero(); 3];
            e[i] = S::one();
            Vec3::from(e)
        };
        let trace = self.hessian_product(x, unit(0)).x
            + self.hessian_product(x, unit(1)).y
            + self.hessian_product(x, unit(2)).z;
        trace / (4.0 * PI * G)
    }

    /// d2 Phi / dr2 along the unit vector `direction` at `x`, in 1/Gyr^2.
    #[inline(always)]
    fn second_derivative_along(&self, x: Vec3<S>, direction: Vec3<S>) -> S {
        direction.dot(self.hessian_product(x, direction))
    }
}

impl<S: Scalar, P: Potential<S>> Potential<S> for &P {
    #[inline(always)]
    fn value(&self, x: Vec3<S>) -> S {
        (**self).value(x)
    }

    #[inline(always)]
    fn acceleration(&self, x: Vec3<S>) -> Vec3<S> {
        (**self).acceleration(x)
    }

    #[inline(always)]
    fn hessian_product(&self, x: Vec3<S>, v: Vec3<S>) -> Vec3<S> {
        (**self).hessian_product(x, v)
    }
}
