//! The loop around the batches: limits, checkpoints, events.

use super::dynamic::Survey;
use super::finish::finish;
use super::likelihood::Likelihood;
use super::settings::{Kernel, Settings};
use super::state::{Job, State};
use crate::checkpoint;
use crate::control::{Control, Event};
use crate::error::{Error, Result};
use crate::output::{Run, Status};
use crate::rng::{Domain, stream};
use crate::target::Target;
use cpu_time::ProcessTime;
use std::time::Instant;

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
    let mut keeper = Keeper::new(&job, control)?;
    let mut warnings = Vec::new();
    let mut state = State::new(&job);
    if let Some((saved, warning)) = keeper.load(control)? {
        state = saved;
        if let Some(text) = warning {
            control.tell(&Event::Warning(text.clone()));
            warnings.push(text);
        }
    }
    keeper.continue_clocks(&state);
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
            stop |= control.tell(&Event::Strand {
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
        if let Err(error) = step {
            // The first failure is the one to report; a second one, of the disk, is told besides.
            if let Err(second) = keeper.save(&mut state, control) {
                control.tell(&Event::Warning(second.to_string()));
            }
            return Err(error);
        }
        stop = control.tell(&event(&state, settings));
        if control.checkpoint_due() {
            keeper.save(&mut state, control)?;
            stop |= control.tell(&Event::Checkpointed);
        }
    };
    if status != Status::Complete {
        keeper.save(&mut state, control)?;
    }
    keeper.stop_clocks(&mut state);
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
        remaining: state.remaining(settings),
        calls: state.calls,
        efficiency: state.efficiency,
    }
}

/// Keeps the state on disk and the clocks.
struct Keeper {
    config_hash: u64,
    fingerprint: u64,
    wall: Instant,
    cpu: ProcessTime,
    wall_before: f64,
    cpu_before: f64,
}

impl Keeper {
    /// The caller's hash joined with all that decides the bits of a run here; without checkpoints neither is needed.
    fn new(job: &Job<'_>, control: &Control<'_>) -> Result<Self> {
        let mut keeper = Self {
            config_hash: 0,
            fingerprint: 0,
            wall: Instant::now(),
            cpu: ProcessTime::now(),
            wall_before: 0.0,
            cpu_before: 0.0,
        };
        if let Some(plan) = &control.checkpoint {
            let key = (job.settings, job.seed, plan.config_hash, job.target.prior());
            let bytes = postcard::to_stdvec(&key).map_err(|e| Error::Checkpoint {
                path: plan.path.clone(),
                why: format!("the settings cannot be encoded ({e})"),
                remedy: "report this as a bug",
            })?;
            keeper.config_hash = checkpoint::hash(&bytes);
            keeper.fingerprint = fingerprint(job.target)?;
        }
        Ok(keeper)
    }

    fn load(&self, control: &Control<'_>) -> Result<Option<(State, Option<String>)>> {
        match &control.checkpoint {
            Some(plan)
                if plan.resume
                    && (plan.path.exists() || checkpoint::previous(&plan.path).exists()) =>
            {
                checkpoint::load(&plan.path, self.config_hash, self.fingerprint).map(Some)
            }
            _ => Ok(None),
        }
    }

    fn save(&self, state: &mut State, control: &Control<'_>) -> Result<()> {
        let Some(plan) = &control.checkpoint else {
            return Ok(());
        };
        self.stop_clocks(state);
        checkpoint::save(&plan.path, self.config_hash, self.fingerprint, state)
    }

    fn continue_clocks(&mut self, state: &State) {
        self.wall_before = state.wall_seconds;
        self.cpu_before = state.cpu_seconds;
    }

    fn stop_clocks(&self, state: &mut State) {
        state.wall_seconds = self.wall_before + self.wall.elapsed().as_secs_f64();
        state.cpu_seconds = self.cpu_before + self.cpu.elapsed().as_secs_f64();
    }
}

/// A hash of ln L at three fixed draws of the prior: names the target. Its calls are not part of the run.
fn fingerprint(target: &dyn Target) -> Result<u64> {
    let mut likelihood = Likelihood::new(target);
    let mut u = vec![0.0; target.dim()];
    let mut bytes = Vec::new();
    for i in 0..3 {
        let mut rng = stream(0, Domain::Prior, 0, i);
        likelihood.draw_prior(&mut rng, &mut u)?;
        bytes.extend_from_slice(&likelihood.at(&u)?.to_bits().to_le_bytes());
    }
    Ok(checkpoint::hash(&bytes))
}
