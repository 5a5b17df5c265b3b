//! What births, deaths and parameters come to: evidence and effective sizes with their errors, of one run or of several.

use super::evidence::{History, Weighted};
use super::gates::Measured;
use super::live::REJECTED;
use super::settings::Settings;
use crate::diagnostics::kish_ess;
use crate::error::Result;
use crate::output::{Draws, Ess, Evidence, Path};
use crate::target::Target;
use std::collections::BTreeMap;

/// Births and deaths, and all that follows from them.
pub(super) struct Reckoning {
    pub history: History,
    pub weighted: Weighted,
    /// Effective size of each parameter: its variance over that of its mean.
    sizes: Vec<f64>,
    simulated: f64,
    bootstrapped: f64,
}

impl Reckoning {
    /// Of a history whose points, in the order given to it, have these physical parameters, row-major, `dim` each, and were
    /// founded so many clans at a time.
    pub fn of(
        history: History,
        theta: &[f64],
        dim: usize,
        founders: usize,
        settings: &Settings,
        seed: u64,
    ) -> Self {
        let weighted = history.weigh();
        let clans = founders as f64;
        // So few scatter a little less, weighted at random, about their own mean than about the truth.
        let freedom = ((clans + 1.0) / (clans - 1.0)).sqrt();
        let read = |weighted: &Weighted| weighted.ln_z;
        let ln_z = history.bootstrap(&history.clans, seed, settings.bootstraps, read);
        let sizes = (0..dim)
            .map(|k| {
                let column: Vec<f64> = history.order.iter().map(|&i| theta[i * dim + k]).collect();
                size_of_mean(&history, &weighted, &column)
            })
            .collect();
        Self {
            simulated: deviation(&history.simulate(seed, settings.simulations)),
            bootstrapped: freedom * deviation(&ln_z),
            sizes,
            history,
            weighted,
        }
    }

    /// The same with an error of ln Z that others have found by their clans.
    pub fn with_bootstrapped(self, bootstrapped: f64) -> Self {
        Self {
            bootstrapped,
            ..self
        }
    }

    pub fn evidence(&self) -> Evidence {
        let best = self.history.ln_l.last();
        if best.is_none_or(|l| *l <= REJECTED) {
            return Evidence {
                ln_z: f64::NEG_INFINITY,
                error: f64::INFINITY,
                ..Evidence::default()
            };
        }
        Evidence {
            ln_z: self.weighted.ln_z,
            error: self.simulated.max(self.bootstrapped),
            error_parts: named([
                ("simulated", self.simulated),
                ("bootstrap", self.bootstrapped),
            ]),
            estimates: named([("ln-of-mean-z", self.history.ln_of_mean_z())]),
            information: self.weighted.information,
        }
    }

    /// The points in order of death, without the rejected ones, which have no likelihood and no weight; `theta` as it was given.
    pub fn draws(&self, target: &dyn Target, theta: &[f64]) -> Result<Draws> {
        let dim = target.dim();
        let mut draws = Draws::of(target);
        for (death, &row) in self.history.order.iter().enumerate() {
            let ln_l = self.history.ln_l[death];
            if ln_l > REJECTED {
                let theta = &theta[row * dim..(row + 1) * dim];
                let (ln_p, lineage) = (self.weighted.ln_p[death], self.history.lineages.of[death]);
                draws.push(target, theta, ln_l, ln_p, lineage)?;
            }
        }
        Ok(draws)
    }

    /// Effective sizes of the draws: never more of a parameter than there are draws.
    pub fn ess(&self, draws: &Draws) -> Ess {
        let most = draws.len() as f64;
        // A parameter that is the same in all draws has no scatter to speak of.
        let of = |size: &f64| if size.is_nan() { most } else { size.min(most) };
        let bulk: Vec<f64> = self.sizes.iter().map(of).collect();
        let kish = kish_ess(&draws.ln_weight);
        Ess {
            kish,
            quoted: bulk.iter().copied().fold(kish, f64::min),
            bulk,
            ..Ess::default()
        }
    }

    pub fn measured(&self, kish: f64) -> Measured {
        Measured {
            simulated: self.simulated,
            bootstrapped: self.bootstrapped,
            halves: self.history.halves(),
            lineages: self.history.effective_lineages(&self.weighted),
            kish,
        }
    }

    /// The way from the prior to the peak, with the ranks of those inserted.
    pub fn path(&self, insertion_rank: Vec<f64>) -> Path {
        let shown = |l: &f64| {
            if *l <= REJECTED {
                f64::NEG_INFINITY
            } else {
                *l
            }
        };
        let mut sum = 0.0;
        Path::Nested {
            ln_x: self
                .history
                .expected_ln_t()
                .iter()
                .map(|t| {
                    sum += t;
                    sum
                })
                .collect(),
            ln_likelihood: self.history.ln_l.iter().map(shown).collect(),
            ln_likelihood_birth: self.history.birth.clone(),
            live: self.history.live.clone(),
            insertion_rank,
        }
    }
}

/// Effective size of a column's mean: its variance over that of the mean by the scatter of lineages, of each of which the summed
/// deviation of its draws is one number. A few scatter less about their common mean than about the truth, one alone not at all.
fn size_of_mean(history: &History, weighted: &Weighted, column: &[f64]) -> f64 {
    let rows = || column.iter().zip(&weighted.p);
    let mean: f64 = rows().map(|(x, p)| p * x).sum();
    let variance: f64 = rows().map(|(x, p)| p * (x - mean).powi(2)).sum();
    let sums = history.lineages.sums(rows().map(|(x, p)| p * (x - mean)));
    let scatter: f64 = sums.iter().map(|s| s * s).sum();
    let freedom = 1.0 - 1.0 / history.effective_lineages(weighted);
    variance * freedom / scatter
}

fn named<const N: usize>(pairs: [(&str, f64); N]) -> BTreeMap<String, f64> {
    pairs.map(|(name, value)| (name.to_owned(), value)).into()
}

/// Standard deviation about the mean.
pub(super) fn deviation(values: &[f64]) -> f64 {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let sum: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
    (sum / (count - 1.0)).sqrt()
}
