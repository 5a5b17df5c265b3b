//! Mock tracks with known truth: prior draws that meet the paper's three criteria (Chemaly et al. 2026, section 3;
//! docs/physics.md, section 11).

use super::ObservedTrack;
use super::extent::length_kpc;
use super::measured::Measured;
use super::mock_stars::{MockStars, VELOCITY_NOISES_KM_S};
use super::observed::{NUMBERS_OF_BINS, RADII_KPC};
use crate::error::{Error, Result};
use crate::params::{StreamParams, StreamPrior};
use crate::scalar::Vec3;
use crate::spray::{SamplingScheme, TableSettings};
use crate::stream::{Model, ModelSettings, Particles, StreamInput, Threads, Workspace};
use crate::track::{ANGLES_DEG, BIN_WIDTHS_DEG, BinEdges, BinQuantity, Track, TrackBin};
use oblate_samplers::limits::{MAX_SEED, in_range};
use oblate_samplers::normal::quantile;
use oblate_samplers::rng::{Domain, RandomStream, standard_normal, stream, unit_open};
use rayon::prelude::*;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};
use std::ops::RangeInclusive;
use toml::Table;

/// How mocks are made and which are kept.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MockSettings {
    /// The stream. Its table of releases has a seed of its own, so that mocks and fits do not have the same release noise.
    #[serde(deserialize_with = "over_the_mock_model")]
    pub model: ModelSettings,
    /// Bin width in degrees.
    pub bin_width_deg: f64,
    /// Relative Gaussian noise of each bin's radius.
    pub noise: f64,
    /// Whether errors have the standard error of a mean over so many stars besides the noise. Without it, as in the paper, the errors of wide
    /// bins with few stars are too small.
    pub star_scatter: bool,
    /// A bin is kept with at least this fraction of the particles (100 of 10,000).
    pub min_fraction: f64,
    /// Minimum angle that the kept bins cover, degrees.
    pub min_angle_deg: f64,
    /// Minimum length of the projected track, kpc.
    pub min_length_kpc: f64,
    /// Range that all radii must lie in, kpc.
    pub radii_kpc: (f64, f64),
    /// Gaussian noise of a mean line-of-sight velocity in every bin, km/s; none: no velocities.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub velocity_noise_km_s: Option<f64>,
    /// Relative Gaussian noise of a width in every bin; none: no widths.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub width_noise: Option<f64>,
    /// Relative Gaussian noise of a density in every bin; none: no densities.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub density_noise: Option<f64>,
    /// Single stars with line-of-sight velocities; none: no such stars.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stars: Option<MockStars>,
    /// Draw q from this population instead of the prior.
    pub population: Option<QPopulation>,
}

/// A Gaussian population of q, or two of the same width and weight; truncated to the prior's range.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct QPopulation {
    /// Mean of the Gaussian.
    pub mu: f64,
    /// Mean of the other one, from which half of the streams are drawn, if there are two.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub other_mu: Option<f64>,
    /// Standard deviation.
    pub sigma: f64,
}

impl QPopulation {
    /// One Gaussian.
    #[must_use]
    pub fn gaussian(mu: f64, sigma: f64) -> Self {
        Self {
            mu,
            other_mu: None,
            sigma,
        }
    }

    /// The q between `lo` and `hi` of a uniform number, which also chooses among two Gaussians.
    fn q(&self, lo: f64, hi: f64, uniform: f64) -> f64 {
        match self.other_mu {
            Some(other) if uniform >= 0.5 => {
                truncated(other, self.sigma, (lo, hi), 2.0 * uniform - 1.0)
            }
            Some(_) => truncated(self.mu, self.sigma, (lo, hi), 2.0 * uniform),
            None => truncated(self.mu, self.sigma, (lo, hi), uniform),
        }
    }
}

/// The model of mocks.
fn mock_model() -> ModelSettings {
    let releases = TableSettings {
        particles: 10_000,
        sampling_scheme: SamplingScheme::Random,
        seed: MOCK_TABLE_SEED,
        ..TableSettings::default()
    };
    ModelSettings {
        releases,
        ..ModelSettings::default()
    }
}

/// Reads the keys of a model that are given and takes the others from the model of mocks, not from that of fits.
fn over_the_mock_model<'de, D: Deserializer<'de>>(
    source: D,
) -> std::result::Result<ModelSettings, D::Error> {
    let given = Table::deserialize(source)?;
    let mut all = Table::try_from(mock_model()).map_err(D::Error::custom)?;
    for (key, value) in given {
        match (all.get_mut("releases"), value) {
            (Some(toml::Value::Table(releases)), toml::Value::Table(given))
                if key == "releases" =>
            {
                releases.extend(given);
            }
            (_, value) => {
                all.insert(key, value);
            }
        }
    }
    all.try_into().map_err(D::Error::custom)
}

impl Default for MockSettings {
    fn default() -> Self {
        Self {
            model: mock_model(),
            bin_width_deg: 10.0,
            noise: 0.02,
            star_scatter: true,
            min_fraction: 0.01,
            min_angle_deg: 90.0,
            min_length_kpc: 100.0,
            radii_kpc: (10.0, 500.0),
            velocity_noise_km_s: None,
            width_noise: None,
            density_noise: None,
            stars: None,
            population: None,
        }
    }
}

impl MockSettings {
    /// Checks every number by itself, those of the model too: the ranges of docs/limits.md.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] with the first one that is out of its range; [`Error::Setting`] for radii of which the first is not the
    /// smaller one.
    pub fn check(&self) -> Result<()> {
        self.model.check()?;
        in_range("bin_width_deg", self.bin_width_deg, BIN_WIDTHS_DEG)?;
        in_range("noise", self.noise, 0.0..=0.5)?;
        in_range("min_fraction", self.min_fraction, 0.0..=1.0)?;
        in_range(
            "min_angle_deg",
            self.min_angle_deg,
            0.0..=2.0 * ANGLES_DEG.end(),
        )?;
        in_range(
            "min_length_kpc",
            self.min_length_kpc,
            0.0..=*RADII_KPC.end(),
        )?;
        let (lo, hi) = self.radii_kpc;
        for radius in [lo, hi] {
            in_range("radii_kpc", radius, RADII_KPC)?;
        }
        if lo >= hi {
            return Err(Error::Setting {
                key: "radii_kpc".to_owned(),
                value: format!("[{lo:?}, {hi:?}]"),
                remedy: "give the smaller one first".to_owned(),
            });
        }
        if let Some(noise) = self.velocity_noise_km_s {
            in_range("velocity_noise_km_s", noise, VELOCITY_NOISES_KM_S)?;
        }
        if let Some(noise) = self.width_noise {
            in_range("width_noise", noise, 0.001..=1.0)?;
        }
        if let Some(noise) = self.density_noise {
            in_range("density_noise", noise, 0.001..=1.0)?;
        }
        if let Some(stars) = self.stars {
            stars.check()?;
        }
        if let Some(population) = self.population {
            let QPopulation {
                mu,
                other_mu,
                sigma,
            } = population;
            in_range("population.mu", mu, -100.0..=100.0)?;
            in_range(
                "population.other_mu",
                other_mu.unwrap_or(mu),
                -100.0..=100.0,
            )?;
            in_range("population.sigma", sigma, 0.0..=100.0)?;
        }
        Ok(())
    }
}

impl MockSettings {
    /// Checks that a prior has the number of stars, if there are densities.
    ///
    /// # Errors
    /// [`Error::Setting`] if it has not.
    fn check_prior(&self, prior: &StreamPrior) -> Result<()> {
        if self.density_noise.is_some() && !prior.has("log10_n_stars") {
            return Err(Error::Setting {
                key: "density_noise".to_owned(),
                value: "given".to_owned(),
                remedy: "give the settings of a fit whose prior has log10_n_stars, the number of stars of the stream"
                    .to_owned(),
            });
        }
        Ok(())
    }
}

/// Allowed numbers of mocks.
pub const NUMBERS_OF_MOCKS: RangeInclusive<usize> = 1..=100_000;

/// Seed of the mocks' table of releases; no default of a fit has it.
const MOCK_TABLE_SEED: u64 = 0x6d6f_636b;

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
/// Those of [`MockSettings::check`] and [`ModelSettings::check_distributions`];
/// [`Error::OutOfRange`] for a `count` that is none of [`NUMBERS_OF_MOCKS`]; [`Error::TooMuchMemory`] by the
/// estimate of [`ModelSettings::memory`] for the threads of the present rayon pool; [`Error::TooFewMocks`] if too few draws meet the
/// criteria.
pub fn mocks(
    prior: &StreamPrior,
    settings: &MockSettings,
    count: usize,
    seed: u64,
) -> Result<Mocks> {
    mocks_with(prior, settings, count, seed, &mut |_| ())
}

/// As [`mocks`]; `advanced` is told the mocks so far while more are searched.
///
/// # Errors
/// As of [`mocks`].
pub fn mocks_with(
    prior: &StreamPrior,
    settings: &MockSettings,
    count: usize,
    seed: u64,
    advanced: &mut dyn FnMut(&Mocks),
) -> Result<Mocks> {
    settings.check()?;
    in_range("count", count, NUMBERS_OF_MOCKS)?;
    in_range("seed", seed, 0..=MAX_SEED)?;
    settings
        .model
        .memory(rayon::current_num_threads())
        .check()?;
    settings.model.check_distributions(prior)?;
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
        advanced(&found);
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

/// The quantile `u` of a truncated Gaussian, computed from the side of the tail.
fn truncated(mu: f64, sigma: f64, (lo, hi): (f64, f64), u: f64) -> f64 {
    use oblate_samplers::normal::{cdf, sf};
    if sigma <= 0.0 {
        return mu.clamp(lo, hi.next_down());
    }
    let (a, b) = ((lo - mu) / sigma, (hi - mu) / sigma);
    let q = if a > 0.0 {
        mu - sigma * quantile(sf(a) + u * (sf(b) - sf(a)))
    } else {
        mu + sigma * quantile(cdf(a) + u * (cdf(b) - cdf(a)))
    };
    // Beyond 38 sigmas the probability is 0 in doubles; then all of it is put at the nearer end.
    let q = if q.is_finite() { q } else { mu };
    q.clamp(lo, hi.next_down())
}
