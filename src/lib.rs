//! The shapes of dark-matter haloes from the projected tracks of stellar streams.
//!
//! A satellite galaxy that orbits a larger one loses stars near two points, on the side of the host and on the far side. These stars
//! form a **stream** of two tails, one ahead of the satellite and one behind it. Around other galaxies a stream is seen only in
//! projection: its mean projected radius at each angle from the satellite is its **track**. The shape of the track depends on the
//! flattening q of the halo, its axis ratio (Chemaly et al. 2026).
//!
//! From thirteen parameters to a track:
//!
//! ```
//! use oblate::params::StreamParams;
//! use oblate::stream::{Model, ModelSettings};
//!
//! # fn main() -> oblate::Result<()> {
//! let params = StreamParams::from([
//!     12.0, 15.0, 0.3, 0.0, 1.2, // halo: log10 of its mass in Msun, scale radius in kpc, shape vector (gives q and the axis)
//!     8.0, 1.0, // progenitor: log10 of its mass in Msun, scale radius in kpc
//!     60.0, 30.0, 30.0, 140.0, 45.0, // its position x, z in kpc and its velocity in km/s today
//!     3.0, // time since the first star left, in Gyr
//! ]);
//! let model = Model::new(&ModelSettings::default())?; // once for many streams
//! let track = model.stream(&params)?.track(10.0)?; // bins of 10 degrees
//! for bin in &track.bins {
//!     println!("{:6.1} deg: {:5.1} +- {:.1} kpc", bin.phi_deg, bin.r_kpc, bin.r_err_kpc);
//! }
//! assert!(track.bins.len() > 5);
//! assert!(track.bins.iter().all(|bin| (10.0..100.0).contains(&bin.r_kpc)));
//! # Ok(())
//! # }
//! ```
//!
//! From a track to the posterior of q and the other parameters:
//!
//! ```no_run
//! use oblate::{FitSettings, data::ObservedTrack};
//! use std::path::Path;
//!
//! # fn main() -> oblate::Result<()> {
//! let track = ObservedTrack::read(Path::new("track.ecsv"))?;
//! let fit = oblate::fit(&track, &FitSettings::default())?;
//! println!("{}", fit.summary);
//! # Ok(())
//! # }
//! ```
//!
//! The folder `examples` has three programs: a stream, a fit, a population.
//!
//! # Modules
//!
//! Each module uses only the modules above it in this table.
//!
//! | module | contents |
//! |---|---|
//! | [`error`] | [`Error`], [`Rejection`] of a parameter set, [`Tally`] of approximations |
//! | [`units`] | kpc, Msun, Gyr, and the conversion from km/s |
//! | [`scalar`] | the traits of the number types `f64`, SIMD lanes and dual numbers |
//! | [`params`] | the parameters, their prior and their symmetries |
//! | [`potential`] | halo and progenitor, and how to add a halo |
//! | [`orbit`] | the progenitor's orbit, the leapfrog of a particle, and its adjoint |
//! | [`spray`] | where, when and how fast stars leave |
//! | [`stream`] | particles today, and gradients in reverse mode |
//! | [`track`] | from particles to one radius per angle |
//! | [`data`] | observed tracks and mock tracks |
//! | [`likelihood`] | ln L of a track, and its exact gradient |
//! | [`posterior`] | weighted draws, their summary, and their files |
//! | [`inference`] | fits: the posterior as a target of [`samplers`], settings, diagnostics |
//! | [`population`] | the distribution of q over many haloes |
//! | [`report`] | figures, tables, one page |
//! | [`config`] | settings files |
//! | [`run`] | run folders, and studies of many runs |
//! | [`cli`] | the command, one file per subcommand |
#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::print_stdout,
    clippy::print_stderr
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
pub use oblate_samplers::{Budget, Control, Event, Observer, Run};
