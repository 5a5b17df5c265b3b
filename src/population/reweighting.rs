//! The reweighting of each stream along the posterior of the hyperparameters: its Monte-Carlo error, and the stream's q given the population.

use super::family::Family;
use super::target::{PopulationTarget, WeightedStream, equal_weight_members};
use crate::posterior::{Interval, MAX_PARETO_K, StreamInPopulation};
use oblate_samplers::diagnostics::{effective_number, pareto_k, weighted_quantile};
use oblate_samplers::output::{Check, Draws};
use rayon::prelude::*;

/// Equal-weight draws of the hyperparameters over which errors are averaged: the standard error of a 5 % quantile is 1.5 % in probability.
pub(super) const ERROR_DRAWS: usize = 200;

/// Largest variance of ln L of a population (Talbot & Golomb 2023).
pub(super) const MAX_VARIANCE: f64 = 1.0;

/// Every stream along the posterior of the hyperparameters, given by their draws, in the streams' order.
pub(super) fn streams_given_population<F: Family<N>, const N: usize>(
    target: &PopulationTarget<F, N>,
    draws: &Draws,
) -> Vec<StreamInPopulation> {
    let members: Vec<[f64; N]> = equal_weight_members(draws, ERROR_DRAWS);
    target
        .weighted_streams()
        .par_iter()
        .map(|stream| along(stream, target.family(), &members))
        .collect()
}

/// One stream along draws of the hyperparameters.
fn along<F: Family<N>, const N: usize>(
    stream: &WeightedStream,
    family: &F,
    alphas: &[[f64; N]],
) -> StreamInPopulation {
    let mut given_population = vec![0.0; stream.q.len()];
    let (mut effective, mut shapes, mut variance) = (Vec::new(), Vec::new(), 0.0);
    for alpha in alphas {
        let ln_pdf = family.ln_pdf(*alpha);
        let terms: Vec<f64> = stream
            .q
            .iter()
            .zip(&stream.ln_factor)
            .map(|(q, w)| w + ln_pdf(*q))
            .collect();
        let top = terms.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let x: Vec<f64> = terms.iter().map(|term| (term - top).exp()).collect();
        let sum: f64 = x.iter().sum();
        // With x_i = w_i r_i the relative variance of r over the stream's posterior is sum w r^2 / (sum w r)^2 - 1.
        let squares: f64 = x
            .iter()
            .zip(terms.iter().zip(&stream.ln_factor))
            .map(|(x, (term, ln_factor))| x * (term - top - ln_factor - stream.ln_prior).exp())
            .sum();
        let relative_variance = squares / (sum * sum) - 1.0;
        // A single draw does not tell how its sum scatters, however many copies of it there are.
        let others = (stream.effective_size - 1.0).max(0.0);
        variance += if others > 0.0 {
            relative_variance / others / alphas.len() as f64
        } else {
            f64::INFINITY
        };
        for (total, x) in given_population.iter_mut().zip(&x) {
            *total += x / sum;
        }
        effective.push(effective_number(x));
        shapes.push(pareto_k(&terms));
    }
    let equal = vec![1.0; alphas.len()];
    StreamInPopulation {
        name: stream.name.clone(),
        q: stream.in_its_fit.clone(),
        q_given_population: Interval::new(&stream.q, &given_population, ""),
        effective_draws: weighted_quantile(&effective, &equal, 0.05),
        pareto_k: weighted_quantile(&shapes, &equal, 0.5),
        ln_likelihood_variance: variance,
        without: None,
    }
}

/// The checks of the sums over draws: whether ln L of the population is more than noise, and which stream is to be fitted longer
/// if not.
#[must_use]
pub fn checks(streams: &[StreamInPopulation]) -> Vec<Check> {
    let worst = |of: fn(&StreamInPopulation) -> f64| {
        let largest = streams.iter().max_by(|a, b| of(a).total_cmp(&of(b)));
        largest.map_or((f64::NAN, ""), |s| (of(s), s.name.as_str()))
    };
    let total: f64 = streams.iter().map(|s| s.ln_likelihood_variance).sum();
    let (most, noisiest) = worst(|s| s.ln_likelihood_variance);
    let (k, heaviest) = worst(|s| s.pareto_k);
    let longer = "fit it until it has more effective draws, or leave it out";
    vec![
        Check::at_most(
            "reweighting-variance",
            total,
            MAX_VARIANCE,
            format!(
                "Monte-Carlo variance of the population's ln L, mean over the posterior; {noisiest} has most of it ({most:.2}): {longer}"
            ),
        ),
        Check::at_most(
            "reweighting-pareto-k",
            k,
            MAX_PARETO_K,
            format!(
                "largest Pareto shape of a stream's terms, that of {heaviest}; above the limit few draws carry the stream: {longer}"
            ),
        ),
    ]
}
