//! The single doorway to the samplers: wraps a likelihood as a target, runs nested sampling or tempered HMC on it, and makes
//! more of what they found.

mod coverage;
mod target;

pub use coverage::check_reach;
pub use target::StreamTarget;

use crate::error::{Error, Result};
use oblate_samplers::{Control, Run, Target, boost, nested, pt, refine};
use serde::{Deserialize, Serialize};

/// Which sampler runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sampler {
    /// Nested sampling: the reference.
    #[default]
    Nested,
    /// Parallel tempering with Hamiltonian moves.
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

/// Settings of both samplers, of what may follow them, and which one runs.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SamplerSettings {
    /// Which one.
    pub sampler: Sampler,
    /// Of the nested sampler.
    pub nested: nested::Settings,
    /// Of the tempered sampler.
    pub pt_hmc: pt::Settings,
    /// Of the importance sampling that may follow either.
    pub boost: boost::Settings,
    /// Of the refinement that may follow either.
    pub refine: refine::Settings,
}

impl SamplerSettings {
    /// Whether the chosen sampler can work with its settings on a target of `dim` parameters: asked before anything is written.
    ///
    /// # Errors
    /// The first setting that is out of its range ([`Error::Sampler`]).
    pub fn check(&self, dim: usize) -> Result<()> {
        match self.sampler {
            Sampler::Nested => self.nested.check(dim)?,
            Sampler::PtHmc => self.pt_hmc.check()?,
        }
        Ok(())
    }
}

/// Samples a target with the chosen sampler: one call, one kind of result.
///
/// # Errors
/// What the samplers refuse ([`Error::Sampler`]).
pub fn sample(
    target: &dyn Target,
    settings: &SamplerSettings,
    seed: u64,
    control: &mut Control<'_>,
) -> Result<Run> {
    let run = match settings.sampler {
        Sampler::Nested => nested::run(target, &settings.nested, seed, control)?,
        Sampler::PtHmc => pt::run(target, &settings.pt_hmc, seed, control)?,
    };
    Ok(run)
}

/// Draws more of what a run on the target found, by importance sampling: the same kind of result.
///
/// # Errors
/// What the importance sampling refuses ([`Error::Sampler`]).
pub fn boosted(
    target: &dyn Target,
    parent: &Run,
    settings: &SamplerSettings,
    seed: u64,
    control: &mut Control<'_>,
) -> Result<Run> {
    Ok(boost::run(target, parent, &settings.boost, seed, control)?)
}

/// Carries a run on a coarse target to a fine one: the same kind of result.
///
/// # Errors
/// What the refinement refuses ([`Error::Sampler`]).
pub fn refined(
    target: &dyn Target,
    coarse: &dyn Target,
    parent: &Run,
    settings: &SamplerSettings,
    seed: u64,
    control: &mut Control<'_>,
) -> Result<Run> {
    Ok(refine::run(
        target,
        coarse,
        parent,
        &settings.refine,
        seed,
        control,
    )?)
}

/// Nested runs on the target from several seeds, as one.
///
/// # Errors
/// What they are refused for ([`Error::Sampler`]).
pub fn merged(target: &dyn Target, runs: &[&Run]) -> Result<Run> {
    Ok(nested::merge(target, runs)?)
}
