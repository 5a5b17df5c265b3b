//! The fits of a study on this computer: several at once, each on threads of its own.

use super::plan::PlannedFit;
use super::watch::{FitsSoFar, Pace, Watcher, watched};
use crate::error::{Error, Result};
use crate::posterior::Summary;
use crate::run::fit::fit;
use crate::run::locked::IfExists;
use crate::run::session::Destination;
use oblate_samplers::Error as SamplerError;
use oblate_samplers::output::Status;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// How a fit ended.
#[derive(Debug)]
pub(super) enum Outcome {
    /// With a result.
    Done(Box<Summary>),
    /// Without one, for a reason that is its own.
    Failed(String),
    /// By the user; it can be continued.
    Interrupted,
}

impl Outcome {
    /// With this result.
    pub fn done(summary: Summary) -> Self {
        Self::Done(Box::new(summary))
    }
}

/// Why a fit has no result at the end of its time.
const OUT_OF_TIME: &str =
    "its time was up before its first result; repeat the study to continue it";

/// Does the fits, at most as many at once as this pool has threads, and returns how each ended, in their order. None is begun after an
/// interrupt.
///
/// # Errors
/// The first error that is not of one fit alone, such as a full disk, once the fits that work have ended.
pub(super) fn all_fits(
    fits: &[PlannedFit],
    command: &str,
    watcher: &dyn Watcher,
) -> Result<Vec<Outcome>> {
    let threads = rayon::current_num_threads();
    let settled: Vec<bool> = fits.iter().map(PlannedFit::is_settled).collect();
    let done = settled.iter().filter(|settled| **settled).count();
    let at_once = threads.min(fits.len() - done);
    let queue = Queue {
        fits,
        settled,
        command,
        watcher,
        at_once,
        next: AtomicUsize::new(0),
        stop: AtomicBool::new(false),
        so_far: Mutex::new((
            FitsSoFar {
                done,
                of: fits.len(),
                ..FitsSoFar::default()
            },
            Pace::new(),
        )),
    };
    queue.tell(|_| {});
    let ended = if at_once <= 1 {
        // All threads for one fit after the other.
        vec![queue.work()]
    } else {
        let worker = |number: usize| {
            let own = threads / at_once + usize::from(number < threads % at_once);
            let pool = rayon::ThreadPoolBuilder::new().num_threads(own).build();
            let pool = pool.map_err(|e| Error::Setting {
                key: "threads".to_owned(),
                value: threads.to_string(),
                remedy: e.to_string(),
            })?;
            pool.install(|| queue.work())
        };
        std::thread::scope(|scope| {
            let workers: Vec<_> = (0..at_once)
                .map(|number| scope.spawn(move || worker(number)))
                .collect();
            let joined = workers.into_iter().map(|worker| {
                worker
                    .join()
                    .unwrap_or_else(|panic| std::panic::resume_unwind(panic))
            });
            joined.collect()
        })
    };
    let mut outcomes: Vec<Outcome> = fits.iter().map(|_| Outcome::Interrupted).collect();
    for worker in ended {
        for (i, outcome) in worker? {
            outcomes[i] = outcome;
        }
    }
    Ok(outcomes)
}

/// The fits, which workers take one after the other.
struct Queue<'a> {
    fits: &'a [PlannedFit],
    /// Which of them were counted as done at the start.
    settled: Vec<bool>,
    command: &'a str,
    watcher: &'a dyn Watcher,
    at_once: usize,
    next: AtomicUsize,
    /// Whether no other fit is to be begun.
    stop: AtomicBool,
    so_far: Mutex<(FitsSoFar, Pace)>,
}

impl Queue<'_> {
    /// Takes fits until none is left, and returns how each ended, with its place.
    fn work(&self) -> Result<Vec<(usize, Outcome)>> {
        let mut ended = Vec::new();
        loop {
            let place = self.next.fetch_add(1, Ordering::Relaxed);
            let stopped = self.stop.load(Ordering::Relaxed) || self.watcher.interrupted();
            let Some(fit) = self.fits.get(place).filter(|_| !stopped) else {
                return Ok(ended);
            };
            let outcome = one_fit(fit, self.fits.len(), self.command, self.watcher)
                .inspect_err(|_| self.stop.store(true, Ordering::Relaxed))?;
            match outcome {
                Outcome::Done(_) if !self.settled[place] => self.tell(|fits| fits.done += 1),
                Outcome::Failed(_) => self.tell(|fits| {
                    fits.done -= usize::from(self.settled[place]);
                    fits.failed += 1;
                }),
                Outcome::Done(_) | Outcome::Interrupted => {}
            }
            ended.push((place, outcome));
        }
    }

    /// Changes what is known of all fits and tells the caller. The lock is held meanwhile, so that the caller is told in order.
    fn tell(&self, change: impl FnOnce(&mut FitsSoFar)) {
        let mut so_far = self.so_far.lock().unwrap_or_else(PoisonError::into_inner);
        let (fits, pace) = &mut *so_far;
        change(fits);
        fits.running = self.at_once.min(fits.of - fits.done - fits.failed);
        pace.estimate(fits);
        self.watcher.advanced(fits);
    }
}

/// Does one fit, or reads it back.
///
/// # Errors
/// Those that are not of this fit alone.
pub(super) fn one_fit(
    planned: &PlannedFit,
    of: usize,
    command: &str,
    watcher: &dyn Watcher,
) -> Result<Outcome> {
    let destination = Destination {
        folder: &planned.folder,
        if_exists: IfExists::Resume,
        command,
    };
    let label = format!("fit {} of {of}, {}", planned.number, planned.name());
    let done = watched(watcher, &label, &mut |monitor| {
        fit(&planned.track, &planned.settings, destination, monitor)
    });
    let done = match done {
        Err(error) if is_of_the_fit(&error) => return Ok(Outcome::Failed(error.to_string())),
        other => other?,
    };
    match done {
        Some(fit) if fit.run.status == Status::Complete => Ok(Outcome::done(fit.summary)),
        // That of the folder: where the time of a coarse fit was up, what is done is that fit.
        Some(_) if planned.is_finished() => Ok(Outcome::done(planned.read_back()?)),
        _ if watcher.interrupted() => Ok(Outcome::Interrupted),
        // The time was up before a result that would replace this one.
        None if planned.is_finished() => Ok(Outcome::done(planned.read_back()?)),
        _ => Ok(Outcome::Failed(OUT_OF_TIME.to_owned())),
    }
}

/// Whether an error is that of a track or of its posterior, so that other fits can succeed.
fn is_of_the_fit(error: &Error) -> bool {
    matches!(error, Error::UnreachableTrack { .. } | Error::NoTrack(_)) || is_of_the_sampler(error)
}

/// Whether an error is that of a sampler at one target.
pub(super) fn is_of_the_sampler(error: &Error) -> bool {
    use SamplerError as S;
    match error {
        Error::Sampler(error) => !matches!(
            error,
            S::OutOfRange(_)
                | S::TooMuchMemory(_)
                | S::Setting { .. }
                | S::Interrupted
                | S::Io { .. }
                | S::Checkpoint { .. }
        ),
        _ => false,
    }
}
