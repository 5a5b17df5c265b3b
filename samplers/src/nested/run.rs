//! The loop around the iterations: limits, checkpoints, events.

use super::dynamic::RunSummary;
use super::finish::finish;
use super::settings::{Kernel, Settings};
use super::state::{Context, State};
use crate::checkpointer::Checkpointer;
use crate::control::{Control, Event};
use crate::error::{Error, Result};
use crate::output::{Run, Status};
use crate::target::Target;

/// Runs nested sampling on `target`, once or until the settings' targets are met, and returns weighted draws of its
/// posterior with the evidence.
///
/// The same target, settings and seed give the same bits on any number of threads (those of the current rayon pool),
/// and after any number of interruptions. A run that was interrupted or whose budget is spent returns its result so
/// far, unconverged; it can be resumed from its checkpoint, which stays after completion too.
///
/// # Errors
/// [`Error::OutOfRange`], [`Error::Setting`] and [`Error::TooMuchMemory`] as of [`Settings::check`];
/// [`Error::GalileanWithoutGradient`]; [`Error::NoStart`] if 100,000
/// draws of the prior have no likelihood; [`Error::Fatal`] and [`Error::Infinite`] from the target and
/// [`Error::EmptySlice`] and [`Error::LooseBound`] from a kernel, after a checkpoint of the last complete iteration;
/// [`Error::Checkpoint`] and [`Error::Io`] from the file.
pub fn run(
    target: &dyn Target,
    settings: &Settings,
    seed: u64,
    control: &mut Control<'_>,
) -> Result<Run> {
    settings.check(target.dim())?;
    let context = Context {
        target,
        settings,
        seed,
    };
    if context.kernel() == Kernel::Galilean && target.gradient_cost().is_none() {
        return Err(Error::GalileanWithoutGradient);
    }
    // The number of batches says only how long the run may go on.
    let drawing = Settings {
        max_batches: 1,
        ..settings.clone()
    };
    let mut checkpointer = Checkpointer::new(&[target], &(&drawing, seed), control)?;
    let saved = checkpointer.load(
        control,
        |state: &State| &state.cost,
        |state| state.check(&context),
    )?;
    let mut state = match saved {
        Some(mut saved) => {
            saved.learner.prepare();
            saved
        }
        None => State::new(&context),
    };
    let mut stop = control.tell(&Event::Started { dim: target.dim() });
    stop |= control.tell_memory(&settings.memory(target.dim()));
    let mut ln_x_at_end = state.ln_x_at_end();
    let status = loop {
        let mut ended = None;
        if state.batch_ended(settings) {
            if !settings.dynamic() || state.batches >= settings.max_batches {
                break Status::Complete;
            }
            let summary = RunSummary::of(state.points(), target, settings, seed)?;
            if summary.meets(settings) {
                break Status::Complete;
            }
            let (open, needed) = summary.open(settings);
            stop |= control.tell(&Event::Batch {
                number: state.batches,
                of: settings.max_batches,
                open,
                needed,
                ln_z: summary.weighted.ln_z,
                ln_z_error: summary.ln_z_error,
                ess: summary.ess,
                calls: state.cost.calls,
            });
            ended = Some(summary);
        }
        if stop || control.interrupted() {
            break Status::Interrupted;
        }
        if control.spent(state.cost.all_calls()) {
            break Status::BudgetSpent;
        }
        let begins = ended.is_some();
        let step = match ended {
            Some(summary) => state.add_batch(&context, summary),
            None => state.advance(&context),
        };
        checkpointer.note_times(&mut state.cost);
        if let Err(error) = step {
            return Err(checkpointer.save_after(error, &state, control));
        }
        if begins {
            ln_x_at_end = state.ln_x_at_end();
        }
        stop = control.tell(&event(&state, settings, ln_x_at_end));
        if control.checkpoint_due() {
            checkpointer.save(&state, control)?;
            stop |= control.tell(&Event::Checkpointed);
        }
    };
    checkpointer.note_times(&mut state.cost);
    checkpointer.save_at_end(status, &state, control)?;
    let run = finish(&context, &state, status)?;
    control.tell(&Event::Finished);
    Ok(run)
}

fn event(state: &State, settings: &Settings, ln_x_at_end: Option<f64>) -> Event {
    Event::Nested {
        iteration: state.iteration,
        ln_x: state.ln_x,
        ln_z: state.ln_z,
        ln_z_error: (state.information.max(0.0) / settings.n_live as f64).sqrt(),
        delta_ln_z: state.delta_ln_z(settings),
        dlnz: settings.dlnz,
        calls: state.cost.calls,
        efficiency: state.efficiency,
        batches: state.batches_done(ln_x_at_end),
    }
}
