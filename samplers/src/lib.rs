//! Nested sampling and non-reversible parallel tempering with Hamiltonian Monte Carlo (HMC), on one [`Target`] and with
//! one result type, [`Run`].
//!
//! A problem is a log-likelihood over a product prior ([`Prior`]). Both samplers use the prior only through unit
//! coordinates: nested sampling through the cube `u`, tempering through standard normals `z = Φ⁻¹(u)`, so that they
//! need no bounds of the prior and can use the same target.
//!
//! Every random number comes from a counter-based stream keyed by (seed, purpose, task, index) ([`rng`]), work is
//! mapped in order over threads, and reductions are serial: one seed gives the same bits on any number of threads.
//!
//! An example of a target and its evidence:
//!
//! ```
//! use oblate_samplers::control::{Control, Silent};
//! use oblate_samplers::{Marginal, Outcome, Prior, Target, nested};
//!
//! /// A likelihood of independent standard normals, over any prior.
//! struct Bell(Prior);
//!
//! impl Target for Bell {
//!     fn prior(&self) -> &Prior {
//!         &self.0
//!     }
//!     fn ln_likelihood(&self, theta: &[f64]) -> Outcome {
//!         let ln_pdf = |x: &f64| -0.5 * x * x - oblate_samplers::normal::LN_SQRT_2PI;
//!         Outcome::Value(theta.iter().map(ln_pdf).sum())
//!     }
//! }
//!
//! # fn main() -> oblate_samplers::Result<()> {
//! let wide = Marginal::Uniform { lo: -10.0, hi: 10.0 };
//! let bell = Bell(Prior::new([("x", "kpc", wide), ("y", "kpc", wide)])?);
//! let run = nested::run(&bell, &nested::Settings::default(), 1, &mut Control::new(&mut Silent))?;
//! // Both normals lie inside the box, whose density is 1/400.
//! assert!((run.evidence.ln_z + 400_f64.ln()).abs() < 4.0 * run.evidence.error);
//! assert!(run.converged(), "{:?}", run.checks);
//! # Ok(())
//! # }
//! ```
//!
//! Modules, each of which may only import the ones before it: [`limits`], [`error`], [`normal`], [`rng`], single precision, [`target`],
//! [`files`], [`read`], checks of states, [`checkpoint`], [`output`], [`control`], checkpointing and clocks, [`diagnostics`], [`difference_pool`],
//! [`smc_weights`], mixtures, [`surrogate`], then the samplers: [`hmc`], [`nested`] and
//! [`pt`], and [`bridge`], the SMC bridge from a finished run to a finer likelihood.
#![cfg_attr(
    test,
    allow(
        clippy::cast_possible_truncation,
        reason = "tests cast small counts of their own"
    )
)]
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::print_stdout,
        clippy::print_stderr
    )
)]

mod autoregressive;
#[cfg(test)]
mod bent;
pub mod bridge;
pub mod checkpoint;
mod checkpointer;
pub mod control;
mod cpu_clock;
pub mod diagnostics;
pub mod difference_pool;
pub mod error;
pub mod files;
pub mod hmc;
pub mod limits;
mod mixture;
pub mod nested;
pub mod normal;
pub mod output;
pub mod pt;
pub mod read;
pub mod rng;
mod single;
pub mod smc_weights;
pub mod surrogate;
pub mod target;
mod valid;

pub use control::{Budget, Control, Event, Observer};
pub use error::{Error, Result};
pub use output::Run;
pub use target::{Cause, Marginal, Outcome, Prior, Symmetry, Target};

/// The example of the README is compiled and run as a documentation test.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
