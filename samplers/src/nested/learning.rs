//! The surrogates of ln L that trajectories follow, and what they learn from.

use super::kernel::{Along, factor_of_covariance};
use super::live::Points;
use super::settings::EXAMPLES_KEPT;
use super::tuning::Tuning;
use crate::rng::RandomStream;
use crate::surrogate::{DEPTH, Examples, Surrogate};
use crate::valid::{Valid, ensure};
use serde::{Deserialize, Serialize};

/// Nats by which the volume shrinks between two fits.
const NATS: f64 = 0.7;

/// Width of the wall at the likelihood bound, over the mean by which ln L of the surviving points is above the bound.
const WALL: f64 = 0.25;

/// The surrogates of even and of odd lineages, each learned from the values of chains of its half, and followed by those of the other.
///
/// A surrogate that knew the live points themselves would be wrong at them less often than elsewhere, and new points would be born too rarely
/// where it is too low: ln Z would be too high (docs/validation.md, section 5).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Learner {
    halves: [Half; 2],
    /// Log prior volume at its last fit.
    ln_x: f64,
}

/// The surrogate of one half of the lineages, and what it learns from.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Half {
    /// The surrogate, once there are enough examples.
    surrogate: Option<Surrogate>,
    examples: Examples,
}

impl Learner {
    /// Checks what was read from a file, for a target with so many features.
    pub fn check(&self, features: usize) -> Valid {
        ensure(
            self.ln_x.is_finite() && self.ln_x <= 0.0,
            "the prior volume at the last fit of a surrogate is above 1 or none",
        )?;
        for half in &self.halves {
            half.examples.check(features)?;
            if let Some(surrogate) = &half.surrogate {
                surrogate.check(features)?;
            }
        }
        Ok(())
    }

    /// Prepares one that was read from a file for use.
    pub fn prepare(&mut self) {
        for surrogate in self.halves.iter_mut().filter_map(|h| h.surrogate.as_mut()) {
            surrogate.prepare();
        }
    }

    /// One of the surrogates, if there is one.
    pub fn any(&self) -> Option<&Surrogate> {
        self.halves.iter().find_map(|half| half.surrogate.as_ref())
    }

    /// Takes up values of chains of a lineage.
    pub fn take(&mut self, lineage: u32, examples: Examples) {
        let half = &mut self.halves[usize::from(!lineage.is_multiple_of(2))];
        half.examples.append(examples);
        half.examples.thin(EXAMPLES_KEPT / 2);
    }

    /// Begins again at the prior, with what it has learned.
    pub fn begin_again(&mut self) {
        self.ln_x = 0.0;
    }

    /// Whether the surrogate is to learn again at this log volume.
    pub fn is_due(&self, ln_x: f64) -> bool {
        ln_x <= self.ln_x - NATS
    }

    /// Fits both surrogates, whose region of interest is as deep as the live points are.
    pub fn learn(&mut self, live: &Points, ln_x: f64, rng: &mut RandomStream) {
        let lowest = live.ln_l.iter().copied().fold(f64::INFINITY, f64::min);
        let depth = DEPTH.max(2.0 * (live.best() - lowest));
        for half in &mut self.halves {
            let earlier = half.surrogate.as_ref();
            let learned = Surrogate::fit_to_depth(&half.examples, depth, earlier, rng);
            half.surrogate = learned.or(half.surrogate.take());
        }
        self.ln_x = ln_x;
    }

    /// What the trajectories from points above a bound have in common; none without a surrogate.
    pub fn along(&self, kept: &Points, contour: f64, tuning: &Tuning) -> Option<Along<'_>> {
        let [Some(even), Some(odd)] = self.halves.each_ref().map(|h| h.surrogate.as_ref()) else {
            return None;
        };
        let surrogates = [even, odd];
        let factors = kept.halves().map(|rows| factor_of_covariance(kept, &rows));
        let [Some(even), Some(odd)] = factors else {
            return None;
        };
        let above = kept.ln_l.iter().map(|ln_l| ln_l - contour);
        Some(Along {
            surrogates,
            width: WALL * above.sum::<f64>() / kept.len() as f64,
            step: tuning.leap,
            sets: tuning.sets(),
            metrics: [even, odd],
        })
    }
}
