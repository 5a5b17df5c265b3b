//! The stars of the host galaxy: a disc, a bulge, or both.

use super::Potential;
use super::disc::{Disc, DiscCotangent};
use super::hernquist::{Hernquist, HernquistCotangent};
use crate::scalar::{Scalar, Vec3};

/// Disc and bulge. One that is absent has no mass, so that the force has no branch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Baryons<S> {
    /// The disc.
    pub disc: Disc<S>,
    /// The bulge.
    pub bulge: Hernquist<S>,
}

/// Derivatives of a result with respect to the parameters of disc and bulge, summed over force evaluations; zero for one that is absent.
#[derive(Clone, Copy, Debug)]
pub struct BaryonsCotangent<S> {
    /// Of the disc.
    pub disc: DiscCotangent<S>,
    /// Of the bulge.
    pub bulge: HernquistCotangent<S>,
}

impl<S: Scalar> Baryons<S> {
    /// Neither disc nor bulge.
    #[inline(always)]
    #[must_use]
    pub fn none() -> Self {
        Self {
            disc: Disc::none(),
            bulge: Hernquist::none(),
        }
    }

    /// The same with numbers of another type, each converted by `f`.
    #[inline(always)]
    pub fn map<T: Scalar>(&self, f: impl Fn(S) -> T) -> Baryons<T> {
        Baryons {
            disc: self.disc.map(&f),
            bulge: self.bulge.map(&f),
        }
    }

    /// Reverse mode of the acceleration, as [`Halo::vjp`](super::Halo::vjp).
    #[inline(always)]
    pub fn vjp(
        &self,
        x: Vec3<S>,
        lambda: Vec3<S>,
        cotangent: &mut BaryonsCotangent<S>,
    ) -> (Vec3<S>, Vec3<S>) {
        let (of_disc, of_disc_bar) = self.disc.vjp(x, lambda, &mut cotangent.disc);
        let (of_bulge, of_bulge_bar) = self.bulge.vjp(x, lambda, &mut cotangent.bulge);
        (of_disc + of_bulge, of_disc_bar + of_bulge_bar)
    }
}

impl<S: Scalar> Potential<S> for Baryons<S> {
    #[inline(always)]
    fn value(&self, x: Vec3<S>) -> S {
        self.disc.value(x) + self.bulge.value(x)
    }

    #[inline(always)]
    fn acceleration(&self, x: Vec3<S>) -> Vec3<S> {
        self.disc.acceleration(x) + self.bulge.acceleration(x)
    }

    #[inline(always)]
    fn hessian_product(&self, x: Vec3<S>, v: Vec3<S>) -> Vec3<S> {
        self.disc.hessian_product(x, v) + self.bulge.hessian_product(x, v)
    }
}

impl<S: Scalar> BaryonsCotangent<S> {
    /// All derivatives zero.
    #[inline(always)]
    #[must_use]
    pub fn zero() -> Self {
        Self {
            disc: DiscCotangent::zero(),
            bulge: HernquistCotangent::zero(),
        }
    }
}
