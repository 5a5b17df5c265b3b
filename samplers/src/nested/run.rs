//! The loop around the batches: limits, checkpoints, events.

use super::dynamic::Survey;
use super::finish::finish;
use super::settings::{Kernel, Settings};
use super::state::{Job, State};
use crate::control::{Control, Event};
use crate::error::{Error, Result};
use crate::keeper::Keeper;
use crate::output::{Run, Status};
use crate::target::Target;

/// Runs nested sampling on `target`, once or until the settings' targets are met, and returns weighted draws of its
/// posterior with the evidence.
///
/// The same target, settings and seed give the same bits on any number of lineages (those of the current rayon pool),
/// and after any number of interruptions. A run that was interrupted or whose budget is spent returns what it has,
/// unconverged; it can be resumed from its checkpoint, which stays after completion too.
///
/// # Errors
/// [`Error::Setting`] for settings out of range; [`Error::NoGradient`] for a kernel that needs gradients of a target that has
/// none; [`Error::NoStart`] if 100,000 draws of the prior have no likelihood;
/// [`Error::Fatal`] and [`Error::Infinite`] from the target and [`Error::Stuck`] from a kernel, after a checkpoint
/// of the last whole batch; [`Error::Checkpoint`] and [`Error::Io`] from the file.
pub fn run(
    target: &dyn Target,
    settings: &Settings,
    seed: u64,
    control: &mut Control<'_>,
) -> Result<Run> {
    settings.check(target.dim())?;
    let job = Job {
        target,
        settings,
        seed,
    };
    if job.kernel() == Kernel::Reflective && target.gradient_cost().is_none() {
        return Err(Error::NoGradient {
            sampler: "the nested sampler's kernel `reflective`",
            remedy: "use `differential` or `random-slice`, which ask for values alone",
        });
    }
    let mut keeper = Keeper::new(&[target], &(settings, seed), control)?;
    let (mut state, warnings) = match keeper.load(control, |state: &State| state.time)? {
        Some((saved, warning)) => (saved, warning.into_iter().collect()),
        None => (State::new(&job), Vec::new()),
    };
    let mut stop = control.tell(&Event::Started { dim: target.dim() });
    let status = loop {
        let mut ended = None;
        if state.rests(settings) {
            if !settings.dynamic() {
                break Status::Complete;
            }
            let survey = Survey::of(state.points(), settings, seed);
            if survey.meets(settings) {
                break Status::Complete;
            }
            stop |= control.tell(&Event::Batch {
                number: state.strands,
                ln_z: survey.weighted.ln_z,
                ln_z_error: survey.ln_z_error,
                ess: survey.ess,
                calls: state.calls,
            });
            ended = Some(survey);
        }
        if stop || control.interrupted() {
            break Status::Interrupted;
        }
        if control.spent(state.calls + state.gradients) {
            break Status::BudgetSpent;
        }
        let step = match ended {
            Some(survey) => state.add_strand(&job, survey),
            None => state.advance(&job),
        };
        state.time = keeper.time();
        if let Err(error) = step {
            return Err(keeper.save_after(error, &state, control));
        }
        stop = control.tell(&event(&state, settings));
        if control.checkpoint_due() {
            keeper.save(&state, control)?;
            stop |= control.tell(&Event::Checkpointed);
        }
    };
    if status != Status::Complete {
        keeper.save(&state, control)?;
    }
    state.time = keeper.time();
    let run = finish(&job, &state, status, warnings)?;
    control.tell(&Event::Finished);
    Ok(run)
}

fn event(state: &State, settings: &Settings) -> Event {
    Event::Nested {
        iteration: state.iteration,
        ln_x: state.ln_x,
        ln_z: state.ln_z,
        ln_z_error: (state.information.max(0.0) / settings.n_live as f64).sqrt(),
        delta_ln_z: state.delta_ln_z(settings),
        calls: state.calls,
        efficiency: state.efficiency,
    }
}
