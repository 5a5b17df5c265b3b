//! A fit from a track and its settings to a run folder: what `oblate fit` and a study do.

use super::job::{Begin, Begun, Job};
use super::{RunFolder, Versions, Watch, conclude};
use crate::config::FitConfig;
use crate::data::ObservedTrack;
use crate::error::Result;
use crate::inference::{StreamTarget, check_reach, refined, sample};
use crate::likelihood::{DataBin, StreamLikelihood, TrackLikelihood};
use crate::params::StreamPrior;
use crate::posterior::{Summary, SummaryContext};
use crate::stream::{Model, ModelSettings};
use oblate_samplers::control::CheckpointPlan;
use oblate_samplers::output::Status;
use oblate_samplers::{Control, Run, Target};
use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

/// How a run folder that exists already is met.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Existing {
    /// It is an error.
    Refuse,
    /// It is replaced.
    Replace,
    /// It is continued, or left alone if it has finished.
    Resume,
}

/// The target of a track under given settings.
///
/// # Errors
/// What the settings' rooms refuse.
pub fn target(track: &ObservedTrack, config: &FitConfig) -> Result<StreamTarget> {
    let prior = StreamPrior::new(&config.prior)?;
    let model = Model::new(&config.model)?;
    let data: Vec<DataBin> = track
        .bins()
        .into_iter()
        .zip(track.r_kpc.iter().zip(&track.r_err_kpc))
        .map(|(bin, (r, e))| DataBin {
            bin,
            r_kpc: *r,
            r_err_kpc: *e,
        })
        .collect();
    let particles = model.table().len();
    let likelihood =
        TrackLikelihood::new(&config.likelihood, track.bin_width_deg, &data, particles)?;
    let q_range = prior.q_range();
    Ok(StreamTarget::new(
        StreamLikelihood::new(model, likelihood, q_range),
        prior,
    ))
}

/// Fits a track into the folder `out`. A folder that has finished with the same inputs is read back under
/// [`Existing::Resume`]. An interrupted run leaves its checkpoint and no summary; its status says so.
///
/// A fit with a coarse model before it ([`FitConfig::coarse`]) leaves that in a folder within; what it costs is counted in both.
/// If the coarse fit did not end by its own rule, it is the result, and the folder waits.
///
/// # Errors
/// What the settings, the folder, the files and the sampler refuse.
pub fn fit(
    track: &ObservedTrack,
    config: &FitConfig,
    out: &Path,
    existing: Existing,
    command: &str,
    watch: &mut Watch<'_>,
) -> Result<(Run, Summary)> {
    let target = target(track, config)?;
    config.sampling.check(target.dim())?;
    check_reach(&target, config.seed)?;
    // What the refinement would refuse is to be known before the coarse fit, not after it.
    let coarse = match config.coarse(track.bin_width_deg) {
        Some(settings) => {
            config.sampling.refine.check(target.dim())?;
            Some((self::target(track, &settings)?, settings))
        }
        None => None,
    };
    let track_bytes = serde_json::to_vec(track).unwrap_or_default();
    let job = Job {
        out,
        existing,
        command,
    };
    let begin = match job.begin(track, config, &[&track_bytes])? {
        Begun::Finished(run, summary) => return Ok((*run, *summary)),
        Begun::Waiting(begin) => begin,
    };
    match coarse {
        Some(coarse) => from_coarse(&job, &begin, &target, track, config, &coarse, watch),
        None => job.work(&begin, &target, track, watch, |control| {
            sample(&target, &config.sampling, config.seed, control)
        }),
    }
}

/// Fits the coarse model, unless that is done, and refines what it gave.
fn from_coarse(
    job: &Job<'_>,
    begin: &Begin,
    fine: &StreamTarget,
    track: &ObservedTrack,
    config: &FitConfig,
    (coarse, settings): &(StreamTarget, FitConfig),
    watch: &mut Watch<'_>,
) -> Result<(Run, Summary)> {
    let (started, max_wall) = (Instant::now(), watch.max_wall);
    let within = begin.folder.coarse();
    // Nobody else is to replace the whole meanwhile.
    let lock = begin.folder.log()?;
    let settings = if begin.folder.checkpoint().exists() {
        // A refinement that has begun is of the coarse fit as it is: that does not go on.
        &settings.drawing()
    } else {
        settings
    };
    let (parent, summary) = fit(
        track,
        settings,
        &within,
        Existing::Resume,
        job.command,
        watch,
    )?;
    if parent.status != Status::Complete {
        return Ok((parent, summary));
    }
    drop(lock);
    watch.max_wall = max_wall.saturating_sub(started.elapsed());
    let refined = job.work(begin, fine, track, watch, |control| {
        let (settings, seed) = (&config.sampling, config.seed);
        let mut run = refined(fine, coarse, &parent, settings, seed, control)?;
        run.cost.add(&parent.cost);
        Ok(run)
    });
    watch.max_wall = max_wall;
    refined
}

/// Summarises a run on a track and writes what it leaves behind.
pub(super) fn close(
    folder: &RunFolder,
    target: &StreamTarget,
    track: &ObservedTrack,
    run: &Run,
    versions: &Versions,
    command: &str,
) -> Result<Summary> {
    let (diagnostics, warnings) = diagnose(target, track, run);
    let context = SummaryContext {
        command: command.to_owned(),
        q_prior: Some(target.stream_prior().q_prior()),
        warnings,
        diagnostics,
        input_hash: versions.input_hash.clone(),
    };
    let summary = Summary::new(run, &context);
    conclude(folder, target, run, &summary, Some(track), run.seed)?;
    Ok(summary)
}

/// Runs a sampler under a watch, with checkpoints in the folder and events in its log.
pub(super) fn watched(
    folder: &RunFolder,
    versions: &Versions,
    watch: &mut Watch<'_>,
    existing: Existing,
    run: impl FnOnce(&mut Control<'_>) -> Result<Run>,
) -> Result<Run> {
    let (every, max_wall) = (watch.checkpoint_every, watch.max_wall);
    let mut tee = watch.tee(folder.log()?);
    let interrupt = tee.interrupt();
    let mut control = Control::new(&mut tee);
    control.interrupt = interrupt;
    control.budget.max_wall = max_wall;
    control.checkpoint = Some(CheckpointPlan {
        path: folder.checkpoint(),
        every,
        resume: existing == Existing::Resume,
        config_hash: u64::from_str_radix(&versions.input_hash, 16).unwrap_or(0),
    });
    run(&mut control)
}

/// Numbers and warnings about the model at the best fit: chi-square, what was bounded or unsafe, how far the track moves
/// when the steps are doubled, whether the density is positive.
fn diagnose(
    target: &StreamTarget,
    track: &ObservedTrack,
    run: &Run,
) -> (BTreeMap<String, f64>, Vec<String>) {
    let mut numbers = BTreeMap::new();
    let mut warnings = Vec::new();
    let tally = target.tally();
    numbers.insert(
        "bounded_tidal_radius".to_owned(),
        tally.bounded_tidal_radius as f64,
    );
    numbers.insert("unsafe_turns".to_owned(), tally.unsafe_turns as f64);
    let Some(best) = run.draws.best() else {
        return (numbers, warnings);
    };
    let params = target.params(run.draws.theta_row(best));
    let likelihood = target.likelihood();
    let (Ok((here, _)), Some(finer)) = (
        likelihood.track_at(&params),
        with_twice_the_steps(likelihood),
    ) else {
        return (numbers, warnings);
    };
    let Ok((there, _)) = finer.track_at(&params) else {
        return (numbers, warnings);
    };
    let mut chi2 = 0.0;
    let mut shift = 0.0_f64;
    for (bin, (r, sigma)) in track
        .bins()
        .into_iter()
        .zip(track.r_kpc.iter().zip(&track.r_err_kpc))
    {
        let find = |t: &crate::track::Track| t.bins.iter().find(|b| b.bin == bin).map(|b| b.r_kpc);
        if let (Some(a), Some(b)) = (find(&here), find(&there)) {
            chi2 += ((a - r) / sigma).powi(2);
            shift = shift.max((a - b).abs() / sigma);
        }
    }
    numbers.insert("best_fit_chi2".to_owned(), chi2);
    numbers.insert("best_fit_bins".to_owned(), track.len() as f64);
    numbers.insert("step_shift_sigma".to_owned(), shift);
    if shift > 1.0 {
        warnings.push(format!(
            "doubling the steps moves the best fit's track by up to {shift:.1} sigma: raise `model.steps`"
        ));
    }
    let galaxy = likelihood.galaxy(&params);
    let r = galaxy.today.x.norm2().sqrt();
    let on_axis = galaxy.host.axis * r;
    let density = crate::potential::Potential::density(&galaxy.host, on_axis);
    numbers.insert("density_on_minor_axis_msun_kpc3".to_owned(), density);
    if density < 0.0 {
        warnings.push(
            "the best fit's mass density is negative on the symmetry axis at the progenitor's radius (q flattens the potential): \
             read q as the potential's, or raise prior.q_min to 0.6"
                .to_owned(),
        );
    }
    (numbers, warnings)
}

fn with_twice_the_steps(likelihood: &StreamLikelihood) -> Option<StreamLikelihood> {
    let settings = likelihood.model().settings();
    let finer = ModelSettings {
        steps: 2 * settings.steps,
        orbit_steps: 2 * settings.orbit_steps,
        ..*settings
    };
    Some(likelihood.with_model(Model::new(&finer).ok()?))
}
