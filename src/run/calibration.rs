//! The ranks of the true values of mocks in their fits.

use super::folder::RunFolder;
use super::stored_fit::StoredFit;
use crate::data::TrackExtent;
use crate::error::{Error, PosteriorFault, Result, TrackFault};
use crate::inference::{DERIVED, derived};
use crate::params::{NAMES, REQUIRED, StreamParams, StreamPrior};
use crate::posterior::{Column, RankedFit, columns, rank};
use crate::stream::host_of;
use oblate_samplers::read;
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// Largest size of a table of ranks, which is some kilobytes per fit.
const MAX_BYTES: u64 = 1 << 30;

/// Reads finished fits of mocks, each of another track, and ranks their true values. A path to a file, where others are run folders, is
/// a table of ranks as `oblate calibration` prints them: its fits come to those of the folders.
///
/// # Errors
/// [`Error::Io`], [`Error::Syntax`], [`Error::Checksum`], [`Error::Array`] or [`Error::InFile`] for a folder or table that cannot be read;
/// [`Error::NotAFit`] for a run without a track; [`Error::TrackFile`] for a track that cannot be read or has no true values;
/// [`Error::InFile`] for true values that the prior of the fit excludes; [`Error::Posterior`] for a track that another fit has too;
/// [`Error::TooFewRuns`] for no fits.
pub fn ranked_fits(paths: &[PathBuf]) -> Result<Vec<RankedFit>> {
    let mut fits: Vec<RankedFit> = Vec::new();
    for path in paths {
        let more = if path.is_file() {
            table(path)?
        } else {
            let fit = StoredFit::read(path)?;
            vec![ranked(&fit, &RunFolder::open(path)?.track())?]
        };
        for fit in more {
            if let Some(other) = fits.iter().find(|other| other.r_kpc == fit.r_kpc) {
                return Err(Error::Posterior {
                    name: fit.name,
                    fault: PosteriorFault::SameTrack {
                        other: other.name.clone(),
                    },
                });
            }
            fits.push(fit);
        }
    }
    if fits.is_empty() {
        return Err(Error::TooFewRuns { given: 0, min: 1 });
    }
    Ok(fits)
}

/// The fits of a table.
fn table(path: &Path) -> Result<Vec<RankedFit>> {
    #[derive(Deserialize)]
    struct Table {
        fits: Vec<RankedFit>,
    }
    let text = read::text(path, MAX_BYTES)
        .map_err(Error::io(path, "give a run folder, or a table of ranks"))?;
    let broken = |line: Option<usize>, message: String| Error::Syntax {
        path: path.to_path_buf(),
        line,
        message,
        remedy: "restore the table, or make it again from the runs",
    };
    let table: Table = serde_json::from_str(&text)
        .map_err(|e| broken(Some(e.line()), format!("not a table of ranks ({e})")))?;
    for fit in &table.fits {
        if let Some((name, rank)) = fit.ranks.iter().find(|(_, u)| !(0.0..=1.0).contains(u)) {
            let message = format!(
                "the rank of {name} in {} is {rank}, outside [0, 1]",
                fit.name
            );
            return Err(broken(None, message));
        }
    }
    Ok(table.fits)
}

/// The ranks of a fit, whose track was read from `file`.
fn ranked(fit: &StoredFit, file: &Path) -> Result<RankedFit> {
    let prior = StreamPrior::new(&fit.settings.prior)?;
    let truth = true_parameters(fit, &prior, file)?;
    let model = &fit.settings.model;
    let host = (host_of(model), model.halo);
    let names = NAMES.iter().chain(DERIVED.iter().map(|(name, _)| name));
    let values = truth
        .to_array()
        .into_iter()
        .chain(derived(&prior, host, &truth));
    let truths: Vec<(&&str, f64)> = names.zip(values).collect();
    let weights = fit.stored.run.draws.weights();
    let truth_of = |name: &str| truths.iter().find(|(own, _)| **own == name);
    let columns = columns(&fit.stored.run);
    let q = columns.iter().find(|column| column.name == "q");
    let q_error = q.zip(truth_of("q")).map(|(q, (_, truth))| {
        let off = q.values.iter().map(|q| (q - truth).abs());
        off.zip(&weights).map(|(off, w)| off * w).sum::<f64>() / weights.iter().sum::<f64>()
    });
    // A derived quantity of fixed parameters alone has no rank.
    let varying = columns.into_iter().filter(Column::varies);
    let ranks = varying.filter_map(|column| {
        let (_, truth) = truth_of(&column.name)?;
        let rank = rank(&column.values, &weights, *truth);
        Some((column.name, rank))
    });
    Ok(RankedFit {
        name: fit.stored.name.clone(),
        r_kpc: fit.track.r_kpc.clone(),
        extent: TrackExtent::of(&fit.track),
        q_error,
        converged: fit.stored.summary.converged,
        ess: fit.stored.summary.ess,
        calls: fit.stored.run.cost.calls,
        cpu_seconds: fit.stored.run.cost.cpu_seconds,
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
