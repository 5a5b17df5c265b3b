//! Settings of mocks: their stream, the noise of their data, and the criteria that they meet.

use super::mock_stars::{MockStars, VELOCITY_NOISES_KM_S};
use super::observed::RADII_KPC;
use super::q_population::QPopulation;
use crate::error::{Error, Result};
use crate::params::StreamPrior;
use crate::spray::{SamplingScheme, TableSettings};
use crate::stream::ModelSettings;
use crate::track::{ANGLES_DEG, BIN_WIDTHS_DEG};
use oblate_samplers::limits::in_range;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};
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
            population.check()?;
        }
        Ok(())
    }
}

impl MockSettings {
    /// Checks that a prior has the number of stars, if there are densities.
    ///
    /// # Errors
    /// [`Error::Setting`] if it has not.
    pub(super) fn check_prior(&self, prior: &StreamPrior) -> Result<()> {
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

/// Seed of the mocks' table of releases; no default of a fit has it.
const MOCK_TABLE_SEED: u64 = 0x6d6f_636b;
