//! What a study tells its caller while it works.

use crate::error::Result;
use crate::inference::Fit;
use crate::run::monitor::{Monitor, unless_interrupted};
use std::time::Instant;

/// A caller's view of a study. Its fits may run on several threads at once.
pub trait Watcher: Sync {
    /// Makes the monitor of one run, whose label is given, and does the work under it.
    ///
    /// # Errors
    /// Those of `work`.
    fn monitored(
        &self,
        label: &str,
        work: &mut dyn FnMut(&mut Monitor<'_>) -> Result<()>,
    ) -> Result<()>;

    /// Told when the fits begin, and after each of them.
    fn advanced(&self, fits: &FitsSoFar);

    /// Whether the user has interrupted the study.
    fn interrupted(&self) -> bool;
}

/// Does a run under its monitor; `None` if it was interrupted, as of [`unless_interrupted`].
///
/// # Errors
/// Those of `run`.
pub(super) fn watched(
    watcher: &dyn Watcher,
    label: &str,
    run: &mut dyn FnMut(&mut Monitor<'_>) -> Result<Fit>,
) -> Result<Option<Fit>> {
    unless_interrupted(
        &mut |label, work| watcher.monitored(label, work),
        label,
        run,
    )
}

/// How far the fits of a study are.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FitsSoFar {
    /// Number of fits that have a result and are not sampled further.
    pub done: usize,
    /// Number of those that failed.
    pub failed: usize,
    /// Number of all fits.
    pub of: usize,
    /// How many work now.
    pub running: usize,
    /// How many wait in a queue.
    pub waiting: usize,
    /// Seconds that the others take, if they take as long as those that this process has seen end; none before the first.
    pub seconds_left: Option<f64>,
}

/// How fast the fits end.
pub(super) struct Pace {
    began: Instant,
    /// Number of those that had a result at the first look.
    before: Option<usize>,
}

impl Pace {
    /// From now on.
    pub fn new() -> Self {
        Self {
            began: Instant::now(),
            before: None,
        }
    }

    /// How long the others take, from the number of fits that have ended since the first call.
    pub fn estimate(&mut self, fits: &mut FitsSoFar) {
        let ended = fits.done + fits.failed;
        // Fewer where a user has removed a result meanwhile.
        let new = ended.saturating_sub(*self.before.get_or_insert(ended));
        if new > 0 {
            let each = self.began.elapsed().as_secs_f64() / new as f64;
            fits.seconds_left = Some(each * (fits.of - ended) as f64);
        }
    }
}
