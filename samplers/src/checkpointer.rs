//! Writing and reading a run's checkpoints, and the clocks of its time.

use crate::checkpoint;
use crate::control::{Control, Event};
use crate::cpu_clock::CpuClock;
use crate::error::{CheckpointFault, Error, Result};
use crate::output::{Cost, Status};
use crate::rng;
use crate::target::Target;
use crate::valid::Valid;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::time::Instant;

/// Checkpoints and clocks of one run.
pub(crate) struct Checkpointer {
    config_hash: u64,
    fingerprint: u64,
    wall: Instant,
    cpu: CpuClock,
    /// Seconds of wall and of CPU time that earlier processes spent on the run.
    before: [f64; 2],
}

impl Checkpointer {
    /// For a run on these targets, the first of which is sampled. `key` is all else that decides the bits of the run; it is
    /// joined with the caller's own hash. Without checkpoints neither is needed.
    ///
    /// # Errors
    /// [`Error::Checkpoint`] if the key cannot be encoded; [`Error::Fatal`] and [`Error::Infinite`] from the targets.
    pub fn new(
        targets: &[&dyn Target],
        key: &impl Serialize,
        control: &Control<'_>,
    ) -> Result<Self> {
        let mut checkpointer = Self {
            config_hash: 0,
            fingerprint: 0,
            wall: Instant::now(),
            cpu: CpuClock::start(),
            before: [0.0; 2],
        };
        if let Some(plan) = &control.checkpoint {
            let priors: Vec<_> = targets.iter().map(|target| target.prior()).collect();
            let bytes = postcard::to_stdvec(&(key, plan.config_hash, priors)).map_err(|e| {
                Error::Checkpoint {
                    path: plan.path.clone(),
                    fault: CheckpointFault::Unencodable {
                        message: e.to_string(),
                    },
                }
            })?;
            checkpointer.config_hash = checkpoint::hash(&bytes);
            checkpointer.fingerprint = fingerprint(targets)?;
        }
        Ok(checkpointer)
    }

    /// The state of the checkpoint to resume, if there is one. A warning about a damaged file is an event; it is no
    /// part of the result, which has the same bits from any checkpoint. `check` decides whether a state is one of this
    /// run.
    ///
    /// # Errors
    /// [`Error::Io`] if neither file can be read; [`Error::Checkpoint`] if both are damaged, or if the file belongs to
    /// another run.
    pub fn load<S: DeserializeOwned>(
        &mut self,
        control: &mut Control<'_>,
        cost: impl Fn(&S) -> &Cost,
        check: impl Fn(&S) -> Valid,
    ) -> Result<Option<S>> {
        let Some(plan) = control.checkpoint.as_ref().filter(|plan| plan.resume) else {
            return Ok(None);
        };
        if !checkpoint::exists(&plan.path) {
            return Ok(None);
        }
        let (state, warning) =
            checkpoint::load::<S>(&plan.path, self.config_hash, self.fingerprint, check)?;
        let spent = cost(&state);
        self.before = [spent.wall_seconds, spent.cpu_seconds];
        if let Some(message) = warning {
            control.tell(&Event::Warning { message });
        }
        Ok(Some(state))
    }

    /// Writes the planned checkpoint, if any; true if there was one.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be written; [`Error::Checkpoint`] if the state cannot be encoded or is too
    /// large.
    pub fn save(&self, state: &impl Serialize, control: &Control<'_>) -> Result<bool> {
        let Some(plan) = &control.checkpoint else {
            return Ok(false);
        };
        checkpoint::save(&plan.path, self.config_hash, self.fingerprint, state)?;
        Ok(true)
    }

    /// As [`save`](Self::save) at a run's end, for a result that can be computed again without sampling. Where the run is complete, a
    /// checkpoint that cannot be written is a warning event and no error: the result itself may still be written.
    ///
    /// # Errors
    /// As of [`save`](Self::save), for a run that is not complete.
    pub fn save_at_end(
        &self,
        status: Status,
        state: &impl Serialize,
        control: &mut Control<'_>,
    ) -> Result<()> {
        match self.save(state, control) {
            Ok(false) => {}
            Ok(true) => {
                control.tell(&Event::Checkpointed);
            }
            Err(error) if status == Status::Complete => {
                control.tell(&Event::Warning {
                    message: error.to_string(),
                });
            }
            Err(error) => return Err(error),
        }
        Ok(())
    }

    /// As [`save`](Self::save) after an error, which is returned; an error of the writing itself is a warning event.
    pub fn save_after(
        &self,
        error: Error,
        state: &impl Serialize,
        control: &mut Control<'_>,
    ) -> Error {
        if let Err(second) = self.save(state, control) {
            control.tell(&Event::Warning {
                message: second.to_string(),
            });
        }
        error
    }

    /// Writes the time spent until now, by all processes that worked on the run, into its cost.
    pub fn note_times(&self, cost: &mut Cost) {
        let [wall_before, cpu_before] = self.before;
        cost.wall_seconds = wall_before + self.wall.elapsed().as_secs_f64();
        cost.cpu_seconds = cpu_before + self.cpu.elapsed().as_secs_f64();
    }
}

/// A hash of ln L, to five digits, at three fixed draws of the prior: another target, data set or model gives another, and another computer, whose
/// instructions round otherwise, the same. Its calls are not part of the run.
fn fingerprint(targets: &[&dyn Target]) -> Result<u64> {
    let mut bytes = Vec::new();
    for target in targets {
        let mut theta = vec![0.0; target.dim()];
        for index in 0..3 {
            let mut rng = rng::stream(0, rng::Domain::Prior, u64::MAX, index);
            let z: Vec<f64> = theta
                .iter()
                .map(|_| rng::standard_normal(&mut rng))
                .collect();
            target.prior().theta_from_z(&z, &mut theta);
            let value = target.ln_likelihood(&theta).ln_likelihood(&theta)?;
            bytes.extend_from_slice(format!("{value:.4e} ").as_bytes());
        }
    }
    Ok(checkpoint::hash(&bytes))
}
