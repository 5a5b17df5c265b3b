//! Assembles a run from its summary and its stored arrays.

use super::summary::Summary;
use super::zarr;
use crate::error::{Error, Result};
use oblate_samplers::Run;
use oblate_samplers::output::{Ess, Evidence};

/// The run that was split into a summary and stored arrays: equal to the original in every bit. Everything that is read
/// from a run folder is checked here.
///
/// # Errors
/// [`Error::MixedFolder`] if the two were not written together; [`Error::UnsoundRun`] if arrays or numbers are damaged.
pub fn assemble_run(summary: &Summary, stored: zarr::Stored) -> Result<Run> {
    let names: Vec<String> = summary.parameters.iter().map(|p| p.0.clone()).collect();
    let derived = summary.derived.iter().map(|d| &d.0);
    if names != stored.names
        || summary.seed != stored.seed
        || !derived.eq(stored.derived_names.iter().map(|d| &d.0))
    {
        return Err(Error::MixedFolder);
    }
    let run = Run {
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
        cost: summary.cost.clone(),
        history: stored.history,
        checks: summary.checks.clone(),
        warnings: summary.warnings.clone(),
        surrogate: stored.surrogate,
    };
    run.check()?;
    Ok(run)
}
