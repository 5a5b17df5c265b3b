//! `summary.json`: all scalar numbers of a run, with the keys that scripts use.

use super::columns::{Column, columns};
use super::information::not_measured;
use super::interval::Interval;
use super::json;
use super::modes::{ModeWeight, mode_weights};
use super::population_summary::PopulationSummary;
use super::zarr::Checksum;
use crate::error::{Error, Result};
use crate::params::QPrior;
use crate::potential::HaloKind;
use oblate_samplers::output::{Check, Cost, ESS_BULK, MIN_ESS, Method, Status};
use oblate_samplers::{Run, read};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// Version of the layout of `summary.json`; a changed meaning raises it.
pub const SUMMARY_FORMAT: u32 = 3;

/// Largest size of `summary.json`.
const MAX_BYTES: u64 = 4 << 20;

/// A value with its standard error.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ValueError {
    /// The value.
    #[serde(with = "json::number")]
    pub value: f64,
    /// One standard error.
    #[serde(with = "json::number")]
    pub error: f64,
}

/// Additions to the sampler's result in a summary.
#[derive(Clone, Debug, Default)]
pub struct SummaryContext {
    /// The command line that made the run.
    pub command: String,
    /// What was assumed about the data, one sentence each.
    pub assumptions: Vec<String>,
    /// The kind of halo of a fit.
    pub halo: Option<HaloKind>,
    /// The prior on q, where q is measured.
    pub q_prior: Option<QPrior>,
    /// More warnings, each with its remedy (the model's own: density below zero).
    pub warnings: Vec<String>,
    /// Checks of the model's own error.
    pub model_checks: Vec<Check>,
    /// More numbers by name, as they should appear under `diagnostics` (tallies, the numbers behind the model's checks).
    pub diagnostics: BTreeMap<String, f64>,
    /// Hash of the inputs (track and resolved configuration), in hexadecimal.
    pub input_hash: String,
    /// Information of a fit about each parameter and q; see [`information`](super::information()).
    pub marginal_information: Vec<(String, f64)>,
    /// The streams and priors of a population.
    pub population: Option<PopulationSummary>,
}

/// All of `summary.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// [`SUMMARY_FORMAT`].
    pub format: u32,
    /// Whether the run ended by its stopping rule and every check passed. It is the most important key, and so the
    /// first.
    pub converged: bool,
    /// Why it ended.
    pub status: Status,
    /// Which sampler.
    pub method: Method,
    /// Log evidence.
    pub ln_z: ValueError,
    /// Errors of ln Z by estimator; docs/files.md, section 6, lists the names.
    #[serde(with = "json::map")]
    pub ln_z_error_parts: BTreeMap<String, f64>,
    /// Other estimates of ln Z.
    #[serde(with = "json::map")]
    pub ln_z_estimates: BTreeMap<String, f64>,
    /// Kullback-Leibler divergence from the prior, in nats.
    #[serde(with = "json::number")]
    pub information: f64,
    /// The same for each parameter of a fit, and for q where its prior is uniform; empty where the draws are too few to say.
    #[serde(with = "json::ordered", default)]
    pub marginal_information: Vec<(String, f64)>,
    /// The effective sample size to quote.
    #[serde(with = "json::number")]
    pub ess: f64,
    /// Kish's effective size.
    #[serde(with = "json::number")]
    pub ess_kish: f64,
    /// Bulk effective size per parameter.
    #[serde(with = "json::list")]
    pub ess_bulk: Vec<f64>,
    /// Tail effective size per parameter.
    #[serde(with = "json::list")]
    pub ess_tail: Vec<f64>,
    /// R-hat per parameter; empty where there are no chains.
    #[serde(with = "json::list")]
    pub r_hat: Vec<f64>,
    /// The shape, where the run has it.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub q: Option<Interval>,
    /// Every parameter by name, in the run's order.
    #[serde(with = "json::ordered")]
    pub parameters: Vec<(String, Interval)>,
    /// Every derived quantity by name, in the run's order.
    #[serde(with = "json::ordered")]
    pub derived: Vec<(String, Interval)>,
    /// The kind of halo of a fit, and with it what q is the axis ratio of.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub halo: Option<HaloKind>,
    /// The prior that the fit put on q.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub q_prior: Option<QPrior>,
    /// Orientation modes, where the run has `dir_x`, `dir_y` and q.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub modes: Option<Vec<ModeWeight>>,
    /// The streams of a population, and what they say about its hyperparameters; none in a fit.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub population: Option<PopulationSummary>,
    /// What it cost.
    pub cost: Cost,
    /// Every convergence check.
    #[serde(with = "json::checks")]
    pub checks: Vec<Check>,
    /// The checks of the model's own error: that of its steps and its particles. They say nothing about the sampler, and do not enter
    /// `converged`.
    #[serde(with = "json::checks")]
    pub model_checks: Vec<Check>,
    /// What was assumed about the data because the track does not say it, and what was changed on reading, one sentence each.
    #[serde(default)]
    pub assumptions: Vec<String>,
    /// The sampler's warnings.
    pub warnings: Vec<String>,
    /// The model's warnings.
    pub model_warnings: Vec<String>,
    /// The model's numbers by name.
    #[serde(with = "json::map")]
    pub diagnostics: BTreeMap<String, f64>,
    /// Master seed.
    pub seed: u64,
    /// Version of the random streams.
    pub stream_version: u32,
    /// Version of oblate.
    pub version: String,
    /// The command line.
    pub command: String,
    /// Hash of the inputs, in hexadecimal.
    pub input_hash: String,
    /// Checksum of the draws that were written with this summary; none before they are.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub posterior: Option<Checksum>,
}

/// The intervals of some columns, by name.
#[must_use]
pub fn intervals(columns: &[Column], weights: &[f64]) -> Vec<(String, Interval)> {
    columns
        .iter()
        .map(|c| (c.name.clone(), Interval::new(&c.values, weights, &c.unit)))
        .collect()
}

impl Summary {
    /// What the result is known by where it is an input: the hash of its own inputs, and the checksum of the draws, which change if the run
    /// is extended.
    #[must_use]
    pub fn result_hash(&self) -> String {
        let draws = self.posterior.as_ref().map(|draws| draws.fnv1a.as_str());
        format!("{} {}", self.input_hash, draws.unwrap_or_default())
    }

    /// Summarises a run.
    #[must_use]
    pub fn new(run: &Run, context: &SummaryContext) -> Self {
        let mut parameters = intervals(&columns(run), &run.draws.weights());
        let derived = parameters.split_off(run.names.len());
        Self {
            format: SUMMARY_FORMAT,
            converged: run.converged(),
            status: run.status,
            method: run.method,
            ln_z: ValueError {
                value: run.evidence.ln_z,
                error: run.evidence.error,
            },
            ln_z_error_parts: run.evidence.error_parts.clone(),
            ln_z_estimates: run.evidence.estimates.clone(),
            information: run.evidence.information,
            marginal_information: context.marginal_information.clone(),
            ess: run.ess.quoted,
            ess_kish: run.ess.kish,
            ess_bulk: run.ess.bulk.clone(),
            ess_tail: run.ess.tail.clone(),
            r_hat: run.ess.r_hat.clone(),
            q: derived
                .iter()
                .chain(&parameters)
                .find(|(name, _)| name == "q")
                .map(|(_, interval)| interval.clone()),
            parameters,
            derived,
            halo: context.halo,
            q_prior: context.q_prior,
            modes: mode_weights(run),
            population: context.population.clone(),
            cost: run.cost.clone(),
            checks: run.checks.clone(),
            model_checks: context.model_checks.clone(),
            assumptions: context.assumptions.clone(),
            warnings: run.warnings.clone(),
            model_warnings: context.warnings.clone(),
            diagnostics: context.diagnostics.clone(),
            seed: run.seed,
            stream_version: run.stream_version,
            version: env!("CARGO_PKG_VERSION").to_owned(),
            command: context.command.clone(),
            input_hash: context.input_hash.clone(),
            posterior: None,
        }
    }

    /// Reads `summary.json`.
    ///
    /// # Errors
    /// [`Error::Io`] if it is missing or cannot be read; [`Error::Syntax`] with the line if it cannot be understood, or is of another
    /// version.
    pub fn read(path: &Path) -> Result<Self> {
        #[derive(Deserialize)]
        struct Version {
            format: u32,
        }
        let text = read::text(path, MAX_BYTES).map_err(Error::io(path, "finish the run first"))?;
        let fail = |line, message| Error::Syntax {
            path: path.to_path_buf(),
            line,
            message,
            remedy: "restore the file, or fit again with this version of oblate",
        };
        let broken = |e: serde_json::Error| fail(Some(e.line()), format!("not a summary ({e})"));
        let Version { format } = serde_json::from_str(&text).map_err(broken)?;
        if format != SUMMARY_FORMAT {
            let message =
                format!("a summary of version {format}, where {SUMMARY_FORMAT} can be read");
            return Err(fail(None, message));
        }
        let summary: Self = serde_json::from_str(&text).map_err(broken)?;
        if let Some(QPrior::Uniform { lo, hi }) = summary.q_prior
            && lo >= hi
        {
            let message = format!("its prior of q is uniform from {lo} to {hi}");
            return Err(fail(None, message));
        }
        Ok(summary)
    }

    /// The verdict: why the run has not converged, or that it has.
    #[must_use]
    pub fn verdict(&self) -> String {
        if self.converged {
            let mut text = format!(
                "Converged: all {} checks passed, effective sample size {:.0}.",
                self.checks.len(),
                self.ess
            );
            let few = |check: &&Check| check.name == ESS_BULK && check.limit < MIN_ESS;
            if let Some(check) = self.checks.iter().find(few) {
                text.push_str(&format!(
                    " The settings ask for {:.0} effective draws only: below {MIN_ESS:.0} checks and ends of intervals are less certain.",
                    check.limit
                ));
            }
            return text;
        }
        let ended = match self.status {
            Status::Complete => "the stopping rule was met",
            Status::Interrupted => "the run was interrupted; resume it",
            Status::BudgetSpent => "the time limit was reached before the end; resume it",
        };
        match failed(&self.checks) {
            Some(failed) => format!("NOT CONVERGED: {ended}; {failed}."),
            None => format!("NOT CONVERGED: {ended}."),
        }
    }

    /// Why it failed, each convergence check that did with its value and its remedy.
    pub fn failed_checks(&self) -> impl Iterator<Item = String> {
        explained(&self.checks)
    }

    /// The same for the checks of the model.
    pub fn failed_model_checks(&self) -> impl Iterator<Item = String> {
        explained(&self.model_checks)
    }

    /// Which posteriors are only their priors; none if every posterior differs from its prior.
    #[must_use]
    pub fn measured_verdict(&self) -> Option<String> {
        match &self.population {
            Some(population) => population.verdict(),
            None => not_measured(
                &self.marginal_information,
                "a longer track, smaller errors or velocities may measure more",
            ),
        }
    }

    /// The verdict on the model: whether its own errors are small over the posterior. None for runs without checks of the model.
    #[must_use]
    pub fn model_verdict(&self) -> Option<String> {
        if self.model_checks.is_empty() {
            return None;
        }
        Some(match failed(&self.model_checks) {
            Some(failed) => format!("MODEL NOT ACCURATE ENOUGH: {failed}."),
            None => format!(
                "Model accurate enough: all {} checks passed.",
                self.model_checks.len()
            ),
        })
    }
}

/// The checks that failed, each with its value, its limit and its remedy.
fn explained(checks: &[Check]) -> impl Iterator<Item = String> {
    checks.iter().filter(|check| !check.pass).map(|check| {
        let limit = number(check.limit, 2);
        // As many digits as it takes to tell the value from the limit.
        let value = [2, 4, 8]
            .map(|digits| number(check.value, digits))
            .into_iter()
            .find(|value| *value != limit)
            .unwrap_or_else(|| limit.clone());
        format!("{} = {value}, limit {limit}: {}", check.name, check.message)
    })
}

/// A number of a check: small ones are p-values, of which the exponent matters, as it does of very large ones.
fn number(value: f64, digits: usize) -> String {
    if value != 0.0 && (value.abs() < 0.01 || value.abs() >= 1e6) {
        format!("{value:.1e}")
    } else {
        let text = format!("{value:.digits$}");
        let text = text.trim_end_matches('0').trim_end_matches('.');
        text.to_owned()
    }
}

/// How many checks failed, and which; none if all passed.
fn failed(checks: &[Check]) -> Option<String> {
    let failed: Vec<&str> = checks
        .iter()
        .filter(|check| !check.pass)
        .map(|check| check.name.as_str())
        .collect();
    (!failed.is_empty()).then(|| {
        format!(
            "{} of {} checks failed ({})",
            failed.len(),
            checks.len(),
            failed.join(", ")
        )
    })
}
