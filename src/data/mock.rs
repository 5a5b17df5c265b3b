//! Mock tracks with known truth: prior draws that meet the paper's three criteria (Chemaly et al. 2026, section 3;
//! docs/physics.md, section 11).

use super::ObservedTrack;
use super::extent::length_kpc;
use super::measured::Measured;
use super::mock_settings::MockSettings;
use super::observed::NUMBERS_OF_BINS;
use super::q_population::QPopulation;
use crate::error::{Error, Result};
use crate::params::{StreamParams, StreamPrior};
use crate::scalar::Vec3;
use crate::stream::{Model, Particles, StreamInput, Threads, Workspace};
use crate::track::{BinEdges, BinQuantity, Track, TrackBin};
use oblate_samplers::Error as SamplerError;
use oblate_samplers::limits::{MAX_SEED, in_range};
use oblate_samplers::rng::{Domain, RandomStream, standard_normal, stream, unit_open};
use rayon::prelude::*;
use std::ops::{ControlFlow, RangeInclusive};

/// Allowed numbers of mocks.
pub const NUMBERS_OF_MOCKS: RangeInclusive<usize> = 1..=100_000;

/// Maximum number of prior draws per mock.
const MAX_TRIES: u64 = 20_000;

/// Number of draws that are computed together.
const BATCH: u64 = 64;

/// A mock track and what made it.
#[derive(Clone, Debug)]
pub struct Mock {
    /// The noisy track, its truth in the header.
    pub track: ObservedTrack,
    /// The true parameters, in the order and units of [`PARAMETERS`](crate::params::PARAMETERS).
    pub params: StreamParams<f64>,
    /// The axis ratio of its halo.
    pub q: f64,
    /// Length of the noiseless projected track, kpc.
    pub length_kpc: f64,
}

/// Mocks, and how many draws they took.
#[derive(Clone, Debug)]
pub struct Mocks {
    /// Those that met the criteria, in order of the draws.
    pub mocks: Vec<Mock>,
    /// Draws of the prior up to the last accepted one.
    pub tried: u64,
}

impl Mocks {
    /// Fraction of draws that met the criteria.
    #[must_use]
    pub fn acceptance(&self) -> f64 {
        self.mocks.len() as f64 / self.tried.max(1) as f64
    }
}

/// The criterion that a draw fails.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Cut {
    NoStream,
    Angle,
    Length,
    Radius,
}

/// `count` mocks: draw number i of `seed` is the same whatever else is drawn, and on any number of threads.
///
/// # Errors
/// Those of [`MockSettings::check`] and [`ModelSettings::check_distributions`](crate::stream::ModelSettings::check_distributions);
/// [`Error::OutOfRange`] for a `count` that is none of [`NUMBERS_OF_MOCKS`]; [`Error::TooMuchMemory`] by the
/// estimate of [`ModelSettings::memory`](crate::stream::ModelSettings::memory) for the threads of the present rayon pool; [`Error::TooFewMocks`] if too few draws meet the
/// criteria.
pub fn mocks(
    prior: &StreamPrior,
    settings: &MockSettings,
    count: usize,
    seed: u64,
) -> Result<Mocks> {
    mocks_with(prior, settings, count, seed, &mut |_| {
        ControlFlow::Continue(())
    })
}

/// As [`mocks`]; `advanced` is told the mocks so far while more are searched, and can stop the search by `Break`.
///
/// # Errors
/// As of [`mocks`]; [`SamplerError::Interrupted`] if `advanced` stops it.
pub fn mocks_with(
    prior: &StreamPrior,
    settings: &MockSettings,
    count: usize,
    seed: u64,
    advanced: &mut dyn FnMut(&Mocks) -> ControlFlow<()>,
) -> Result<Mocks> {
    settings.check()?;
    in_range("count", count, NUMBERS_OF_MOCKS)?;
    in_range("seed", seed, 0..=MAX_SEED)?;
    settings
        .model
        .memory(rayon::current_num_threads())
        .check()?;
    settings.model.check_distributions(prior)?;
    prior.check_sides()?;
    settings.check_prior(prior)?;
    let model = Model::new(&settings.model)?;
    let mut found = Mocks {
        mocks: Vec::new(),
        tried: 0,
    };
    let mut first = 0;
    while found.mocks.len() < count {
        if first >= MAX_TRIES * (found.mocks.len() as u64 + 1) {
            return Err(Error::TooFewMocks {
                tries: first,
                found: found.mocks.len(),
            });
        }
        let batch: Vec<(u64, std::result::Result<Mock, Cut>)> = (first..first + BATCH)
            .into_par_iter()
            .map(|i| {
                let drawn = draw(prior, settings, &model, seed, i);
                (i, drawn.map(|drawn| measured(drawn, settings)))
            })
            .collect();
        for (i, outcome) in batch {
            if let Ok(mock) = outcome
                && found.mocks.len() < count
            {
                found.mocks.push(mock);
                found.tried = i + 1;
            }
        }
        first += BATCH;
        if advanced(&found).is_break() {
            return Err(SamplerError::Interrupted.into());
        }
    }
    Ok(found)
}

/// A draw of the prior that meets the criteria: its stream with measured radii.
struct Drawn {
    mock: Mock,
    particles: Particles,
    /// The track of the particles.
    track: Track,
    /// What the noise of further data is drawn from.
    rng: RandomStream,
}

/// Draw number `index`, with radii alone.
fn draw(
    prior: &StreamPrior,
    settings: &MockSettings,
    model: &Model,
    seed: u64,
    index: u64,
) -> std::result::Result<Drawn, Cut> {
    let mut rng = stream(seed, Domain::Prior, 1, index);
    let mut params = prior.draw(&mut rng);
    let mut q = prior.shape(&params).q;
    // Both are drawn always, so that the noise of a draw does not depend on the population.
    let uniform = unit_open(&mut rng);
    if let Some(population) = settings.population {
        let (lo, hi) = (prior.settings().q_min, prior.settings().q_max);
        q = population.q(lo, hi, uniform);
        let dir: Vec3<f64> = prior
            .q_range()
            .dir(q, prior.shape(&params).axis)
            .map_err(|_| Cut::NoStream)?;
        (params.dir_x, params.dir_y, params.dir_z) = (dir.x, dir.y, dir.z);
    }
    let input = StreamInput {
        params: &params,
        q_range: prior.q_range(),
        threads: Threads::One,
    };
    let mut work = Workspace::default();
    (model.particles(&input, &mut work)).map_err(|_| Cut::NoStream)?;
    let particles = work.particles;
    let min_n = settings.min_fraction * particles.len() as f64;
    let track = Track::from_checked(
        &particles,
        settings.bin_width_deg,
        0.0 - params.phi0_deg,
        BinEdges::Hard,
        min_n,
    )
    .measured_with(&params);
    let length_kpc = criteria(&track, settings)?;
    let phi: Vec<f64> = track.bins.iter().map(|b| b.phi_deg).collect();
    let noise = settings.noise.hypot(params.jitter);
    let r: Vec<f64> = track
        .bins
        .iter()
        .map(|b| b.r_kpc * (1.0 + noise * standard_normal(&mut rng)))
        .collect();
    let r_err: Vec<f64> = (r.iter().zip(&track.bins))
        .map(|(r, bin)| {
            let of_mean = if settings.star_scatter {
                bin.r_err_kpc
            } else {
                0.0
            };
            (settings.noise.max(1e-6) * r).hypot(of_mean)
        })
        .collect();
    let name = format!("mock_{seed}_{index}");
    let mut observed = ObservedTrack::new(&name, &phi, settings.bin_width_deg, &r, &r_err)
        .map_err(|_| Cut::Radius)?;
    observed.n = Some(track.bins.iter().map(|b| b.n).collect());
    observed.meta.insert("truth".to_owned(), truth(&params, q));
    let mock = Mock {
        track: observed,
        params,
        q,
        length_kpc,
    };
    Ok(Drawn {
        mock,
        particles,
        track,
        rng,
    })
}

/// The mock of a draw, with all data that the settings name.
fn measured(drawn: Drawn, settings: &MockSettings) -> Mock {
    let Drawn {
        mut mock,
        particles,
        track,
        mut rng,
    } = drawn;
    let observed = &mut mock.track;
    // After the radii, so that these have the same noise with and without other data.
    for quantity in BinQuantity::ALL {
        let noise_of = |bin: &TrackBin| match quantity {
            BinQuantity::Velocity => settings.velocity_noise_km_s,
            BinQuantity::Width => settings.width_noise.map(|noise| noise * bin.width_kpc),
            BinQuantity::Density => {
                (settings.density_noise).map(|noise| noise * bin.density_per_deg)
            }
        };
        let mut measure = |bin: &TrackBin| {
            let noise = noise_of(bin)?;
            let of_mean = if settings.star_scatter {
                bin.error(quantity)
            } else {
                0.0
            };
            let value = bin.value(quantity) + noise * standard_normal(&mut rng);
            let error = noise.hypot(of_mean);
            // Noise may leave a width that no file can have.
            let column = quantity.column();
            let possible = column.values.contains(&value) && column.errors.contains(&error);
            possible.then_some(Measured { value, error })
        };
        let rows: Vec<_> = track.bins.iter().map(&mut measure).collect();
        if rows.iter().any(Option::is_some) {
            observed.measured.insert(quantity, rows);
        }
    }
    if let Some(stars) = settings.stars {
        observed.stars = stars.draw(&particles, &mock.params, observed, &mut rng);
    }
    mock
}

/// Whether draw number `index` meets the criteria if its halo has this q.
pub(super) fn is_kept(
    prior: &StreamPrior,
    settings: &MockSettings,
    model: &Model,
    q: f64,
    seed: u64,
    index: u64,
) -> bool {
    let only_q = MockSettings {
        population: Some(QPopulation::gaussian(q, 0.0)),
        ..*settings
    };
    draw(prior, &only_q, model, seed, index).is_ok()
}

/// The true parameters for the header: a mapping of the names and q, without absent parameters.
fn truth(params: &StreamParams<f64>, q: f64) -> serde_json::Value {
    let mut map = serde_json::to_value(params).unwrap_or_default();
    map["q"] = q.into();
    map
}

/// The paper's three criteria; gives the length of the projected track.
fn criteria(track: &Track, settings: &MockSettings) -> std::result::Result<f64, Cut> {
    let angle = track.bins.len() as f64 * track.width_deg;
    if angle <= settings.min_angle_deg || !NUMBERS_OF_BINS.contains(&track.bins.len()) {
        return Err(Cut::Angle);
    }
    let bins = track.bins.iter();
    let (phi_deg, r_kpc): (Vec<f64>, Vec<f64>) = bins.map(|b| (b.phi_deg, b.r_kpc)).unzip();
    let length = length_kpc(&phi_deg, &r_kpc);
    if length <= settings.min_length_kpc {
        return Err(Cut::Length);
    }
    let (lo, hi) = settings.radii_kpc;
    if track.bins.iter().any(|b| !(b.r_kpc >= lo && b.r_kpc <= hi)) {
        return Err(Cut::Radius);
    }
    Ok(length)
}
