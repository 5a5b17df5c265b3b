//! Several nested fits of one track, merged into one fit.

use super::locked::RunState;
use super::monitor::{MODEL_ERROR, Monitor};
use super::session::{Destination, RunSession};
use super::stored_fit::StoredFit;
use crate::error::{Error, Result};
use crate::inference::{self, Fit, StreamTarget};
use oblate_samplers::Run;
use oblate_samplers::output::Method;
use std::path::PathBuf;

/// Merges finished nested fits of one track, which differ in the seed and the sampler's settings only. The settings of the result are
/// those of the first.
///
/// # Errors
/// [`Error::TooFewRuns`] for no `parts`; [`Error::NotAFit`] or [`Error::NotNested`] if one is not a nested fit;
/// [`Error::OtherPosterior`] if one is of another track or model; [`Error::OutputIsInput`] if the destination is one of
/// them, is in one or holds one; [`Error::Sampler`] if two have the same seed; [`Error::Io`], [`Error::Syntax`],
/// [`Error::Checksum`], [`Error::Array`] or [`Error::InFile`] if one cannot be read; [`Error::Exists`],
/// [`Error::OutputPath`], [`Error::OtherInputs`] or [`Error::FolderInUse`] if the destination cannot be used.
pub fn merge(
    parts: &[PathBuf],
    destination: Destination<'_>,
    monitor: &mut Monitor<'_>,
) -> Result<Fit> {
    destination.is_apart_from(parts)?;
    let fits = parts
        .iter()
        .map(|p| StoredFit::read(p))
        .collect::<Result<Vec<_>>>()?;
    let Some((first, others)) = fits.split_first() else {
        return Err(Error::TooFewRuns { given: 0, min: 2 });
    };
    for (fit, part) in fits.iter().zip(parts) {
        if fit.stored.run.method == Method::Bridge {
            return Err(Error::NotNested {
                path: part.clone(),
                coarse: part.join("coarse"),
            });
        }
    }
    for other in others {
        first.matches(other)?;
    }
    let target = StreamTarget::from_track(&first.track, &first.settings)?;
    // Merged before anything is written, so that no folder is made for fits that do not belong together.
    let runs: Vec<&Run> = fits.iter().map(|f| &f.stored.run).collect();
    let run = inference::merge(&target, &runs)?;
    let mut inputs = vec![b"merge".as_slice()];
    let hashes: Vec<String> = fits
        .iter()
        .map(|f| f.stored.summary.result_hash())
        .collect();
    inputs.extend(hashes.iter().map(String::as_bytes));
    match RunSession::begin_fit(destination, &first.track, &first.settings, &inputs)? {
        RunState::Finished(stored) => Ok(stored.into()),
        RunState::Unfinished(session) => {
            let error_of_model = |monitor: &mut Monitor<'_>| monitor.stage(1, 1, MODEL_ERROR);
            session.complete_fit(&target, &first.track, monitor, error_of_model, |_| Ok(run))
        }
    }
}

impl StoredFit {
    /// Checks that another fit is of the same posterior.
    fn matches(&self, other: &Self) -> Result<()> {
        let part = if self.track != other.track {
            "track"
        } else if self.settings.model != other.settings.model {
            "[model]"
        } else if self.settings.likelihood != other.settings.likelihood {
            "[likelihood]"
        } else if self.settings.prior != other.settings.prior {
            "[prior]"
        } else {
            return Ok(());
        };
        Err(Error::OtherPosterior {
            first: self.stored.name.clone(),
            second: other.stored.name.clone(),
            part,
        })
    }
}
