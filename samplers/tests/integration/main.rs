//! One binary for the crate's integration tests; each module mirrors a module of `src`.
#![allow(
    clippy::cast_possible_truncation,
    reason = "tests cast small counts of their own"
)]

mod arrows;
mod batch;
mod bridge;
mod calibration;
mod checkpoint;
mod exact;
mod files;
mod hmc;
mod modules;
mod nested;
mod pt;
#[allow(dead_code, reason = "some functions belong to the campaign")]
mod pulls;
mod stops;
mod targets;
