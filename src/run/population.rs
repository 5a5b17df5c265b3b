//! The population of finished fits, from their run folders into another one.

use super::folder::{RunFolder, StoredRun};
use super::locked::RunState;
use super::monitor::Monitor;
use super::session::{Destination, RunSession};
use crate::config::{PopulationConfig, to_toml};
use crate::error::{Error, Result};
use crate::inference::{Fit, sample};
use crate::params::QPrior;
use crate::population::{Family, PopulationTarget, QPosterior, TruncatedGaussian};
use crate::posterior::{Summary, SummaryContext, column};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// The posterior of q of a finished fit, with the prior of that fit.
///
/// # Errors
/// [`Error::NoColumn`] if the run has no q.
pub fn q_posterior(stored: &StoredRun) -> Result<QPosterior> {
    let q = column(&stored.run, "q")?;
    Ok(QPosterior {
        name: stored.name.clone(),
        q: q.values,
        ln_weight: stored.run.draws.ln_weight.clone(),
        prior: stored.summary.q_prior.unwrap_or(QPrior::Unknown),
    })
}

/// Checks the settings of a population, and makes its family.
///
/// # Errors
/// Those of [`PopulationConfig::check`]; [`Error::Setting`] or [`Error::Sampler`] for settings that do not go together.
pub(super) fn check(config: &PopulationConfig) -> Result<TruncatedGaussian> {
    config.check()?;
    let family = TruncatedGaussian::new(config.family)?;
    config.sampling.check(family.hyperparameters().len())?;
    Ok(family)
}

/// Samples the population of finished fits into a run folder.
///
/// # Errors
/// [`Error::NotConverged`] if a fit has not converged and `allow_unconverged` is false; [`Error::Posterior`] if its
/// posterior of q cannot be used; [`Error::TooFewRuns`] for no fits; [`Error::OutputIsInput`] if the destination is one
/// of them, is in one or holds one; [`Error::OutOfRange`], [`Error::Setting`] or [`Error::Sampler`] for settings,
/// before anything is read; [`Error::Io`], [`Error::Syntax`], [`Error::Checksum`], [`Error::Array`] or
/// [`Error::InFile`] if a fit cannot be read; [`Error::Exists`], [`Error::OutputPath`], [`Error::OtherInputs`] or
/// [`Error::FolderInUse`] if the destination cannot be used.
pub fn population(
    fits: &[PathBuf],
    config: &PopulationConfig,
    allow_unconverged: bool,
    destination: Destination<'_>,
    monitor: &mut Monitor<'_>,
) -> Result<Fit> {
    let family = check(config)?;
    destination.is_apart_from(fits)?;
    let stored: Vec<StoredRun> = fits
        .iter()
        .map(|path| RunFolder::open(path)?.read())
        .collect::<Result<_>>()?;
    let mut warnings = Vec::new();
    for fit in stored.iter().filter(|s| !s.summary.converged) {
        if !allow_unconverged {
            return Err(Error::NotConverged {
                name: fit.name.clone(),
            });
        }
        warnings.push(format!(
            "the fit {} has not converged: fit it longer",
            fit.name
        ));
    }
    let streams: Vec<QPosterior> = stored.iter().map(q_posterior).collect::<Result<_>>()?;
    let target = PopulationTarget::new(family, &streams, config.reweighting)?;
    let config_toml = to_toml(config)?;
    let hashes: Vec<String> = stored
        .iter()
        .map(|s| s.summary.input_hash.clone())
        .collect();
    let hashes = hashes.join(" ");
    let inputs = [config_toml.as_bytes(), hashes.as_bytes()];
    let session = match RunSession::begin(destination, config_toml.clone(), &inputs)? {
        RunState::Finished(stored) => return Ok(stored.into()),
        RunState::Unfinished(session) => session,
    };
    monitor.tell_memory(&config.reweighting.memory(streams.len()));
    let context = |command: &str, input_hash: &str| SummaryContext {
        assumptions: Vec::new(),
        model_checks: Vec::new(),
        command: command.to_owned(),
        q_prior: None,
        warnings,
        diagnostics: BTreeMap::from([("streams".to_owned(), streams.len() as f64)]),
        input_hash: input_hash.to_owned(),
    };
    session.complete(
        &target,
        None,
        monitor,
        |control| sample(&target, &config.sampling, config.seed, control),
        |run, command, hash| Summary::new(run, &context(command, hash)),
    )
}
