//! Weights of sequential Monte Carlo from one distribution to the next (Del Moral, Doucet & Jasra 2006).
//!
//! The next density is the present one times `exp(step x energy)`. A step is chosen so that the effective number of
//! particles falls to a half; then the particles are resampled by their weights.

use crate::diagnostics::effective_number;
use crate::error::{Error, Result};

/// Largest number of steps of one annealing path. A posterior of 13 parameters needs about 30.
const MAX_STEPS: usize = 4_096;

/// The position on an annealing path after a step from `at` towards 1, as step number `number`. A remainder of less than 1e-9 of the step
/// is added to it.
///
/// # Errors
/// [`Error::EndlessPath`] if the step does not change the position, or if there were too many before it.
pub fn after_step(at: f64, step: f64, number: usize) -> Result<f64> {
    let left = 1.0 - at;
    let next = if step >= left * (1.0 - 1e-9) {
        1.0
    } else {
        at + step
    };
    if next > at && number <= MAX_STEPS {
        return Ok(next);
    }
    Err(Error::EndlessPath { steps: number })
}

/// ESS (Kish) of the weights of one step, as a fraction of the number of particles.
const KEPT: f64 = 0.5;

/// The energies of the particles; minus infinity where the next density is 0.
#[derive(Clone, Debug)]
pub struct SmcWeights {
    energies: Vec<f64>,
    best: f64,
}

impl SmcWeights {
    /// From the energies.
    #[must_use]
    pub fn new(energies: Vec<f64>) -> Self {
        let best = energies.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        Self { energies, best }
    }

    /// The longest step, at most `max`, whose weights keep half of the particles as ESS (Kish).
    #[must_use]
    pub fn longest_step(&self, max: f64) -> f64 {
        let enough = KEPT * self.energies.len() as f64;
        if effective_number(self.weights(max)) >= enough {
            return max;
        }
        let mut bracket = (0.0, max);
        for _ in 0..60 {
            let step = 0.5 * (bracket.0 + bracket.1);
            if effective_number(self.weights(step)) < enough {
                bracket.1 = step;
            } else {
                bracket.0 = step;
            }
        }
        0.5 * (bracket.0 + bracket.1)
    }

    /// Logarithm of the mean weight of a step: of the ratio of the integrals of the next density and the present one.
    #[must_use]
    pub fn ln_mean_weight(&self, step: f64) -> f64 {
        let sum: f64 = self.weights(step).iter().sum();
        step * self.best + (sum / self.energies.len() as f64).ln()
    }

    /// Numbers of the resampled particles, as many as there are (systematic resampling).
    #[must_use]
    pub fn resample(&self, step: f64, uniform: f64) -> Vec<usize> {
        systematic(&self.weights(step), uniform)
    }

    /// Weights of a step, in units of the largest.
    fn weights(&self, step: f64) -> Vec<f64> {
        let weight = |energy: &f64| (step * (energy - self.best)).exp();
        self.energies.iter().map(weight).collect()
    }
}

fn systematic(weights: &[f64], uniform: f64) -> Vec<usize> {
    let count = weights.len();
    let sum: f64 = weights.iter().sum();
    let mut index = 0;
    let mut passed = weights[0];
    (0..count)
        .map(|j| {
            let at = (j as f64 + uniform) / count as f64 * sum;
            while passed < at && index + 1 < count {
                index += 1;
                passed += weights[index];
            }
            index
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn resampling_takes_each_as_often_as_its_weight_says() {
        let weights = [0.5, 0.0, 2.5, 1.0];
        assert_eq!(systematic(&weights, 0.4), [0, 2, 2, 3]);
        assert_eq!(systematic(&weights, 0.6), [2, 2, 2, 3]);
    }

    #[test]
    fn a_path_ends_or_says_that_it_does_not() {
        assert!((after_step(0.25, 0.5, 1).unwrap() - 0.75).abs() < 1e-15);
        // The whole remainder, except for rounding.
        assert!(after_step(0.25, 0.75 * (1.0 - 1e-10), 1).unwrap() >= 1.0);
        for (step, number) in [(1e-20, 1), (0.0, 1), (f64::NAN, 1), (0.1, MAX_STEPS + 1)] {
            let error = after_step(0.5, step, number).unwrap_err();
            assert!(
                matches!(error, Error::EndlessPath { .. }),
                "{step} {number}"
            );
        }
    }

    #[test]
    fn a_step_leaves_half_and_its_mean_weight_is_that_of_the_exponentials() {
        let smc_weights = SmcWeights::new(vec![-1000.0, -1001.0, -1004.0, f64::NEG_INFINITY]);
        let step = smc_weights.longest_step(1.0);
        assert!((effective_number(smc_weights.weights(step)) - 2.0).abs() < 1e-9 && step < 1.0);
        let mean = ((-0.5_f64).exp() + (-2.0_f64).exp() + 1.0) / 4.0;
        assert!((smc_weights.ln_mean_weight(0.5) - (mean.ln() - 500.0)).abs() < 1e-12);
    }
}
