//! What a stream is integrated in: a halo alone, or a galaxy.

use super::Potential;
use super::baryons::{Baryons, BaryonsCotangent};
use super::halo::{Halo, HaloCotangent, HaloParameters};
use super::kind::HaloKind;
use crate::scalar::{Scalar, Vec3};
use std::fmt::Debug;

/// What a host consists of. One of a single kind of halo without baryons takes the parameters of the halo alone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HostParts<S> {
    /// The kind of halo.
    pub kind: HaloKind,
    /// The parameters of the halo.
    pub halo: HaloParameters<S>,
    /// Disc and bulge; without mass if there are none.
    pub baryons: Baryons<S>,
    /// Whether there is a disc or a bulge.
    pub has_baryons: bool,
}

/// Derivatives of a result with respect to the parameters of a host, summed over force evaluations.
#[derive(Clone, Copy, Debug)]
pub struct HostCotangent<S> {
    /// Of the halo.
    pub halo: HaloCotangent<S>,
    /// Of disc and bulge.
    pub baryons: BaryonsCotangent<S>,
}

impl<S: Scalar> HostCotangent<S> {
    /// All derivatives zero.
    #[inline(always)]
    #[must_use]
    pub fn zero() -> Self {
        Self {
            halo: HaloCotangent::zero(),
            baryons: BaryonsCotangent::zero(),
        }
    }
}

/// A kind of host: every [`Halo`] is one, and so is the [`Galaxy`](super::Galaxy).
pub trait Host: Copy + Debug + Default + Send + Sync + 'static {
    /// The potential in the number type `S`.
    type In<S: Scalar>: Potential<S> + Copy + Debug + Send + Sync;

    /// Whether it is a galaxy: it may have a disc, a bulge and a second axis, and a progenitor that loses mass.
    const IS_GALAXY: bool;

    /// The potential of these parts.
    fn from_parts<S: Scalar>(parts: HostParts<S>) -> Self::In<S>;

    /// The parts of a potential.
    fn parts<S: Scalar>(host: &Self::In<S>) -> HostParts<S>;

    /// As [`Halo::broadcast`].
    fn broadcast<S: Scalar>(host: &Self::In<f64>) -> Self::In<S>;

    /// As [`Halo::vjp`].
    fn vjp<S: Scalar>(
        host: &Self::In<S>,
        x: Vec3<S>,
        lambda: Vec3<S>,
        cotangent: &mut HostCotangent<S>,
    ) -> (Vec3<S>, Vec3<S>);

    /// As [`Halo::log10_m200`]: of the halo alone, which is of this kind if the host can have several.
    #[must_use]
    fn log10_m200(kind: HaloKind, log10_mass: f64, r_s: f64) -> f64;
}

impl<H: Halo> Host for H {
    type In<S: Scalar> = <H as Halo>::In<S>;

    const IS_GALAXY: bool = false;

    #[inline(always)]
    fn from_parts<S: Scalar>(parts: HostParts<S>) -> <H as Halo>::In<S> {
        H::new(parts.halo)
    }

    #[inline(always)]
    fn parts<S: Scalar>(host: &<H as Halo>::In<S>) -> HostParts<S> {
        HostParts {
            kind: HaloKind::default(),
            halo: H::parameters(host),
            baryons: Baryons::none(),
            has_baryons: false,
        }
    }

    #[inline(always)]
    fn broadcast<S: Scalar>(host: &<H as Halo>::In<f64>) -> <H as Halo>::In<S> {
        <H as Halo>::broadcast(host)
    }

    #[inline(always)]
    fn vjp<S: Scalar>(
        host: &<H as Halo>::In<S>,
        x: Vec3<S>,
        lambda: Vec3<S>,
        cotangent: &mut HostCotangent<S>,
    ) -> (Vec3<S>, Vec3<S>) {
        <H as Halo>::vjp(host, x, lambda, &mut cotangent.halo)
    }

    fn log10_m200(_: HaloKind, log10_mass: f64, r_s: f64) -> f64 {
        <H as Halo>::log10_m200(log10_mass, r_s)
    }
}
