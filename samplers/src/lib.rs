//! Nested sampling and non-reversible parallel tempering with Hamiltonian moves, on one [`Target`] and with one
//! result type, [`Run`].
//!
//! A problem is a log-likelihood over a product prior ([`Prior`]). Both samplers see the prior only through unit
//! coordinates: nested sampling through the cube `u`, tempering through standard normals `z = Φ⁻¹(u)`, so that the
//! walls of a bounded prior vanish and the same target serves both.
//!
//! Every random number comes from a counter-based stream keyed by (seed, purpose, task, index) ([`rng`]), work is
//! mapped in order over threads, and reductions are serial: one seed gives the same bits on any number of threads.
//!
//! Rooms, each of which may only look at the ones before it: [`error`], [`normal`], [`rng`], [`target`],
//! [`output`], [`control`], [`checkpoint`], [`diagnostics`], then the samplers.
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::print_stdout
    )
)]

pub mod checkpoint;
pub mod control;
pub mod diagnostics;
pub mod error;
pub mod hmc;
pub mod nested;
pub mod normal;
pub mod output;
pub mod pt;
pub mod rng;
pub mod target;

pub use control::{Budget, Control, Event, Observer};
pub use error::{Error, Result};
pub use output::Run;
pub use target::{Cause, Marginal, Outcome, Prior, Symmetry, Target};
