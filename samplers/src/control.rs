//! How a caller monitors, limits, stops and resumes a run.

use crate::limits::Memory;
use serde::Serialize;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Events of a run, sent to its observer at safe points only.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "event", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Event {
    /// A stage of a task of several begins. Samplers have one stage and do not send it; their callers do.
    Stage {
        /// Its number, from 1.
        number: usize,
        /// How many stages there are.
        of: usize,
        /// What it does.
        name: String,
    },
    /// A part of a stage that counts its work is done.
    Advanced {
        /// Pieces done.
        done: u64,
        /// All pieces.
        of: u64,
    },
    /// Work begins.
    Started {
        /// Number of parameters.
        dim: usize,
    },
    /// One iteration of a nested run.
    Nested {
        /// Iterations so far.
        iteration: u64,
        /// Expected log prior volume of the live points.
        ln_x: f64,
        /// Evidence so far.
        ln_z: f64,
        /// Its simulated error, where known.
        ln_z_error: f64,
        /// Log-evidence that the live points could still add.
        delta_ln_z: f64,
        /// At less than this the run, or its first batch, ends.
        dlnz: f64,
        /// Likelihood calls so far.
        calls: u64,
        /// New points per call in the last iteration.
        efficiency: f64,
        /// Batches done, with the part of the present one that is done, by its logarithm of the prior volume; 0 in the first batch.
        batches: f64,
    },
    /// A dynamic nested run has ended a batch without meeting its target, and adds another batch of live points.
    Batch {
        /// Batches so far.
        number: usize,
        /// How many there may be.
        of: usize,
        /// Names of the convergence checks that are still open.
        open: Vec<String>,
        /// How many times as many batches these need, if their numbers grow with them.
        needed: f64,
        /// Evidence.
        ln_z: f64,
        /// Its error.
        ln_z_error: f64,
        /// Effective draws.
        ess: f64,
        /// Likelihood calls so far.
        calls: u64,
    },
    /// One MCMC step of the SMC samplers that a tempered run starts from.
    Smc {
        /// Inverse temperature that all SMC samplers have reached.
        beta: f64,
        /// Mean over the SMC samplers of the logarithm of the estimated integral of prior times L^beta, over the part of the prior that is
        /// not rejected.
        ln_z: f64,
        /// Likelihood calls so far.
        calls: u64,
    },
    /// One scan of a tempered run.
    Tempered {
        /// Round, from 0.
        round: usize,
        /// Scan of the round, from 0.
        scan: usize,
        /// Scans of this round.
        scans: usize,
        /// Communication barrier of the last finished round; NaN in the first.
        communication_barrier: f64,
        /// Round trips in this round, all chain sets.
        round_trips: u64,
        /// Evidence of the last finished round; NaN in the first.
        ln_z: f64,
        /// Gradients so far.
        gradients: u64,
    },
    /// A look at the draws of a tempered run at the end of its last round or of an extension, after which it goes on.
    Look {
        /// Scans so far.
        scans: usize,
        /// Names of the convergence checks that are still open.
        open: Vec<String>,
        /// How many times as many scans the open checks need whose numbers grow with them; infinite where one of these is zero, 1 if there
        /// is none of them.
        needed: f64,
    },
    /// One MCMC step of an SMC bridge.
    Bridge {
        /// Exponent `s` of the fine likelihood.
        fraction: f64,
        /// Further MCMC steps done at the fine likelihood since the last batch of particles came there.
        further: usize,
        /// How many there may be.
        of: usize,
        /// Batches of particles, the present one included.
        batches: usize,
        /// How many there may be.
        of_batches: usize,
        /// Effective sample size at the fine likelihood; none before.
        ess: Option<f64>,
        /// At this one the bridge ends.
        target_ess: f64,
        /// Evidence there.
        ln_z: f64,
        /// Likelihood calls so far.
        calls: u64,
    },
    /// A checkpoint was written.
    Checkpointed,
    /// A warning, with its remedy.
    Warning {
        /// What it is, and its remedy.
        message: String,
    },
    /// Work ends.
    Finished,
}

/// Receives the events of a run; the library itself prints nothing.
pub trait Observer {
    /// Called at safe points; `Break` stops the run there, as an interrupt does.
    fn event(&mut self, event: &Event) -> ControlFlow<()>;
}

/// An observer that does nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Observer for Silent {
    fn event(&mut self, _: &Event) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }
}

/// Limits of a run, read at safe points only; a spent budget gives a valid, unconverged result.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Budget {
    /// Likelihood calls, a gradient counted as one.
    pub max_calls: u64,
    /// Wall time of this process.
    pub max_wall: Duration,
}

impl Default for Budget {
    fn default() -> Self {
        Self {
            max_calls: u64::MAX,
            max_wall: Duration::MAX,
        }
    }
}

/// Where and when to write checkpoints.
#[derive(Clone, Debug)]
pub struct CheckpointPlan {
    /// The file.
    pub path: PathBuf,
    /// Minimum time between two of them.
    pub every: Duration,
    /// Continue from the file if it exists.
    pub resume: bool,
    /// Hash of everything that must agree between the run that wrote the file and the one that reads it.
    pub config_hash: u64,
}

/// A caller's control of a run.
pub struct Control<'a> {
    /// Receives the events.
    pub observer: &'a mut dyn Observer,
    /// Limits.
    pub budget: Budget,
    /// Set to true, also from a signal handler, to stop the run at the next safe point.
    pub interrupt: Arc<AtomicBool>,
    /// Checkpoints; none if `None`.
    pub checkpoint: Option<CheckpointPlan>,
    started: Instant,
    last_checkpoint: Instant,
}

impl<'a> Control<'a> {
    /// Control without limits and checkpoints.
    pub fn new(observer: &'a mut dyn Observer) -> Self {
        let now = Instant::now();
        Self {
            observer,
            budget: Budget::default(),
            interrupt: Arc::new(AtomicBool::new(false)),
            checkpoint: None,
            started: now,
            last_checkpoint: now,
        }
    }

    /// Sends an event to the observer; true if the run should stop here.
    pub fn tell(&mut self, event: &Event) -> bool {
        self.observer.event(event).is_break()
    }

    /// Sends the observer a warning if the run will take much memory; true if the run should stop here.
    pub fn tell_memory(&mut self, memory: &Memory) -> bool {
        let warning = memory.warning();
        warning.is_some_and(|message| self.tell(&Event::Warning { message }))
    }

    /// Whether an interrupt was requested.
    #[must_use]
    pub fn interrupted(&self) -> bool {
        self.interrupt.load(Ordering::Relaxed)
    }

    /// Whether the budget is spent at this many calls.
    #[must_use]
    pub fn spent(&self, calls: u64) -> bool {
        calls >= self.budget.max_calls || self.started.elapsed() >= self.budget.max_wall
    }

    /// Whether a checkpoint is due; restarts the clock if so.
    pub fn checkpoint_due(&mut self) -> bool {
        let due = self
            .checkpoint
            .as_ref()
            .is_some_and(|plan| self.last_checkpoint.elapsed() >= plan.every);
        if due {
            self.last_checkpoint = Instant::now();
        }
        due
    }
}
