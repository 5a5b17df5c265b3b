//! What the summary of a population says beside that of any run: its streams, and what they say about its hyperparameters.

use super::information::{equal_to_prior, not_measured};
use super::interval::Interval;
use super::json;
use serde::{Deserialize, Serialize};

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
    /// Information that the streams give about each hyperparameter, in the run's order; see [`marginal_information`](super::marginal_information).
    #[serde(with = "json::ordered")]
    pub information: Vec<(String, f64)>,
}

impl PopulationSummary {
    /// Whether every hyperparameter's posterior equals its prior.
    #[must_use]
    pub fn measures_nothing(&self) -> bool {
        equal_to_prior(&self.information).len() == self.information.len()
    }

    /// The verdict on what the streams say: which hyperparameters are only their priors. None if every posterior differs from its prior.
    #[must_use]
    pub fn verdict(&self) -> Option<String> {
        let remedy = "add streams, or streams that constrain q better";
        not_measured(&self.information, remedy)
    }
}
