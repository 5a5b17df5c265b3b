//! Draws of several chain sets at the posterior, and how well the chain sets agree.

use crate::diagnostics::{bulk_ess, mode_agreement, r_hat, tail_ess, two_means};
use crate::output::Ess;

/// Draws at beta = 1, one list per chain set.
pub(super) struct PosteriorDraws {
    /// Scan by scan.
    pub(super) positions: Vec<Vec<f64>>,
    pub(super) ln_likelihood: Vec<Vec<f64>>,
}

/// How well chain sets agree, and how many independent draws they are worth.
pub(super) struct Agreement {
    /// Effective sizes and R-hat per parameter (of its coordinate `z`: ranks do not change under a monotone map).
    pub(super) ess: Ess,
    /// Largest R-hat over coordinates, their squares and ln L.
    pub(super) worst_r_hat: f64,
    /// p-value that all chain sets give two modes, or halves, of the posterior the same weights.
    pub(super) modes: f64,
}

impl PosteriorDraws {
    /// The last draws of each chain set, at most so many.
    pub(super) fn newest(&self, scans: usize, dim: usize) -> Self {
        let last = |rows: &Vec<f64>, width: usize| {
            let from = rows.len().saturating_sub(scans * width);
            rows[from..].to_vec()
        };
        Self {
            positions: self.positions.iter().map(|z| last(z, dim)).collect(),
            ln_likelihood: self.ln_likelihood.iter().map(|l| last(l, 1)).collect(),
        }
    }

    /// Compares the chain sets, of which number `k` belongs to cluster `k % clusters`.
    pub(super) fn agreement(&self, dim: usize, clusters: usize) -> Agreement {
        let chain_sets = self.positions.len();
        let mut ess = Ess {
            kish: self.ln_likelihood.iter().map(Vec::len).sum::<usize>() as f64,
            ..Ess::default()
        };
        let columns: Vec<Vec<Vec<f64>>> = (0..dim)
            .map(|j| {
                let of = |rows: &Vec<f64>| rows.iter().skip(j).step_by(dim).copied().collect();
                self.positions.iter().map(of).collect()
            })
            .collect();
        for chain_sets in &columns {
            let squares: Vec<Vec<f64>> = chain_sets
                .iter()
                .map(|column| column.iter().map(|z| z * z).collect())
                .collect();
            let chains = slices(chain_sets);
            ess.bulk.push(bulk_ess(&chains));
            ess.tail.push(tail_ess(&chains));
            ess.r_hat.push(r_hat(&chains).max(r_hat(&slices(&squares))));
        }
        if clusters < chain_sets {
            let design_effect = design_effect(&columns, &ess.bulk, clusters);
            for size in ess.bulk.iter_mut().chain(&mut ess.tail) {
                *size /= design_effect;
            }
        }
        ess.quoted = Ess::smallest(&ess.bulk, &ess.tail);
        let of_ln_l = r_hat(&slices(&self.ln_likelihood));
        Agreement {
            worst_r_hat: ess.r_hat.iter().copied().fold(of_ln_l, f64::max),
            ess,
            modes: self.modes(dim),
        }
    }

    fn modes(&self, dim: usize) -> f64 {
        let scans = self.ln_likelihood.first().map_or(0, Vec::len);
        let labels = two_means(&self.positions.concat(), dim);
        let labels: Vec<&[bool]> = labels.chunks_exact(scans.max(1)).collect();
        mode_agreement(&labels, &slices(&self.ln_likelihood))
    }
}

fn slices(chains: &[Vec<f64>]) -> Vec<&[f64]> {
    chains.iter().map(Vec::as_slice).collect()
}

/// Design effect of clusters: the variance of their means over that expected from the effective sample sizes of their
/// chain sets, as the mean over all parameters, at least 1. The mean is over all parameters because few clusters give a
/// noisy estimate for each. Chain sets that started from the same SMC sampler have its errors in common.
fn design_effect(columns: &[Vec<Vec<f64>>], bulk: &[f64], clusters: usize) -> f64 {
    let excess = columns.iter().zip(bulk).map(|(chain_sets, bulk)| {
        let of_cluster = |cluster: usize| -> Vec<f64> {
            let own = chain_sets.iter().skip(cluster).step_by(clusters);
            own.flatten().copied().collect()
        };
        let mean = |x: &[f64]| x.iter().sum::<f64>() / x.len() as f64;
        let scatter = |x: &[f64]| {
            let centre = mean(x);
            x.iter().map(|x| (x - centre).powi(2)).sum::<f64>() / (x.len() as f64 - 1.0)
        };
        let means: Vec<f64> = (0..clusters).map(|f| mean(&of_cluster(f))).collect();
        scatter(&means) * bulk / (clusters as f64 * scatter(&chain_sets.concat()))
    });
    let mean = excess.sum::<f64>() / columns.len() as f64;
    if mean.is_finite() { mean.max(1.0) } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Domain, standard_normal, stream};

    /// 32 chain sets of 10 independent draws in each of 13 parameters, with this standard deviation of the part that
    /// the chain sets of each of four clusters have in common.
    fn columns(common: f64) -> Vec<Vec<Vec<f64>>> {
        let mut rng = stream(3, Domain::Test, 0, 0);
        (0..13)
            .map(|_| {
                let shared: Vec<f64> = (0..4).map(|_| common * standard_normal(&mut rng)).collect();
                let chain_set = |k: usize, rng: &mut _| -> Vec<f64> {
                    (0..10)
                        .map(|_| shared[k % 4] + standard_normal(rng))
                        .collect()
                };
                (0..32).map(|k| chain_set(k, &mut rng)).collect()
            })
            .collect()
    }

    #[test]
    fn what_chain_sets_of_a_cluster_have_in_common_makes_their_draws_fewer() {
        // Variance of a cluster's mean: 1 / 80 of its own draws, and the common part. 39 degrees of freedom in all: a
        // standard error of 23 %.
        let alone = design_effect(&columns(0.0), &[320.0; 13], 4);
        assert!((1.0..1.7).contains(&alone), "{alone}");
        let shared = design_effect(&columns(0.5), &[320.0; 13], 4);
        // The draws' own variance is 1.25 with it.
        let exact = (0.25 + 1.0 / 80.0) * 80.0 / 1.25;
        assert!((shared / exact - 1.0).abs() < 0.7, "{shared} {exact}");
    }
}
