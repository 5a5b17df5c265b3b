//! One binary for the integration tests; each module mirrors a room of `src`.

mod data;
mod gala;
mod golden;
mod ks;
mod likelihood;
mod orbit;
mod params;
mod posterior;
mod potential;
mod report;
mod run;
mod runs;
mod spray;
mod stream;
mod track;
