//! Weighted draws with names, their summary, and the files that keep both.
//!
//! A finished [`Run`] of either sampler is split over two files of a run folder: `posterior.zarr` ([`zarr`]) holds every
//! array to the bit, `summary.json` ([`Summary`]) every single number, so that [`run_from_parts`] puts the same `Run`
//! together again.

mod compare;
mod display;
pub mod json;
pub mod modes;
mod summary;
pub mod zarr;

pub use compare::{Comparison, CostRow, MarginalRow, ModeRow, SIGMA_LIMIT, compare};
pub use modes::{Mode, ModeWeight, Share, mode_weights, prolate_share};
pub use summary::{
    CheckRow, Counts, Interval, SUMMARY_FORMAT, Summary, SummaryContext, ValueError, intervals,
};

use crate::error::{Error, Result};
use oblate_samplers::Run;
use oblate_samplers::output::{Cost, Ess, Evidence};

/// One named column of draws.
#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    /// The name, of a parameter or of a derived quantity.
    pub name: String,
    /// Its unit, empty where it has none.
    pub unit: String,
    /// One value per draw.
    pub values: Vec<f64>,
}

/// All columns of a run, parameters first, then derived quantities.
#[must_use]
pub fn columns(run: &Run) -> Vec<Column> {
    let parameters = run
        .names
        .iter()
        .zip(&run.units)
        .enumerate()
        .map(|(i, (name, unit))| Column {
            name: name.clone(),
            unit: unit.clone(),
            values: run.draws.column(i),
        });
    let derived = run
        .derived_names
        .iter()
        .enumerate()
        .map(|(i, (name, unit))| Column {
            name: name.clone(),
            unit: unit.clone(),
            values: run.draws.derived_column(i),
        });
    parameters.chain(derived).collect()
}

/// One column of a run by name.
///
/// # Errors
/// [`Error::NoColumn`] that lists the columns there are.
pub fn column(run: &Run, name: &str) -> Result<Column> {
    columns(run)
        .into_iter()
        .find(|c| c.name == name)
        .ok_or_else(|| Error::NoColumn {
            column: name.to_owned(),
            found: run
                .names
                .iter()
                .chain(run.derived_names.iter().map(|d| &d.0))
                .cloned()
                .collect(),
        })
}

/// The run that was split into a summary and stored arrays: equal to the original in every bit.
///
/// # Errors
/// [`Error::MixedFolder`] if the two were not written together.
pub fn run_from_parts(summary: &Summary, stored: zarr::Stored) -> Result<Run> {
    let names: Vec<String> = summary.parameters.iter().map(|p| p.0.clone()).collect();
    if names != stored.names || summary.seed != stored.seed {
        return Err(Error::MixedFolder);
    }
    Ok(Run {
        method: summary.method,
        status: summary.status,
        seed: summary.seed,
        stream_version: summary.stream_version,
        names,
        units: stored.units,
        derived_names: stored.derived_names,
        draws: stored.draws,
        evidence: Evidence {
            ln_z: summary.ln_z.value,
            error: summary.ln_z.error,
            error_parts: summary.ln_z_error_parts.clone(),
            estimates: summary.ln_z_estimates.clone(),
            information: summary.information,
        },
        ess: Ess {
            kish: summary.ess_kish,
            bulk: summary.ess_bulk.clone(),
            tail: summary.ess_tail.clone(),
            r_hat: summary.r_hat.clone(),
            quoted: summary.ess,
        },
        cost: Cost {
            calls: summary.cost.calls,
            gradients: summary.cost.gradients,
            cpu_seconds: summary.cost.cpu_seconds,
            wall_seconds: summary.cost.wall_seconds,
            rejected: summary.cost.rejected.clone(),
        },
        history: stored.history,
        checks: summary.checks.iter().map(CheckRow::check).collect(),
        warnings: summary.warnings.clone(),
    })
}
