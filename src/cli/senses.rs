//! `oblate fit` of both senses of phi: two run folders, and the probability of each sense.

use super::command_line::CommandLine;
use super::exit::Exit;
use super::folder::{FolderFlags, interrupted};
use super::next::{Step, after_stored_fit, tell_coarse};
use super::options::LimitFlags;
use super::output::{Output, shown};
use super::several::{print_faults, tell_once};
use crate::data::ObservedTrack;
use crate::error::Result;
use crate::inference::FitSettings;
use crate::posterior::ValueError;
use crate::run::{RunFolder, SenseRun, senses};
use oblate_samplers::output::Status;
use serde_json::json;

/// Fits a track as given and mirrored, and says how probable each sense is.
pub fn fit_both(
    tracks: [&ObservedTrack; 2],
    settings: &FitSettings,
    folder: &FolderFlags,
    limits: &LimitFlags,
    command: &CommandLine,
    out: &mut Output<'_>,
) -> Result<Exit> {
    let runs = folder.fill_several(command, limits, |destination, monitored| {
        senses(tracks, settings, destination, monitored)
    })?;
    let Some(runs) = runs else {
        return Ok(interrupted(command, "one of the senses"));
    };
    if folder.json() {
        let rows: Vec<_> = runs
            .iter()
            .map(|run| {
                json!({"handedness": run.handedness, "probability": run.probability, "folder": shown(&run.folder), "summary": run.summary})
            })
            .collect();
        out.json(&json!({"senses": rows}))?;
    } else {
        print(&runs, out)?;
    }
    let mut steps = Vec::new();
    for run in &runs {
        let folder = RunFolder::open(&run.folder)?;
        tell_coarse(&run.summary, &folder);
        if run.summary.status == Status::BudgetSpent {
            // Of both, because only this command says how probable they are.
            steps.push(Step::resume(command));
        } else {
            // Its folder has the track in its sense, and the prior of this sense.
            steps.extend(after_stored_fit(&run.summary, &folder)?);
        }
    }
    tell_once(steps);
    let converged = runs.iter().all(|run| run.summary.converged);
    Ok(Exit::from_converged(converged || folder.allow_unconverged))
}

/// A probability with its error as text; small ones keep their digits.
fn probability(p: Option<ValueError>) -> String {
    let Some(p) = p else {
        return "not known yet".to_owned();
    };
    if p.value < 1e-3 {
        format!("{:.1e} +- {:.1e}", p.value, p.error)
    } else {
        format!("{:.4} +- {:.4}", p.value, p.error)
    }
}

/// The senses with their evidences and probabilities; then what is wrong with either fit.
fn print(runs: &[SenseRun], out: &mut Output<'_>) -> Result<()> {
    out.line("sense     converged  ln Z                 probability            ESS  in")?;
    for run in runs {
        let ln_z = run.summary.ln_z;
        out.line(&format!(
            "{:<8}  {:<9}  {:10.3} +- {:.3}  {:<18}  {:5.0}  {}",
            run.handedness.name(),
            if run.summary.converged { "yes" } else { "NO" },
            ln_z.value,
            ln_z.error,
            probability(run.probability),
            run.summary.ess,
            run.folder.display()
        ))?;
    }
    for run in runs {
        print_faults(run.handedness.name(), &run.summary, out)?;
    }
    Ok(())
}
