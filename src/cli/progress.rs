//! Progress of long work on standard error: a bar on a terminal, plain lines otherwise.

use super::options::{Common, LimitFlags};
use super::output::note;
use crate::run::Monitor;
use indicatif::{ProgressBar, ProgressStyle};
use oblate_samplers::{Event, Observer};
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

/// Time between two lines of plain text.
const LINE_EVERY: Duration = Duration::from_secs(10);

/// The interrupt flag of the process. The first Ctrl-C sets it, a second one ends the process at once.
pub fn interrupt() -> Arc<AtomicBool> {
    static FLAG: OnceLock<Arc<AtomicBool>> = OnceLock::new();
    Arc::clone(FLAG.get_or_init(|| {
        let flag = Arc::new(AtomicBool::new(false));
        let seen = Arc::clone(&flag);
        // If there can be no handler, Ctrl-C ends the process, which can be resumed from its last checkpoint.
        let _ = ctrlc::set_handler(move || {
            if seen.swap(true, Ordering::Relaxed) {
                std::process::exit(130);
            }
        });
        flag
    }))
}

/// An observer that shows one run.
pub struct Progress {
    label: String,
    bar: Option<ProgressBar>,
    plain: bool,
    last: Instant,
    limits: LimitFlags,
}

impl Progress {
    /// For a run called `label`.
    pub fn new(label: &str, common: &Common, limits: LimitFlags) -> Self {
        let terminal = std::io::IsTerminal::is_terminal(&std::io::stderr());
        let bar = (terminal && !common.quiet).then(|| {
            let bar = ProgressBar::new_spinner();
            if let Ok(style) = ProgressStyle::with_template("{spinner} {prefix} [{elapsed}] {msg}")
            {
                bar.set_style(style);
            }
            bar.set_prefix(label.to_owned());
            bar
        });
        Self {
            label: label.to_owned(),
            bar,
            plain: !terminal && !common.quiet,
            last: Instant::now(),
            limits,
        }
    }

    /// A monitor with this observer and the interrupt flag of the process.
    pub fn monitor(&mut self) -> Monitor<'_> {
        Monitor {
            interrupt: interrupt(),
            checkpoint_every: Duration::from_secs(self.limits.checkpoint_every),
            max_wall: self.limits.max_minutes.map_or(Duration::MAX, |minutes| {
                Duration::from_secs(minutes.saturating_mul(60))
            }),
            observer: self,
        }
    }

    fn show(&mut self, message: &str, always: bool) {
        if let Some(bar) = &self.bar {
            if always {
                bar.println(format!("{}: {message}", self.label));
            } else {
                bar.set_message(message.to_owned());
                bar.tick();
            }
        } else if self.plain && (always || self.last.elapsed() >= LINE_EVERY) {
            self.last = Instant::now();
            note(&format!("{}: {message}", self.label));
        }
    }
}

impl Observer for Progress {
    fn event(&mut self, event: &Event) -> ControlFlow<()> {
        match event {
            Event::Nested { ln_x, ln_z, ln_z_error, delta_ln_z, calls, efficiency, .. } => self.show(
                &format!(
                    "ln X {ln_x:.1}, ln Z {ln_z:.2} +- {ln_z_error:.2}, delta ln Z {delta_ln_z:.3}, {calls} calls, \
                     efficiency {:.2} %",
                    100.0 * efficiency
                ),
                false,
            ),
            Event::Batch { number, ln_z, ln_z_error, ess, calls } => self.show(
                &format!("batch {number}, ln Z {ln_z:.2} +- {ln_z_error:.2}, ESS {ess:.0}, {calls} calls"),
                false,
            ),
            Event::Smc { beta, ln_z, calls } => {
                self.show(&format!("SMC, beta {beta:.2e}, ln Z {ln_z:.2}, {calls} calls"), false);
            }
            Event::Tempered {
                round, scan, scans, communication_barrier, round_trips, ln_z, gradients, surrogate_acceptance,
            } => {
                let last = surrogate_acceptance.map_or_else(
                    || format!("{gradients} gradients"),
                    |acceptance| format!("surrogate moves accepted {acceptance:.2}"),
                );
                self.show(
                    &format!(
                        "round {round}, scan {} of {scans}, communication barrier {communication_barrier:.1}, {round_trips} round trips, \
                         ln Z {ln_z:.2}, {last}",
                        scan + 1
                    ),
                    false,
                );
            }
            Event::Bridge { fraction, ln_z, calls } => {
                self.show(
                    &format!("bridge {:.0} %, ln Z {ln_z:.2}, {calls} calls", 100.0 * fraction),
                    false,
                );
            }
            Event::Warning { message } => self.show(&format!("warning: {message}"), true),
            Event::Finished => {
                if let Some(bar) = &self.bar {
                    bar.finish_and_clear();
                }
            }
            _ => {}
        }
        ControlFlow::Continue(())
    }
}
