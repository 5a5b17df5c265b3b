//! The kernels of a stream, compiled for one kind of halo.

use super::integrate::{IntegrateKernel, integrate};
use super::integrate_vjp::{VjpKernel, integrate_vjp};
use super::progenitor_solution_vjp::{SolutionVjpKernel, progenitor_solution_vjp};
use super::system::SYSTEM_LEN;
use crate::potential::{Halo, Logarithmic, Nfw, NfwDensity};
use crate::scalar::Level;

/// The kernels of a stream in one kind of halo, for every instruction set.
pub struct Kernels<H: Halo> {
    pub(super) integrate: fn(IntegrateKernel<'_, H>, Level) -> f64,
    pub(super) integrate_vjp: fn(VjpKernel<'_, H>, Level),
    pub(super) progenitor_solution_vjp: fn(SolutionVjpKernel<'_, H>, Level) -> [f64; SYSTEM_LEN],
}

impl<H: Halo> Kernels<H> {
    /// The kernels, compiled in the crate that calls this function.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            integrate,
            integrate_vjp,
            progenitor_solution_vjp,
        }
    }
}

impl<H: Halo> Default for Kernels<H> {
    fn default() -> Self {
        Self::new()
    }
}

/// A kind of halo whose kernels have been compiled.
///
/// The kernels are large. A `static` holds them, so that they are compiled once, in the crate of the halo, and not again in each
/// crate that uses it:
///
/// ```
/// # use oblate::potential::{FlattenedNfw, Halo, HaloParameters};
/// # use oblate::scalar::Scalar;
/// use oblate::stream::{CompiledHalo, Kernels};
/// # #[derive(Clone, Copy, Debug, Default)]
/// # struct Mine;
/// # impl Halo for Mine {
/// #     type In<S: Scalar> = FlattenedNfw<S>;
/// #     fn new<S: Scalar>(p: HaloParameters<S>) -> FlattenedNfw<S> {
/// #         FlattenedNfw::from_flattening(p.mass, p.r_s, p.flattening, p.axis)
/// #     }
/// #     fn parameters<S: Scalar>(h: &FlattenedNfw<S>) -> HaloParameters<S> {
/// #         HaloParameters { mass: h.mass, r_s: h.r_s, flattening: h.flattening, axis: h.axis }
/// #     }
/// # }
///
/// impl CompiledHalo for Mine {
///     fn kernels() -> &'static Kernels<Self> {
///         static KERNELS: Kernels<Mine> = Kernels::new();
///         &KERNELS
///     }
/// }
/// ```
pub trait CompiledHalo: Halo {
    /// The kernels of this kind of halo, from a `static`.
    fn kernels() -> &'static Kernels<Self>;
}

/// Compiles the kernels of a kind of halo in this crate.
macro_rules! compile_halo {
    ($halo:ident) => {
        impl CompiledHalo for $halo {
            fn kernels() -> &'static Kernels<Self> {
                static KERNELS: Kernels<$halo> = Kernels::new();
                &KERNELS
            }
        }
    };
}

compile_halo!(Nfw);
compile_halo!(NfwDensity);
compile_halo!(Logarithmic);
