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
    /// The population without this stream; none in runs of earlier versions.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub without: Option<WithoutStream>,
}

/// A hyperparameter without one of the streams.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MeanWithoutStream {
    /// Its mean.
    #[serde(with = "json::number")]
    pub mean: f64,
    /// Its standard deviation.
    #[serde(with = "json::number")]
    pub sd: f64,
    /// The mean without the stream less that with it, in standard deviations with it.
    #[serde(with = "json::number")]
    pub mean_move: f64,
    /// The standard deviation without the stream over that with it.
    #[serde(with = "json::number")]
    pub width_ratio: f64,
}

/// A population without one of its streams.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct WithoutStream {
    /// Logarithm of the density that the population of the other streams predicts for this one's data, relative to that under the prior of its
    /// own fit.
    #[serde(with = "json::number")]
    pub ln_predictive_density: f64,
    /// Pareto shape of the weights; above [`MAX_PARETO_K`] the other numbers are not reliable.
    #[serde(with = "json::number")]
    pub pareto_k: f64,
    /// Every hyperparameter by name, in the run's order.
    #[serde(with = "json::ordered")]
    pub parameters: Vec<(String, MeanWithoutStream)>,
}

/// Largest Pareto shape of weights whose sums are reliable (Vehtari et al. 2024).
pub const MAX_PARETO_K: f64 = 0.7;

impl StreamInPopulation {
    /// The numbers of a table's line, each with the name of its column.
    fn row(&self) -> Vec<(String, f64)> {
        let mut row = Vec::new();
        for (name, q) in [
            ("q", &self.q),
            ("q_given_population", &self.q_given_population),
        ] {
            let ends = [
                ("median", q.median),
                ("lo68", q.lo68),
                ("hi68", q.hi68),
                ("lo95", q.lo95),
                ("hi95", q.hi95),
            ];
            row.extend(ends.map(|(end, x)| (format!("{name}_{end}"), x)));
        }
        let sums = [
            ("effective_draws", self.effective_draws),
            ("pareto_k", self.pareto_k),
            ("ln_likelihood_variance", self.ln_likelihood_variance),
        ];
        row.extend(sums.map(|(name, x)| (name.to_owned(), x)));
        let Some(without) = &self.without else {
            return row;
        };
        let weights = [
            ("ln_predictive_density", without.ln_predictive_density),
            ("without_pareto_k", without.pareto_k),
        ];
        row.extend(weights.map(|(name, x)| (name.to_owned(), x)));
        for (name, moved) in &without.parameters {
            let numbers = [
                ("mean", moved.mean),
                ("sd", moved.sd),
                ("mean_move", moved.mean_move),
                ("width_ratio", moved.width_ratio),
            ];
            row.extend(numbers.map(|(of, x)| (format!("{name}_{of}"), x)));
        }
        row
    }
}

impl WithoutStream {
    /// The hyperparameter that moves most, and how.
    #[must_use]
    pub fn largest_move(&self) -> Option<&(String, MeanWithoutStream)> {
        let size = |(_, moved): &&(String, MeanWithoutStream)| moved.mean_move.abs();
        let known = self
            .parameters
            .iter()
            .filter(|(_, m)| !m.mean_move.is_nan());
        known.max_by(|a, b| size(a).total_cmp(&size(b)))
    }

    /// Whether the weights can be trusted.
    #[must_use]
    pub fn reliable(&self) -> bool {
        // A NaN is not.
        self.pareto_k <= MAX_PARETO_K
    }
}

/// A quantity of the set of all streams' q, in the streams and in populations that the posterior predicts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PredictiveQuantity {
    /// Its name.
    pub name: String,
    /// Of the streams' q given the population.
    pub streams: Interval,
    /// Of as many q drawn from the population.
    pub population: Interval,
    /// Twice the probability that a population's is beyond the streams', at most 1.
    #[serde(with = "json::number")]
    pub p_value: f64,
}

/// The streams of a population, and their information about its hyperparameters.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PopulationSummary {
    /// The streams, in the order in which their fits were given.
    pub streams: Vec<StreamInPopulation>,
    /// Information that the streams give about each hyperparameter, in the run's order; see [`marginal_information`](super::marginal_information).
    /// Empty where the draws are too few to say.
    #[serde(with = "json::ordered")]
    pub information: Vec<(String, f64)>,
    /// The posterior predictive check; empty in runs of earlier versions.
    #[serde(default)]
    pub predictive: Vec<PredictiveQuantity>,
}

impl PopulationSummary {
    /// Whether every hyperparameter's posterior equals its prior; not where the draws are too few to say.
    #[must_use]
    pub fn measures_nothing(&self) -> bool {
        !self.information.is_empty()
            && equal_to_prior(&self.information).len() == self.information.len()
    }

    /// The verdict on what the streams say: which hyperparameters are only their priors. None if every posterior differs from its prior.
    #[must_use]
    pub fn verdict(&self) -> Option<String> {
        let remedy = "add streams, or streams that constrain q better";
        not_measured(&self.information, remedy)
    }

    /// The streams that were left out, with the population without each: all of them, or none in runs of earlier versions.
    pub fn left_out(&self) -> impl Iterator<Item = (&StreamInPopulation, &WithoutStream)> {
        let streams = self.streams.iter();
        streams.filter_map(|stream| Some((stream, stream.without.as_ref()?)))
    }

    /// The streams as a table with commas: one line of names, then one line for each stream, with all digits; the columns are those of
    /// docs/files.md, section 6. Streams of earlier versions, which were not left out, have no columns of that.
    ///
    /// # Errors
    /// Those of the writer of tables.
    pub fn csv(&self) -> std::io::Result<Vec<u8>> {
        let rows: Vec<_> = self.streams.iter().map(StreamInPopulation::row).collect();
        let names = rows.first().into_iter().flatten();
        let names = names.map(|(name, _)| name.as_str());
        let mut table = csv::Writer::from_writer(Vec::new());
        table.write_record(["stream"].into_iter().chain(names))?;
        for (stream, row) in self.streams.iter().zip(&rows) {
            let numbers = row.iter().map(|(_, x)| format!("{x:?}"));
            table.write_record([stream.name.clone()].into_iter().chain(numbers))?;
        }
        table.into_inner().map_err(csv::IntoInnerError::into_error)
    }

    /// The stream whose removal moves a hyperparameter most, and what moves, as a sentence; none for a single stream.
    #[must_use]
    pub fn influence(&self) -> Option<String> {
        let moved = self.left_out();
        let moved = moved.filter_map(|(stream, w)| Some((stream, w, w.largest_move()?)));
        let (stream, without, (parameter, moved)) =
            moved.max_by(|(_, _, (_, a)), (_, _, (_, b))| {
                a.mean_move.abs().total_cmp(&b.mean_move.abs())
            })?;
        if self.streams.len() < 2 {
            return None;
        }
        let reliable = if without.reliable() {
            String::new()
        } else {
            format!(
                ", which is not reliable (Pareto k {:.2}): sample the population again without it",
                without.pareto_k
            )
        };
        Some(format!(
            "Most influential stream: {}; without it the mean of {parameter} is {:.3}, moved by {:+.2} of its standard deviation{reliable}.",
            stream.name, moved.mean, moved.mean_move
        ))
    }
}
