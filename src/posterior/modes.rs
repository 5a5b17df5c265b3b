//! Weights of the orientation modes: the eight cells of (sign of `dir_x`, sign of `dir_y`, q below or above 1).

use super::column;
use oblate_samplers::Run;
use oblate_samplers::diagnostics::effective_number;
use oblate_samplers::rng::{Domain, below, stream};
use serde::{Deserialize, Serialize};

/// Task of the bootstrap's streams within [`Domain::Post`].
const BOOTSTRAP_TASK: u64 = 0x6d6f_6465;

/// Resamples behind each error.
const BOOTSTRAPS: u64 = 200;

/// One cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Mode {
    /// Whether `dir_x >= 0`.
    pub dir_x_positive: bool,
    /// Whether `dir_y >= 0`.
    pub dir_y_positive: bool,
    /// Whether `q > 1`.
    pub prolate: bool,
}

/// The weight of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ModeWeight {
    /// Which cell.
    #[serde(flatten)]
    pub mode: Mode,
    /// Its posterior probability.
    #[serde(flatten)]
    pub share: Share,
}

/// The probability of one of several exclusive things, and its Monte-Carlo standard error: by bootstrap over populations or lineages, or
/// over the draws where they are independent.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Share {
    /// Posterior probability.
    pub weight: f64,
    /// Its error. A run that never saw the thing cannot know about it: 0 is then no bound.
    pub error: f64,
    /// Degrees of freedom of the error: populations, lineages or draws, in effect, less one. Files do without: draws tell it.
    #[serde(skip)]
    pub freedom: f64,
}

/// The eight cells in a fixed order, or `None` if the run lacks `dir_x`, `dir_y` or `q`.
#[must_use]
pub fn mode_weights(run: &Run) -> Option<Vec<ModeWeight>> {
    let (x, y, q) = (
        column(run, "dir_x").ok()?.values,
        column(run, "dir_y").ok()?.values,
        column(run, "q").ok()?.values,
    );
    let cells: Vec<usize> = (0..q.len())
        .map(|i| {
            usize::from(x[i] >= 0.0) + 2 * usize::from(y[i] >= 0.0) + 4 * usize::from(q[i] > 1.0)
        })
        .collect();
    let weights = shares::<8>(run, &cells).into_iter().enumerate();
    Some(
        weights
            .map(|(cell, share)| ModeWeight {
                mode: Mode {
                    dir_x_positive: cell & 1 != 0,
                    dir_y_positive: cell & 2 != 0,
                    prolate: cell & 4 != 0,
                },
                share,
            })
            .collect(),
    )
}

/// The probability that q > 1, or `None` if the run lacks `q`.
#[must_use]
pub fn prolate_share(run: &Run) -> Option<Share> {
    let q = column(run, "q").ok()?.values;
    let sides: Vec<usize> = q.iter().map(|q| usize::from(*q > 1.0)).collect();
    Some(shares::<2>(run, &sides)[1])
}

/// The shares of labels below `N`, one label per draw.
fn shares<const N: usize>(run: &Run, labels: &[usize]) -> [Share; N] {
    let weights = run.draws.weights();
    let groups = run.draws.clusters();
    // Groups of dependent draws are drawn whole; where there are none, rows.
    let groups: Vec<[f64; N]> = if groups.len() > 1 {
        let sums = groups.into_iter();
        sums.map(|own| sums_of(labels, &weights, own.into_iter()))
            .collect()
    } else {
        (0..labels.len())
            .map(|row| sums_of(labels, &weights, std::iter::once(row)))
            .collect()
    };
    let count = groups.len();
    let freedom = effective_number(groups.iter().map(|own| own.iter().sum())) - 1.0;
    let samples: Vec<[f64; N]> = (0..BOOTSTRAPS)
        .map(|b| {
            let mut rng = stream(run.seed, Domain::Post, BOOTSTRAP_TASK, b);
            let mut sums = [0.0; N];
            for _ in 0..count {
                let drawn = groups[below(&mut rng, count)];
                sums.iter_mut().zip(drawn).for_each(|(s, d)| *s += d);
            }
            normalised(sums)
        })
        .collect();
    let whole: [f64; N] = normalised(sums_of(labels, &weights, 0..labels.len()));
    // Few groups scatter a little less about their own mean than about the truth.
    let few = count as f64 / (count as f64 - 1.0).max(1.0);
    std::array::from_fn(|label| {
        let mean = samples.iter().map(|s| s[label]).sum::<f64>() / BOOTSTRAPS as f64;
        let squares = samples.iter().map(|s| (s[label] - mean).powi(2));
        let variance = few * squares.sum::<f64>() / (BOOTSTRAPS as f64 - 1.0);
        Share {
            weight: whole[label],
            error: variance.sqrt(),
            freedom,
        }
    })
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
