//! From births and deaths to weights, evidence and its errors.
//!
//! Everything follows from two numbers per point, the likelihood bound above which it was born and its own log-likelihood:
//! the number n of points alive when it died, and with it the shrinkage of the prior volume, `t ~ Beta(n, 1)`, of
//! which `ln t` has mean `-1/n` and variance `1/n^2`. With `E ln t` the estimate of ln Z is unbiased; with `ln E t`
//! the one of Z is.

use super::live::{Genealogy, Points};
use crate::diagnostics::{effective_number, ln_sum_exp, sums_by_group};
use crate::rng::{Domain, stream, unit_open};
use rayon::prelude::*;

/// Task numbers of the post-processing streams.
const SIMULATION: u64 = 1;
const BOOTSTRAP: u64 = 2;

/// Births and deaths in order of death.
#[derive(Clone, Debug)]
pub(super) struct DeadPoints {
    /// Log-likelihoods, ascending.
    pub ln_l: Vec<f64>,
    /// Likelihood bounds above which the points were born.
    pub birth: Vec<f64>,
    /// Lineages: clusters for what chains do not change, such as the mode of a point.
    pub lineages: Groups,
    /// Recent lineages: clusters for what chains do change, and so for the volumes.
    pub recent_lineages: Groups,
    /// Row numbers of the points as they were given.
    pub order: Vec<usize>,
    /// Rows in order of birth.
    by_birth: Vec<usize>,
    /// Number alive at each death, the dying one included.
    pub live: Vec<u32>,
}

/// A partition of the points into clusters of dependent points.
#[derive(Clone, Debug)]
pub(super) struct Groups {
    /// The cluster of each point.
    pub of: Vec<u32>,
    /// One more than the largest number.
    pub count: usize,
}

impl Groups {
    fn new(of: Vec<u32>) -> Self {
        let count = of.iter().map(|g| *g as usize + 1).max().unwrap_or(0);
        Self { of, count }
    }
}

/// Weights, their sum and what follows from it.
#[derive(Clone, Debug, Default)]
pub(super) struct Weighted {
    /// ln Z.
    pub ln_z: f64,
    /// Kullback-Leibler divergence from the prior, nats.
    pub information: f64,
    /// Posterior probabilities of the points.
    pub p: Vec<f64>,
    /// Their logarithms, finite where a point has a likelihood.
    pub ln_p: Vec<f64>,
}

impl DeadPoints {
    /// Of the points of a run.
    pub fn of(points: &Points) -> Self {
        Self::new(&points.ln_l, &points.birth, &points.genealogy)
    }

    /// Points in any order; equal log-likelihoods die in the order given.
    pub fn new(ln_l: &[f64], birth: &[f64], genealogy: &[Genealogy]) -> Self {
        let mut order: Vec<usize> = (0..ln_l.len()).collect();
        order.sort_by(|&a, &b| ln_l[a].total_cmp(&ln_l[b]));
        let birth: Vec<f64> = order.iter().map(|&i| birth[i]).collect();
        let mut by_birth: Vec<usize> = (0..birth.len()).collect();
        by_birth.sort_by(|&a, &b| birth[a].total_cmp(&birth[b]));
        let groups = |of: fn(&Genealogy) -> u32| {
            Groups::new(order.iter().map(|&i| of(&genealogy[i])).collect())
        };
        let mut history = Self {
            ln_l: order.iter().map(|&i| ln_l[i]).collect(),
            lineages: groups(|genealogy| genealogy.lineage),
            recent_lineages: groups(|genealogy| genealogy.recent_lineage),
            birth,
            order,
            by_birth,
            live: Vec::new(),
        };
        let everyone = vec![1.0; history.lineages.count];
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "sums of ones are counts"
        )]
        let counts = history
            .alive(&history.lineages, &everyone)
            .iter()
            .map(|n| *n as u32)
            .collect();
        history.live = counts;
        history
    }

    /// Weight of the live points at each death if cluster k has the weight `weights[k]`: births strictly below, minus earlier
    /// deaths.
    fn alive(&self, groups: &Groups, weights: &[f64]) -> Vec<f64> {
        let weight_of = |i: usize| weights[groups.of[i] as usize];
        let mut born = self.by_birth.iter().peekable();
        let mut alive = 0.0;
        self.ln_l
            .iter()
            .enumerate()
            .map(|(i, l)| {
                while let Some(&&b) = born.peek() {
                    if self.birth[b] >= *l {
                        break;
                    }
                    alive += weight_of(b);
                    born.next();
                }
                let now = alive;
                alive -= weight_of(i);
                now
            })
            .collect()
    }

    /// Expected `ln t` of each death.
    pub fn expected_ln_t(&self) -> Vec<f64> {
        self.live.iter().map(|&n| -1.0 / f64::from(n)).collect()
    }

    /// Evidence, information and posterior probabilities with the expected volumes.
    pub fn weigh(&self) -> Weighted {
        weigh(&self.ln_l, &self.expected_ln_t())
    }

    /// The estimate whose Z, not ln Z, is unbiased: `t = n / (n + 1)`.
    pub fn ln_of_mean_z(&self) -> f64 {
        let ln_t: Vec<f64> = self
            .live
            .iter()
            .map(|&n| -(1.0 / f64::from(n)).ln_1p())
            .collect();
        weigh(&self.ln_l, &ln_t).ln_z
    }

    /// Error of ln Z to first order in the shrinkages: `ln t` of a death scatters by `1/n`, and moves the volume of all points
    /// from it on, so ln Z by their posterior mass.
    pub fn expected_error(&self, weighted: &Weighted) -> f64 {
        let deaths = weighted.p.iter().zip(&self.live).rev();
        let variance = deaths.scan(0.0, |rest, (p, n)| {
            *rest += p;
            Some((*rest / f64::from(*n)).powi(2))
        });
        variance.sum::<f64>().sqrt()
    }

    /// ln Z in `count` simulations of all volumes.
    pub fn simulate(&self, seed: u64, count: usize) -> Vec<f64> {
        (0..count as u64)
            .into_par_iter()
            .map(|s| {
                let mut rng = stream(seed, Domain::Post, SIMULATION, s);
                let ln_t: Vec<f64> = self
                    .live
                    .iter()
                    .map(|&n| unit_open(&mut rng).ln() / f64::from(n))
                    .collect();
                weigh(&self.ln_l, &ln_t).ln_z
            })
            .collect()
    }

    /// ln Z in `count` Bayesian bootstraps (Rubin 1981) over recent lineages: each has a weight drawn from the unit
    /// exponential. No recent lineage is left out, so that no bootstrap lacks a peak that few of them have reached.
    pub fn bootstrap(&self, seed: u64, count: usize) -> Vec<f64> {
        (0..count as u64)
            .into_par_iter()
            .map(|b| {
                let mut rng = stream(seed, Domain::Post, BOOTSTRAP, b);
                let weights: Vec<f64> = (0..self.recent_lineages.count)
                    .map(|_| -unit_open(&mut rng).ln())
                    .collect();
                self.weigh_groups(&self.recent_lineages, &weights).1.ln_z
            })
            .collect()
    }

    /// Effective number of lineages of the posterior, by their weights (Kish).
    pub fn effective_lineages(&self, weighted: &Weighted) -> f64 {
        effective_number(sums_by_group(&self.lineages.of, weighted.p.iter().copied()))
    }

    /// ln Z from the recent lineages of even and of odd number.
    pub fn halves(&self) -> [f64; 2] {
        [0, 1].map(|parity| {
            let weights: Vec<f64> = (0..self.recent_lineages.count)
                .map(|k| if k % 2 == parity { 1.0 } else { 0.0 })
                .collect();
            self.weigh_groups(&self.recent_lineages, &weights).1.ln_z
        })
    }

    /// The rows with a positive weight, and their posterior weights, if cluster k has the weight `weights[k]`.
    fn weigh_groups(&self, groups: &Groups, weights: &[f64]) -> (Vec<usize>, Weighted) {
        let alive = self.alive(groups, weights);
        let mut rows = Vec::with_capacity(alive.len());
        let mut ln_l = Vec::with_capacity(alive.len());
        let mut ln_t = Vec::with_capacity(alive.len());
        for (i, &all) in alive.iter().enumerate() {
            let own = weights[groups.of[i] as usize];
            if own > 0.0 {
                rows.push(i);
                ln_l.push(self.ln_l[i]);
                // Rounding must not make the weight of the live points smaller than that of the dying one.
                ln_t.push(-own / all.max(own));
            }
        }
        let weighted = weigh(&ln_l, &ln_t);
        (rows, weighted)
    }
}

/// Evidence from ascending log-likelihoods and log shrinkages. Cell edges are the mid-points `(X_i + X_{i+1}) / 2`,
/// with 1 before the first and 0 after the last: the cells tile the prior exactly.
pub(super) fn weigh(ln_l: &[f64], ln_t: &[f64]) -> Weighted {
    let count = ln_l.len();
    let mut ln_x = 0.0_f64;
    let mut ln_p = Vec::with_capacity(count);
    let mut t = ln_t.first().map_or(1.0, |t| t.exp());
    for i in 0..count {
        let next = ln_t.get(i + 1).map(|t| t.exp());
        // In units of X_{i-1}; the first cell reaches up to 1, the last one down to 0.
        let upper = if i == 0 { 1.0 } else { 0.5 * (1.0 + t) };
        let lower = next.map_or(0.0, |next| 0.5 * t * (1.0 + next));
        ln_p.push(ln_l[i] + ln_x + (upper - lower).ln());
        ln_x += ln_t[i];
        t = next.unwrap_or(1.0);
    }
    let ln_z = ln_sum_exp(&ln_p);
    let mut information = -ln_z;
    let mut p = Vec::with_capacity(count);
    for (ln_p, l) in ln_p.iter_mut().zip(ln_l) {
        *ln_p -= ln_z;
        let fraction = ln_p.exp();
        p.push(fraction);
        // A rejected point has no weight, but a log-likelihood that must not be multiplied.
        if fraction > 0.0 {
            information += fraction * l;
        }
    }
    Weighted {
        ln_z,
        information,
        p,
        ln_p,
    }
}

#[cfg(test)]
mod tests;
