//! Who watches a run: the caller's observer and interrupt, and the log in the run folder.

use super::Log;
use oblate_samplers::{Event, Observer};
use serde_json::json;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

/// A caller's observer and interrupt.
pub struct Watch<'a> {
    /// Is told what happens.
    pub observer: &'a mut dyn Observer,
    /// Set from anywhere to stop at the next safe point.
    pub interrupt: Arc<AtomicBool>,
    /// Time between two checkpoints: what a kill costs at most.
    pub checkpoint_every: Duration,
    /// Wall time after which the run ends with what it has; it can be resumed.
    pub max_wall: Duration,
}

impl Watch<'_> {
    /// This watch with a log beside it.
    pub(super) fn tee(&mut self, log: Log) -> Tee<'_> {
        Tee {
            observer: self.observer,
            interrupt: Arc::clone(&self.interrupt),
            log,
        }
    }
}

/// An observer that also writes `log.jsonl`.
pub(super) struct Tee<'a> {
    observer: &'a mut dyn Observer,
    interrupt: Arc<AtomicBool>,
    log: Log,
}

impl Tee<'_> {
    pub(super) fn interrupt(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.interrupt)
    }
}

impl Observer for Tee<'_> {
    fn event(&mut self, event: &Event) -> ControlFlow<()> {
        // A log that cannot be written must not end the run: the checkpoint and the summary will say so themselves.
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
        Event::Boost { draws, ln_z, ess } => json!({
            "event": "boost", "draws": draws, "ln_z": ln_z, "ess": ess,
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
