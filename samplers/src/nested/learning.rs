//! The surrogate of ln L that trajectories follow, and what it learns from.

use super::kernel::{Along, factor_of_covariance};
use super::live::Points;
use super::tuning::Tuning;
use crate::rng::RandomStream;
use crate::surrogate::{DEPTH, Examples, Surrogate};
use crate::valid::{Valid, ensure};
use serde::{Deserialize, Serialize};

/// Largest number of values that a surrogate learns from. Some of every age stay: with the last ones alone the surrogate forgets how deep ln L
/// is elsewhere, and trajectories are lost there (docs/validation.md, section 5).
const EXAMPLES: usize = 120_000;

/// Nats by which the volume shrinks between two fits.
const NATS: f64 = 0.7;

/// Width of the wall at the likelihood bound, over the mean by which ln L of the surviving points is above the bound.
const WALL: f64 = 0.25;

/// A surrogate, and values of ln L.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Learner {
    /// The surrogate, once there are enough examples.
    pub surrogate: Option<Surrogate>,
    examples: Examples,
    /// Log prior volume at its last fit.
    ln_x: f64,
}

impl Learner {
    /// Checks what was read from a file, for a target with so many features. The log volume is now `ln_x`.
    pub fn check(&self, features: usize) -> Valid {
        self.examples.check(features)?;
        ensure(
            self.ln_x.is_finite() && self.ln_x <= 0.0,
            "the prior volume at the last fit of a surrogate is above 1 or none",
        )?;
        match &self.surrogate {
            Some(surrogate) => surrogate.check(features),
            None => Ok(()),
        }
    }

    /// Prepares one that was read from a file for use.
    pub fn prepare(&mut self) {
        if let Some(surrogate) = &mut self.surrogate {
            surrogate.prepare();
        }
    }

    /// Takes up values.
    pub fn take(&mut self, examples: Examples) {
        self.examples.append(examples);
        self.examples.thin(EXAMPLES);
    }

    /// Whether the surrogate is to learn again at this log volume.
    pub fn is_due(&self, ln_x: f64) -> bool {
        ln_x <= self.ln_x - NATS
    }

    /// Fits the surrogate, whose region of interest is as deep as the live points are.
    pub fn learn(&mut self, live: &Points, ln_x: f64, rng: &mut RandomStream) {
        let lowest = live.ln_l.iter().copied().fold(f64::INFINITY, f64::min);
        let depth = DEPTH.max(2.0 * (live.best() - lowest));
        let earlier = self.surrogate.as_ref();
        let learned = Surrogate::fit_to_depth(&self.examples, depth, earlier, rng);
        self.surrogate = learned.or(self.surrogate.take());
        self.ln_x = ln_x;
    }

    /// What the trajectories from points above a bound have in common; none without a surrogate.
    pub fn along(&self, kept: &Points, contour: f64, tuning: &Tuning) -> Option<Along<'_>> {
        let surrogate = self.surrogate.as_ref()?;
        let factors = kept.halves().map(|rows| factor_of_covariance(kept, &rows));
        let [Some(even), Some(odd)] = factors else {
            return None;
        };
        let above = kept.ln_l.iter().map(|ln_l| ln_l - contour);
        Some(Along {
            surrogate,
            width: WALL * above.sum::<f64>() / kept.len() as f64,
            step: tuning.leap,
            sets: tuning.sets(),
            metrics: [even, odd],
        })
    }
}
