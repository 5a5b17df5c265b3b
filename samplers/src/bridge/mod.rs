//! The SMC bridge: from a finished run on a coarse likelihood to the posterior of a fine one that costs more (Del
//! Moral, Doucet & Jasra 2006). Draws of the run are moved along `L_coarse^(1 - s) L_fine^s` from `s = 0` to 1, in
//! steps after which an effective half of them is left ([`smc_weights`](crate::smc_weights)).
//!
//! The coarse run may be of any sampler; the fine likelihood is evaluated in the bridge only. ln Z is that of the
//! coarse run plus the logarithms of the mean weights of all steps. The result is consistent for any two likelihoods,
//! and takes few steps if they differ by a few nats. The bridge cannot find what the coarse run has missed: a mode, or
//! points without a coarse likelihood.
//!
//! After each step every SMC particle makes MCMC steps. Particles of even lineages of the run take directions and metric from
//! those of odd ones and the other way round: directions from the same lineage would not leave the distribution
//! invariant. An MCMC step is a slice update. If the coarse run has a surrogate of its likelihood, it is instead three moves along a
//! surrogate of the fine one ([`surrogate_move`](crate::hmc::surrogate_move)), with a slice update and involutions in the first at each exponent, which begins as that of the coarse run and is fitted anew
//! before each MCMC step to the values of the fine likelihood so far. At the fine likelihood further MCMC steps follow while
//! the effective sample size is too small: copies of one particle part by them. Where these do not suffice another batch of particles begins with
//! draws of the run, resampled anew, is moved in the same way, and joins the others.

mod batch;
mod between;
mod check;
mod explore;
mod independent;
mod outcome;
mod particle;
mod settings;
mod state;

pub use outcome::{BRIDGE_ERROR, COARSE_RUN_CHECKS};
pub use settings::Settings;

use crate::checkpointer::Checkpointer;
use crate::control::{Control, Event};
use crate::error::{Error, Result};
use crate::output::{MIN_ESS, Run, Status};
use crate::surrogate::Surrogate;
use crate::target::Target;
use state::{Bridge, State};

/// The name of the coarse run in errors.
const COARSE: &str = "the coarse run";

/// Moves draws of `parent`, a run on `coarse`, to the posterior of `target`, which has the same parameters.
///
/// The same parent, settings and seed give the same bits on any number of threads and after any number of interruptions. A bridge
/// that is interrupted or whose budget is spent has no result yet: it writes a checkpoint, where one is planned. Calls are of both
/// likelihoods, except that the parent's are not counted again.
///
/// # Errors
/// [`Error::OutOfRange`], [`Error::Setting`] and [`Error::TooMuchMemory`] as of [`Settings::check`];
/// [`Error::OtherParameters`], [`Error::NoDraws`] and
/// [`Error::OtherLikelihood`] if `parent` is not a run on `coarse`, or `target` has other parameters;
/// [`Error::NoCommonSupport`] if `target` rejects all of its draws; [`Error::Interrupted`] after a checkpoint;
/// [`Error::Fatal`] and [`Error::Infinite`] from the targets, after a checkpoint of the last complete MCMC step;
/// [`Error::Checkpoint`] and [`Error::Io`] from the file.
pub fn run(
    target: &dyn Target,
    coarse: &dyn Target,
    parent: &Run,
    settings: &Settings,
    seed: u64,
    control: &mut Control<'_>,
) -> Result<Run> {
    settings.check(target.dim())?;
    parent.check_belongs(coarse, COARSE)?;
    if target.prior().names() != coarse.prior().names() {
        return Err(Error::OtherParameters { run: COARSE });
    }
    let differs = |s: &Surrogate| s.features() != target.feature_count();
    if parent.surrogate.as_ref().is_some_and(differs) {
        return Err(Error::Inconsistent {
            run: COARSE,
            message: "its surrogate has another number of features than the target".to_owned(),
        });
    }
    let origin = (parent.seed, parent.evidence.ln_z, parent.draws.len());
    // The number of batches decides where a bridge ends, but not what it draws.
    let drawing = Settings {
        max_batches: 1,
        ..settings.clone()
    };
    let mut checkpointer = Checkpointer::new(&[target, coarse], &(drawing, seed, origin), control)?;
    let mut bridge = Bridge {
        target,
        coarse,
        settings,
        seed,
        parent,
        proposals: None,
        state: State::default(),
    };
    let mut stop = control.tell(&Event::Started { dim: target.dim() });
    stop |= control.tell_memory(&settings.memory(target.dim()));
    let saved = checkpointer.load(
        control,
        |state: &State| &state.cost,
        |state| {
            state.check(
                settings,
                &parent.draws,
                target.dim(),
                target.feature_count(),
            )
        },
    )?;
    match saved {
        Some(state) => bridge.resume(state),
        None => bridge.begin()?,
    }
    let mut ess = outcome::ess(&bridge)?;
    while !outcome::enough(&bridge, ess) {
        if stop || control.interrupted() || control.spent(bridge.state.cost.calls) {
            checkpointer.save(&bridge.state, control)?;
            control.tell(&Event::Checkpointed);
            return Err(Error::Interrupted);
        }
        let moved = bridge.advance();
        checkpointer.note_times(&mut bridge.state.cost);
        if let Err(error) = moved {
            return Err(checkpointer.save_after(error, &bridge.state, control));
        }
        ess = outcome::ess(&bridge)?;
        stop = control.tell(&Event::Bridge {
            fraction: bridge.state.fraction,
            further: bridge.further_mcmc_steps().unwrap_or(0),
            of: settings.further_mcmc_steps,
            batches: bridge.state.batches.len() + 1,
            of_batches: settings.max_batches,
            ess,
            target_ess: MIN_ESS,
            ln_z: parent.evidence.ln_z + outcome::ln_ratio(&bridge),
            calls: bridge.state.cost.calls,
        });
        if control.checkpoint_due() {
            checkpointer.save(&bridge.state, control)?;
            stop |= control.tell(&Event::Checkpointed);
        }
    }
    checkpointer.save_at_end(Status::Complete, &bridge.state, control)?;
    let run = outcome::assemble(&bridge)?;
    control.tell(&Event::Finished);
    Ok(run)
}
