//! How the errors of hyperparameters fall with the number of streams.

use super::summary::Summary;
use serde::Serialize;
use std::fmt::Write;

/// Populations of one number of streams.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ScalingRow {
    /// Number of streams.
    pub streams: usize,
    /// Number of populations of so many.
    pub populations: usize,
    /// Width of the central 68 % interval of each hyperparameter.
    pub widths: Vec<ScalingWidth>,
}

/// The widths of one hyperparameter.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ScalingWidth {
    /// Name of the hyperparameter.
    pub name: String,
    /// Mean over the populations.
    pub mean: f64,
    /// Their standard deviation; none of a single one.
    pub sd: Option<f64>,
}

/// One row for each number of streams, in increasing order, from pairs of it and of the summary of a population of so many.
#[must_use]
pub fn scaling(populations: &[(usize, &Summary)]) -> Vec<ScalingRow> {
    let mut sizes: Vec<usize> = populations.iter().map(|(streams, _)| *streams).collect();
    sizes.sort_unstable();
    sizes.dedup();
    let row = |streams: usize| {
        let own = populations.iter().filter(|(size, _)| *size == streams);
        let own: Vec<&Summary> = own.map(|(_, summary)| *summary).collect();
        let width = |name: &String| {
            let widths = own.iter().filter_map(|summary| {
                let interval = summary.parameters.iter().find(|(own, _)| own == name);
                interval.map(|(_, interval)| interval.hi68 - interval.lo68)
            });
            ScalingWidth::new(name, &widths.collect::<Vec<_>>())
        };
        ScalingRow {
            streams,
            populations: own.len(),
            widths: own[0]
                .parameters
                .iter()
                .map(|(name, _)| width(name))
                .collect(),
        }
    };
    sizes.into_iter().map(row).collect()
}

impl ScalingWidth {
    fn new(name: &str, widths: &[f64]) -> Self {
        let count = widths.len() as f64;
        let mean = widths.iter().sum::<f64>() / count;
        let squares: f64 = widths.iter().map(|w| (w - mean).powi(2)).sum();
        Self {
            name: name.to_owned(),
            mean,
            sd: (widths.len() > 1).then(|| (squares / (count - 1.0)).sqrt()),
        }
    }
}

/// The rows as a table: `streams`, `populations`, then `width_NAME` and `sd_NAME` of each hyperparameter; empty where a width has no standard deviation.
#[must_use]
pub fn scaling_csv(rows: &[ScalingRow]) -> String {
    let mut text = "streams,populations".to_owned();
    for width in rows.first().iter().flat_map(|row| &row.widths) {
        let _ = write!(text, ",width_{0},sd_{0}", width.name);
    }
    text.push('\n');
    for row in rows {
        let _ = write!(text, "{},{}", row.streams, row.populations);
        for width in &row.widths {
            let sd = width.sd.map(|sd| sd.to_string()).unwrap_or_default();
            let _ = write!(text, ",{},{sd}", width.mean);
        }
        text.push('\n');
    }
    text
}
