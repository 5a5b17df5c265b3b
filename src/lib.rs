//! The shapes of dark-matter haloes from the projected tracks of stellar streams.
//!
//! A satellite that orbits a galaxy loses stars through two points, one on the side of the galaxy and one on the far
//! side. The first run ahead, the others fall behind, and together they draw a **stream** across the sky. Around other
//! galaxies this drawing is all there is to see: one projected radius at each angle from the satellite, a **track**.
//! How it winds depends on the halo's flattening q, the ratio of its axes (Chemaly et al. 2026).
//!
//! From thirteen parameters to a track:
//!
//! ```
//! use oblate::params::{PriorSettings, StreamParams, StreamPrior};
//! use oblate::stream::{Particles, StepSchedules, System, Model, ModelSettings};
//! use oblate::track::{BinEdges, Track};
//!
//! # fn main() -> oblate::Result<()> {
//! let params = StreamParams::from_array([
//!     12.0, 15.0, 0.3, 0.0, 1.2, // halo: log10 mass, scale radius, shape vector (its length is q, its direction the axis)
//!     8.0, 1.0, // progenitor: log10 mass, scale radius
//!     60.0, 30.0, 30.0, 140.0, 45.0, 3.0, // where it is today (kpc, km/s), and its stream's age (Gyr)
//! ]);
//! let prior = StreamPrior::new(&PriorSettings::default())?;
//! prior.check_inside(&params)?;
//! let model = Model::new(&ModelSettings::default())?;
//! let galaxy = System::from_params(&params, prior.q_range());
//! let setup = model.setup(&galaxy).map_err(oblate::Error::NoTrack)?;
//! let (mut flights, mut stars) = (StepSchedules::default(), Particles::default());
//! model.integrate(&setup, &mut flights, &mut stars).map_err(oblate::Error::NoTrack)?;
//! let track = Track::of(&stars, 10.0, BinEdges::default(), 0.01 * stars.len() as f64);
//! assert!(track.bins.len() > 5);
//! assert!(track.bins.iter().all(|bin| (10.0..100.0).contains(&bin.r_kpc)));
//! # Ok(())
//! # }
//! ```
//!
//! # Rooms
//!
//! A walk with the data; each room may only use the ones before it.
//!
//! | room | what it holds |
//! |---|---|
//! | [`error`] | [`Error`]: this run cannot go on; [`Rejection`]: this point has no track; [`Tally`]: it went on, but count it |
//! | [`units`] | kpc, solar masses, Gyr; km/s at the doors; the one value of G |
//! | [`scalar`] | what physics may ask of a number, and the numbers: `f64`, lanes of it, duals |
//! | [`params`] | the thirteen parameters, their prior, their coordinates, their symmetries |
//! | [`potential`] | halo, progenitor, discs, and sums of them |
//! | [`orbit`] | the progenitor's dense orbit, a particle's leapfrog, and its reverse |
//! | [`spray`] | where, when and how stars leave |
//! | [`stream`] | host, progenitor and releases in, present-day particles out; the gradient backwards |
//! | [`track`] | from particles to one radius per angle |
//! | [`data`] | observed tracks, read and checked, and mocks with their selection |
//! | [`likelihood`] | from parameters to ln L, and its exact gradient |
//! | [`posterior`] | weighted draws with names, their summary, and the files that keep both |
//! | [`inference`] | a fit: the posterior as a target of [`oblate_samplers`], its settings and its diagnostics |
//! | [`population`] | many posteriors of q reweighted into one population |
//! | [`report`] | figures, tables, one page |
//! | [`config`] | the settings files |
//! | [`run`] | a run folder, the work that fills it, and studies of many |
//! | [`cli`] | the command, one file per verb |
#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::print_stdout
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
pub use inference::{Fit, FitSettings, fit};
pub use oblate_samplers as samplers;
