//! The intermediate likelihood of a bridge, `L_coarse^(1 - s) L_fine^s`, as a target; `s` is called `fraction` in the
//! code.

use super::particle::Both;
use crate::error::Result;
use crate::hmc::{Evaluator, Point};
use crate::output::Calls;
use crate::target::{Outcome, Prior, Symmetry, Target};
use std::sync::{Mutex, PoisonError};

/// The intermediate likelihood, for one particle at a time: it keeps the values at its last point, at which a slice
/// update ends.
pub struct Between<'a> {
    coarse: &'a dyn Target,
    fine: &'a dyn Target,
    fraction: f64,
    /// The last values.
    last: Mutex<Both>,
}

impl<'a> Between<'a> {
    /// The target with the fine likelihood at this exponent.
    pub fn new(coarse: &'a dyn Target, fine: &'a dyn Target, fraction: f64) -> Self {
        let nowhere = Both {
            coarse: f64::NEG_INFINITY,
            fine: f64::NEG_INFINITY,
        };
        Self {
            coarse,
            fine,
            fraction,
            last: Mutex::new(nowhere),
        }
    }

    /// Moves `point`, where the two likelihoods are `both`, by the MCMC moves `explore` on the intermediate posterior.
    /// Counts the calls of both likelihoods.
    ///
    /// # Errors
    /// Those of `explore`; [`Error::Fatal`] and [`Error::Infinite`] from the targets.
    pub fn explore(
        &self,
        point: &mut Point,
        both: &mut Both,
        explore: impl FnOnce(&mut Evaluator<'_>, &mut Point) -> Result<()>,
    ) -> Result<Calls> {
        point.ln_likelihood = both.at(self.fraction);
        self.keep(*both);
        let mut evaluator = Evaluator::new(self);
        explore(&mut evaluator, point)?;
        let mut calls = evaluator.calls;
        // One value costs one call of each likelihood.
        calls.values *= 2;
        let last = *self.last.lock().unwrap_or_else(PoisonError::into_inner);
        *both = if last.at(self.fraction).to_bits() == point.ln_likelihood.to_bits() {
            last
        } else {
            let mut own = [Evaluator::new(self.coarse), Evaluator::new(self.fine)];
            let [coarse, fine] = &mut own;
            let both = Both {
                coarse: coarse.value(&point.z)?,
                fine: fine.value(&point.z)?,
            };
            own.iter().for_each(|evaluator| calls.add(&evaluator.calls));
            both
        };
        Ok(calls)
    }

    fn keep(&self, both: Both) {
        *self.last.lock().unwrap_or_else(PoisonError::into_inner) = both;
    }
}

impl Target for Between<'_> {
    fn prior(&self) -> &Prior {
        self.fine.prior()
    }
    fn ln_likelihood(&self, theta: &[f64]) -> Outcome {
        let coarse = self.coarse.ln_likelihood(theta);
        let Outcome::Value(coarse) = coarse else {
            return coarse;
        };
        match self.fine.ln_likelihood(theta) {
            Outcome::Value(fine) => {
                let both = Both { coarse, fine };
                self.keep(both);
                Outcome::from_ln_likelihood(both.at(self.fraction))
            }
            other => other,
        }
    }
    fn ln_likelihood_bound(&self) -> Option<f64> {
        let both = Both {
            coarse: self.coarse.ln_likelihood_bound()?,
            fine: self.fine.ln_likelihood_bound()?,
        };
        Some(both.at(self.fraction))
    }
    fn symmetries(&self) -> &[Symmetry] {
        self.fine.symmetries()
    }
}
