//! Settings files: reading and writing them, and the settings of populations and studies.

use crate::data::MockSettings;
use crate::error::{Error, Result};
use crate::inference::{FitSettings, Sampler, SamplerSettings, over_defaults};
use crate::population::{PopulationSettings, TruncatedGaussianSettings};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Deserializer, Serialize};
use std::path::{Path, PathBuf};
use std::result::Result as StdResult;

/// Settings of a population: with the posteriors of q of its streams, they determine its result.
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
    #[serde(deserialize_with = "sampling_of_populations")]
    pub sampling: SamplerSettings,
}

impl Default for PopulationConfig {
    fn default() -> Self {
        Self {
            seed: 1,
            family: TruncatedGaussianSettings::default(),
            reweighting: PopulationSettings::default(),
            sampling: SamplerSettings::for_populations(),
        }
    }
}

fn sampling_of_populations<'de, D: Deserializer<'de>>(
    given: D,
) -> StdResult<SamplerSettings, D::Error> {
    over_defaults(SamplerSettings::for_populations(), given)
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
    pub fit: FitSettings,
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
    pub fit: FitSettings,
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
/// [`Error::Io`] if it cannot be read; [`Error::Syntax`] with file, line and the parser's message for an unknown key, a
/// wrong type or broken syntax.
pub fn read<T: DeserializeOwned>(path: &Path) -> Result<T> {
    let text = std::fs::read_to_string(path).map_err(|source| Error::Io {
        path: path.to_path_buf(),
        source,
        remedy: "give the path of a readable settings file",
    })?;
    toml::from_str(&text).map_err(|e| Error::Syntax {
        path: path.to_path_buf(),
        line: e.span().map(|span| {
            let start = span.start.min(text.len());
            let own = unknown_key(e.message(), &text[start..]).unwrap_or(0);
            text[..start + own].matches('\n').count() + 1
        }),
        message: e.message().trim().replace('\n', " "),
        remedy: "give the known keys, with values of their types",
    })
}

/// Writes settings as TOML, every value spelled out.
///
/// # Errors
/// [`Error::Setting`] for a value that TOML has no form for (a seed above 2^63).
pub fn to_toml<T: Serialize>(settings: &T) -> Result<String> {
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
