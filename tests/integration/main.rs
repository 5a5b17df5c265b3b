//! One binary for the integration tests; each module mirrors a room of `src`.

mod gala;
mod golden;
mod ks;
mod likelihood;
mod orbit;
mod params;
mod population;
mod potential;
mod spray;
mod stream;
mod track;
