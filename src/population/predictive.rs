//! Posterior predictive checks: whether the streams' q look like draws of their population.

use super::cells::Cells;
use super::family::Family;
use super::kept_cells::KeptCells;
use super::target::{PopulationTarget, equal_weight_members};
use crate::posterior::{Interval, PredictiveQuantity};
use oblate_samplers::output::{Check, Draws};
use oblate_samplers::rng::{Domain, RandomStream, stream, unit_open};
use rayon::prelude::*;

/// Draws of the hyperparameters, each with one q of every stream and one replicated population: a p-value of 0.01 has an error of 0.003.
const REPLICATIONS: usize = 2_000;

/// Substream within [`Domain::Post`]; the index is the number of the draw.
const TASK: u64 = 0x7072_6564;

/// Smallest p-value.
const MIN_P_VALUE: f64 = 0.01;

/// What is compared.
const QUANTITIES: [&str; 4] = ["minimum", "maximum", "standard deviation", "largest gap"];

/// The quantities of a set of q.
fn quantities(mut q: Vec<f64>) -> [f64; 4] {
    q.sort_by(f64::total_cmp);
    let n = q.len() as f64;
    let mean = q.iter().sum::<f64>() / n;
    let variance = q.iter().map(|q| (q - mean).powi(2)).sum::<f64>() / n;
    let gaps = q.windows(2).map(|pair| pair[1] - pair[0]);
    [
        q.first().copied().unwrap_or(f64::NAN),
        q.last().copied().unwrap_or(f64::NAN),
        variance.sqrt(),
        gaps.fold(0.0, f64::max),
    ]
}

/// The quantities of the streams' q given the population, and of as many q drawn from it.
pub(super) fn predictive<F: Family<N>, const N: usize>(
    target: &PopulationTarget<F, N>,
    draws: &Draws,
    seed: u64,
) -> Vec<PredictiveQuantity> {
    let members: Vec<[f64; N]> = equal_weight_members(draws, REPLICATIONS);
    let cells = Cells::new(target.family().support());
    let pairs: Vec<[[f64; 4]; 2]> = members
        .into_par_iter()
        .enumerate()
        .map(|(index, member)| {
            let mut rng = stream(seed, Domain::Post, TASK, index as u64);
            let streams = q_of_streams(target, member, &mut rng);
            let replicated = replicated(target, &cells, member, &mut rng);
            [quantities(streams), quantities(replicated)]
        })
        .collect();
    let equal = vec![1.0; pairs.len()];
    QUANTITIES
        .iter()
        .enumerate()
        .map(|(k, name)| {
            let of = |which: usize| -> Vec<f64> { pairs.iter().map(|p| p[which][k]).collect() };
            let (streams, replicated) = (of(0), of(1));
            let count = |wanted: fn(&f64, &f64) -> bool| {
                let both = replicated.iter().zip(&streams);
                both.filter(|(r, s)| wanted(r, s)).count() as f64
            };
            let tail = count(f64::le).min(count(f64::ge));
            PredictiveQuantity {
                name: (*name).to_owned(),
                streams: Interval::new(&streams, &equal, ""),
                population: Interval::new(&replicated, &equal, ""),
                p_value: (2.0 * tail / pairs.len() as f64).min(1.0),
            }
        })
        .collect()
}

/// One q of every stream, given a member of the family.
fn q_of_streams<F: Family<N>, const N: usize>(
    target: &PopulationTarget<F, N>,
    member: [f64; N],
    rng: &mut RandomStream,
) -> Vec<f64> {
    let ln_pdf = target.family().ln_pdf(member);
    let draw = |stream: &super::target::WeightedStream, rng: &mut RandomStream| {
        let draws = stream.q.iter().zip(&stream.ln_factor);
        let terms: Vec<f64> = draws.map(|(q, w)| w + ln_pdf(*q)).collect();
        let cumulative = cumulative(&terms);
        let aim = unit_open(rng) * cumulative.last().copied().unwrap_or(f64::NAN);
        let row = cumulative.partition_point(|sum| *sum < aim);
        stream.q[row.min(stream.q.len() - 1)]
    };
    let streams = target.weighted_streams();
    streams.iter().map(|stream| draw(stream, rng)).collect()
}

/// As many q as streams, drawn from a member of the family as far as it is kept.
fn replicated<F: Family<N>, const N: usize>(
    target: &PopulationTarget<F, N>,
    cells: &Cells,
    member: [f64; N],
    rng: &mut RandomStream,
) -> Vec<f64> {
    let ln_pdf = target.family().ln_pdf(member);
    let selection = target.kept_cells().map(KeptCells::selection);
    let ln_kept = |q: f64| selection.map_or(0.0, |selection| selection.at(q).ln());
    let terms: Vec<f64> = cells
        .iter()
        .map(|(q, ln_width)| ln_pdf(q) + ln_width + ln_kept(q))
        .collect();
    let cumulative = cumulative(&terms);
    (0..target.streams())
        .map(|_| cells.quantile(&cumulative, unit_open(rng)))
        .collect()
}

/// Sums of the exponentials up to each term, relative to the largest.
fn cumulative(terms: &[f64]) -> Vec<f64> {
    let top = terms.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let mut sum = 0.0;
    terms
        .iter()
        .map(|term| {
            sum += (term - top).exp();
            sum
        })
        .collect()
}

/// The check of the quantity that differs most.
#[must_use]
pub fn predictive_check(quantities: &[PredictiveQuantity]) -> Check {
    let worst = quantities
        .iter()
        .min_by(|a, b| a.p_value.total_cmp(&b.p_value));
    let (p_value, found) = worst.map_or((f64::NAN, String::new()), |worst| {
        let (streams, population) = (&worst.streams, &worst.population);
        let found = format!(
            ", that of the {}: {:.3} in the streams, {:.3} to {:.3} (95 %) in populations of this family",
            worst.name, streams.median, population.lo95, population.hi95
        );
        (worst.p_value, found)
    });
    Check::at_least(
        "predictive-p-value",
        p_value,
        MIN_P_VALUE,
        format!(
            "smallest p-value of the posterior predictive check{found}; choose another family, or look for a stream that does not belong"
        ),
    )
}
