//! Monitoring a run: the caller's observer, interrupt and time limits, and the log in the run folder.

use super::log::Log;
use oblate_samplers::{Event, Observer};
use serde_json::json;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

/// How a caller follows, interrupts and limits a run.
pub struct Monitor<'a> {
    /// Receives the run's events.
    pub observer: &'a mut dyn Observer,
    /// Stops the run at the next safe point once it is true; it can be set from any thread.
    pub interrupt: Arc<AtomicBool>,
    /// Time between two checkpoints: the most work that is lost if the process is killed.
    pub checkpoint_every: Duration,
    /// Wall time after which the run ends with the result so far; it can be resumed.
    pub max_wall: Duration,
}

impl Monitor<'_> {
    /// The observer, with every event also written to a log.
    pub(super) fn with_log(&mut self, log: Log) -> Logged<'_> {
        Logged {
            observer: self.observer,
            log,
        }
    }
}

/// An observer that also writes `log.jsonl`.
pub(super) struct Logged<'a> {
    observer: &'a mut dyn Observer,
    log: Log,
}

impl Observer for Logged<'_> {
    fn event(&mut self, event: &Event) -> ControlFlow<()> {
        // A log that cannot be written must not end the run: where the disk is full, the checkpoint reports it.
        let _ = self.log.write(&line(event));
        self.observer.event(event)
    }
}

/// An event as one line of the log.
fn line(event: &Event) -> serde_json::Value {
    match event {
        Event::Started { dim } => json!({"event": "started", "dim": dim}),
        Event::Nested {
            iteration,
            ln_x,
            ln_z,
            ln_z_error,
            remaining,
            calls,
            efficiency,
        } => json!({
            "event": "nested", "iteration": iteration, "ln_x": ln_x, "ln_z": ln_z, "ln_z_error": ln_z_error,
            "remaining": remaining, "calls": calls, "efficiency": efficiency,
        }),
        Event::Strand {
            number,
            ln_z,
            ln_z_error,
            ess,
            calls,
        } => json!({
            "event": "strand", "number": number, "ln_z": ln_z, "ln_z_error": ln_z_error, "ess": ess, "calls": calls,
        }),
        Event::Annealing { beta, ln_z, calls } => json!({
            "event": "annealing", "beta": beta, "ln_z": ln_z, "calls": calls,
        }),
        Event::Tempered {
            round,
            scan,
            scans,
            barrier,
            round_trips,
            ln_z,
            gradients,
        } => json!({
            "event": "tempered", "round": round, "scan": scan, "scans": scans, "barrier": barrier,
            "round_trips": round_trips, "ln_z": ln_z, "gradients": gradients,
        }),
        Event::Refining { share, ln_z, calls } => json!({
            "event": "refining", "share": share, "ln_z": ln_z, "calls": calls,
        }),
        Event::Checkpointed => json!({"event": "checkpointed"}),
        Event::Warning(say) => json!({"event": "warning", "say": say}),
        Event::Finished => json!({"event": "finished"}),
        other => json!({"event": format!("{other:?}")}),
    }
}
