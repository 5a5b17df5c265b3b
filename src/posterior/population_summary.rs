//! What the summary of a population says beside that of any run: its streams, and what they say about its hyperparameters.

use super::interval::Interval;
use super::json;
use oblate_samplers::{Marginal, Prior, Run};
use serde::{Deserialize, Serialize};

/// A posterior with less information than this about a hyperparameter, in nats, is called equal to its prior: a normal distribution that is shifted by
/// less than half of its width, or that is not narrower than 0.7 times its width.
pub const EQUAL_TO_PRIOR: f64 = 0.1;

/// Cells of equal prior probability over which the information is summed.
const CELLS: usize = 20;

/// One stream of a population.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StreamInPopulation {
    /// Name of the fit.
    pub name: String,
    /// q in the fit, under the fit's own prior.
    pub q: Interval,
    /// q given the population: under the population's density as its prior, over the posterior of the hyperparameters.
    pub q_given_population: Interval,
    /// Effective number of draws that carry the stream's sum: 5 % of the posterior of the hyperparameters have fewer.
    #[serde(with = "json::number")]
    pub effective_draws: f64,
    /// Pareto shape of the terms of the sum, median over the posterior of the hyperparameters.
    #[serde(with = "json::number")]
    pub pareto_k: f64,
    /// Monte-Carlo variance of the logarithm of the sum, mean over the posterior of the hyperparameters.
    #[serde(with = "json::number")]
    pub ln_likelihood_variance: f64,
}

/// The streams of a population, and their information about its hyperparameters.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PopulationSummary {
    /// The streams, in the order in which their fits were given.
    pub streams: Vec<StreamInPopulation>,
    /// Information that the streams give about each hyperparameter, in the run's order; see [`marginal_information`].
    #[serde(with = "json::ordered")]
    pub information: Vec<(String, f64)>,
}

impl PopulationSummary {
    /// Names of the hyperparameters whose posterior equals the prior, by [`EQUAL_TO_PRIOR`].
    #[must_use]
    pub fn equal_to_prior(&self) -> Vec<&str> {
        self.information
            .iter()
            .filter(|(_, information)| *information < EQUAL_TO_PRIOR)
            .map(|(name, _)| name.as_str())
            .collect()
    }

    /// Whether every hyperparameter's posterior equals its prior.
    #[must_use]
    pub fn measures_nothing(&self) -> bool {
        self.equal_to_prior().len() == self.information.len()
    }

    /// The verdict on what the streams say: which hyperparameters are only their priors. None if every posterior differs from its prior.
    #[must_use]
    pub fn verdict(&self) -> Option<String> {
        let equal = self.equal_to_prior();
        if equal.is_empty() {
            return None;
        }
        let (posterior, prior) = if equal.len() == 1 {
            ("the posterior", "its prior")
        } else {
            ("the posteriors", "their priors")
        };
        Some(format!(
            "NOT MEASURED: {posterior} of {} equal{} {prior} (less than {EQUAL_TO_PRIOR} nat of information); add streams, or streams that \
             constrain q better.",
            equal.join(", "),
            if equal.len() == 1 { "s" } else { "" }
        ))
    }
}

/// Kullback-Leibler divergence of the marginal posterior of each parameter from its prior, in nats: the sum over twenty cells of equal prior
/// probability, less its expectation for as many draws of the prior as the run has effective ones, and at least 0. At most ln 20.
#[must_use]
pub fn marginal_information(run: &Run, prior: &Prior) -> Vec<(String, f64)> {
    let weights = run.draws.weights();
    let expected = (CELLS - 1) as f64 / (2.0 * run.ess.quoted.max(1.0));
    let information = |k: usize, marginal: &Marginal| {
        let mut cells = [0.0; CELLS];
        for (value, weight) in run.draws.column(k).iter().zip(&weights) {
            #[allow(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "a probability times the number of cells"
            )]
            let cell = (marginal.u_from_theta(*value) * CELLS as f64) as usize;
            cells[cell.min(CELLS - 1)] += weight;
        }
        let filled = cells.iter().filter(|p| **p > 0.0);
        let sum: f64 = filled.map(|p| p * (p * CELLS as f64).ln()).sum();
        (sum - expected).max(0.0)
    };
    let names = prior.names().iter().zip(prior.marginals()).enumerate();
    names
        .map(|(k, (name, marginal))| (name.clone(), information(k, marginal)))
        .collect()
}
