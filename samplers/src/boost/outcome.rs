//! From weighted points to a result, and whether to believe it.

use super::{Weighted, normals};
use crate::diagnostics::{Tail, kish_ess, ln_sum_exp, weighted_moments};
use crate::error::Result;
use crate::hmc::{Evaluator, Tally};
use crate::mixture::Mixture;
use crate::output::{Cost, Draws, Ess, Evidence, Gate, Method, Origin, Path, Run, Status};
use crate::rng::STREAM_VERSION;
use crate::target::Target;

/// Effective draws of the parent that a component must hold for its share to be compared.
const TOLD: f64 = 10.0;

/// Everything that a boost has come to.
pub(super) struct Boosted<'a> {
    pub target: &'a dyn Target,
    pub parent: &'a Run,
    pub mixture: &'a Mixture,
    /// Draws of the proposal, those without a likelihood included.
    pub made: usize,
    pub points: Vec<Weighted>,
    pub evaluator: Evaluator<'a>,
    pub seed: u64,
    pub status: Status,
    pub cpu_seconds: f64,
    pub wall_seconds: f64,
}

impl Boosted<'_> {
    pub fn assemble(self) -> Result<Run> {
        let ln_weight: Vec<f64> = self.points.iter().map(|p| p.ln_weight).collect();
        let sum = ln_sum_exp(&ln_weight);
        let made = self.made as f64;
        // Draws without a likelihood weigh nothing, and count.
        let mut all = ln_weight.clone();
        all.resize(self.made, f64::NEG_INFINITY);
        let tail = Tail::of(&all);
        let draws = self.draws(sum)?;
        let weights = draws.weights();
        let kish = kish_ess(&draws.ln_weight);
        let ln_z = sum - made.ln();
        let mean_ln_l: f64 = weights
            .iter()
            .zip(&draws.ln_likelihood)
            .filter(|(w, _)| **w > 0.0)
            .map(|(w, l)| w * l)
            .sum();
        let error = (1.0 / kish - 1.0 / made).max(0.0).sqrt();
        let evidence = Evidence {
            ln_z,
            error,
            error_parts: [("weights".to_owned(), error)].into(),
            estimates: [(
                "pareto-smoothed".to_owned(),
                tail.ln_smooth_sum(&all) - made.ln(),
            )]
            .into(),
            information: mean_ln_l - ln_z,
        };
        let bulk = bulk(&draws, &weights);
        let ess = Ess {
            kish,
            quoted: bulk.iter().copied().fold(kish, f64::min),
            bulk,
            ..Ess::default()
        };
        let shares = self.shares(&weights);
        let gates = self.gates(&evidence, &ess, &tail, &shares);
        let mut tally = Tally::default();
        tally.add(&self.evaluator);
        let prior = self.target.prior();
        Ok(Run {
            method: Method::Boost,
            status: self.status,
            seed: self.seed,
            stream_version: STREAM_VERSION,
            names: prior.names().to_vec(),
            units: prior.units().to_vec(),
            derived_names: self.target.derived_names(),
            draws,
            evidence,
            ess,
            cost: Cost {
                calls: tally.calls,
                gradients: 0,
                cpu_seconds: self.cpu_seconds,
                wall_seconds: self.wall_seconds,
                rejected: tally.rejected,
            },
            path: Path::Importance {
                // In units of their mean.
                ln_tail: tail.raw.iter().map(|w| w - ln_z).collect(),
                ln_tail_smooth: tail.smooth.iter().map(|w| w - ln_z).collect(),
                share: shares.iter().map(|s| s.here).collect(),
                parent_share: shares.iter().map(|s| s.parent).collect(),
            },
            gates,
            warnings: Vec::new(),
        })
    }

    fn draws(&self, sum: f64) -> Result<Draws> {
        let mut draws = Draws::of(self.target);
        let mut theta = vec![0.0; self.target.dim()];
        for point in &self.points {
            self.target.prior().theta_from_z(&point.z, &mut theta);
            draws.push(
                self.target,
                &theta,
                point.ln_l,
                point.ln_weight - sum,
                Origin::default(),
            )?;
        }
        Ok(draws)
    }

    /// The weight of every component, here and in the parent run.
    fn shares(&self, weights: &[f64]) -> Vec<Share> {
        let mut shares = vec![Share::default(); self.mixture.len()];
        for (point, weight) in self.points.iter().zip(weights) {
            for (share, belongs) in shares.iter_mut().zip(self.mixture.belonging(&point.z)) {
                share.here += weight * belongs;
            }
        }
        let draws = &self.parent.draws;
        for (row, weight) in draws.weights().into_iter().enumerate() {
            if weight > 0.0
                && let Some(z) = normals(self.target, draws.theta_row(row))
            {
                for (share, belongs) in shares.iter_mut().zip(self.mixture.belonging(&z)) {
                    share.parent += weight * belongs;
                }
            }
        }
        shares
    }

    fn gates(&self, evidence: &Evidence, ess: &Ess, tail: &Tail, shares: &[Share]) -> Vec<Gate> {
        let made = self.made as f64;
        let parent = &self.parent.evidence;
        let apart = (evidence.ln_z - parent.ln_z).abs() / evidence.error.hypot(parent.error);
        // Components of fewer draws of the parent are there by chance.
        let least = TOLD / self.parent.ess.quoted.max(1.0);
        let least_found = shares
            .iter()
            .filter(|s| s.parent >= least)
            .map(|s| s.here / s.parent)
            .fold(1.0, f64::min);
        vec![
            Gate::at_most(
                "pareto-k",
                tail.k,
                (1.0 - 1.0 / made.log10()).min(0.7),
                "tail index of the importance weights; if too large, the mixture misses part of the posterior: keep to the parent run",
            ),
            Gate::at_least(
                "effective-share",
                ess.kish / made,
                0.01,
                "effective draws per draw; if too small, the mixture hardly resembles the posterior: keep to the parent run",
            ),
            Gate::at_most(
                "parent-evidence",
                apart,
                3.0,
                "difference of ln Z from the parent run in units of their error; if too large, one of the two is wrong: run the parent again with another seed",
            ),
            Gate::at_least(
                "components-found",
                least_found,
                0.2,
                "smallest share of a component over that in the parent run; if too small, the draws miss a mode that the parent has: keep to the parent run",
            ),
        ]
    }
}

#[derive(Clone, Debug, Default)]
struct Share {
    here: f64,
    parent: f64,
}

/// Effective size of every parameter: its variance over that of its mean.
fn bulk(draws: &Draws, weights: &[f64]) -> Vec<f64> {
    (0..draws.dim)
        .map(|j| {
            let column = draws.column(j);
            let (mean, variance) = weighted_moments(&column, weights);
            let rows = column.iter().zip(weights);
            let of_mean: f64 = rows.map(|(x, w)| (w * (x - mean)).powi(2)).sum();
            let size = variance / of_mean;
            if size.is_nan() { 0.0 } else { size }
        })
        .collect()
}
