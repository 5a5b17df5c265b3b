//! The SMC bridge from a finished fit to a finer model, into another run folder.

use super::locked::RunState;
use super::monitor::{MODEL_ERROR, Monitor};
use super::session::{Destination, RunSession};
use super::stored_fit::StoredFit;
use crate::error::{Error, Result};
use crate::inference::{self, Fit, FitSettings, StreamTarget};
use oblate_samplers::Target;
use std::path::Path;

/// Continues the finished fit in `parent` to another model of the stream; `change` makes its settings from those of the parent. Track
/// and prior stay the same.
///
/// # Errors
/// [`Error::SameModel`] if `change` leaves model and likelihood as they are; [`Error::Setting`] or [`Error::Sampler`]
/// for a setting out of its range, as of [`FitSettings::check`]; [`Error::TooMuchMemory`] if both models need too much;
/// [`Error::NotAFit`] if `parent` is not a fit; [`Error::OutputIsInput`] if the destination is `parent`, is in it or
/// holds it; [`Error::Io`], [`Error::Syntax`], [`Error::Checksum`], [`Error::Array`] or [`Error::InFile`] if `parent`
/// cannot be read; [`Error::Exists`], [`Error::OutputPath`], [`Error::OtherInputs`] or [`Error::FolderInUse`] if the
/// destination cannot be used; those of `change`.
pub fn bridge(
    parent: &Path,
    change: impl FnOnce(&mut FitSettings) -> Result<()>,
    destination: Destination<'_>,
    monitor: &mut Monitor<'_>,
) -> Result<Fit> {
    destination.is_apart_from(&[parent.to_path_buf()])?;
    let StoredFit {
        stored,
        track,
        settings: coarse,
    } = StoredFit::read(parent)?;
    let mut settings = coarse.clone();
    change(&mut settings)?;
    if settings.model == coarse.model && settings.likelihood == coarse.likelihood {
        return Err(Error::SameModel);
    }
    settings.check()?;
    let fine = StreamTarget::from_track(&track, &settings)?;
    let coarse = StreamTarget::from_track(&track, &coarse)?;
    settings.sampling.check_bridge(fine.dim())?;
    let threads = rayon::current_num_threads();
    let memory = fine.memory(threads).and(&coarse.memory(threads), "");
    memory.check()?;
    let hash = stored.summary.result_hash();
    let inputs = [b"bridge".as_slice(), hash.as_bytes()];
    let session = match RunSession::begin_fit(destination, &track, &settings, &inputs)? {
        RunState::Finished(stored) => return Ok(stored.into()),
        RunState::Unfinished(session) => session,
    };
    monitor.tell_memory(&memory);
    monitor.stage(1, 2, "bridge to the finer model");
    let error_of_model = |monitor: &mut Monitor<'_>| monitor.stage(2, 2, MODEL_ERROR);
    session.complete_fit(&fine, &track, monitor, error_of_model, |control| {
        let (sampling, seed) = (&settings.sampling, settings.seed);
        inference::bridge(&fine, &coarse, &stored.run, sampling, seed, control)
    })
}
