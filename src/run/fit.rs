//! A fit of a track into a run folder: what `oblate fit` and a study do.

use super::folder::RunFolder;
use super::locked::{IfExists, RunState};
use super::monitor::{MODEL_ERROR, Monitor};
use super::session::{Destination, RunSession, versions_of_fit};
use crate::data::ObservedTrack;
use crate::error::{Error, Result};
use crate::inference::{
    Coarse, Fit, FitPlan, FitSettings, bridge_from, check_prior_predictive, sample,
};
use crate::posterior::Summary;
use oblate_samplers::checkpoint;
use oblate_samplers::output::Status;
use std::ops::ControlFlow::Continue;
use std::path::Path;
use std::time::Instant;

/// Fits a track into a run folder. Under [`IfExists::Resume`], a folder that has finished with the same inputs is read
/// back. An interrupted run leaves its checkpoint and no summary; its status is then `interrupted`.
///
/// A coarse fit that comes first ([`FitSettings::coarse`]) is a run folder `coarse` in this one, and its cost is counted in both. If it
/// is interrupted or its time is up, it is the result, and this folder has no summary yet.
///
/// # Errors
/// Those of [`FitPlan::new`]; [`Error::Exists`], [`Error::OtherInputs`] or [`Error::FolderInUse`] if the folder exists and cannot be used;
/// [`Error::Io`] if a file cannot be read or written; [`Error::Sampler`] if the sampler fails.
pub fn fit(
    track: &ObservedTrack,
    settings: &FitSettings,
    destination: Destination<'_>,
    monitor: &mut Monitor<'_>,
) -> Result<Fit> {
    fit_in_stages(track, settings, destination, monitor, None)
}

/// Reads back what a fit of a track has written so far, also one that would be sampled further.
///
/// # Errors
/// [`Error::OtherInputs`] if it was made from other inputs; as of [`RunFolder::read`].
pub(super) fn read_fit(
    track: &ObservedTrack,
    settings: &FitSettings,
    folder: &Path,
) -> Result<Summary> {
    let opened = RunFolder::open(folder)?;
    let versions = versions_of_fit(settings, &[&bytes(track)])?;
    if opened.read_versions()?.input_hash != versions.input_hash {
        return Err(Error::OtherInputs {
            path: folder.to_path_buf(),
        });
    }
    Ok(opened.read()?.summary)
}

/// A track as an input of its fit.
fn bytes(track: &ObservedTrack) -> Vec<u8> {
    serde_json::to_vec(track).unwrap_or_default()
}

/// Stages of a fit of one model: check of the prior, sampling, error of the model.
const STAGES: usize = 3;

/// As [`fit`], as stages of a fit that has `coarse_of` stages, if this one is its coarse fit.
fn fit_in_stages(
    track: &ObservedTrack,
    settings: &FitSettings,
    destination: Destination<'_>,
    monitor: &mut Monitor<'_>,
    coarse_of: Option<usize>,
) -> Result<Fit> {
    let plan = FitPlan::of_settings(track, settings)?;
    let (before, of) = match (coarse_of, &plan.coarse) {
        (Some(of), _) => (1, of),
        (None, Some(_)) => (0, 2 * STAGES),
        (None, None) => (0, STAGES),
    };
    let (of_model, error) = match coarse_of {
        Some(_) => (" of the coarse model", "error of the coarse model"),
        None => ("", MODEL_ERROR),
    };
    monitor.stage(before + 1, of, &format!("check of the prior{of_model}"));
    // What an interrupted command proposes is to go on with the run in its folder, which must not be one that it replaces.
    let replaces = destination.if_exists == IfExists::Replace;
    let warning = check_prior_predictive(&plan.target, settings.seed, &mut |done, of| {
        let flow = monitor.advanced(done, of);
        if replaces { Continue(()) } else { flow }
    })?;
    if let Some(message) = warning {
        monitor.warn(message);
    }
    let track_bytes = bytes(track);
    let session = match RunSession::begin_fit(destination, track, settings, &[&track_bytes])? {
        RunState::Finished(stored) => return Ok(stored.into()),
        RunState::Unfinished(session) => session,
    };
    monitor.tell_memory(&plan.memory);
    if let Some(coarse) = &plan.coarse {
        return from_coarse(&session, &plan, coarse, track, settings, monitor);
    }
    monitor.stage(before + 2, of, &format!("sampling{of_model}"));
    let error_of_model = |monitor: &mut Monitor<'_>| monitor.stage(before + 3, of, error);
    session.complete_fit(&plan.target, track, monitor, error_of_model, |control| {
        sample(&plan.target, &settings.sampling, settings.seed, control)
    })
}

/// Fits the coarse model, unless that is done, and continues by the bridge to the model itself.
fn from_coarse(
    session: &RunSession<'_>,
    plan: &FitPlan,
    coarse: &Coarse,
    track: &ObservedTrack,
    settings: &FitSettings,
    monitor: &mut Monitor<'_>,
) -> Result<Fit> {
    let (started, max_wall) = (Instant::now(), monitor.max_wall);
    let coarse_settings = if checkpoint::exists(&session.folder().checkpoint()) {
        // A bridge that has begun is one from the coarse fit as it was: that fit must not be extended.
        &coarse.settings.without_extensions()
    } else {
        &coarse.settings
    };
    let destination = Destination {
        folder: &session.folder().coarse(),
        if_exists: IfExists::Resume,
        ..session.destination()
    };
    let of = 2 * STAGES;
    let parent = fit_in_stages(track, coarse_settings, destination, monitor, Some(of))?;
    if parent.run.status != Status::Complete {
        return Ok(parent);
    }
    monitor.max_wall = max_wall.saturating_sub(started.elapsed());
    monitor.stage(of - 1, of, "bridge to the model itself");
    let error_of_model = |monitor: &mut Monitor<'_>| monitor.stage(of, of, MODEL_ERROR);
    let bridged = session.complete_fit(&plan.target, track, monitor, error_of_model, |control| {
        bridge_from(plan, coarse, &parent.run, settings, control)
    });
    monitor.max_wall = max_wall;
    bridged
}
