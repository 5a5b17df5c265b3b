//! How often do rules of stopping end a tempered run that has not seen a mode?
//!
//! `cargo bench -p oblate-samplers --bench stopping` simulates the states at the posterior of four chain sets: a normal distribution, and
//! with the weight 0.05 another one six standard deviations away, which a state leaves after 100 or 600 scans on average. A unit are 4,096
//! scans, of which there are at most 16. At each look the checks of draws are made as in a run (R-hat, effective sizes, agreement of modes); the run
//! ends at the first look that passes. Printed are the fraction of runs that pass, of those the fraction whose weight of the mode is wrong
//! by more than a factor of two, the mean of that weight, and the mean number of units. The recorded table is in docs/validation.md.

use oblate_samplers::diagnostics::{bulk_ess, mode_agreement, r_hat, tail_ess};
use oblate_samplers::rng::{Domain, RandomStream, standard_normal, stream, unit_open};
use rayon::prelude::*;
use std::ops::Range;

const RUNS: u64 = 120;
const CHAIN_SETS: usize = 4;
const UNIT: usize = 4_096;
const UNITS: usize = 16;
const WEIGHT: f64 = 0.05;
const DISTANCE: f64 = 6.0;

/// The states of one chain set: whether each is in the mode, and its coordinate.
struct States {
    in_mode: Vec<bool>,
    x: Vec<f64>,
}

fn states(rng: &mut RandomStream, stay: f64) -> States {
    let mut states = States {
        in_mode: Vec::with_capacity(UNIT * UNITS),
        x: Vec::with_capacity(UNIT * UNITS),
    };
    let mut now = unit_open(rng) < WEIGHT;
    for _ in 0..UNIT * UNITS {
        let leave = if now {
            1.0 / stay
        } else {
            WEIGHT / (1.0 - WEIGHT) / stay
        };
        if unit_open(rng) < leave {
            now = !now;
        }
        states.in_mode.push(now);
        let centre = if now { DISTANCE } else { 0.0 };
        states.x.push(centre + standard_normal(rng));
    }
    states
}

/// Whether the draws of some units pass the checks.
fn passes(chain_sets: &[States], units: Range<usize>) -> bool {
    let range = units.start * UNIT..units.end * UNIT;
    let chains: Vec<&[f64]> = chain_sets.iter().map(|c| &c.x[range.clone()]).collect();
    let squares: Vec<Vec<f64>> = chains
        .iter()
        .map(|chain| chain.iter().map(|x| x * x).collect())
        .collect();
    let squares: Vec<&[f64]> = squares.iter().map(Vec::as_slice).collect();
    let labels: Vec<&[bool]> = chain_sets
        .iter()
        .map(|c| &c.in_mode[range.clone()])
        .collect();
    r_hat(&chains).max(r_hat(&squares)) <= 1.01
        && bulk_ess(&chains) >= 400.0
        && tail_ess(&chains) >= 400.0
        && mode_agreement(&labels, &chains) >= 0.01
}

/// A rule: the units of the result of a run, which ends with the last of them; none if it never passes.
type Rule = fn(&[States]) -> Option<Range<usize>>;

/// A look after every unit, at the later half of them.
fn sliding(c: &[States]) -> Option<Range<usize>> {
    (1..=UNITS).find(|n| passes(c, n / 2..*n)).map(|n| n / 2..n)
}

/// The same; a pass is confirmed by as many new units, which must pass too.
fn sliding_confirmed(c: &[States]) -> Option<Range<usize>> {
    let mut n = 1;
    while n <= UNITS {
        let new = n..2 * n - n / 2;
        if passes(c, n / 2..n) {
            if new.end <= UNITS && passes(c, new.clone()) {
                return Some(n / 2..new.end);
            }
            n = new.end;
        } else {
            n += 1;
        }
    }
    None
}

/// Looks at 1, 2, 4, 8 and 16 units, each at those since the last one.
fn doubling(c: &[States]) -> Option<Range<usize>> {
    [1, 2, 4, 8, 16]
        .into_iter()
        .find(|n| passes(c, n / 2..*n))
        .map(|n| n / 2..n)
}

/// The same, with two looks in succession that pass.
fn confirmed(c: &[States]) -> Option<Range<usize>> {
    [1, 2, 4, 8]
        .into_iter()
        .find(|n| passes(c, n / 2..*n) && passes(c, *n..2 * n))
        .map(|n| n / 2..2 * n)
}

fn main() {
    println!(
        "| stay | rule | pass | of these wrong | mean weight | mean units |\n|---|---|---|---|---|---|"
    );
    let rules: [(&str, Rule); 4] = [
        ("sliding", sliding),
        ("sliding, confirmed", sliding_confirmed),
        ("doubling", doubling),
        ("doubling, confirmed", confirmed),
    ];
    for stay in [100.0, 600.0] {
        let ended: Vec<Vec<Option<(f64, usize)>>> = (0..RUNS)
            .into_par_iter()
            .map(|run| {
                let chain_sets: Vec<States> = (0..CHAIN_SETS as u64)
                    .map(|k| states(&mut stream(1, Domain::Test, run, k), stay))
                    .collect();
                let of = |rule: Rule| {
                    let units = rule(&chain_sets)?;
                    let range = units.start * UNIT..units.end * UNIT;
                    let count =
                        |c: &States| c.in_mode[range.clone()].iter().filter(|m| **m).count();
                    let inside: usize = chain_sets.iter().map(count).sum();
                    Some((inside as f64 / (range.len() * CHAIN_SETS) as f64, units.end))
                };
                rules.iter().map(|(_, rule)| of(*rule)).collect()
            })
            .collect();
        for (k, (name, _)) in rules.iter().enumerate() {
            let passed: Vec<(f64, usize)> = ended.iter().filter_map(|run| run[k]).collect();
            let count = passed.len().max(1) as f64;
            let wrong = passed
                .iter()
                .filter(|(w, _)| *w > 2.0 * WEIGHT || *w < 0.5 * WEIGHT)
                .count();
            println!(
                "| {stay} | {name} | {:.2} | {:.2} | {:.4} | {:.1} |",
                passed.len() as f64 / RUNS as f64,
                wrong as f64 / count,
                passed.iter().map(|(w, _)| w).sum::<f64>() / count,
                passed.iter().map(|(_, n)| *n as f64).sum::<f64>() / count
            );
        }
    }
}
