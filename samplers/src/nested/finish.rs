//! From the points of a run to its result.

use super::evidence::History;
use super::gates::{self, Measured};
use super::live::{Points, REJECTED};
use super::state::{Job, State};
use crate::diagnostics::kish_ess;
use crate::error::Result;
use crate::output::{Cost, Draws, Ess, Evidence, Method, Path, Run, Status};
use crate::rng::STREAM_VERSION;
use std::collections::BTreeMap;

/// Builds the result. The live points count as dead in the order of their likelihoods.
pub(super) fn finish(
    job: &Job<'_>,
    state: &State,
    status: Status,
    mut warnings: Vec<String>,
) -> Result<Run> {
    let points = state.points();
    let history = History::of(&points);
    let weighted = history.weigh();
    let dim = points.dim();
    let theta = physical(job, &points);
    let lineages = job.lineages() as f64;
    // So few scatter a little less, weighted at random, about their own mean than about the truth.
    let freedom = ((lineages + 1.0) / (lineages - 1.0)).sqrt();
    let bootstraps = history.bootstrap(job.seed, job.settings.bootstraps, &theta, dim);
    let simulated = deviation(&history.simulate(job.seed, job.settings.simulations));
    let ln_z: Vec<f64> = bootstraps.iter().map(|b| b.0).collect();
    let bootstrapped = freedom * deviation(&ln_z);
    let empty = points.best() <= REJECTED;

    let draws = draws(job, &history, &weighted.ln_p, &theta)?;
    let bulk: Vec<f64> = (0..dim)
        .map(|k| {
            let column: Vec<f64> = history.order.iter().map(|&i| theta[i * dim + k]).collect();
            let mean: f64 = column.iter().zip(&weighted.p).map(|(x, p)| p * x).sum();
            let variance: f64 = column
                .iter()
                .zip(&weighted.p)
                .map(|(x, p)| p * (x - mean).powi(2))
                .sum();
            let means: Vec<f64> = bootstraps.iter().map(|b| b.1[k]).collect();
            (variance / (freedom * deviation(&means)).powi(2)).min(draws.len() as f64)
        })
        .map(|ess| {
            if ess.is_nan() {
                draws.len() as f64
            } else {
                ess
            }
        })
        .collect();
    let kish = kish_ess(&draws.ln_weight);
    let ess = Ess {
        kish,
        quoted: bulk.iter().copied().fold(kish, f64::min),
        bulk,
        ..Ess::default()
    };
    let evidence = if empty {
        Evidence {
            ln_z: f64::NEG_INFINITY,
            error: f64::INFINITY,
            ..Evidence::default()
        }
    } else {
        Evidence {
            ln_z: weighted.ln_z,
            error: simulated.max(bootstrapped),
            error_parts: named([("simulated", simulated), ("bootstrap", bootstrapped)]),
            estimates: named([("ln-of-mean-z", history.ln_of_mean_z())]),
            information: weighted.information,
        }
    };
    let gates = gates::judge(
        job,
        state,
        &Measured {
            simulated,
            bootstrapped,
            halves: history.halves(),
            kish,
        },
    );
    if state.tuning.steps > job.first_steps() {
        warnings.push(format!(
            "steps per new point were raised from {} to {} because new points resembled their seeds; start the next run with `steps = {}`",
            job.first_steps(),
            state.tuning.steps,
            state.tuning.steps
        ));
    }
    let prior = job.target.prior();
    Ok(Run {
        method: Method::Nested,
        status,
        seed: job.seed,
        stream_version: STREAM_VERSION,
        names: prior.names().to_vec(),
        units: prior.units().to_vec(),
        derived_names: job.target.derived_names(),
        draws,
        evidence,
        ess,
        cost: Cost {
            calls: state.calls,
            gradients: 0,
            cpu_seconds: state.cpu_seconds,
            wall_seconds: state.wall_seconds,
            rejected: state.rejected.clone(),
        },
        path: path(&history, state),
        gates,
        warnings,
    })
}

fn named<const N: usize>(pairs: [(&str, f64); N]) -> BTreeMap<String, f64> {
    pairs.map(|(name, value)| (name.to_owned(), value)).into()
}

/// Physical parameters of all points, row-major.
fn physical(job: &Job<'_>, points: &Points) -> Vec<f64> {
    let dim = points.dim();
    let mut theta = vec![0.0; dim * points.len()];
    for (i, row) in theta.chunks_exact_mut(dim).enumerate() {
        job.target.prior().theta_from_u(points.row(i), row);
    }
    theta
}

/// Draws in order of death, without the rejected ones, which have no likelihood and no weight.
fn draws(job: &Job<'_>, history: &History, ln_p: &[f64], theta: &[f64]) -> Result<Draws> {
    let dim = job.target.dim();
    let mut draws = Draws::of(job.target);
    for (death, &row) in history.order.iter().enumerate() {
        let ln_l = history.ln_l[death];
        if ln_l > REJECTED {
            let theta = &theta[row * dim..(row + 1) * dim];
            draws.push(job.target, theta, ln_l, ln_p[death], history.lineage[death])?;
        }
    }
    Ok(draws)
}

fn path(history: &History, state: &State) -> Path {
    let shown = |l: &f64| {
        if *l <= REJECTED {
            f64::NEG_INFINITY
        } else {
            *l
        }
    };
    let mut sum = 0.0;
    Path::Nested {
        ln_x: history
            .expected_ln_t()
            .iter()
            .map(|t| {
                sum += t;
                sum
            })
            .collect(),
        ln_likelihood: history.ln_l.iter().map(shown).collect(),
        ln_likelihood_birth: history.birth.clone(),
        live: history.live.clone(),
        insertion_rank: state.ranks.fractions(),
    }
}

/// Standard deviation about the mean.
pub(super) fn deviation(values: &[f64]) -> f64 {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let sum: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
    (sum / (count - 1.0)).sqrt()
}
