//! One binary for the integration tests; each module mirrors a module of `src`.
#![allow(
    clippy::cast_possible_truncation,
    reason = "tests cast small counts of their own"
)]

mod arrows;
mod baryons;
mod calibration;
mod cli;
mod codes;
mod commands;
mod config;
mod data;
mod families;
#[cfg(target_os = "linux")]
mod faults;
mod folders;
mod friction;
mod gala;
mod golden;
mod haloes;
mod inference;
mod ks;
mod likelihood;
mod limits;
mod mass_loss;
mod orbit;
mod orientation;
mod own_halo;
mod pages;
mod params;
mod population;
mod posterior;
mod potential;
// The reader of import orders lives with the samplers, which must not depend on this crate.
#[allow(dead_code, reason = "some functions belong to the other crate's tests")]
#[path = "../../samplers/tests/integration/files.rs"]
mod files;
#[path = "../../samplers/tests/integration/modules.rs"]
mod modules;
mod release_rate;
mod report;
mod run;
mod runs;
mod scalar;
mod spray;
mod stream;
mod tour;
mod track;
mod units;
