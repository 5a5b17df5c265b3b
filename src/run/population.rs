//! The population of finished fits, from their run folders into another one.

use super::folder::{RunFolder, StoredRun};
use super::locked::RunState;
use super::monitor::Monitor;
use super::population_fits::{self, q_posterior};
use super::session::{Destination, RunSession};
use crate::config::{PopulationConfig, to_toml};
use crate::error::{Error, Result};
use crate::inference::{Fit, SamplerSettings, sample};
use crate::population::{Population, QPosterior, checks, predictive_check, selection_check};
use crate::posterior::{PopulationSummary, Summary, SummaryContext, marginal_information};
use oblate_samplers::Run;
use oblate_samplers::files::write_atomically;
use oblate_samplers::nested::Kernel;
use oblate_samplers::output::Status;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Steps of a nested run per new point and hyperparameter. Two leave a rank correlation of new points with their seeds of 0.24 for a histogram of three
/// streams; 0.2 is the limit.
const STEPS_PER_HYPERPARAMETER: usize = 3;

/// Points of the density of q, in the table and in the figure.
pub(super) const DENSITY_POINTS: usize = 201;

/// Checks the settings of a population, those of the chosen family and sampler too.
///
/// # Errors
/// Those of [`PopulationConfig::check`]; [`Error::Setting`] or [`Error::Sampler`] for settings that do not go together.
pub(super) fn check(config: &PopulationConfig) -> Result<()> {
    config.check()?;
    config.sampling.check(config.family.dim()?)
}

/// Largest number of hyperparameters for which the kernel `auto` draws from ellipsoids. Those around the live points of a mixture of five may be a
/// thousand times larger than the prior, so that a draw is hardly ever accepted.
const MAX_UNIFORM: usize = 2;

/// The settings of the samplers for `dim` hyperparameters. The posterior of a flexible family is hardly narrower than its prior, so that a nested run
/// has too few iterations in which to raise its steps by itself; where a kernel has steps and the user has not chosen their number, they are three
/// per hyperparameter from the beginning.
#[must_use]
pub fn sampling_of_population(config: &PopulationConfig, dim: usize) -> SamplerSettings {
    let mut sampling = config.sampling.clone();
    let nested = &mut sampling.nested;
    if nested.kernel == Kernel::Auto && dim > MAX_UNIFORM {
        nested.kernel = Kernel::Differential;
    }
    if nested.kernel.resolve(dim) != Kernel::Uniform {
        nested.steps = nested.steps.or(Some(STEPS_PER_HYPERPARAMETER * dim));
    }
    sampling
}

/// The fits of a population.
#[derive(Clone, Copy, Debug)]
pub struct PopulationFits<'a> {
    /// Their run folders.
    pub folders: &'a [PathBuf],
    /// Streams that belong to the population and have no fit, each with the reason; the summary warns of them.
    pub missing: &'a [String],
    /// Whether fits that have not converged are taken, with a warning.
    pub allow_unconverged: bool,
}

/// Samples the population of finished fits into a run folder.
///
/// # Errors
/// [`Error::NotConverged`] if a fit has not converged and that is not allowed; [`Error::Posterior`] if its
/// posterior of q cannot be used, or if two are of one track or differ in prior or recipe; [`Error::TooFewRuns`] for no fits; [`Error::OutputIsInput`] if the destination is one
/// of them, is in one or holds one; [`Error::OutOfRange`], [`Error::Setting`] or [`Error::Sampler`] for settings,
/// before anything is read; [`Error::Io`], [`Error::Syntax`], [`Error::Checksum`], [`Error::Array`] or
/// [`Error::InFile`] if a fit cannot be read; [`Error::Exists`], [`Error::OutputPath`], [`Error::OtherInputs`] or
/// [`Error::FolderInUse`] if the destination cannot be used.
pub fn population(
    fits: &PopulationFits<'_>,
    config: &PopulationConfig,
    destination: Destination<'_>,
    monitor: &mut Monitor<'_>,
) -> Result<Fit> {
    check(config)?;
    destination.is_apart_from(fits.folders)?;
    let stored = population_fits::read(fits.folders)?;
    let warnings = warnings(fits, &stored)?;
    let streams: Vec<QPosterior> = stored.iter().map(q_posterior).collect::<Result<_>>()?;
    let target = config
        .family
        .target(&streams, config.reweighting, config.selection.as_ref())?;
    let session = match begin(destination, config, &stored, fits.missing)? {
        RunState::Finished(stored) => {
            let folder = RunFolder::at(destination.folder)?;
            write_tables(config, &folder, &stored.run, &stored.summary)?;
            return Ok(stored.into());
        }
        RunState::Unfinished(session) => session,
    };
    let sampling = sampling_of_population(config, target.prior().dim());
    monitor.tell_memory(&config.reweighting.memory(streams.len()));
    let fit = session.complete(
        target.as_ref(),
        None,
        monitor,
        |control| sample(target.as_ref(), &sampling, config.seed, control),
        |run, _, command, hash| {
            let context = SummaryContext {
                warnings,
                command: command.to_owned(),
                input_hash: hash.to_owned(),
                ..context(target.as_ref(), run, config.seed)
            };
            Summary::new(run, &context)
        },
    )?;
    if fit.run.status != Status::Interrupted {
        write_tables(config, session.folder(), &fit.run, &fit.summary)?;
    }
    Ok(fit)
}

/// The warnings of streams that are missing, of fits that have not converged, and of those whose model is not accurate enough.
///
/// # Errors
/// [`Error::NotConverged`] if a fit has not converged and that is not allowed.
fn warnings(fits: &PopulationFits<'_>, stored: &[StoredRun]) -> Result<Vec<String>> {
    let missing = fits.missing.iter();
    let mut warnings: Vec<String> = missing
        .map(|stream| {
            format!(
                "a stream is missing, which biases the population if that depends on q: {stream}"
            )
        })
        .collect();
    for fit in stored.iter().filter(|s| !s.summary.converged) {
        if !fits.allow_unconverged {
            return Err(Error::NotConverged {
                name: fit.name.clone(),
            });
        }
        warnings.push(format!(
            "the fit {} has not converged: fit it longer",
            fit.name
        ));
    }
    for fit in stored {
        let failed = fit.summary.model_checks.iter().filter(|check| !check.pass);
        let failed: Vec<&str> = failed.map(|check| check.name.as_str()).collect();
        if !failed.is_empty() {
            warnings.push(format!(
                "the fit {} has failed checks of its model ({}): continue it to a finer model",
                fit.name,
                failed.join(", ")
            ));
        }
    }
    Ok(warnings)
}

/// Begins the run, whose result follows from the settings, the results of the fits, and the streams that are missing.
///
/// # Errors
/// As of [`RunSession::begin`]; [`Error::Setting`] for settings that TOML cannot hold.
fn begin<'a>(
    destination: Destination<'a>,
    config: &PopulationConfig,
    stored: &[StoredRun],
    missing: &[String],
) -> Result<RunState<RunSession<'a>>> {
    let config_toml = to_toml(config)?;
    let hashes: Vec<String> = stored.iter().map(|s| s.summary.result_hash()).collect();
    let hashes = hashes.join(" ");
    let mut inputs = vec![config_toml.as_bytes(), hashes.as_bytes()];
    inputs.extend(missing.iter().map(String::as_bytes));
    RunSession::begin(destination, config_toml.clone(), &inputs)
}

/// What the draws of a population say about its streams and about its own error, for the summary.
fn context(target: &dyn Population, run: &Run, seed: u64) -> SummaryContext {
    let mut streams = target.streams_given_population(&run.draws);
    for (stream, without) in streams.iter_mut().zip(target.leave_one_out(&run.draws)) {
        stream.without = Some(without);
    }
    let predictive = target.predictive(&run.draws, seed);
    let mut model_checks = Vec::new();
    // Without draws no stream is to blame.
    if !run.draws.is_empty() {
        model_checks = checks(&streams);
        model_checks.push(predictive_check(&predictive));
        model_checks.extend(target.selection_variance(&run.draws).map(selection_check));
    }
    SummaryContext {
        model_checks,
        diagnostics: BTreeMap::from([("streams".to_owned(), streams.len() as f64)]),
        population: Some(PopulationSummary {
            streams,
            information: marginal_information(run, target.prior()),
            predictive,
        }),
        ..SummaryContext::default()
    }
}

/// Writes the density of q with its bands, and the streams, as tables; nothing of a run that was stopped before its first draw.
///
/// # Errors
/// [`Error::Unwritten`] if one cannot be written.
fn write_tables(
    config: &PopulationConfig,
    folder: &RunFolder,
    run: &Run,
    summary: &Summary,
) -> Result<()> {
    if run.draws.is_empty() {
        return Ok(());
    }
    let density = config.family.density(&run.draws, DENSITY_POINTS)?;
    write_table(&folder.density(), density.csv().as_bytes())?;
    let Some(population) = &summary.population else {
        return Ok(());
    };
    let path = folder.streams();
    let streams = population
        .csv()
        .map_err(Error::io(&path, "this should not happen: report it"))?;
    write_table(&path, &streams)
}

/// Writes one table, unless it is there: a finished run may be on a disk that cannot be written.
fn write_table(path: &Path, table: &[u8]) -> Result<()> {
    if std::fs::read(path).is_ok_and(|old| old == table) {
        return Ok(());
    }
    write_atomically(path, table).map_err(|source| Error::Unwritten {
        source: Box::new(source.into()),
    })
}
