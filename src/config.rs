//! Settings files: reading and writing them, and the settings of populations and studies.

use crate::data::{AssumedError, MockSettings, NUMBERS_OF_MOCKS, Selection};
use crate::error::{Error, Result};
use crate::inference::{FitSettings, Sampler, SamplerSettings, over_defaults};
use crate::population::{FamilyName, FamilySettings, PopulationSettings};
use oblate_samplers::limits::{MAX_SEED, in_range};
use oblate_samplers::read::text;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Deserializer, Serialize};
use std::path::{Path, PathBuf};
use std::result::Result as StdResult;

/// Largest size of a settings file.
const MAX_BYTES: u64 = 1 << 20;

/// Largest number of opening brackets and braces in a settings file, ten times what all settings need. The parser limits the depth of
/// valid lists and tables, but not that of all invalid ones, and its stack would overflow.
const MAX_BRACKETS: usize = 512;

/// Settings of a population: with the posteriors of q of its streams, they determine its result.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PopulationConfig {
    /// Master seed of the sampler.
    pub seed: u64,
    /// The family of distributions of q.
    pub family: FamilySettings,
    /// The reweighting of the streams' posteriors.
    pub reweighting: PopulationSettings,
    /// Which fraction of streams is kept at each q; none: all, or the same at each.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub selection: Option<Selection>,
    /// The samplers.
    #[serde(deserialize_with = "sampling_of_populations")]
    pub sampling: SamplerSettings,
}

impl Default for PopulationConfig {
    fn default() -> Self {
        Self {
            seed: 1,
            family: FamilySettings::default(),
            reweighting: PopulationSettings::default(),
            selection: None,
            sampling: SamplerSettings::for_populations(),
        }
    }
}

impl PopulationConfig {
    /// Checks every number of every table by itself: the ranges of docs/limits.md.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] or [`Error::Setting`] with the first key that is at fault.
    pub fn check(&self) -> Result<()> {
        in_range("seed", self.seed, 0..=MAX_SEED)?;
        self.family.check()?;
        self.reweighting.check()?;
        if let Some(selection) = &self.selection {
            selection.check()?;
        }
        self.sampling.check_ranges()
    }
}

fn sampling_of_populations<'de, D: Deserializer<'de>>(
    given: D,
) -> StdResult<SamplerSettings, D::Error> {
    over_defaults(SamplerSettings::for_populations(), given)
}

/// Settings of a study: tracks and mocks, their fits by one or more samplers, a population and a report.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StudyConfig {
    /// Title of the report.
    pub title: String,
    /// Folder of all results, relative to the working directory.
    pub out: PathBuf,
    /// Exit with 0 even if a run has not converged; the output and the report still say so.
    #[serde(default)]
    pub allow_unconverged: bool,
    /// Tracks to fit.
    #[serde(default)]
    pub tracks: Option<StudyTracks>,
    /// Mocks to make and fit.
    #[serde(default)]
    pub mocks: Option<StudyMocks>,
    /// The population of the mocks or of the tracks.
    #[serde(default)]
    pub population: Option<StudyPopulation>,
    /// How fits are given to Slurm, where that is asked for.
    #[serde(default)]
    pub slurm: SlurmSettings,
}

impl StudyConfig {
    /// Checks every number of all its settings, so that no work is lost to one that is used late.
    ///
    /// # Errors
    /// [`Error::InTable`] with what [`FitSettings::check`], [`MockSettings::check`] or [`PopulationConfig::check`] refuse;
    /// [`Error::OutOfRange`] for the number or the seed of mocks, and for numbers of the cluster; [`Error::Setting`] for a family or a size of
    /// subsets that is listed twice.
    pub fn check(&self) -> Result<()> {
        if let Some(tracks) = &self.tracks {
            tracks.fit.check().map_err(|e| e.within("tracks.fit"))?;
        }
        if let Some(mocks) = &self.mocks {
            in_range("count", mocks.count, NUMBERS_OF_MOCKS)
                .and_then(|()| in_range("seed", mocks.seed, 0..=MAX_SEED))
                .map_err(|e| Error::from(e).within("mocks"))?;
            mocks.mock.check().map_err(|e| e.within("mocks.mock"))?;
            mocks.fit.check().map_err(|e| e.within("mocks.fit"))?;
        }
        if let Some(population) = &self.population {
            let checked = population.settings.check();
            checked.map_err(|e| e.within("population.settings"))?;
            let families = &population.families;
            each_once("families", families, |family| family.name().to_owned())
                .map_err(|e| e.within("population"))?;
            if let Some(subsets) = &population.subsets {
                subsets
                    .check()
                    .map_err(|e| e.within("population.subsets"))?;
            }
        }
        self.slurm.check().map_err(|e| e.within("slurm"))
    }
}

/// Observed tracks of a study.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StudyTracks {
    /// Track files, and folders of which every file that ends in `.ecsv` or `.csv` is a track; relative to the folder of the study file.
    pub files: Vec<PathBuf>,
    /// The errors of tracks that have none.
    #[serde(default)]
    pub assume_error: Option<AssumedError>,
    /// Samplers; each fits every track.
    pub samplers: Vec<Sampler>,
    /// Settings of the fits; `sampling.sampler` is set by `samplers`.
    #[serde(default)]
    pub fit: FitSettings,
}

/// Mocks of a study.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StudyMocks {
    /// Number of mocks.
    pub count: usize,
    /// Seed of the draws.
    pub seed: u64,
    /// Samplers; each fits every track.
    pub samplers: Vec<Sampler>,
    /// How the mocks are made.
    #[serde(default)]
    pub mock: MockSettings,
    /// Settings of the fits; the prior is that of the mocks too.
    #[serde(default)]
    pub fit: FitSettings,
}

/// Streams of a study.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum StreamsOf {
    /// Those of `[tracks]`.
    Tracks,
    /// Those of `[mocks]`.
    Mocks,
}

/// Population of a study.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StudyPopulation {
    /// Whose population; none: that of the mocks if the study has any, else that of the tracks.
    #[serde(default)]
    pub of: Option<StreamsOf>,
    /// Samplers; each samples the population.
    pub samplers: Vec<Sampler>,
    /// Families; each is sampled. None: the family of the settings.
    #[serde(default)]
    pub families: Vec<FamilyName>,
    /// Random subsets of the streams whose populations show how the errors fall with the number of streams, if they are wanted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub subsets: Option<SubsetSettings>,
    /// Settings.
    #[serde(default)]
    pub settings: PopulationConfig,
}

impl StudyPopulation {
    /// The families that are sampled: those listed, else that of the settings.
    #[must_use]
    pub fn families(&self) -> Vec<FamilyName> {
        if self.families.is_empty() {
            vec![self.settings.family.name]
        } else {
            self.families.clone()
        }
    }
}

/// Random subsets of the streams of a population, each sampled by the first family and the first sampler.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SubsetSettings {
    /// Numbers of streams. Those that are not below the number of all streams are left out.
    pub sizes: Vec<usize>,
    /// Number of subsets of each size.
    pub repeats: usize,
}

impl SubsetSettings {
    /// Checks every number by itself: the ranges of docs/limits.md; and that no size is listed twice.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] with the first one that is out of its range; [`Error::Setting`] for a size that is listed twice.
    pub fn check(&self) -> Result<()> {
        for size in &self.sizes {
            in_range("sizes", *size, NUMBERS_OF_MOCKS)?;
        }
        each_once("sizes", &self.sizes, usize::to_string)?;
        in_range("repeats", self.repeats, 1..=1_000)?;
        Ok(())
    }
}

/// How the fits of a study are given to Slurm.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SlurmSettings {
    /// Options of `sbatch` for each fit, such as `--partition=long`.
    pub options: Vec<String>,
    /// Largest number of fits that work at once; none: as many as Slurm allows.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub at_once: Option<usize>,
    /// How often a fit is submitted if it ends without a result, or with one that goes on, and without an error of its own.
    pub attempts: usize,
    /// Seconds between two looks at the queue.
    pub poll_seconds: u64,
}

impl Default for SlurmSettings {
    fn default() -> Self {
        Self {
            options: Vec::new(),
            at_once: None,
            attempts: 3,
            poll_seconds: 30,
        }
    }
}

impl SlurmSettings {
    /// Checks every number by itself: the ranges of docs/limits.md.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] with the first key that is at fault.
    pub fn check(&self) -> Result<()> {
        if let Some(at_once) = self.at_once {
            in_range("at_once", at_once, 1..=100_000)?;
        }
        in_range("attempts", self.attempts, 1..=100)?;
        in_range("poll_seconds", self.poll_seconds, 1..=3_600)?;
        Ok(())
    }
}

/// Reads a settings file, of at most 1 MiB.
///
/// # Errors
/// [`Error::Io`] if it cannot be read; [`Error::Syntax`] with file, line and the parser's message for an unknown key, a
/// wrong type or broken syntax.
pub fn read<T: DeserializeOwned>(path: &Path) -> Result<T> {
    let text = text(path, MAX_BYTES).map_err(Error::io(
        path,
        "give the path of a readable settings file (UTF-8 text)",
    ))?;
    parse(&text, path)
}

/// Reads the text of a settings file; `path` is for messages.
///
/// # Errors
/// [`Error::Syntax`] as of [`read`].
pub fn parse<T: DeserializeOwned>(text: &str, path: &Path) -> Result<T> {
    let line_at = |place: usize| text[..place].matches('\n').count() + 1;
    if let Some((place, _)) = text.match_indices(['[', '{']).nth(MAX_BRACKETS) {
        return Err(Error::Syntax {
            path: path.to_path_buf(),
            line: Some(line_at(place)),
            message: format!("more than {MAX_BRACKETS} lists and tables"),
            remedy: "give each setting once",
        });
    }
    toml::from_str(text).map_err(|e| Error::Syntax {
        path: path.to_path_buf(),
        line: e.span().map(|span| {
            let start = span.start.min(text.len());
            let own = key_at_fault(&e.message().replace('\n', " "), &text[start..]).unwrap_or(0);
            line_at(start + own)
        }),
        message: e.message().trim().replace('\n', " "),
        remedy: "give the known keys, with values of their types",
    })
}

/// Checks that a list of settings has no value twice.
///
/// # Errors
/// [`Error::Setting`] with the first value that repeats one before it.
pub(crate) fn each_once<T: PartialEq>(
    key: &str,
    values: &[T],
    text: impl Fn(&T) -> String,
) -> Result<()> {
    let mut all = values.iter().enumerate();
    match all.find(|(i, value)| values[..*i].contains(value)) {
        None => Ok(()),
        Some((_, value)) => Err(Error::Setting {
            key: key.to_owned(),
            value: text(value),
            remedy: "name each value of the list once".to_owned(),
        }),
    }
}

/// Writes all settings as TOML.
///
/// # Errors
/// [`Error::Setting`] for a value that TOML cannot hold (a seed of 2^63 or more).
pub fn to_toml<T: Serialize>(settings: &T) -> Result<String> {
    toml::to_string_pretty(settings).map_err(|e| Error::Setting {
        key: "settings".to_owned(),
        value: e.to_string(),
        remedy: "give numbers that a settings file can hold, seeds below 2^63".to_owned(),
    })
}

/// Settings with one of them changed. `key` has the names of its tables before it, with dots; `value` is TOML, or a text without quotes.
///
/// # Errors
/// [`Error::Setting`] for an unknown key or a value of another type.
pub fn with_value<T: Serialize + DeserializeOwned>(
    settings: &T,
    key: &str,
    value: &str,
) -> Result<T> {
    let wrong = |message: &str| Error::Setting {
        key: key.to_owned(),
        value: value.to_owned(),
        remedy: format!(
            "{}; give a key of the settings file with a value of its type",
            message.trim().replace('\n', " ")
        ),
    };
    let parsed = toml::from_str::<toml::Table>(&format!("value = {value}"));
    let parsed = parsed.ok().filter(|table| table.len() == 1);
    let parsed = parsed.and_then(|mut table| table.remove("value"));
    let parsed = parsed.unwrap_or_else(|| toml::Value::String(value.to_owned()));
    let mut all = toml::Table::try_from(settings).map_err(|e| wrong(&e.to_string()))?;
    let mut names = key.split('.').map(str::to_owned).collect::<Vec<_>>();
    let last = names.pop().unwrap_or_default();
    let mut table = &mut all;
    for name in names {
        let inner = table
            .entry(name.clone())
            .or_insert_with(|| toml::Value::Table(toml::Table::new()));
        table = inner
            .as_table_mut()
            .ok_or_else(|| wrong(&format!("`{name}` is not a table")))?;
    }
    table.insert(last, parsed);
    T::deserialize(all).map_err(|e| wrong(e.message()))
}

/// Position in `text` of the key that the parser's message is about, where `text` begins with the table that the parser points at. Tables
/// that are merged with defaults are checked as a whole, so that the parser itself knows only the table.
fn key_at_fault(message: &str, text: &str) -> Option<usize> {
    let quoted = |start: &str| message.split(start).nth(1)?.split('`').next();
    let key = match quoted("unknown field `") {
        Some(unknown) => unknown,
        // The path of a value of another type, such as `nested.n_live`.
        None => quoted(" in `")?.rsplit('.').next()?,
    };
    let stands_alone = |at: &usize| {
        let before = text[..*at].chars().next_back();
        let after = text[at + key.len()..].trim_start();
        before.is_none_or(|c| c.is_whitespace() || "{,.[".contains(c))
            && after.starts_with(['=', '.', ']'])
    };
    let mut places = text.match_indices(key).map(|(at, _)| at);
    places.find(stands_alone)
}
