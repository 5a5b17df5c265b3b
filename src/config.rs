//! The settings file: gathers each room's own settings; rooms never import it.

use crate::data::MockSettings;
use crate::error::{Error, Result};
use crate::inference::{Sampler, SamplerSettings};
use crate::likelihood::{Coverage, LikelihoodSettings};
use crate::params::PriorSettings;
use crate::population::{PopulationSettings, TruncatedGaussianSettings};
use crate::spray::{Design, TableSettings};
use crate::stream::ModelSettings;
use crate::track::BinEdges;
use serde::de::{DeserializeOwned, Error as _};
use serde::{Deserialize, Deserializer, Serialize};
use std::path::{Path, PathBuf};
use std::result::Result as StdResult;

/// Settings that together have a name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Profile {
    /// 2,560 linked Sobol particles, 120 steps per age, soft bins, a smooth penalty, the model's own noise beside the data's: for
    /// fits. The error of its tracks against 131,072 particles of 800 steps each is below that of [`Paper`](Self::Paper)
    /// for a quarter of its time: over 60 mocks and 4 tables 1.28 % (median) and 9.9 % (95 per cent) against 1.32 and 18 %
    /// (`cargo bench --bench noise`).
    #[default]
    Fast,
    /// The paper: 10,000 random particles, 100 uniform steps, a leapfrog orbit, hard bins, `reject`.
    Paper,
}

impl Profile {
    /// Its model.
    #[must_use]
    pub fn model(self) -> ModelSettings {
        match self {
            Self::Fast => ModelSettings::default(),
            Self::Paper => ModelSettings {
                releases: TableSettings {
                    particles: 10_000,
                    epochs: 100,
                    design: Design::Random,
                    ..TableSettings::default()
                },
                steps: 100,
                steps_per: crate::stream::StepsPer::Particle,
                step_rule: crate::stream::StepRule::Uniform,
                orbit: crate::orbit::OrbitMethod::Leapfrog,
                orbit_steps: 100,
                steps_per_turn: 0,
            },
        }
    }

    /// Its likelihood.
    #[must_use]
    pub fn likelihood(self) -> LikelihoodSettings {
        match self {
            Self::Fast => LikelihoodSettings::default(),
            Self::Paper => LikelihoodSettings {
                edges: BinEdges::Hard,
                coverage: Coverage::Reject,
                model_noise: false,
                ..LikelihoodSettings::default()
            },
        }
    }
}

/// Everything that decides a fit beside its data.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FitConfig {
    /// Master seed of the sampler.
    pub seed: u64,
    /// The stream.
    pub model: ModelSettings,
    /// Its comparison with the data.
    pub likelihood: LikelihoodSettings,
    /// The prior.
    pub prior: PriorSettings,
    /// Particles of the coarse model that a fit begins with, by either sampler, to be refined to the model itself; 0: none. A model
    /// with less than twice as many, and one whose likelihood is zero where the track is not covered, is fitted at once.
    pub coarse_particles: usize,
    /// The samplers.
    #[serde(deserialize_with = "over_those_of_streams")]
    pub sampling: SamplerSettings,
}

impl Default for FitConfig {
    fn default() -> Self {
        Self {
            seed: 1,
            model: ModelSettings::default(),
            likelihood: LikelihoodSettings::default(),
            prior: PriorSettings::default(),
            coarse_particles: 512,
            sampling: sampling_of_streams(),
        }
    }
}

/// Steps of the dense orbit of a coarse model, at most: twice as many take a fifth of its time, and it is no better.
const COARSE_ORBIT_STEPS: usize = 128;

/// Residual of a missing bin of a coarse model, in sigma, at most: a bin of few particles comes and goes.
const COARSE_Z_MISS: f64 = 5.0;

impl FitConfig {
    /// The settings of the coarse fit that this one begins with, to a track in bins of a width. None if it has none: a likelihood
    /// that is zero somewhere would be zero elsewhere in a coarse model, and what that has not found cannot be refined.
    ///
    /// Few particles make a likelihood rough, and slow to explore. Edges as wide as bins allow, and bins that are missed at a smaller
    /// cost, make it smoother (`cargo bench --bench roughness`).
    #[must_use]
    pub fn coarse(&self, bin_width_deg: f64) -> Option<Self> {
        let Coverage::Penalty { z_miss, lambda } = self.likelihood.coverage else {
            return None;
        };
        let many = self.model.releases.particles >= 2 * self.coarse_particles;
        (self.coarse_particles > 0 && many).then(|| {
            let mut coarse = self.clone();
            coarse.coarse_particles = 0;
            let releases = &mut coarse.model.releases;
            // As many release times as there are particles for.
            releases.epochs = 0;
            releases.particles = self.coarse_particles;
            coarse.model.orbit_steps = self.model.orbit_steps.min(COARSE_ORBIT_STEPS);
            coarse.likelihood.edges = BinEdges::Soft {
                half_width_deg: 0.5 * bin_width_deg,
            };
            coarse.likelihood.coverage = Coverage::Penalty {
                z_miss: z_miss.min(COARSE_Z_MISS),
                lambda,
            };
            coarse
        })
    }
}

/// Everything that decides a population beside its streams.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PopulationConfig {
    /// Master seed of the sampler.
    pub seed: u64,
    /// The family.
    pub family: TruncatedGaussianSettings,
    /// The reweighting.
    pub reweighting: PopulationSettings,
    /// The samplers.
    #[serde(deserialize_with = "over_those_of_populations")]
    pub sampling: SamplerSettings,
}

impl Default for PopulationConfig {
    fn default() -> Self {
        Self {
            seed: 1,
            family: TruncatedGaussianSettings::default(),
            reweighting: PopulationSettings::default(),
            sampling: sampling_of_populations(),
        }
    }
}

impl FitConfig {
    /// The settings that decide what a run draws: all but how often a tempered one may go on, of which a resumed run may be given
    /// more.
    #[must_use]
    pub fn drawing(&self) -> Self {
        let mut config = self.clone();
        config.sampling.pt_hmc.extensions = 0;
        config
    }

    /// Whether a run that has ended by the settings `then` without passing its gates may go on by these, which are otherwise
    /// the same.
    #[must_use]
    pub fn goes_on(&self, then: &Self) -> bool {
        let extensions = |config: &Self| config.sampling.pt_hmc.extensions;
        self.sampling.sampler == Sampler::PtHmc && extensions(self) > extensions(then)
    }
}

/// What suits the posterior of a stream: thirteen curved directions, several modes, and a likelihood that is rough at the
/// scale of a leapfrog step. Populations find the modes, and paths from a mixture that resembles them are half as long as those from
/// the prior: machines travel, few slices per scan do, gradients pay for single steps alone, and the last round goes on until it
/// passes. With few live points nested runs lose modes, with few slices new points echo their seeds.
fn sampling_of_streams() -> SamplerSettings {
    let mut sampling = SamplerSettings::default();
    sampling.nested.n_live = 1_000;
    sampling.nested.steps = Some(16);
    sampling.pt_hmc.annealing = 400;
    sampling.pt_hmc.slices = 4;
    sampling.pt_hmc.max_leapfrogs = 1;
    sampling.pt_hmc.target_acceptance = 0.6;
    sampling.pt_hmc.first_scans = 256;
    sampling.pt_hmc.rounds = 4;
    sampling.pt_hmc.extensions = 15;
    // All of them, however many are asked for.
    sampling.pt_hmc.mixture_rounds = 24;
    sampling
}

/// What suits two smooth dimensions: short ladders and few draws per stream.
fn sampling_of_populations() -> SamplerSettings {
    let mut sampling = SamplerSettings::default();
    sampling.pt_hmc.rounds = 8;
    sampling.pt_hmc.temperatures = 8;
    sampling.pt_hmc.max_temperatures = 16;
    sampling
}

fn over_those_of_streams<'de, D: Deserializer<'de>>(
    given: D,
) -> StdResult<SamplerSettings, D::Error> {
    over(sampling_of_streams(), given)
}

fn over_those_of_populations<'de, D: Deserializer<'de>>(
    given: D,
) -> StdResult<SamplerSettings, D::Error> {
    over(sampling_of_populations(), given)
}

/// What is given, and defaults for the rest: those of the settings' use, where the type's own would suit another.
fn over<'de, T: Serialize + DeserializeOwned, D: Deserializer<'de>>(
    defaults: T,
    given: D,
) -> StdResult<T, D::Error> {
    fn merge(base: &mut toml::Table, given: toml::Table) {
        for (key, value) in given {
            match (base.get_mut(&key), value) {
                (Some(toml::Value::Table(inner)), toml::Value::Table(more)) => merge(inner, more),
                (_, value) => {
                    base.insert(key, value);
                }
            }
        }
    }
    let given = toml::Table::deserialize(given)?;
    let mut all = toml::Table::try_from(defaults).map_err(D::Error::custom)?;
    merge(&mut all, given);
    T::deserialize(all).map_err(D::Error::custom)
}

/// A study: tracks and mocks, their fits by one or more samplers, a population, a report.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StudyConfig {
    /// Title of the report.
    pub title: String,
    /// Folder of all results, from the working directory.
    pub out: PathBuf,
    /// Exit with 0 even if a run has not converged; the output and the page still say so first.
    #[serde(default)]
    pub allow_unconverged: bool,
    /// Tracks to fit.
    #[serde(default)]
    pub tracks: Option<StudyTracks>,
    /// Mocks to make and fit.
    #[serde(default)]
    pub mocks: Option<StudyMocks>,
    /// The population of the mocks.
    #[serde(default)]
    pub population: Option<StudyPopulation>,
}

/// Observed tracks of a study.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StudyTracks {
    /// Track files, from the study file's folder.
    pub files: Vec<PathBuf>,
    /// Samplers that each is fitted by.
    pub samplers: Vec<Sampler>,
    /// Settings of the fits; `sampling.sampler` is set by `samplers`.
    #[serde(default)]
    pub fit: FitConfig,
}

/// Mocks of a study.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StudyMocks {
    /// How many.
    pub count: usize,
    /// Seed of the draws.
    pub seed: u64,
    /// Samplers that each is fitted by.
    pub samplers: Vec<Sampler>,
    /// How they are made.
    #[serde(default)]
    pub mock: MockSettings,
    /// Settings of the fits; the prior is that of the mocks too.
    #[serde(default)]
    pub fit: FitConfig,
}

/// Population of a study.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StudyPopulation {
    /// Samplers that it is sampled by.
    pub samplers: Vec<Sampler>,
    /// Settings.
    #[serde(default)]
    pub settings: PopulationConfig,
}

/// Reads a settings file.
///
/// # Errors
/// [`Error::Io`] if it cannot be read; [`Error::Input`] with file, line and the parser's word for an unknown key, a
/// wrong type or broken syntax.
pub fn read<T: DeserializeOwned>(path: &Path) -> Result<T> {
    let text = std::fs::read_to_string(path).map_err(|source| Error::Io {
        path: path.to_path_buf(),
        source,
        remedy: "give the path of a readable settings file",
    })?;
    toml::from_str(&text).map_err(|e| Error::Input {
        path: path.to_path_buf(),
        line: e.span().map(|span| {
            let start = span.start.min(text.len());
            let own = unknown_key(e.message(), &text[start..]).unwrap_or(0);
            text[..start + own].matches('\n').count() + 1
        }),
        what: e.message().trim().replace('\n', " "),
        remedy: "see `oblate fit --print-config` for every key and its default".to_owned(),
    })
}

/// Writes settings as TOML, every value spelled out.
///
/// # Errors
/// [`Error::Setting`] for a value that TOML has no form for (a seed above 2^63).
pub fn text<T: Serialize>(settings: &T) -> Result<String> {
    toml::to_string_pretty(settings).map_err(|e| Error::Setting {
        key: "settings".to_owned(),
        value: e.to_string(),
        remedy: "give numbers that a settings file can hold, seeds below 2^63".to_owned(),
    })
}

/// Where in `text`, the table that the parser points at, an unknown key itself stands: tables that are laid over defaults are
/// checked as a whole.
fn unknown_key(message: &str, text: &str) -> Option<usize> {
    let key = message.split("unknown field `").nth(1)?.split('`').next()?;
    let stands_alone = |at: &usize| {
        let before = text[..*at].chars().next_back();
        let after = text[at + key.len()..].trim_start();
        before.is_none_or(|c| c.is_whitespace() || "{,.[".contains(c))
            && after.starts_with(['=', '.', ']'])
    };
    let mut places = text.match_indices(key).map(|(at, _)| at);
    places.find(stands_alone)
}
