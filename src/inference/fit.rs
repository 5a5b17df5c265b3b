//! A fit in memory, and the common plan of fits in memory and fits into a run folder.

use super::best_fit::diagnose;
use super::model_error::{model_error, other_particles};
use super::posterior_predictive::check_posterior_predictive;
use super::prior_predictive::{Advanced, check_prior_predictive};
use super::sample::{bridge, sample};
use super::settings::FitSettings;
use super::target::StreamTarget;
use crate::data::ObservedTrack;
use crate::error::{Error, Result};
use crate::params::{QPrior, StreamPrior};
use crate::posterior::{Summary, SummaryContext, column, information, marginal_information};
use oblate_samplers::control::Silent;
use oblate_samplers::limits::Memory;
use oblate_samplers::output::Status;
use oblate_samplers::{Control, Run, Target};
use std::ops::ControlFlow::Continue;

/// The result of a fit.
#[derive(Clone, Debug)]
pub struct Fit {
    /// Draws, evidence and convergence checks.
    pub run: Run,
    /// Medians and intervals of the parameters and of q, and whether the run has converged. Its `Display` is a table.
    pub summary: Summary,
}

/// The targets of a fit, built and checked.
pub struct FitPlan {
    /// The posterior of the track under the model itself.
    pub target: StreamTarget,
    /// The coarse fit that comes first, if there is one.
    pub coarse: Option<Coarse>,
    /// An estimate of the memory of the models and of the values that the threads of the present rayon pool compute at
    /// once. The memory of the sampler comes in addition.
    pub memory: Memory,
}

/// A coarse fit that comes before a bridge.
pub struct Coarse {
    /// The posterior of the track under the coarse model.
    pub target: StreamTarget,
    /// Settings of the coarse fit.
    pub settings: FitSettings,
}

impl FitPlan {
    /// As [`of_settings`](Self::of_settings), for a track that the prior can reach.
    ///
    /// # Errors
    /// As of [`of_settings`](Self::of_settings); [`Error::UnreachableTrack`] if no draw of the prior reaches more than half of the track.
    pub fn new(track: &ObservedTrack, settings: &FitSettings) -> Result<Self> {
        let plan = Self::of_settings(track, settings)?;
        check_prior_predictive(&plan.target, settings.seed, &mut |_, _| Continue(()))?;
        Ok(plan)
    }

    /// Builds the targets and checks all settings, those of the bridge too, so that no work is lost to a setting out of range.
    ///
    /// # Errors
    /// Those of [`FitSettings::check`] and of [`StreamPrior::check_sides`]; [`Error::Setting`] or [`Error::Sampler`] for settings that do not go together;
    /// [`Error::TooMuchMemory`] if models, threads and sampler together need too much.
    pub fn of_settings(track: &ObservedTrack, settings: &FitSettings) -> Result<Self> {
        settings.check()?;
        StreamPrior::new(&settings.prior)?.check_sides()?;
        let target = StreamTarget::from_track(track, settings)?;
        settings.sampling.check(target.dim())?;
        let coarse = match settings.coarse(track.bin_width_deg) {
            Some(coarse) => {
                settings.sampling.check_bridge(target.dim())?;
                Some(Coarse {
                    target: StreamTarget::from_track(track, &coarse).map_err(of_coarse)?,
                    settings: coarse,
                })
            }
            None => None,
        };
        let threads = rayon::current_num_threads();
        let mut memory = target.memory(threads);
        if let Some(coarse) = &coarse {
            memory = memory.and(&coarse.target.memory(threads), "");
        }
        // The model of the checks of the model's error.
        let other = other_particles(&settings.model);
        memory = memory.and(&other.memory(threads), "");
        let remembered = settings.sampling.memory(target.dim());
        memory.clone().and(&remembered, "").check()?;
        Ok(Self {
            target,
            coarse,
            memory,
        })
    }
}

/// An error of the coarse model, whose number of particles has a key of its own.
fn of_coarse(error: Error) -> Error {
    match error {
        Error::Setting { key, value, remedy } if key == "model.releases.particles" => {
            Error::Setting {
                key: "coarse_particles".to_owned(),
                value,
                remedy,
            }
        }
        other => other,
    }
}

/// The bridge from a finished coarse fit to the model itself; the cost of both is counted.
///
/// # Errors
/// [`Error::Sampler`] for a setting of the bridge, a target that fails, an interrupt before the result, or a checkpoint
/// that cannot be read or written.
pub fn bridge_from(
    plan: &FitPlan,
    coarse: &Coarse,
    parent: &Run,
    settings: &FitSettings,
    control: &mut Control<'_>,
) -> Result<Run> {
    let mut run = bridge(
        &plan.target,
        &coarse.target,
        parent,
        &settings.sampling,
        settings.seed,
        control,
    )?;
    run.cost.add(&parent.cost);
    Ok(run)
}

/// The summary of a run on a track, with [`diagnose`]'s numbers and warnings, and the checks of the model's own error at the posterior
/// (docs/samplers.md, section 4), for which some hundred draws are evaluated again, unless the run was interrupted. `advanced` is told how
/// many of how many values are done.
///
/// # Errors
/// [`Error::Sampler`] if `advanced` stops the checks of the model's error.
pub fn summarize(
    target: &StreamTarget,
    track: &ObservedTrack,
    run: &Run,
    command: &str,
    input_hash: &str,
    advanced: &mut Advanced<'_>,
) -> Result<Summary> {
    let mut found = diagnose(target, track, run);
    // An interrupted run ends at once.
    let model_checks = match run.status {
        Status::Interrupted => Vec::new(),
        Status::Complete | Status::BudgetSpent => {
            check_posterior_predictive(target, run, &mut found);
            model_error(target, run, &mut found, advanced)?
        }
    };
    let context = SummaryContext {
        population: None,
        marginal_information: information_of_fit(target, run),
        command: command.to_owned(),
        assumptions: track.assumptions(),
        halo: Some(target.likelihood().model().settings().halo),
        q_prior: Some(target.stream_prior().q_prior()),
        warnings: found.warnings,
        model_checks,
        diagnostics: found.numbers,
        input_hash: input_hash.to_owned(),
    };
    Ok(Summary::new(run, &context))
}

/// Information about each free parameter, and about q where its prior is uniform; empty where the draws are too few to say.
fn information_of_fit(target: &StreamTarget, run: &Run) -> Vec<(String, f64)> {
    let mut all = marginal_information(run, target.prior());
    if all.is_empty() {
        return all;
    }
    if let (QPrior::Uniform { lo, hi }, Ok(q)) = (target.stream_prior().q_prior(), column(run, "q"))
    {
        let weights = run.draws.weights();
        let probability = |q: f64| (q - lo) / (hi - lo);
        let about = information(&q.values, &weights, run.ess.quoted, probability);
        all.push(("q".to_owned(), about));
    }
    all
}

/// Fits a track: draws of the posterior of the model's parameters.
///
/// Nothing is written; `oblate::run::fit` writes the same result into a folder, with checkpoints. By default all thirteen parameters are
/// free; docs/validation.md, section 3, has the times of such fits.
///
/// ```no_run
/// use oblate::{FitSettings, data::ObservedTrack};
/// use std::path::Path;
///
/// # fn main() -> oblate::Result<()> {
/// let track = ObservedTrack::read(Path::new("track.ecsv"))?;
/// let fit = oblate::fit(&track, &FitSettings::default())?;
/// println!("{}", fit.summary);
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// Those of [`FitPlan::new`] and [`sample`].
pub fn fit(track: &ObservedTrack, settings: &FitSettings) -> Result<Fit> {
    fit_with(track, settings, &mut Control::new(&mut Silent))
}

/// As [`fit`], under a [`Control`]: with an observer, a budget and an interrupt. If the coarse fit is interrupted or
/// its budget is spent, the result is that of the coarse fit, with its status. The control must have no checkpoint
/// plan, because the stages of the fit would use the same file.
///
/// # Errors
/// As of [`fit`].
pub fn fit_with(
    track: &ObservedTrack,
    settings: &FitSettings,
    control: &mut Control<'_>,
) -> Result<Fit> {
    let plan = FitPlan::new(track, settings)?;
    control.tell_memory(&plan.memory);
    let finish = |target: &StreamTarget, run: Run| {
        // To its end: a result in memory could not be had again.
        let summary = summarize(target, track, &run, "", "", &mut |_, _| Continue(()))?;
        Ok(Fit { run, summary })
    };
    let Some(coarse) = &plan.coarse else {
        let run = sample(&plan.target, &settings.sampling, settings.seed, control)?;
        return finish(&plan.target, run);
    };
    check_prior_predictive(&coarse.target, settings.seed, &mut |_, _| Continue(()))?;
    let parent = sample(
        &coarse.target,
        &coarse.settings.sampling,
        settings.seed,
        control,
    )?;
    if parent.status != Status::Complete {
        return finish(&coarse.target, parent);
    }
    let run = bridge_from(&plan, coarse, &parent, settings, control)?;
    finish(&plan.target, run)
}
