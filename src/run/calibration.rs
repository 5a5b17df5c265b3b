//! The ranks of the true values of mocks in their fits.

use super::folder::RunFolder;
use super::stored_fit::StoredFit;
use crate::error::{Error, PosteriorFault, Result, TrackFault};
use crate::inference::{DERIVED, derived};
use crate::params::{NAMES, REQUIRED, StreamParams, StreamPrior};
use crate::posterior::{RankedFit, columns, rank};
use std::path::{Path, PathBuf};

/// Reads finished fits of mocks, each of another track, and ranks their true values.
///
/// # Errors
/// [`Error::Io`], [`Error::Syntax`], [`Error::Checksum`], [`Error::Array`] or [`Error::InFile`] for a folder that cannot be read;
/// [`Error::NotAFit`] for one without a track; [`Error::TrackFile`] for a track that cannot be read or has no true values;
/// [`Error::InFile`] for true values that the prior of the fit excludes; [`Error::Posterior`] for a track that another fit has too.
pub fn ranked_fits(paths: &[PathBuf]) -> Result<Vec<RankedFit>> {
    let mut radii: Vec<Vec<f64>> = Vec::new();
    let mut fits: Vec<RankedFit> = Vec::new();
    for path in paths {
        let fit = StoredFit::read(path)?;
        if let Some(other) = radii.iter().position(|r| *r == fit.track.r_kpc) {
            return Err(Error::Posterior {
                name: fit.stored.name,
                fault: PosteriorFault::SameTrack {
                    other: fits[other].name.clone(),
                },
            });
        }
        fits.push(ranked(&fit, &RunFolder::open(path)?.track())?);
        radii.push(fit.track.r_kpc);
    }
    Ok(fits)
}

/// The ranks of a fit, whose track was read from `file`.
fn ranked(fit: &StoredFit, file: &Path) -> Result<RankedFit> {
    let prior = StreamPrior::new(&fit.settings.prior)?;
    let truth = true_parameters(fit, &prior, file)?;
    let names = NAMES.iter().chain(DERIVED.iter().map(|(name, _)| name));
    let values = truth.to_array().into_iter().chain(derived(&prior, &truth));
    let truths: Vec<(&&str, f64)> = names.zip(values).collect();
    let weights = fit.stored.run.draws.weights();
    let ranks = columns(&fit.stored.run).into_iter().filter_map(|column| {
        let (_, truth) = truths.iter().find(|(name, _)| **name == column.name)?;
        let rank = rank(&column.values, &weights, *truth);
        Some((column.name, rank))
    });
    Ok(RankedFit {
        name: fit.stored.name.clone(),
        bins: fit.track.len(),
        converged: fit.stored.summary.converged,
        ranks: ranks.collect(),
    })
}

/// The true parameters of a track, which its fit could find.
fn true_parameters(fit: &StoredFit, prior: &StreamPrior, file: &Path) -> Result<StreamParams<f64>> {
    let known = fit.track.truth();
    if let Some(parameter) = NAMES[..REQUIRED]
        .iter()
        .find(|name| !known.contains_key(**name))
    {
        return Err(Error::TrackFile {
            path: file.to_path_buf(),
            line: None,
            fault: TrackFault::NoTruth { parameter },
        });
    }
    let given = StreamParams::from_array(NAMES.map(|name| known.get(name).copied()));
    let complete = prior.complete(&given).and_then(|params| {
        prior.check_inside(&params)?;
        Ok(params)
    });
    complete.map_err(|e| Error::InFile {
        path: file.to_path_buf(),
        line: None,
        source: Box::new(e),
    })
}
