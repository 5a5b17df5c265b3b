//! A marginal posterior in five quantiles.

use super::json;
use oblate_samplers::diagnostics::weighted_quantile;
use serde::{Deserialize, Serialize};

/// A marginal posterior in five quantiles.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Interval {
    /// The median.
    #[serde(with = "json::number")]
    pub median: f64,
    /// Lower end of the central 68 %.
    #[serde(with = "json::number")]
    pub lo68: f64,
    /// Upper end of the central 68 %.
    #[serde(with = "json::number")]
    pub hi68: f64,
    /// Lower end of the central 95 %.
    #[serde(with = "json::number")]
    pub lo95: f64,
    /// Upper end of the central 95 %.
    #[serde(with = "json::number")]
    pub hi95: f64,
    /// The unit, empty where there is none.
    pub unit: String,
}

impl Interval {
    /// Quantiles of weighted values; NaN throughout without values.
    #[must_use]
    pub fn new(values: &[f64], weights: &[f64], unit: &str) -> Self {
        let at = |p| weighted_quantile(values, weights, p);
        Self {
            median: at(0.5),
            lo68: at(0.16),
            hi68: at(0.84),
            lo95: at(0.025),
            hi95: at(0.975),
            unit: unit.to_owned(),
        }
    }
}
