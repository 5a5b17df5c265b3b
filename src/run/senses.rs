//! Fits of one track in both senses of phi: each a run folder of its own, in one folder, with the probability of each sense.

use super::fit::fit;
use super::monitor::{Monitored, unless_interrupted};
use super::session::Destination;
use crate::data::{Handedness, ObservedTrack};
use crate::error::Result;
use crate::inference::FitSettings;
use crate::posterior::{Summary, ValueError};
use oblate_samplers::output::Status;
use std::path::PathBuf;

/// A finished fit of one sense.
#[derive(Clone, Debug)]
pub struct SenseRun {
    /// The sense, which is the name of the run folder.
    pub handedness: Handedness,
    /// Its run folder.
    pub folder: PathBuf,
    /// Probability of this sense, if both were equally probable before, with the standard error from those of ln Z; `None` where one of the
    /// fits was stopped by its time limit.
    pub probability: Option<ValueError>,
    /// Its summary.
    pub summary: Summary,
}

/// Fits a track in both senses, each into the run folder of its name in the destination. `tracks` are the same track as given and mirrored.
/// The settings are those of the track as given; the mirrored one has the mirrored prior ([`PriorSettings::mirrored`]). `None` if a fit was
/// interrupted; the one before it is finished.
///
/// # Errors
/// As of [`fit`] and [`PriorSettings::mirrored`]; [`Error::OutputPath`] if the destination itself is a run folder.
///
/// [`PriorSettings::mirrored`]: crate::params::PriorSettings::mirrored
/// [`Error::OutputPath`]: crate::Error::OutputPath
pub fn senses(
    tracks: [&ObservedTrack; 2],
    settings: &FitSettings,
    destination: Destination<'_>,
    monitored: &mut Monitored<'_>,
) -> Result<Option<Vec<SenseRun>>> {
    let mirrored = FitSettings {
        prior: settings.prior.mirrored()?,
        ..settings.clone()
    };
    destination.is_no_run()?;
    let folders = Handedness::BOTH.map(|sense| destination.folder.join(sense.name()));
    destination.may_hold(&folders)?;
    let mut fits = Vec::new();
    for (i, settings) in [settings, &mirrored].into_iter().enumerate() {
        let (track, sense) = (tracks[i], Handedness::BOTH[i]);
        let own = Destination {
            folder: &folders[i],
            ..destination
        };
        let sampler = settings.sampling.sampler.name();
        let label = format!(
            "fit {} of 2, {} {} {sampler}",
            i + 1,
            track.name,
            sense.name()
        );
        let done = unless_interrupted(monitored, &label, &mut |monitor| {
            fit(track, settings, own, monitor)
        })?;
        match done {
            Some(fit) => fits.push((sense, fit.summary)),
            None => return Ok(None),
        }
    }
    let complete = fits.iter().all(|(_, s)| s.status == Status::Complete);
    let ln_z: Vec<ValueError> = fits.iter().map(|(_, summary)| summary.ln_z).collect();
    let runs = fits.into_iter().zip(folders).enumerate();
    let runs = runs.map(|(i, ((handedness, summary), folder))| SenseRun {
        handedness,
        folder,
        probability: complete.then(|| probability(ln_z[i], ln_z[1 - i])),
        summary,
    });
    Ok(Some(runs.collect()))
}

/// Probability of a hypothesis of this ln Z against one other that was equally probable before.
fn probability(own: ValueError, other: ValueError) -> ValueError {
    let value = 1.0 / (1.0 + (other.value - own.value).exp());
    ValueError {
        value,
        error: value * (1.0 - value) * own.error.hypot(other.error),
    }
}
