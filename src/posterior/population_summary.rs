//! What the summary of a population says beside that of any run: its streams, and how far its hyperparameters are from their priors.

use super::interval::Interval;
use super::json;
use oblate_samplers::{Marginal, Prior, Run};
use serde::{Deserialize, Serialize};

/// A posterior whose cumulative probabilities differ by at most this from those of its prior is called equal to it. The median then moves
/// by less than a tenth of the prior's probability, and 400 draws of the prior itself reach 0.07 once in twenty times.
pub const EQUAL_TO_PRIOR: f64 = 0.1;

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

/// The streams of a population, and its hyperparameters' distances from their priors.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PopulationSummary {
    /// The streams, in the order in which their fits were given.
    pub streams: Vec<StreamInPopulation>,
    /// The largest difference between the cumulative probabilities of posterior and prior (Kolmogorov-Smirnov distance) of each
    /// hyperparameter, in the run's order.
    #[serde(with = "json::ordered")]
    pub prior_distances: Vec<(String, f64)>,
}

impl PopulationSummary {
    /// Names of the hyperparameters whose posterior equals the prior, by [`EQUAL_TO_PRIOR`].
    #[must_use]
    pub fn equal_to_prior(&self) -> Vec<&str> {
        let equal = |distance: &f64| *distance <= EQUAL_TO_PRIOR;
        self.prior_distances
            .iter()
            .filter(|(_, distance)| equal(distance))
            .map(|(name, _)| name.as_str())
            .collect()
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
            "NOT MEASURED: {posterior} of {} equal{} {prior} (cumulative probabilities differ by at most {EQUAL_TO_PRIOR}); add streams, or \
             streams that constrain q.",
            equal.join(", "),
            if equal.len() == 1 { "s" } else { "" },
        ))
    }
}

/// The largest difference between the cumulative probabilities of each parameter's posterior and of its prior.
#[must_use]
pub fn prior_distances(run: &Run, prior: &Prior) -> Vec<(String, f64)> {
    let weights = run.draws.weights();
    let marginals = prior.names().iter().zip(prior.marginals()).enumerate();
    let distance = |k: usize, marginal: &Marginal| {
        let values = run.draws.column(k);
        let u = values.iter().map(|value| marginal.u_from_theta(*value));
        let mut rows: Vec<(f64, f64)> = u.zip(weights.iter().copied()).collect();
        rows.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (mut below, mut distance) = (0.0_f64, 0.0_f64);
        for (u, weight) in rows {
            distance = distance.max((u - below).abs());
            below += weight;
            distance = distance.max((below - u).abs());
        }
        distance
    };
    marginals
        .map(|(k, (name, marginal))| (name.clone(), distance(k, marginal)))
        .collect()
}
