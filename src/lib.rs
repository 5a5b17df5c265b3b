//! The shapes of dark-matter haloes from the projected tracks of stellar streams.
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::print_stdout
    )
)]

pub mod cli;
pub mod config;
pub mod data;
pub mod error;
pub mod inference;
pub mod likelihood;
pub mod orbit;
pub mod params;
pub mod population;
pub mod posterior;
pub mod potential;
pub mod report;
pub mod run;
pub mod scalar;
pub mod spray;
pub mod stream;
pub mod track;
pub mod units;

pub use error::{Error, Rejection, Result, Tally};
