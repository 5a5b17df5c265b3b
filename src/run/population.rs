//! A population from run folders to a run folder.

use super::fit::{Existing, watched};
use super::{Opened, RunFolder, StoredRun, Versions, Watch, conclude, open_or_create};
use crate::config::{PopulationConfig, text};
use crate::error::{Error, Result};
use crate::inference::sample;
use crate::params::QPrior;
use crate::population::{PopulationTarget, QPosterior, TruncatedGaussian};
use crate::posterior::{Summary, SummaryContext, column};
use oblate_samplers::{Run, Target};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The posterior of q of a finished fit, with the prior that the fit really used.
///
/// # Errors
/// [`Error::Mismatch`] if the run has no q.
pub fn q_posterior(stored: &StoredRun) -> Result<QPosterior> {
    let q = column(&stored.run, "q")?;
    Ok(QPosterior {
        name: stored.name.clone(),
        q: q.values,
        ln_weight: stored.run.draws.ln_weight.clone(),
        prior: stored.summary.q_prior.unwrap_or(QPrior::Unknown),
    })
}

/// Samples the population of finished fits into the folder `out`.
///
/// # Errors
/// What the fits' folders, the family, the folder and the sampler refuse; [`Error::Mismatch`] if a fit has not converged
/// and `allow_unconverged` is not given.
pub fn population(
    fits: &[PathBuf],
    config: &PopulationConfig,
    out: &Path,
    existing: Existing,
    allow_unconverged: bool,
    command: &str,
    watch: &mut Watch<'_>,
) -> Result<(Run, Summary)> {
    let stored: Vec<StoredRun> = fits
        .iter()
        .map(|path| RunFolder::open(path)?.read())
        .collect::<Result<_>>()?;
    let mut warnings = Vec::new();
    for fit in stored.iter().filter(|s| !s.summary.converged) {
        if !allow_unconverged {
            return Err(Error::Mismatch {
                what: format!("the fit {} has not converged", fit.name),
                remedy: "fit it longer (its summary says what failed), leave it out, or give --allow-unconverged"
                    .to_owned(),
            });
        }
        warnings.push(format!(
            "the fit {} has not converged: fit it longer",
            fit.name
        ));
    }
    let streams: Vec<QPosterior> = stored.iter().map(q_posterior).collect::<Result<_>>()?;
    let family = TruncatedGaussian::new(config.family)?;
    let target = PopulationTarget::new(family, &streams, config.reweighting)?;
    config.sampling.check(target.dim())?;
    let config_text = text(config)?;
    let hashes: Vec<String> = stored
        .iter()
        .map(|s| s.summary.input_hash.clone())
        .collect();
    let versions = Versions::of(&[config_text.as_bytes(), hashes.join(" ").as_bytes()]);
    let folder = match open_or_create(out, existing, &versions)? {
        Opened::Finished(run, summary) => return Ok((*run, *summary)),
        Opened::Folder(folder) => folder,
    };
    folder.begin(&config_text, &versions)?;
    let run = watched(&folder, &versions, watch, existing, |control| {
        sample(&target, &config.sampling, config.seed, control)
    })?;
    let mut diagnostics = BTreeMap::new();
    diagnostics.insert("streams".to_owned(), streams.len() as f64);
    let context = SummaryContext {
        command: command.to_owned(),
        q_prior: None,
        warnings,
        diagnostics,
        input_hash: versions.input_hash.clone(),
    };
    let summary = Summary::new(&run, &context);
    conclude(&folder, &target, &run, &summary, None, config.seed)?;
    Ok((run, summary))
}
