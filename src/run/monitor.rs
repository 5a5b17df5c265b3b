//! Monitoring a run: the caller's observer, interrupt and time limits, and the log in the run folder.

use super::log::Log;
use crate::error::{Error, Result};
use crate::inference::Fit;
use oblate_samplers::Error as SamplerError;
use oblate_samplers::limits::Memory;
use oblate_samplers::output::Status;
use oblate_samplers::{Event, Observer};
use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// The last stage of every fit.
pub(super) const MODEL_ERROR: &str = "error of the model";

/// A caller's control of a run: observer, interrupt and time limits.
pub struct Monitor<'a> {
    /// Receives the run's events.
    pub observer: &'a mut dyn Observer,
    /// Stops the run at the next safe point once it is true; it can be set from any thread.
    pub interrupt: Arc<AtomicBool>,
    /// Time between two checkpoints: the maximum of work that is lost if the process is killed.
    pub checkpoint_every: Duration,
    /// Wall time after which the run ends with the result so far; it can be resumed.
    pub max_wall: Duration,
}

/// Makes the monitor of one run, whose label is given, and does the work under it.
pub type Monitored<'a> =
    dyn FnMut(&str, &mut dyn FnMut(&mut Monitor<'_>) -> Result<()>) -> Result<()> + 'a;

/// Does a run under its monitor. `None` if it was interrupted, whether or not it had draws by then, or if its time was up before it had any.
///
/// # Errors
/// Those of `run` and of the monitor.
pub(super) fn unless_interrupted(
    monitored: &mut Monitored<'_>,
    label: &str,
    run: &mut dyn FnMut(&mut Monitor<'_>) -> Result<Fit>,
) -> Result<Option<Fit>> {
    let mut done = None;
    let ended = monitored(label, &mut |monitor| {
        done = Some(run(monitor)?);
        Ok(())
    });
    match ended {
        Err(Error::Sampler(SamplerError::Interrupted)) => Ok(None),
        Err(error) => Err(error),
        Ok(()) => Ok(done.filter(|fit| fit.run.status != Status::Interrupted)),
    }
}

impl Monitor<'_> {
    /// Sends the observer a warning if the run will take much memory.
    pub(super) fn tell_memory(&mut self, memory: &Memory) {
        if let Some(message) = memory.warning() {
            self.warn(message);
        }
    }

    /// Sends the observer a warning. A `Break` is ignored here, because no work has begun; it is possible again at the sampler's first
    /// event.
    pub(super) fn warn(&mut self, message: String) {
        let _ = self.observer.event(&Event::Warning { message });
    }

    /// Tells the observer that stage `number` of `of` begins. A `Break` is ignored here; the observer can stop the run at the next event.
    pub(super) fn stage(&mut self, number: usize, of: usize, name: &str) {
        let name = name.to_owned();
        let _ = self.observer.event(&Event::Stage { number, of, name });
    }

    /// Tells the observer how many of how many values of a stage are done; `Break` if the observer or an interrupt stops the work.
    pub(super) fn advanced(&mut self, done: u64, of: u64) -> ControlFlow<()> {
        let told = self.observer.event(&Event::Advanced { done, of });
        if self.interrupt.load(Ordering::Relaxed) {
            return ControlFlow::Break(());
        }
        told
    }

    /// The observer, with every event also written to a log.
    pub(super) fn with_log<'b>(&'b mut self, log: &'b Log) -> Logged<'b> {
        Logged {
            observer: self.observer,
            log,
        }
    }
}

/// An observer that also writes `log.jsonl`.
pub(super) struct Logged<'a> {
    observer: &'a mut dyn Observer,
    log: &'a Log,
}

impl Observer for Logged<'_> {
    fn event(&mut self, event: &Event) -> ControlFlow<()> {
        // A log that cannot be written must not end the run: where the disk is full, the checkpoint reports it.
        let _ = self.log.write(event);
        self.observer.event(event)
    }
}
