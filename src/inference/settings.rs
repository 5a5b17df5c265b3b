//! Settings of a fit: the model, its comparison with the data, the prior and the samplers.

use crate::error::{Error, Result};
use crate::likelihood::LikelihoodSettings;
use crate::params::PriorSettings;
use crate::stream::ModelSettings;
use oblate_samplers::limits::{MAX_SEED, Memory, in_range};
use oblate_samplers::output::{MIN_ESS, Method};
use oblate_samplers::{bridge, nested, pt};
use serde::de::{DeserializeOwned, Error as _};
use serde::{Deserialize, Deserializer, Serialize};
use std::result::Result as StdResult;

/// Which sampler runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sampler {
    /// Nested sampling; the default of populations.
    #[default]
    Nested,
    /// Parallel tempering with Hamiltonian Monte Carlo; the default of fits.
    PtHmc,
}

impl Sampler {
    /// Its name in flags and files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Nested => "nested",
            Self::PtHmc => "pt-hmc",
        }
    }
}

impl std::str::FromStr for Sampler {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        [Self::Nested, Self::PtHmc]
            .into_iter()
            .find(|s| s.name() == text)
            .ok_or_else(|| Error::Setting {
                key: "sampler".to_owned(),
                value: text.to_owned(),
                remedy: "give `nested` or `pt-hmc`".to_owned(),
            })
    }
}

/// Settings of both samplers and of the bridge to a finer model, and which sampler runs.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SamplerSettings {
    /// Which sampler runs.
    pub sampler: Sampler,
    /// Nested sampling.
    pub nested: nested::Settings,
    /// Parallel tempering.
    pub pt_hmc: pt::Settings,
    /// The SMC bridge from a coarse model to a finer one.
    pub bridge: bridge::Settings,
}

impl SamplerSettings {
    /// Defaults for the posterior of a stream: thirteen parameters, several modes, and a likelihood that is rough on the scale of a
    /// leapfrog step.
    ///
    /// Nested runs move along surrogates of ln L, and add batches of live points until there are enough effective draws. With fewer live points
    /// they lose modes, and with fewer steps new points remain correlated with the points that they started from. The tempered sampler finds the modes by SMC, starts its annealing path at a
    /// mixture fitted to them, which makes the path shorter than that from the prior, and extends its last round until
    /// the convergence checks pass. Rounds and extensions are short at first, so that an easy track ends early. States are moved
    /// along a surrogate of ln L, which needs no gradients of ln L itself: one costs as much as seven values
    /// (docs/decisions.md, section 3).
    #[must_use]
    pub fn for_streams() -> Self {
        let mut sampling = Self {
            sampler: Sampler::PtHmc,
            ..Self::default()
        };
        sampling.nested.n_live = 1_000;
        sampling.nested.steps = Some(16);
        sampling.nested.kernel = nested::Kernel::Surrogate;
        sampling.nested.target_ess = Some(MIN_ESS);
        sampling.nested.max_batches = 8;
        sampling.bridge.smc_particles = 1_000;
        sampling.bridge.mcmc_steps = 2;
        sampling.bridge.further_mcmc_steps = 16;
        sampling.bridge.max_batches = 6;
        sampling.pt_hmc.surrogate = true;
        // A path from a screened reference is short.
        sampling.pt_hmc.min_temperatures = 4;
        sampling.pt_hmc.smc_particles = 400;
        sampling.pt_hmc.mcmc_steps = 5;
        sampling.pt_hmc.slice_updates = 1;
        sampling.pt_hmc.hmc_transitions = 0;
        // HMC transitions along ln L itself, without a surrogate: MALA, since longer trajectories are rejected.
        sampling.pt_hmc.max_leapfrogs = 1;
        sampling.pt_hmc.first_scans = 32;
        sampling.pt_hmc.rounds = 4;
        sampling.pt_hmc.extensions = 13;
        // The largest number of rounds allowed, so that every round starts at a mixture.
        sampling.pt_hmc.mixture_rounds = 24;
        sampling
    }

    /// Defaults for the population: two parameters and a smooth likelihood, which need few temperatures.
    #[must_use]
    pub fn for_populations() -> Self {
        let mut sampling = Self::default();
        sampling.nested.target_ess = Some(MIN_ESS);
        sampling.nested.max_batches = 8;
        sampling.pt_hmc.rounds = 8;
        sampling.pt_hmc.temperatures = 8;
        sampling.pt_hmc.max_temperatures = 16;
        sampling
    }

    /// Checks every number of every sampler by itself: the ranges of docs/limits.md.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] with the first one that is out of its range.
    pub fn check_ranges(&self) -> Result<()> {
        in_table("sampling.nested", self.nested.check_ranges())?;
        in_table("sampling.pt_hmc", self.pt_hmc.check_ranges())?;
        in_table("sampling.bridge", self.bridge.check_ranges())
    }

    /// Checks all ranges, and whether the chosen sampler can work with its settings on a target of `dim` parameters.
    ///
    /// # Errors
    /// As of [`check_ranges`](Self::check_ranges); [`Error::Sampler`] or [`Error::TooMuchMemory`] by the sampler's own check.
    pub fn check(&self, dim: usize) -> Result<()> {
        self.check_ranges()?;
        match self.sampler {
            Sampler::Nested => in_table("sampling.nested", self.nested.check(dim)),
            Sampler::PtHmc => in_table("sampling.pt_hmc", self.pt_hmc.check(dim)),
        }
    }

    /// Checks whether the bridge can work with its settings on a target of `dim` parameters.
    ///
    /// # Errors
    /// [`Error::OutOfRange`], [`Error::Sampler`] or [`Error::TooMuchMemory`] by the bridge's own check.
    pub fn check_bridge(&self, dim: usize) -> Result<()> {
        in_table("sampling.bridge", self.bridge.check(dim))
    }

    /// An estimate of the memory of the chosen sampler on a target of `dim` parameters.
    #[must_use]
    pub fn memory(&self, dim: usize) -> Memory {
        let (memory, table) = match self.sampler {
            Sampler::Nested => (self.nested.memory(dim), "sampling.nested"),
            Sampler::PtHmc => (self.pt_hmc.memory(dim), "sampling.pt_hmc"),
        };
        Memory::default().and(&memory, table)
    }
}

/// A sampler's check of its settings, with the key as it is in a settings file.
fn in_table(table: &str, checked: oblate_samplers::Result<()>) -> Result<()> {
    use oblate_samplers::Error as S;
    checked.map_err(|error| match error {
        S::OutOfRange(wrong) => wrong.within(table).into(),
        S::TooMuchMemory(mut much) => {
            much.key = format!("{table}.{}", much.key);
            much.into()
        }
        other => other.into(),
    })
}

/// Settings of a fit: with the track, they determine its result.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FitSettings {
    /// Master seed of the sampler.
    pub seed: u64,
    /// Number of particles of the coarse model that is fitted first, before the SMC bridge to the model itself; 0: none. There is also
    /// none if the model has less than twice as many particles, or if its likelihood is zero where the track is not covered.
    pub coarse_particles: usize,
    /// The stream model.
    pub model: ModelSettings,
    /// Its comparison with the data.
    pub likelihood: LikelihoodSettings,
    /// The prior.
    pub prior: PriorSettings,
    /// The samplers.
    #[serde(deserialize_with = "sampling_of_streams")]
    pub sampling: SamplerSettings,
}

impl Default for FitSettings {
    fn default() -> Self {
        Self {
            seed: 1,
            coarse_particles: 512,
            model: ModelSettings::default(),
            likelihood: LikelihoodSettings::default(),
            prior: PriorSettings::default(),
            sampling: SamplerSettings::for_streams(),
        }
    }
}

impl FitSettings {
    /// Checks every number of every table by itself, whether this fit uses it or not: the ranges of docs/limits.md.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] or [`Error::Setting`] with the first key that is at fault.
    pub fn check(&self) -> Result<()> {
        in_range("seed", self.seed, 0..=MAX_SEED)?;
        in_range("coarse_particles", self.coarse_particles, 0..=10_000_000)?;
        self.model.check()?;
        self.likelihood.check()?;
        self.prior.check()?;
        self.sampling.check_ranges()
    }

    /// These settings with another sampler.
    #[must_use]
    pub fn with_sampler(&self, sampler: Sampler) -> Self {
        let mut settings = self.clone();
        settings.sampling.sampler = sampler;
        settings
    }

    /// Whether these settings and others ask for one posterior of a track: host, prior and what is assumed of the data's errors are the same. What only makes the
    /// model more or less accurate may differ.
    #[must_use]
    pub fn has_posterior_of(&self, other: &Self) -> bool {
        let errors = |settings: &Self| {
            let likelihood = settings.likelihood;
            (
                likelihood.error_floor_percent.to_bits(),
                likelihood.error_correlation,
            )
        };
        self.model.has_host_of(&other.model)
            && self.prior == other.prior
            && errors(self) == errors(other)
    }

    /// These settings without those that say only how long a run may go on: batches of a nested run and of a bridge, and extensions of the last
    /// tempered round. Everything else determines the draws, so that two runs which agree in these settings agree in all draws that they have in
    /// common.
    #[must_use]
    pub fn without_extensions(&self) -> Self {
        let mut settings = self.clone();
        settings.sampling.nested.max_batches = 1;
        settings.sampling.pt_hmc.extensions = 0;
        settings.sampling.bridge.max_batches = 1;
        settings
    }

    /// Whether a finished run by `method` with the settings `before`, which failed its convergence checks, may go on under these settings: a
    /// tempered run, or a bridge from one, if these allow more extensions; a nested one with a target, or a bridge from one, if they allow more
    /// batches; any bridge if they allow more batches of its own. The two must be equal in everything else.
    #[must_use]
    pub fn may_go_on(&self, before: &Self, method: Method) -> bool {
        let extensions = |settings: &Self| settings.sampling.pt_hmc.extensions;
        let of_bridge = |settings: &Self| settings.sampling.bridge.max_batches;
        let batches = |settings: &Self| settings.sampling.nested.max_batches;
        let longer = match self.sampling.sampler {
            Sampler::PtHmc => extensions(self) > extensions(before),
            Sampler::Nested => self.sampling.nested.dynamic() && batches(self) > batches(before),
        };
        longer || method == Method::Bridge && of_bridge(self) > of_bridge(before)
    }
}

fn sampling_of_streams<'de, D: Deserializer<'de>>(
    given: D,
) -> StdResult<SamplerSettings, D::Error> {
    over_defaults(SamplerSettings::for_streams(), given)
}

/// Deserializes a table that may be incomplete, at any depth; what is missing is taken from `defaults`.
///
/// # Errors
/// Those of the deserializer: unknown keys and wrong types.
pub fn over_defaults<'de, T: Serialize + DeserializeOwned, D: Deserializer<'de>>(
    defaults: T,
    given: D,
) -> StdResult<T, D::Error> {
    fn merge(base: &mut toml::Table, given: toml::Table) -> StdResult<(), String> {
        for (key, value) in given {
            match (base.get_mut(&key), value) {
                (Some(toml::Value::Table(inner)), toml::Value::Table(more)) => merge(inner, more)?,
                // A list of values would replace also the defaults that it does not name.
                (Some(toml::Value::Table(_)), other) => {
                    return Err(format!("`{key}` is {}, not a table", other.type_str()));
                }
                (_, value) => {
                    base.insert(key, value);
                }
            }
        }
        Ok(())
    }
    let given = toml::Table::deserialize(given)?;
    let mut all = toml::Table::try_from(defaults).map_err(D::Error::custom)?;
    merge(&mut all, given).map_err(D::Error::custom)?;
    T::deserialize(all).map_err(D::Error::custom)
}
