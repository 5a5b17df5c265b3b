//! The kernels of a stream, compiled for one kind of host.

use super::integrate::{IntegrateKernel, integrate};
use super::integrate_vjp::{VjpKernel, integrate_vjp};
use super::progenitor_solution_vjp::{SolutionVjpKernel, progenitor_solution_vjp};
use super::system::SYSTEM_LEN;
use crate::potential::{Galaxy, Host, Nfw};
use crate::scalar::Level;

/// The kernels of a stream in one kind of host, for every instruction set.
pub struct Kernels<H: Host> {
    pub(super) integrate: fn(IntegrateKernel<'_, H>, Level) -> f64,
    pub(super) integrate_vjp: fn(VjpKernel<'_, H>, Level),
    pub(super) progenitor_solution_vjp: fn(SolutionVjpKernel<'_, H>, Level) -> [f64; SYSTEM_LEN],
}

impl<H: Host> Kernels<H> {
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

impl<H: Host> Default for Kernels<H> {
    fn default() -> Self {
        Self::new()
    }
}

/// A kind of host whose kernels have been compiled.
///
/// The kernels are large. A `static` holds them, so that they are compiled once, in the crate of the host, and not again in each
/// crate that uses it:
///
/// ```
/// # use oblate::potential::{FlattenedNfw, Halo, HaloParameters, Nfw};
/// # use oblate::scalar::Scalar;
/// use oblate::stream::{CompiledHost, Kernels};
/// # #[derive(Clone, Copy, Debug, Default)]
/// # struct Mine;
/// # impl Halo for Mine {
/// #     type In<S: Scalar> = FlattenedNfw<S>;
/// #     fn new<S: Scalar>(p: HaloParameters<S>) -> FlattenedNfw<S> {
/// #         FlattenedNfw::from_flattening(p.mass, p.r_s, p.flattening, p.axis)
/// #     }
/// #     fn parameters<S: Scalar>(h: &FlattenedNfw<S>) -> HaloParameters<S> {
/// #         Nfw::parameters(h)
/// #     }
/// # }
///
/// impl CompiledHost for Mine {
///     fn kernels() -> &'static Kernels<Self> {
///         static KERNELS: Kernels<Mine> = Kernels::new();
///         &KERNELS
///     }
/// }
/// ```
pub trait CompiledHost: Host {
    /// The kernels of this kind of host, from a `static`.
    fn kernels() -> &'static Kernels<Self>;
}

/// Compiles the kernels of a kind of host in this crate.
macro_rules! compile_host {
    ($host:ty) => {
        impl CompiledHost for $host {
            fn kernels() -> &'static Kernels<Self> {
                static KERNELS: Kernels<$host> = Kernels::new();
                &KERNELS
            }
        }
    };
}

compile_host!(Nfw);
compile_host!(Galaxy);
