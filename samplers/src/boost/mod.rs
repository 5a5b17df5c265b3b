//! More effective draws from a run that has ended: importance sampling from a mixture fitted to its draws.
//!
//! Half of the run's draws fit mixtures of Student distributions in standard-normal coordinates, the other half choose among
//! them, all of them fit the chosen one again; then it is frozen. Its draws, a share of them from the prior, are weighted by
//! posterior over mixture: independent draws, and an evidence of their own. On smooth posteriors one or two calls make an
//! effective draw; on thin or rough ones the mixture misses what matters, and the gates say so: the tail index of the
//! weights (Vehtari et al. 2024), agreement with the parent run on ln Z and on the share of every component.

mod outcome;
mod settings;

pub use settings::Settings;

use crate::control::{Control, Event};
use crate::diagnostics::{kish_ess, ln_sum_exp};
use crate::error::{Error, Result};
use crate::hmc::Evaluator;
use crate::mixture::{Mixture, Rows};
use crate::normal;
use crate::output::{Run, Status};
use crate::rng::{Domain, standard_normal, stream, unit_open};
use crate::target::Target;
use cpu_time::ProcessTime;
use std::time::Instant;

/// Draws that are made between two looks at budget and interrupt.
const BLOCK: usize = 1024;

/// Most draws of a half that fit the mixture.
const MOST_TRAINING: usize = 5_000;

/// Tasks of the streams within [`Domain::Boost`]; draws of the mixture are task 0.
const RESAMPLING: u64 = 1;
const CENTRES: u64 = 2;

/// A point with its weight.
struct Weighted {
    z: Vec<f64>,
    ln_l: f64,
    /// `ln (prior L / proposal)`.
    ln_weight: f64,
}

/// Draws `settings.draws` points of a mixture fitted to `parent`, a run on the same `target`, and returns them weighted.
///
/// The same parent, settings and seed give the same bits on any number of threads. It takes one call per draw; there are no
/// checkpoints. A boost that was interrupted or whose budget is spent returns the draws that it has, unconverged.
///
/// # Errors
/// [`Error::Setting`] for settings out of range; [`Error::Mismatch`] if `parent` is not a run on this target, has too few
/// draws for a mixture, or the prior has walls, whose mass is not known; [`Error::Fatal`] and [`Error::Infinite`] from the
/// target.
pub fn run(
    target: &dyn Target,
    parent: &Run,
    settings: &Settings,
    seed: u64,
    control: &mut Control<'_>,
) -> Result<Run> {
    settings.check()?;
    belongs(target, parent)?;
    let (wall, cpu) = (Instant::now(), ProcessTime::now());
    let mut stop = control.tell(&Event::Started { dim: target.dim() });
    let mixture = fit(target, parent, settings, seed)?;
    let mut evaluator = Evaluator::new(target);
    let mut points = Vec::new();
    let mut made = 0;
    let status =
        loop {
            if made >= settings.draws {
                break Status::Complete;
            }
            if stop || control.interrupted() {
                break Status::Interrupted;
            }
            if control.spent(made as u64) {
                break Status::BudgetSpent;
            }
            let end = settings.draws.min(made + BLOCK);
            let places: Vec<Vec<f64>> = (made..end)
                .map(|i| propose(&mixture, settings, target.dim(), seed, i as u64))
                .collect();
            let views: Vec<&[f64]> = places.iter().map(Vec::as_slice).collect();
            let ln_l = evaluator.values(&views)?;
            let weighted = places.into_iter().zip(ln_l);
            points.extend(weighted.filter(|(_, ln_l)| *ln_l > f64::NEG_INFINITY).map(
                |(z, ln_l)| {
                    let ln_prior: f64 = z.iter().map(|z| normal::ln_pdf(*z)).sum();
                    let ln_proposal = ln_sum_exp(&[
                        settings.prior_share.ln() + ln_prior,
                        (-settings.prior_share).ln_1p() + mixture.ln_density(&z),
                    ]);
                    Weighted {
                        ln_weight: ln_l + ln_prior - ln_proposal,
                        z,
                        ln_l,
                    }
                },
            ));
            made = end;
            let ln_weight: Vec<f64> = points.iter().map(|p| p.ln_weight).collect();
            let sum = ln_sum_exp(&ln_weight);
            let normalised: Vec<f64> = ln_weight.iter().map(|w| w - sum).collect();
            stop = control.tell(&Event::Boost {
                draws: made,
                ln_z: sum - (made as f64).ln(),
                ess: kish_ess(&normalised),
            });
        };
    let boosted = outcome::Boosted {
        target,
        parent,
        mixture: &mixture,
        made,
        points,
        evaluator,
        seed,
        status,
        cpu_seconds: cpu.elapsed().as_secs_f64(),
        wall_seconds: wall.elapsed().as_secs_f64(),
    };
    let run = boosted.assemble()?;
    control.tell(&Event::Finished);
    Ok(run)
}

/// Whether the parent is a run on this target, whose prior a mixture can be compared with.
fn belongs(target: &dyn Target, parent: &Run) -> Result<()> {
    const WHAT: &str = "the run to boost";
    if !target.walls().is_empty() {
        return Err(Error::Mismatch {
            what: WHAT,
            why: "its prior has walls, whose mass is not known; use the run as it is".to_owned(),
        });
    }
    parent.check_belongs(target, WHAT)
}

/// The mixture: its size chosen by the half of the parent's draws that did not fit it.
fn fit(target: &dyn Target, parent: &Run, settings: &Settings, seed: u64) -> Result<Mixture> {
    let [first, second] = halves(target, parent, seed);
    let few = first.len().min(second.len());
    let refuse = || Error::Mismatch {
        what: "the run to boost",
        why: format!(
            "half of it has {few} effective draws, too few for a mixture in {} dimensions; let it go on, with `target_ess` or more rounds",
            target.dim()
        ),
    };
    let rng = |count: usize| stream(seed, Domain::Boost, CENTRES, count as u64);
    Mixture::choose([&first, &second], settings.max_components, rng).ok_or_else(refuse)
}

/// Two halves of a run's draws, equally weighted, in standard-normal coordinates: even and odd groups, or rows where there are
/// none.
fn halves(target: &dyn Target, parent: &Run, seed: u64) -> [Rows; 2] {
    let draws = &parent.draws;
    let grouped = draws.group.iter().any(|g| *g != draws.group[0]);
    [0, 1].map(|half| {
        let mut part = draws.clone();
        for row in 0..draws.len() {
            let number = if grouped {
                draws.group[row] as usize
            } else {
                row
            };
            if number % 2 != half {
                part.ln_weight[row] = f64::NEG_INFINITY;
            }
        }
        let sum = ln_sum_exp(&part.ln_weight);
        part.ln_weight.iter_mut().for_each(|w| *w -= sum);
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "an effective size lies between 0 and the number of rows"
        )]
        let count = (kish_ess(&part.ln_weight) as usize).min(MOST_TRAINING);
        let offset = unit_open(&mut stream(seed, Domain::Boost, RESAMPLING, half as u64));
        let mut rows = Rows {
            dim: draws.dim,
            values: Vec::new(),
        };
        for row in part.resample(count, offset) {
            rows.values
                .extend(normals(target, draws.theta_row(row)).into_iter().flatten());
        }
        rows
    })
}

/// A draw in standard-normal coordinates; none where rounding has put it on the wall of a bounded prior.
fn normals(target: &dyn Target, theta: &[f64]) -> Option<Vec<f64>> {
    let mut z = vec![0.0; theta.len()];
    target.prior().z_from_theta(theta, &mut z);
    z.iter().all(|z| z.is_finite()).then_some(z)
}

/// Draw number `index` of the proposal.
fn propose(mixture: &Mixture, settings: &Settings, dim: usize, seed: u64, index: u64) -> Vec<f64> {
    let mut rng = stream(seed, Domain::Boost, 0, index);
    if unit_open(&mut rng) < settings.prior_share {
        (0..dim).map(|_| standard_normal(&mut rng)).collect()
    } else {
        mixture.draw(&mut rng)
    }
}
