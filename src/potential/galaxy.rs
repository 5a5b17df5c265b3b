//! A galaxy: a halo of any kind that settings name, with disc and bulge.

use super::baryons::Baryons;
use super::ellipsoidal_nfw::{EllipsoidalNfw, NfwDensity};
use super::halo::Halo;
use super::host::{Host, HostCotangent, HostParts};
use super::kind::HaloKind;
use super::logarithmic::{Logarithmic, LogarithmicHalo};
use super::nfw::{FlattenedNfw, Nfw};
use super::{Called, Potential};
use crate::scalar::{Scalar, Subroutine, Vec3};

/// The kind of host that can have any halo of settings, a disc and a bulge. Its kernels are compiled once for all of these; a halo alone
/// whose kernels are its own is faster.
#[derive(Clone, Copy, Debug, Default)]
pub struct Galaxy;

/// A halo of a kind that is known only when the program runs.
#[derive(Clone, Copy, Debug)]
enum AnyHalo<S> {
    Nfw(FlattenedNfw<S>),
    NfwEllipsoidal(EllipsoidalNfw<S>),
    Logarithmic(LogarithmicHalo<S>),
}

/// The potential of a [`Galaxy`].
#[derive(Clone, Copy, Debug)]
pub struct GalaxyPotential<S> {
    halo: AnyHalo<S>,
    baryons: Baryons<S>,
    has_baryons: bool,
}

/// Evaluates an expression for the halo, whatever its kind.
macro_rules! with_halo {
    ($any:expr, $halo:ident => $value:expr) => {
        match $any {
            AnyHalo::Nfw($halo) => $value,
            AnyHalo::NfwEllipsoidal($halo) => $value,
            AnyHalo::Logarithmic($halo) => $value,
        }
    };
}

impl<S: Scalar> Potential<S> for GalaxyPotential<S> {
    #[inline(always)]
    fn value(&self, x: Vec3<S>) -> S {
        with_halo!(&self.halo, halo => halo.value(x)) + self.baryons.value(x)
    }

    #[inline(always)]
    fn acceleration(&self, x: Vec3<S>) -> Vec3<S> {
        let of_halo = with_halo!(&self.halo, halo => halo.acceleration(x));
        if self.has_baryons {
            of_halo + self.baryons.acceleration(x)
        } else {
            of_halo
        }
    }

    #[inline(always)]
    fn hessian_product(&self, x: Vec3<S>, v: Vec3<S>) -> Vec3<S> {
        let of_halo = with_halo!(&self.halo, halo => halo.hessian_product(x, v));
        if self.has_baryons {
            of_halo + self.baryons.hessian_product(x, v)
        } else {
            of_halo
        }
    }
}

impl Host for Galaxy {
    type In<S: Scalar> = Called<GalaxyPotential<S>>;

    const IS_GALAXY: bool = true;

    #[inline(always)]
    fn from_parts<S: Scalar>(parts: HostParts<S>) -> Self::In<S> {
        let HostParts {
            kind,
            halo,
            baryons,
            has_baryons,
        } = parts;
        let halo = match kind {
            HaloKind::Nfw => AnyHalo::Nfw(Nfw::new(halo)),
            HaloKind::NfwDensity | HaloKind::NfwTriaxial => {
                AnyHalo::NfwEllipsoidal(NfwDensity::new(halo))
            }
            HaloKind::Logarithmic => AnyHalo::Logarithmic(Logarithmic::new(halo)),
        };
        Called(GalaxyPotential {
            halo,
            baryons,
            has_baryons,
        })
    }

    #[inline(always)]
    fn parts<S: Scalar>(Called(galaxy): &Self::In<S>) -> HostParts<S> {
        let (kind, halo) = match &galaxy.halo {
            AnyHalo::Nfw(halo) => (HaloKind::Nfw, Nfw::parameters(halo)),
            AnyHalo::NfwEllipsoidal(halo) => (HaloKind::NfwTriaxial, NfwDensity::parameters(halo)),
            AnyHalo::Logarithmic(halo) => (HaloKind::Logarithmic, Logarithmic::parameters(halo)),
        };
        HostParts {
            kind,
            halo,
            baryons: galaxy.baryons,
            has_baryons: galaxy.has_baryons,
        }
    }

    #[inline(always)]
    fn broadcast<S: Scalar>(Called(galaxy): &Self::In<f64>) -> Self::In<S> {
        let halo = match &galaxy.halo {
            AnyHalo::Nfw(halo) => AnyHalo::Nfw(<Nfw as Halo>::broadcast(halo)),
            AnyHalo::NfwEllipsoidal(halo) => {
                AnyHalo::NfwEllipsoidal(<NfwDensity as Halo>::broadcast(halo))
            }
            AnyHalo::Logarithmic(halo) => {
                AnyHalo::Logarithmic(<Logarithmic as Halo>::broadcast(halo))
            }
        };
        Called(GalaxyPotential {
            halo,
            baryons: galaxy.baryons.map(S::from_f64),
            has_baryons: galaxy.has_baryons,
        })
    }

    #[inline(always)]
    fn vjp<S: Scalar>(
        Called(galaxy): &Self::In<S>,
        x: Vec3<S>,
        lambda: Vec3<S>,
        cotangent: &mut HostCotangent<S>,
    ) -> (Vec3<S>, Vec3<S>) {
        S::call(Reverse {
            galaxy,
            x,
            lambda,
            cotangent,
        })
    }

    fn log10_m200(kind: HaloKind, log10_mass: f64, r_s: f64) -> f64 {
        match kind {
            HaloKind::Nfw => <Nfw as Halo>::log10_m200(log10_mass, r_s),
            HaloKind::NfwDensity | HaloKind::NfwTriaxial => {
                <NfwDensity as Halo>::log10_m200(log10_mass, r_s)
            }
            HaloKind::Logarithmic => <Logarithmic as Halo>::log10_m200(log10_mass, r_s),
        }
    }
}

/// The reverse mode of the acceleration as a subroutine.
struct Reverse<'a, S: Scalar> {
    galaxy: &'a GalaxyPotential<S>,
    x: Vec3<S>,
    lambda: Vec3<S>,
    cotangent: &'a mut HostCotangent<S>,
}

impl<S: Scalar> Subroutine for Reverse<'_, S> {
    type Output = (Vec3<S>, Vec3<S>);

    #[inline(always)]
    fn run(self) -> (Vec3<S>, Vec3<S>) {
        let Self {
            galaxy,
            x,
            lambda,
            cotangent:
                HostCotangent {
                    halo: of_halo,
                    baryons,
                },
        } = self;
        let (a, x_bar) = match &galaxy.halo {
            AnyHalo::Nfw(halo) => <Nfw as Halo>::vjp(halo, x, lambda, of_halo),
            AnyHalo::NfwEllipsoidal(halo) => <NfwDensity as Halo>::vjp(halo, x, lambda, of_halo),
            AnyHalo::Logarithmic(halo) => <Logarithmic as Halo>::vjp(halo, x, lambda, of_halo),
        };
        if galaxy.has_baryons {
            let (of_baryons, of_baryons_bar) = galaxy.baryons.vjp(x, lambda, baryons);
            (a + of_baryons, x_bar + of_baryons_bar)
        } else {
            (a, x_bar)
        }
    }
}
