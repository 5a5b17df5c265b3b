//! Gravitational potentials and their derivatives, one file per mass model.
//!
//! In [`FlattenedNfw`] q is the axis ratio of the potential, as in the code of Chemaly et al. (2026); their text calls
//! it that of the density. For q below about 0.59 the density is then negative on the minor axis; see
//! [`Potential::density`].
//!
//! Units: kpc, Gyr, solar masses; a potential is in (kpc/Gyr)^2.

mod halo;
mod miyamoto_nagai;
mod nfw;
mod plummer;
mod sum;

pub use halo::{Halo, HaloCotangent, HaloParameters};
pub use miyamoto_nagai::MiyamotoNagai;
pub use nfw::{FlattenedNfw, Nfw, log10_m200};
pub use plummer::{Plummer, PlummerCotangent};
pub use sum::Sum;

use crate::scalar::{Scalar, Vec3};
use crate::units::G;
use std::f64::consts::PI;

/// A potential, centred on the origin unless it says otherwise. A model gives value, acceleration and the product of the
/// Hessian with a vector; the rest follows from these.
pub trait Potential<S: Scalar> {
    /// Phi at `x`, in (kpc/Gyr)^2.
    fn value(&self, x: Vec3<S>) -> S;

    /// -grad Phi at `x`, in kpc/Gyr^2.
    fn acceleration(&self, x: Vec3<S>) -> Vec3<S>;

    /// (grad grad Phi) v at `x`; in 1/Gyr^2 times the unit of `v`.
    fn hessian_product(&self, x: Vec3<S>, v: Vec3<S>) -> Vec3<S>;

    /// The mass density by Poisson's equation, in Msun/kpc^3. It can be negative for a strongly flattened potential.
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
