//! Dynamic nested sampling: where batches of live points are added, and when the targets are met (Higson et al. 2019).
//!
//! A batch is a run of its own in a range of likelihoods: its points begin as draws of the prior above a lower bound,
//! and it ends when its lowest point is above an upper bound. Births and deaths of all batches are weighted together,
//! like those of one run. Where draws are few because they resemble each other, more of them in that range would too:
//! a batch begins with the prior.

use super::check_names;
use super::evidence::{DeadPoints, Weighted};
use super::live::Points;
use super::results::{MIN_LINEAGES, draws, ess, simulated};
use super::settings::Settings;
use crate::error::Result;
use crate::target::Target;
use serde::{Deserialize, Serialize};

/// A batch spans the points of at least this fraction of the largest importance.
const SPANNED_IMPORTANCE: f64 = 0.5;

/// Fraction of the posterior above the end of every batch.
const REMAINDER: f64 = 0.01;

/// Effective draws over what their weights alone would say (Kish), below which draws resemble each other.
const MIN_INDEPENDENCE: f64 = 0.5;

/// The range of log-likelihoods of a batch.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct LikelihoodRange {
    /// Its points are born above this one; minus infinity: draws of the prior.
    pub floor: f64,
    /// It ends when its lowest point is above this log-likelihood.
    pub ceiling: f64,
    /// Log prior volume above the floor.
    pub ln_x: f64,
}

impl LikelihoodRange {
    /// The range in which more points reduce the errors most. The importance of a point for the posterior is its
    /// weight; for the evidence it is the weight of all points from it on, divided by the number of live points,
    /// because its shrinkage enters the volumes of all of them.
    pub fn of(history: &DeadPoints, weighted: &Weighted, posterior_fraction: f64) -> Self {
        let count = weighted.p.len();
        let mut rest = 0.0;
        let mut evidence: Vec<f64> = (0..count)
            .rev()
            .map(|i| {
                rest += weighted.p[i];
                rest / f64::from(history.live[i])
            })
            .collect();
        evidence.reverse();
        let sum: f64 = evidence.iter().sum();
        let importance: Vec<f64> = weighted
            .p
            .iter()
            .zip(evidence)
            .map(|(p, e)| posterior_fraction * p + (1.0 - posterior_fraction) * e / sum)
            .collect();
        let enough = SPANNED_IMPORTANCE * importance.iter().copied().fold(0.0, f64::max);
        let within = |i: &usize| importance[*i] >= enough;
        let first = (0..count).find(within).unwrap_or(0);
        let last = (0..count).rev().find(within).unwrap_or(0);
        // Points of one likelihood are all above the floor or none of them is.
        let before = history.ln_l.partition_point(|l| *l < history.ln_l[first]);
        let floor = match before.checked_sub(1) {
            Some(before) => history.ln_l[before],
            None => f64::NEG_INFINITY,
        };
        let end = (last + 1).min(top(weighted)).min(count - 1);
        let below = history.ln_l.partition_point(|l| *l <= floor);
        Self {
            floor,
            ceiling: history.ln_l[end],
            ln_x: history.expected_ln_t()[..below].iter().sum(),
        }
    }

    /// From the prior to the peak.
    pub fn whole(history: &DeadPoints, weighted: &Weighted) -> Self {
        Self {
            floor: f64::NEG_INFINITY,
            ceiling: history.ln_l[top(weighted).min(weighted.p.len() - 1)],
            ln_x: 0.0,
        }
    }
}

/// The first point above which less than [`REMAINDER`] of the posterior remains.
fn top(weighted: &Weighted) -> usize {
    let mut above = 0.0;
    let last = (0..weighted.p.len()).rev().find(|i| {
        above += weighted.p[*i];
        above >= REMAINDER
    });
    last.map_or(0, |last| last + 1)
}

/// Weights and errors of a run so far, all batches together.
pub(super) struct RunSummary {
    pub points: Points,
    pub history: DeadPoints,
    pub weighted: Weighted,
    /// Error of ln Z: to first order while that is above the target, then simulated, as in the convergence check.
    pub ln_z_error: f64,
    /// Effective sample size to quote.
    pub ess: f64,
    /// Effective number of the draws' ancestors.
    lineages: f64,
    /// Whether they resemble each other.
    alike: bool,
}

impl RunSummary {
    /// # Errors
    /// Those of the derived quantities of `target`.
    pub fn of(points: Points, target: &dyn Target, settings: &Settings, seed: u64) -> Result<Self> {
        let history = DeadPoints::of(&points);
        let weighted = history.weigh();
        let theta = points.physical(target);
        let ess = ess(&draws(&history, &weighted, target, &theta)?);
        let expected = history.expected_error(&weighted);
        // Simulations of the whole history can cost more than a batch of cheap likelihoods.
        let near = |target| expected <= target;
        Ok(Self {
            ln_z_error: if settings.target_ln_z_error.is_some_and(near) {
                simulated(&history, settings, seed)
            } else {
                expected
            },
            ess: ess.quoted,
            lineages: history.effective_lineages(&weighted),
            alike: ess.quoted < MIN_INDEPENDENCE * ess.kish,
            points,
            history,
            weighted,
        })
    }

    /// Where the next batch is to be.
    pub fn next_range(&self, settings: &Settings) -> LikelihoodRange {
        let [more_draws, _] = self.wants(settings);
        if more_draws && (self.alike || self.few_ancestors()) {
            return LikelihoodRange::whole(&self.history, &self.weighted);
        }
        let fraction = self.posterior_fraction(settings);
        LikelihoodRange::of(&self.history, &self.weighted, fraction)
    }

    /// The checks that keep the run from its end, and how many times as many batches they need if their numbers grow with them.
    pub fn open(&self, settings: &Settings) -> (Vec<String>, f64) {
        let ess = settings.target_ess.map_or(0.0, |target| target / self.ess);
        let lineages = settings
            .target_ess
            .map_or(0.0, |_| MIN_LINEAGES / self.lineages);
        let error = (settings.target_ln_z_error).map_or(0.0, |target| self.ln_z_error / target);
        let checks = [
            (check_names::TARGET_ESS, ess),
            (check_names::EFFECTIVE_LINEAGES, lineages),
            (check_names::TARGET_LN_Z_ERROR, error.powi(2)),
        ];
        let open: Vec<(&str, f64)> = checks.into_iter().filter(|check| check.1 > 1.0).collect();
        let names = open.iter().map(|(name, _)| (*name).to_owned()).collect();
        (names, open.iter().map(|check| check.1).fold(1.0, f64::max))
    }

    /// Whether all targets are met.
    pub fn meets(&self, settings: &Settings) -> bool {
        self.wants(settings) == [false, false]
    }

    /// The aim of the next batch: the evidence alone where only its error is too large, as points at the peak hardly reduce it; the posterior alone where
    /// only that of two targets is not met; else that of the settings.
    fn posterior_fraction(&self, settings: &Settings) -> f64 {
        let both = settings.target_ess.is_some() && settings.target_ln_z_error.is_some();
        match self.wants(settings) {
            [true, false] if both => 1.0,
            [false, true] => 0.0,
            _ => settings.posterior_fraction,
        }
    }

    /// Whether the draws have few ancestors.
    fn few_ancestors(&self) -> bool {
        self.lineages < MIN_LINEAGES
    }

    /// Whether the target ESS, and whether the target error of ln Z, is not met yet.
    fn wants(&self, settings: &Settings) -> [bool; 2] {
        [
            (settings.target_ess).is_some_and(|target| self.ess < target || self.few_ancestors()),
            settings
                .target_ln_z_error
                .is_some_and(|target| self.ln_z_error > target),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nested::live::Genealogy;

    const NEVER: f64 = f64::NEG_INFINITY;

    /// Ten points that die one after the other, none replaced; weights peak where `ln_l` does not grow as fast as the volume
    /// shrinks.
    fn history(ln_l: &[f64]) -> DeadPoints {
        let lineages: Vec<Genealogy> = (0..).take(ln_l.len()).map(Genealogy::from).collect();
        DeadPoints::new(ln_l, &vec![NEVER; ln_l.len()], &lineages)
    }

    /// A run of such points whose effective size is 10.
    fn summary(ln_l: &[f64]) -> RunSummary {
        let history = history(ln_l);
        RunSummary {
            points: Points::new(1),
            weighted: history.weigh(),
            history,
            ln_z_error: 0.3,
            ess: 10.0,
            lineages: 2.0 * MIN_LINEAGES,
            alike: false,
        }
    }

    #[test]
    fn a_batch_for_the_posterior_spans_its_weight_and_one_point_more() {
        let ln_l: Vec<f64> = (0..10)
            .map(|i| [0.0, 9.0][usize::from(i > 3)] + 1e-3 * f64::from(i))
            .collect();
        let history = history(&ln_l);
        let range = LikelihoodRange::of(&history, &history.weigh(), 1.0);
        assert_eq!((range.floor, range.ceiling), (ln_l[3], ln_l[9]));
        // Four of ten have died below it.
        let ln_x: f64 = (7..=10).map(|n| -1.0 / f64::from(n)).sum();
        assert!((range.ln_x - ln_x).abs() < 1e-12, "{range:?}");
    }

    #[test]
    fn a_batch_for_a_plateau_begins_below_it() {
        let ln_l: Vec<f64> = (0..10).map(|i| f64::from(i.min(4))).collect();
        let history = history(&ln_l);
        let mut weighted = history.weigh();
        // More of the plateau's weight lies with its later points.
        weighted.p = vec![0.19; 10];
        weighted.p[..5].copy_from_slice(&[0.01; 5]);
        let range = LikelihoodRange::of(&history, &weighted, 1.0);
        assert_eq!((range.floor, range.ceiling), (ln_l[3], ln_l[9]));
    }

    #[test]
    fn batches_aim_at_the_target_that_is_left() {
        let mut summary = summary(&[0.0]);
        let settings = Settings {
            target_ess: Some(100.0),
            target_ln_z_error: Some(0.1),
            ..Settings::default()
        };
        let alone = Settings {
            target_ln_z_error: None,
            ..settings.clone()
        };
        for (ess, error, fraction) in [(90.0, 0.2, 0.8), (90.0, 0.1, 1.0), (100.0, 0.2, 0.0)] {
            (summary.ess, summary.ln_z_error) = (ess, error);
            assert!(!summary.meets(&settings));
            assert!((summary.posterior_fraction(&settings) - fraction).abs() < 1e-12);
        }
        (summary.ess, summary.ln_z_error) = (90.0, 0.1);
        assert!((summary.posterior_fraction(&alone) - 0.8).abs() < 1e-12);
        let of_evidence = Settings {
            target_ess: None,
            ..settings.clone()
        };
        summary.ln_z_error = 0.2;
        assert!(summary.posterior_fraction(&of_evidence).abs() < 1e-12);
        (summary.ess, summary.ln_z_error) = (100.0, 0.1);
        assert!(summary.meets(&settings) && summary.meets(&alone));
        // An error falls as the root of the number of batches.
        (summary.ess, summary.ln_z_error) = (50.0, 0.2);
        let (open, needed) = summary.open(&settings);
        assert_eq!(open, ["target-ess", "target-ln-z-error"]);
        assert!((needed - 4.0).abs() < 1e-12);
        assert_eq!(summary.open(&alone), (vec!["target-ess".to_owned()], 2.0));
    }

    #[test]
    fn a_batch_begins_with_the_prior_where_draws_are_few_because_they_resemble_each_other() {
        let ln_l: Vec<f64> = (0..10).map(f64::from).collect();
        let settings = Settings {
            target_ess: Some(100.0),
            ..Settings::default()
        };
        let floor = |change: fn(&mut RunSummary)| {
            let mut summary = summary(&ln_l);
            summary.weighted.p = vec![0.01; 10];
            summary.weighted.p[8] = 0.91;
            change(&mut summary);
            (!summary.meets(&settings)).then(|| summary.next_range(&settings).floor)
        };
        assert_eq!(floor(|_| ()), Some(7.0));
        assert_eq!(floor(|s| s.alike = true), Some(NEVER));
        assert_eq!(floor(|s| s.lineages = 1.0), Some(NEVER));
        // Enough draws are enough, however alike, but not if their number rests on few ancestors.
        assert_eq!(floor(|s| (s.ess, s.alike) = (100.0, true)), None);
        let few = floor(|s| (s.ess, s.lineages) = (100.0, 1.0));
        assert_eq!(few, Some(NEVER));
    }

    #[test]
    fn a_batch_for_the_evidence_begins_with_the_prior() {
        let ln_l: Vec<f64> = (0..10).map(f64::from).collect();
        let history = history(&ln_l);
        let mut weighted = history.weigh();
        // With a constant number of live points the first death matters most, because all later volumes depend on it.
        weighted.p = vec![0.65 / 7.0; 10];
        weighted.p[..3].copy_from_slice(&[0.05, 0.05, 0.25]);
        let mut even = history.clone();
        even.live = vec![10; 10];
        let range = LikelihoodRange::of(&even, &weighted, 0.0);
        // From the sixth on less than half of the weight is left.
        assert_eq!((range.floor, range.ceiling), (NEVER, ln_l[5]));
        assert!(range.ln_x.abs() < f64::MIN_POSITIVE);
    }
}
