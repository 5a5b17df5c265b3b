//! Weights of the orientation modes: the eight combinations of (sign of `dir_x`, sign of `dir_y`, q below or above 1).

use super::columns::column;
use oblate_samplers::Run;
use oblate_samplers::diagnostics::effective_number;
use oblate_samplers::rng::{Domain, below, stream};
use serde::{Deserialize, Serialize};

/// Task of the bootstrap's streams within [`Domain::Post`].
const BOOTSTRAP_TASK: u64 = 0x6d6f_6465;

/// Resamples behind each error.
const BOOTSTRAPS: u64 = 200;

/// One orientation mode.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Mode {
    /// Whether `dir_x >= 0`.
    pub dir_x_positive: bool,
    /// Whether `dir_y >= 0`.
    pub dir_y_positive: bool,
    /// Whether `q > 1`.
    pub prolate: bool,
}

/// The weight of a mode.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ModeWeight {
    /// Which mode.
    #[serde(flatten)]
    pub mode: Mode,
    /// Its posterior probability.
    #[serde(flatten)]
    pub probability: Probability,
}

/// The posterior probability of one of several exclusive cases, and its Monte-Carlo standard error: of Markov chains by the effective size
/// of the case's own draws; otherwise by bootstrap over clusters of dependent draws, or over the draws where they are independent.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Probability {
    /// Posterior probability.
    pub weight: f64,
    /// Its error. A run without draws of this case has an error of 0, which then says nothing about the true error.
    pub error: f64,
    /// Degrees of freedom of the error: the effective number of clusters, or of draws, minus one. Not stored, because it follows from the
    /// draws.
    #[serde(skip)]
    pub degrees_of_freedom: f64,
}

/// The eight modes in a fixed order, or `None` if the run lacks `dir_x`, `dir_y` or `q`.
#[must_use]
pub fn mode_weights(run: &Run) -> Option<Vec<ModeWeight>> {
    let modes = modes_of_draws(run)?;
    let weights = probabilities::<8>(run, &modes).into_iter().enumerate();
    Some(
        weights
            .map(|(index, probability)| ModeWeight {
                mode: Mode {
                    dir_x_positive: index & 1 != 0,
                    dir_y_positive: index & 2 != 0,
                    prolate: index & 4 != 0,
                },
                probability,
            })
            .collect(),
    )
}

/// The mode of each draw, as its index in [`mode_weights`]; `None` if the run lacks `dir_x`, `dir_y` or `q`.
#[must_use]
pub fn modes_of_draws(run: &Run) -> Option<Vec<usize>> {
    let (x, y, q) = (
        column(run, "dir_x").ok()?.values,
        column(run, "dir_y").ok()?.values,
        column(run, "q").ok()?.values,
    );
    let mode = |i: usize| {
        usize::from(x[i] >= 0.0) + 2 * usize::from(y[i] >= 0.0) + 4 * usize::from(q[i] > 1.0)
    };
    Some((0..q.len()).map(mode).collect())
}

/// The probability that q > 1, or `None` if the run lacks `q`.
#[must_use]
pub fn prolate_probability(run: &Run) -> Option<Probability> {
    let q = column(run, "q").ok()?.values;
    let sides: Vec<usize> = q.iter().map(|q| usize::from(*q > 1.0)).collect();
    Some(probabilities::<2>(run, &sides)[1])
}

/// The probabilities of labels below `N`, one label per draw.
fn probabilities<const N: usize>(run: &Run, labels: &[usize]) -> [Probability; N] {
    let weights = run.draws.weights();
    let clusters = run.draws.clusters();
    // Chain sets that are independent of each other; those of one cluster have its error in common.
    if clusters.len() > 1 && clusters == run.draws.chains() {
        let whole: [f64; N] = normalised(sums_of(labels, &weights, 0..labels.len()));
        return std::array::from_fn(|label| of_chains(run, labels, label, whole[label]));
    }
    // Clusters of dependent draws are resampled as a whole; independent draws one by one.
    let clusters: Vec<[f64; N]> = if clusters.len() > 1 {
        let sums = clusters.into_iter();
        sums.map(|own| sums_of(labels, &weights, own.into_iter()))
            .collect()
    } else {
        (0..labels.len())
            .map(|row| sums_of(labels, &weights, std::iter::once(row)))
            .collect()
    };
    let count = clusters.len();
    let degrees_of_freedom = effective_number(clusters.iter().map(|own| own.iter().sum())) - 1.0;
    let samples: Vec<[f64; N]> = (0..BOOTSTRAPS)
        .map(|b| {
            let mut rng = stream(run.seed, Domain::Post, BOOTSTRAP_TASK, b);
            let mut sums = [0.0; N];
            for _ in 0..count {
                let drawn = clusters[below(&mut rng, count)];
                sums.iter_mut().zip(drawn).for_each(|(s, d)| *s += d);
            }
            normalised(sums)
        })
        .collect();
    let whole: [f64; N] = normalised(sums_of(labels, &weights, 0..labels.len()));
    // The standard deviation of few clusters about their own mean is smaller than about the true value.
    let few = count as f64 / (count as f64 - 1.0).max(1.0);
    std::array::from_fn(|label| {
        let mean = samples.iter().map(|s| s[label]).sum::<f64>() / BOOTSTRAPS as f64;
        let squares = samples.iter().map(|s| (s[label] - mean).powi(2));
        let variance = few * squares.sum::<f64>() / (BOOTSTRAPS as f64 - 1.0);
        Probability {
            weight: whole[label],
            error: variance.sqrt(),
            degrees_of_freedom,
        }
    })
}

/// The probability of a label in independent Markov chains.
fn of_chains(run: &Run, labels: &[usize], label: usize, weight: f64) -> Probability {
    let has = |own: &usize| f64::from(u8::from(*own == label));
    let ess = run
        .draws
        .ess_of_mean(&labels.iter().map(has).collect::<Vec<f64>>());
    Probability {
        weight,
        error: (weight * (1.0 - weight) / ess).sqrt(),
        degrees_of_freedom: ess - 1.0,
    }
}

/// Summed weights of the labels of some rows.
fn sums_of<const N: usize>(
    labels: &[usize],
    weights: &[f64],
    rows: impl Iterator<Item = usize>,
) -> [f64; N] {
    let mut sums = [0.0; N];
    for row in rows {
        sums[labels[row]] += weights[row];
    }
    sums
}

fn normalised<const N: usize>(sums: [f64; N]) -> [f64; N] {
    let sum: f64 = sums.iter().sum();
    if sum > 0.0 {
        sums.map(|s| s / sum)
    } else {
        sums
    }
}
