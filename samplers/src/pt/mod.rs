//! Non-reversible parallel tempering (Syed, Bouchard-Cote, Deligiannidis & Doucet 2022).
//!
//! A chain set has one chain per inverse temperature beta, from the reference (0) to the posterior (1). In each scan
//! every chain is moved by slice updates and HMC transitions, then neighbouring temperatures exchange states by
//! deterministic even-odd swaps. Several independent chain sets run through rounds of doubling length. Temperatures,
//! metrics and step sizes are adapted between rounds, step sizes also within all rounds but the last. The last round
//! has fixed settings and is the result. It can be extended until the run passes its checks: from the prior with the
//! same settings; from a mixture with settings fitted anew before each extension and within long ones, and the round
//! itself is the burn-in, with extensions until ln Z no longer changes. At beta = 0 the prior or the mixture is drawn independently in every scan. So each round trip of a
//! replica is an independent restart, and the evidence of each chain set is an independent estimate.
//!
//! With `surrogate` a surrogate of ln L is fitted before each step in temperature of the SMC samplers, before the first round, after each, and
//! eight times in an extension. Beside slice updates each chain then makes moves along it, whose ends are accepted by ln L itself at the
//! chain's temperature. The result is exact whatever the surrogate, and a good one carries states far for one value of ln L.
//!
//! ```
//! use oblate_samplers::control::{Control, Silent};
//! use oblate_samplers::{Marginal, Outcome, Prior, Target, pt};
//!
//! /// A datum 1 with standard deviation 1/3, and a standard normal prior of its mean.
//! struct Datum(Prior);
//!
//! impl Target for Datum {
//!     fn prior(&self) -> &Prior {
//!         &self.0
//!     }
//!     fn ln_likelihood(&self, theta: &[f64]) -> Outcome {
//!         Outcome::Value(-4.5 * (theta[0] - 1.0).powi(2))
//!     }
//!     fn ln_likelihood_and_gradient(&self, theta: &[f64], gradient: &mut [f64]) -> Outcome {
//!         gradient[0] = -9.0 * (theta[0] - 1.0);
//!         self.ln_likelihood(theta)
//!     }
//!     fn gradient_cost(&self) -> Option<f64> {
//!         Some(1.0)
//!     }
//! }
//!
//! let target = Datum(Prior::new([("mean", "", Marginal::Normal { mean: 0.0, sd: 1.0 })])?);
//! let run = pt::run(&target, &pt::Settings::default(), 1, &mut Control::new(&mut Silent))?;
//! let exact = -0.5 * 10_f64.ln() - 0.45;
//! assert!((run.evidence.ln_z - exact).abs() < 4.0 * run.evidence.error);
//! assert!(run.converged(), "{:?}", run.checks);
//! # Ok::<(), oblate_samplers::Error>(())
//! ```

mod adapt;
mod check;
pub mod check_names;
mod checks;
mod evidence;
#[cfg(test)]
mod missed_mode;
mod outcome;
mod posterior_draws;
mod record;
mod scan;
mod schedule;
mod settings;
mod smc;
mod state;
mod surrogate_moves;
mod swap;

pub use schedule::round_trip_rate;
pub use settings::Settings;

use crate::checkpointer::Checkpointer;
use crate::control::{Control, Event};
use crate::error::{Error, Result};
use crate::output::{Run, Status};
use crate::target::Target;
use state::State;

/// Samples `target` by parallel tempering. The result is a function of `target`, `settings` and `seed` alone,
/// whatever the number of threads of the current rayon pool and however often the run was stopped and resumed.
///
/// An interrupt, an observer's `Break` or a spent budget ends the run after the scan in progress: a checkpoint is
/// written where one is planned, and the round in progress is returned as an unconverged result. Draws of a round that
/// adapts are not exact; [`Run::status`] is then not complete. A run that has ended without passing its checks is
/// continued from its checkpoint if `settings` allow more `extensions`, with the same bits as if they had allowed them from the start.
///
/// # Errors
/// [`Error::TemperingWithoutGradient`]; [`Error::OutOfRange`], [`Error::Setting`] and [`Error::TooMuchMemory`] as of [`Settings::check`];
/// [`Error::NoStart`] if 100,000
/// prior draws have no likelihood; [`Error::Interrupted`] if it was stopped before it has a result, after a checkpoint;
/// [`Error::EndlessPath`] if its SMC samplers do not reach the posterior; [`Error::Fatal`] and [`Error::Infinite`] from
/// the target, after a checkpoint of the last complete scan; [`Error::Io`] and [`Error::Checkpoint`] from checkpoints.
pub fn run(
    target: &dyn Target,
    settings: &Settings,
    seed: u64,
    control: &mut Control<'_>,
) -> Result<Run> {
    settings.check(target.dim())?;
    if settings.hmc_transitions > 0 && target.gradient_cost().is_none() {
        return Err(Error::TemperingWithoutGradient);
    }
    // The number of extensions decides where a run ends, but not what it draws.
    let drawing = Settings {
        extensions: 0,
        ..settings.clone()
    };
    let mut checkpointer = Checkpointer::new(&[target], &(drawing, seed), control)?;
    let saved = checkpointer.load(
        control,
        |state: &State| &state.cost,
        |state| state.check(settings, seed, target.dim(), target.feature_count()),
    )?;
    let mut state = match saved {
        Some(state) => state.resumed(settings.extensions),
        None => State::start(target, settings, seed)?,
    };
    let mut stop = control.tell(&Event::Started { dim: target.dim() });
    stop |= control.tell_memory(&settings.memory(target.dim()));
    let status = loop {
        if state.finished() {
            if !state.may_extend() {
                break Status::Complete;
            }
            let look = outcome::look(&state, target.dim());
            if look.confirmed {
                break Status::Complete;
            }
            stop |= control.tell(&look.event(state.scans()));
            if let Err(error) = state.go_on(target, look.passed, look.ln_z) {
                return Err(checkpointer.save_after(error, &state, control));
            }
        }
        let interrupted = stop || control.interrupted();
        let spent = control.spent(state.cost.all_calls());
        if state.smc_samplers() && (interrupted || spent) {
            checkpointer.save(&state, control)?;
            control.tell(&Event::Checkpointed);
            return Err(Error::Interrupted);
        }
        if state.scanned() && interrupted {
            break Status::Interrupted;
        }
        if state.scanned() && spent {
            break Status::BudgetSpent;
        }
        let advanced = state.advance(target);
        checkpointer.note_times(&mut state.cost);
        if let Err(error) = advanced {
            return Err(checkpointer.save_after(error, &state, control));
        }
        stop |= control.tell(&state.progress());
        if control.checkpoint_due() {
            checkpointer.save(&state, control)?;
            stop |= control.tell(&Event::Checkpointed);
        }
    };
    // A finished run writes its checkpoint too: resumed, it gives the same result, or is extended if it now may.
    checkpointer.save_at_end(status, &state, control)?;
    let run = outcome::assemble(target, &state, status)?;
    for warning in &run.warnings {
        control.tell(&Event::Warning {
            message: warning.clone(),
        });
    }
    control.tell(&Event::Finished);
    Ok(run)
}
