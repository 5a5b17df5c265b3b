//! One binary for the integration tests; each module mirrors a room of `src`.
#![allow(
    clippy::cast_possible_truncation,
    reason = "tests cast small counts of their own"
)]

mod arrows;
mod cli;
mod data;
mod gala;
mod golden;
mod inference;
mod ks;
mod likelihood;
mod orbit;
mod params;
mod population;
mod posterior;
mod potential;
// The reader of import orders lives with the samplers, which must not depend on this crate.
mod report;
#[path = "../../samplers/tests/integration/rooms.rs"]
mod rooms;
mod run;
mod runs;
mod spray;
mod stream;
mod track;
