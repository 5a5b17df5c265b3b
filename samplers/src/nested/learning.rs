//! The surrogates of ln L that trajectories follow, and what they learn from.

use super::kernel::{Along, Proposals, factor_of_covariance, normal_rows};
use super::live::Points;
use super::settings::EXAMPLES_KEPT;
use super::tuning::Tuning;
use crate::diagnostics::weighted_quantile;
use crate::mixture::{Mixture, Rows};
use crate::rng::RandomStream;
use crate::surrogate::{DEPTH, Examples, Surrogate};
use crate::valid::{Valid, ensure};
use serde::{Deserialize, Serialize};

/// Nats by which the volume shrinks between two fits.
const NATS: f64 = 0.7;

/// Width of the wall at the likelihood bound, over the mean by which ln L of the surviving points is above the bound.
const WALL: f64 = 0.25;

/// Largest number of components of a density for proposals, and the factor by which it is widened.
const MAX_COMPONENTS: usize = 16;
const WIDENING: f64 = 1.2;

/// Streams of one half: that of the surrogate, and one for each number of components.
const STREAMS: usize = 1 + MAX_COMPONENTS;

/// One of so many live points chooses the number of components, to which the others are fitted.
const HELD_OUT: usize = 4;

/// Fraction of the live points at which prior / density is less than where all draws are kept.
const MOST: f64 = 0.75;

/// The surrogates of even and of odd lineages, each learned from the values of chains of its half, and followed by those of the other.
///
/// A surrogate that knew the live points themselves would be wrong at them less often than elsewhere, and new points would be born too rarely
/// where it is too low: ln Z would be too high (docs/decisions.md, section 5).
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
    /// The density fitted to the live points at the last fit.
    mixture: Option<Mixture>,
}

impl Learner {
    /// Checks what was read from a file, for a target with so many dimensions and features.
    pub fn check(&self, dim: usize, features: usize) -> Valid {
        ensure(
            self.ln_x.is_finite() && self.ln_x <= 0.0,
            "the prior volume at the last fit of a surrogate is above 1 or none",
        )?;
        for half in &self.halves {
            half.examples.check(features)?;
            if let Some(surrogate) = &half.surrogate {
                surrogate.check(features)?;
            }
            if let Some(mixture) = &half.mixture {
                mixture.check(dim)?;
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

    /// Begins a batch at this log volume with what it has learned, and learns again at its first iteration, unless that is the prior.
    pub fn begin_at(&mut self, ln_x: f64) {
        self.ln_x = (ln_x + NATS).min(0.0);
    }

    /// Whether the surrogate is to learn again at this log volume.
    pub fn is_due(&self, ln_x: f64) -> bool {
        ln_x <= self.ln_x - NATS
    }

    /// Fits both surrogates, whose region of interest is as deep as the live points are, and densities of the live points; `rng` gives the
    /// streams.
    pub fn learn(&mut self, live: &Points, ln_x: f64, rng: impl Fn(u64) -> RandomStream) {
        let lowest = live.ln_l.iter().copied().fold(f64::INFINITY, f64::min);
        let depth = DEPTH.max(2.0 * (live.best() - lowest));
        let halves = self.halves.iter_mut().zip(live.halves());
        for (first, (half, rows)) in (0..).step_by(STREAMS).zip(halves) {
            let earlier = half.surrogate.as_ref();
            let learned = Surrogate::fit_to_depth(&half.examples, depth, earlier, &mut rng(first));
            half.surrogate = learned.or(half.surrogate.take());
            half.mixture = density(&normal_rows(live, &rows), |size| rng(first + size as u64));
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
        let width = WALL * above.sum::<f64>() / kept.len() as f64;
        let mut rows = kept.halves().into_iter();
        let proposals = self.halves.each_ref().map(|half| {
            let rows = normal_rows(kept, &rows.next()?);
            (half.mixture.as_ref()).map(|mixture| proposals(mixture, &rows))
        });
        Some(Along {
            surrogates,
            proposals,
            width,
            step: tuning.leap,
            sets: tuning.sets(),
            metrics: [even, odd],
        })
    }
}

/// The density that fits the live points of one half of the lineages.
fn density(rows: &Rows, rng: impl Fn(usize) -> RandomStream) -> Option<Mixture> {
    let held_out = |i: &usize| i.is_multiple_of(HELD_OUT);
    let part = |of: &dyn Fn(&usize) -> bool| Rows {
        dim: rows.dim,
        values: (0..rows.len())
            .filter(|i| of(i))
            .flat_map(|i| {
                rows.values[i * rows.dim..(i + 1) * rows.dim]
                    .iter()
                    .copied()
            })
            .collect(),
    };
    let (fitted, rest) = (part(&|i| !held_out(i)), part(&held_out));
    Mixture::choose([&fitted, &rest], MAX_COMPONENTS, rng)?.widened(WIDENING)
}

/// Independent proposals from a density, whose draws are kept where prior / density is as large as at most of these points.
fn proposals<'a>(mixture: &'a Mixture, rows: &Rows) -> Proposals<'a> {
    let ratios: Vec<f64> = rows
        .iter()
        .map(|z| Proposals::ln_ratio(mixture, z))
        .collect();
    let weights = vec![1.0; ratios.len()];
    Proposals {
        mixture,
        ln_most: weighted_quantile(&ratios, &weights, MOST),
    }
}
