//! Whether the arrays and numbers of a run belong together. A run that a sampler returns is sound; one that was put together from
//! files or by hand need not be.

use super::{Draws, History, Method, Run};
use crate::error::Error;
use crate::target::Target;

/// What is wrong with a run.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RunFault {
    /// An array has another length than the others.
    #[error("`{array}` has {found} values where {needed} are needed")]
    Length {
        /// The array.
        array: &'static str,
        /// Its length.
        found: usize,
        /// The length that follows from the other arrays.
        needed: usize,
    },
    /// A number is not one that its array can have.
    #[error("`{array}` is {value} in place {place}, and must be {needed}")]
    Value {
        /// The array.
        array: &'static str,
        /// The place, from 0.
        place: usize,
        /// The number.
        value: f64,
        /// What it must be.
        needed: &'static str,
    },
    /// The weights are not normalised.
    #[error("the weights add up to {sum}, and must add up to 1")]
    WeightSum {
        /// Their sum.
        sum: f64,
    },
    /// The history is one of another method.
    #[error("the history is not one of the method `{method:?}`")]
    OtherHistory {
        /// The method.
        method: Method,
    },
    /// A number of the result is not one that it can be.
    #[error("`{name}` is {value}, and must be {needed}")]
    Number {
        /// Which number.
        name: &'static str,
        /// The number.
        value: f64,
        /// What it must be.
        needed: &'static str,
    },
}

type Sound = Result<(), RunFault>;

/// How far the sum of the weights may be from 1: the rounding of some million exponentials.
const WEIGHT_SUM_TOLERANCE: f64 = 1e-6;

/// Largest difference between ln L of a draw and a new value at its point, for all but a fifth of the draws that are compared: a target may
/// work in single precision, compute gradients in another precision than values, and be symmetric only to rounding. Where ln L is chaotic
/// rounding changes it by more, at a few draws of a posterior (docs/decisions.md, section 1).
const ROUNDING: f64 = 0.05;

/// Number of draws of equal weight whose ln L is compared, besides the best.
const COMPARED: usize = 16;

fn length(array: &'static str, found: usize, needed: usize) -> Sound {
    if found == needed {
        Ok(())
    } else {
        Err(RunFault::Length {
            array,
            found,
            needed,
        })
    }
}

fn each(
    array: &'static str,
    values: &[f64],
    needed: &'static str,
    holds: impl Fn(f64) -> bool,
) -> Sound {
    match values.iter().position(|value| !holds(*value)) {
        None => Ok(()),
        Some(place) => Err(RunFault::Value {
            array,
            place,
            value: values[place],
            needed,
        }),
    }
}

fn finite(array: &'static str, values: &[f64]) -> Sound {
    each(array, values, "finite", f64::is_finite)
}

impl Draws {
    /// Largest number of a chain or a cluster. Sums by number are kept in arrays, whose length it bounds.
    pub const MAX_LABEL: u32 = (1 << 16) - 1;

    /// Checks that rows are complete and their numbers finite, that weights are normalised, and that no number of a chain or cluster is
    /// above [`MAX_LABEL`](Self::MAX_LABEL).
    ///
    /// # Errors
    /// The first [`RunFault`].
    pub fn check(&self) -> Result<(), RunFault> {
        let rows = self.len();
        for (array, found, columns) in [
            ("theta", self.theta.len(), self.dim),
            ("derived", self.derived.len(), self.derived_dim),
            ("ln_weight", self.ln_weight.len(), 1),
            ("chain", self.chain.len(), 1),
            ("cluster", self.cluster.len(), 1),
        ] {
            length(array, found, rows.saturating_mul(columns))?;
        }
        finite("theta", &self.theta)?;
        finite("derived", &self.derived)?;
        finite("ln_likelihood", &self.ln_likelihood)?;
        for (array, labels) in [("chain", &self.chain), ("cluster", &self.cluster)] {
            if let Some(place) = labels.iter().position(|label| *label > Self::MAX_LABEL) {
                return Err(RunFault::Value {
                    array,
                    place,
                    value: f64::from(labels[place]),
                    needed: "below 2^16",
                });
            }
        }
        each("ln_weight", &self.ln_weight, "a number of at most 0", |w| {
            w <= WEIGHT_SUM_TOLERANCE
        })?;
        let sum: f64 = self.weights().iter().sum();
        if rows > 0 && (sum - 1.0).abs() > WEIGHT_SUM_TOLERANCE {
            return Err(RunFault::WeightSum { sum });
        }
        Ok(())
    }
}

impl History {
    /// Checks that arrays of one dimension have one length, and numbers that others are computed from.
    fn check(&self) -> Sound {
        match self {
            Self::Nested {
                ln_x,
                ln_likelihood,
                ln_likelihood_birth,
                live,
                insertion_rank,
            } => {
                let deaths = ln_x.len();
                length("ln_likelihood", ln_likelihood.len(), deaths)?;
                length("ln_likelihood_birth", ln_likelihood_birth.len(), deaths)?;
                length("live", live.len(), deaths)?;
                finite("ln_x", ln_x)?;
                each(
                    "ln_likelihood",
                    ln_likelihood,
                    "a number below infinity",
                    |l| l < f64::INFINITY,
                )?;
                for (place, (birth, l)) in ln_likelihood_birth.iter().zip(ln_likelihood).enumerate()
                {
                    // A rejected point has minus infinity, and may be born there too.
                    let below = *birth < l.max(f64::MIN);
                    if !below {
                        return Err(RunFault::Value {
                            array: "ln_likelihood_birth",
                            place,
                            value: *birth,
                            needed: "below the point's own log-likelihood",
                        });
                    }
                }
                let within = |rank: f64| rank > 0.0 && rank < 1.0;
                each("insertion_rank", insertion_rank, "between 0 and 1", within)
            }
            Self::Tempered {
                beta,
                mean_ln_likelihood,
                variance_ln_likelihood,
                swap_rejection,
                acceptance,
                step_size,
                mean_leapfrogs,
                divergences,
                communication_barrier,
                round_trips: _,
                trace: _,
            } => {
                let temperatures = beta.len();
                let gaps = temperatures.saturating_sub(1);
                length("swap_rejection", swap_rejection.len(), gaps)?;
                length("divergences", divergences.len(), temperatures)?;
                for (array, values) in [
                    ("mean_ln_likelihood", mean_ln_likelihood),
                    ("variance_ln_likelihood", variance_ln_likelihood),
                    ("acceptance", acceptance),
                    ("step_size", step_size),
                    ("mean_leapfrogs", mean_leapfrogs),
                    ("communication_barrier", communication_barrier),
                ] {
                    length(array, values.len(), temperatures)?;
                }
                Ok(())
            }
            Self::Bridge {
                fraction,
                ln_ratio,
                ancestors,
                correlation,
            } => {
                length("ln_ratio", ln_ratio.len(), fraction.len())?;
                length("ancestors", ancestors.len(), fraction.len())?;
                length("correlation", correlation.len(), fraction.len())
            }
        }
    }

    fn is_of(&self, method: Method) -> bool {
        matches!(
            (self, method),
            (Self::Nested { .. }, Method::Nested)
                | (Self::Tempered { .. }, Method::PtHmc)
                | (Self::Bridge { .. }, Method::Bridge)
        )
    }
}

impl Run {
    /// Checks that all arrays and numbers belong together, as they do in every run that a sampler returns. Code that
    /// uses a run that passes does not panic.
    ///
    /// # Errors
    /// The first [`RunFault`].
    pub fn check(&self) -> Result<(), RunFault> {
        let (dim, draws) = (self.names.len(), &self.draws);
        length("units", self.units.len(), dim)?;
        length("theta", draws.dim, dim)?;
        length("derived", draws.derived_dim, self.derived_names.len())?;
        draws.check()?;
        for (array, sizes) in [
            ("ess_bulk", &self.ess.bulk),
            ("ess_tail", &self.ess.tail),
            ("r_hat", &self.ess.r_hat),
        ] {
            if !sizes.is_empty() {
                length(array, sizes.len(), dim)?;
            }
        }
        if !self.history.is_of(self.method) {
            return Err(RunFault::OtherHistory {
                method: self.method,
            });
        }
        if let History::Nested { ln_x, .. } = &self.history
            && ln_x.len() < draws.len()
        {
            return Err(RunFault::Length {
                array: "ln_x",
                found: ln_x.len(),
                needed: draws.len(),
            });
        }
        self.history.check()?;
        for (name, value, needed, holds) in [
            (
                "ln_z",
                self.evidence.ln_z,
                "a number below infinity",
                self.evidence.ln_z < f64::INFINITY,
            ),
            (
                "ess_kish",
                self.ess.kish,
                "a number of at least 0",
                self.ess.kish >= 0.0,
            ),
            (
                "ess",
                self.ess.quoted,
                "a number of at least 0",
                self.ess.quoted >= 0.0,
            ),
        ] {
            if !holds {
                return Err(RunFault::Number {
                    name,
                    value,
                    needed,
                });
            }
        }
        Ok(())
    }

    /// Whether it is a consistent run ([`check`](Self::check)) on this target: parameters have the same names, and all but a fifth of some
    /// draws the same ln L to rounding. `run` names it in errors.
    ///
    /// # Errors
    /// [`Error::Inconsistent`], [`Error::OtherParameters`], [`Error::NoDraws`] or [`Error::OtherLikelihood`] if it is not; [`Error::Fatal`] and
    /// [`Error::Infinite`] from the target.
    pub fn check_belongs(&self, target: &dyn Target, run: &'static str) -> crate::Result<()> {
        if let Err(fault) = self.check() {
            return Err(Error::Inconsistent {
                run,
                message: fault.to_string(),
            });
        }
        if self.names != target.prior().names() {
            return Err(Error::OtherParameters { run });
        }
        let Some(best) = self.draws.best() else {
            return Err(Error::NoDraws { run });
        };
        let mut rows = self.draws.resample(COMPARED, 0.5);
        rows.push(best);
        let mut others = Vec::new();
        for row in &rows {
            let theta = self.draws.theta_row(*row);
            let there = self.draws.ln_likelihood[*row];
            let here = target.ln_likelihood(theta).ln_likelihood(theta)?;
            // A point that this target rejects has minus infinity here.
            if (here - there).abs() > ROUNDING + 1e-9 * there.abs() {
                others.push((here, there));
            }
        }
        match others.first() {
            Some(&(here, there)) if 5 * others.len() > rows.len() => {
                Err(Error::OtherLikelihood { run, here, there })
            }
            _ => Ok(()),
        }
    }
}
