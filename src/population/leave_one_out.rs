//! Each stream left out in turn, by weighting the draws of the hyperparameters with the inverse of its likelihood.

use super::family::Family;
use super::target::{PopulationTarget, equal_weight_members};
use crate::posterior::{MeanWithoutStream, WithoutStream};
use oblate_samplers::diagnostics::{ln_sum_exp, pareto_k, weighted_moments};
use oblate_samplers::output::Draws;
use rayon::prelude::*;

/// Equal-weight draws of the hyperparameters that are weighted; their means have an error of 2 % of the width of the posterior.
const WEIGHTED_DRAWS: usize = 2_000;

/// Every stream left out in turn, in the streams' order: the draws of the hyperparameters with weights `1 / L_n`.
pub(super) fn leave_one_out<F: Family<N>, const N: usize>(
    target: &PopulationTarget<F, N>,
    draws: &Draws,
) -> Vec<WithoutStream> {
    let members: Vec<[f64; N]> = equal_weight_members(draws, WEIGHTED_DRAWS);
    let names = target.family().hyperparameters().map(|(name, _)| name);
    let columns: [Vec<f64>; N] = std::array::from_fn(|k| members.iter().map(|m| m[k]).collect());
    let equal = vec![1.0 / members.len() as f64; members.len()];
    let all = columns.each_ref().map(|column| moments(column, &equal));
    let ln_likelihoods: Vec<Vec<f64>> = members
        .par_iter()
        .map(|member| target.ln_likelihoods(*member))
        .collect();
    (0..target.streams())
        .map(|n| {
            let ln_weight: Vec<f64> = ln_likelihoods.iter().map(|of| -of[n]).collect();
            let ln_sum = ln_sum_exp(&ln_weight);
            let weights: Vec<f64> = ln_weight.iter().map(|w| (w - ln_sum).exp()).collect();
            let parameters = (0..N)
                .map(|k| {
                    let (mean, sd) = moments(&columns[k], &weights);
                    let (mean_of_all, sd_of_all) = all[k];
                    let without = MeanWithoutStream {
                        mean,
                        sd,
                        mean_move: (mean - mean_of_all) / sd_of_all,
                        width_ratio: sd / sd_of_all,
                    };
                    (names[k].to_owned(), without)
                })
                .collect();
            WithoutStream {
                ln_predictive_density: (members.len() as f64).ln() - ln_sum,
                pareto_k: pareto_k(&ln_weight),
                parameters,
            }
        })
        .collect()
}

/// Mean and standard deviation.
fn moments(values: &[f64], weights: &[f64]) -> (f64, f64) {
    let (mean, variance) = weighted_moments(values, weights);
    (mean, variance.sqrt())
}
