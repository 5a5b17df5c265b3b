//! A nested run between two batches: everything that a checkpoint holds, and the step from one batch to the next.

use super::bound::Bound;
use super::kernel::{self, Newborn, Setting};
use super::likelihood::Likelihood;
use super::live::{self, Batch, Points, REJECTED};
use super::rank::Ranks;
use super::settings::{Kernel, Settings};
use super::tuning::Tuning;
use crate::error::{Error, Result};
use crate::rng::{Domain, Stream, below, stream};
use crate::target::Target;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Prior draws without a likelihood after which a run gives up.
const MAX_FIRST_DRAWS: usize = 100_000;

/// Prior volume from which on bounds are used; plain draws of the prior above it cost less than any chain.
const FIRST_BOUND: f64 = 0.1;

/// Shrinkage of the volume after which the bound is fitted again.
const REFIT: f64 = 1.5;

/// What a run is about; never changes.
#[derive(Clone, Copy)]
pub(super) struct Job<'a> {
    pub target: &'a dyn Target,
    pub settings: &'a Settings,
    pub seed: u64,
}

impl Job<'_> {
    pub fn kernel(&self) -> Kernel {
        self.settings.kernel.resolve(self.target.dim())
    }

    pub fn first_steps(&self) -> usize {
        let default = self.settings.kernel.default_steps(self.target.dim());
        self.settings.steps.unwrap_or(default)
    }
}

/// The run so far.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct State {
    pub live: Points,
    pub dead: Points,
    /// Whether the first draws are complete.
    started: bool,
    pub iteration: u64,
    next_point: u64,
    /// Expected log prior volume of the live points.
    pub ln_x: f64,
    /// Evidence and information of the dead, by left Riemann sums: for the stopping rule and for observers.
    pub ln_z: f64,
    pub information: f64,
    /// None, one to draw from, or two metrics: see [`Setting::bounds`].
    bounds: Vec<Bound>,
    ln_x_at_fit: f64,
    /// Points per call in the first batch after the fit, once known.
    efficiency_at_fit: Option<f64>,
    /// Points per call in the last batch.
    pub efficiency: f64,
    pub tuning: Tuning,
    pub ranks: Ranks,
    pub calls: u64,
    pub rejected: BTreeMap<String, u64>,
    /// Points drawn with a bound, and their calls.
    pub bounded_points: u64,
    pub bounded_calls: u64,
    pub cpu_seconds: f64,
    pub wall_seconds: f64,
}

impl State {
    pub fn new(job: &Job<'_>) -> Self {
        let dim = job.target.dim();
        Self {
            live: Points::new(dim),
            dead: Points::new(dim),
            started: false,
            iteration: 0,
            next_point: 0,
            ln_x: 0.0,
            ln_z: f64::NEG_INFINITY,
            information: 0.0,
            bounds: Vec::new(),
            ln_x_at_fit: 0.0,
            efficiency_at_fit: None,
            efficiency: 1.0,
            tuning: Tuning::new(job.first_steps()),
            ranks: Ranks::default(),
            calls: 0,
            rejected: BTreeMap::new(),
            bounded_points: 0,
            bounded_calls: 0,
            cpu_seconds: 0.0,
            wall_seconds: 0.0,
        }
    }

    /// How much the live points could still raise ln Z; 0 on a final plateau, whose volume the deaths already share.
    pub fn remaining(&self, settings: &Settings) -> f64 {
        let best = self.live.best();
        if !self.started || best <= REJECTED {
            return f64::INFINITY;
        }
        // The next batch would take everyone.
        let lower = self.live.ln_l.iter().filter(|l| **l < best).count();
        if lower < settings.batch_size() {
            return 0.0;
        }
        (best + self.ln_x - self.ln_z).exp().ln_1p()
    }

    /// One batch: the lowest points die, as many are born. On an error nothing has changed.
    pub fn advance(&mut self, job: &Job<'_>) -> Result<()> {
        if !self.started {
            return self.draw_first(job);
        }
        let batch = live::lowest(&self.live, job.settings.batch_size());
        let kept = self.live.select(&batch.kept);
        let ln_x = self.ln_x_after(&batch);
        let refitted = self.refit_if_due(job, &kept, ln_x);
        let bounds = refitted.as_ref().unwrap_or(&self.bounds);
        let mut tuning = self.tuning.clone();
        if let Some(new) = &refitted {
            tuning.keep_step_length(&self.bounds, new, &kept);
        }
        let mut rng = stream(job.seed, Domain::NestedSeeds, 0, self.iteration);
        let births = job.settings.n_live.saturating_sub(kept.len());
        let seeds = choose_seeds(&mut rng, kept.len(), births);
        let halves = if job.kernel() == Kernel::Differential && !bounds.is_empty() {
            kernel::halves(job.target, &kept)
        } else {
            Default::default()
        };
        let setting = Setting {
            target: job.target,
            contour: batch.contour,
            kernel: job.kernel(),
            bounds,
            halves: &halves,
            scale: tuning.scale,
            stride: tuning.stride,
            steps: tuning.steps,
        };
        let first = self.next_point;
        let born: Vec<Result<Newborn>> = seeds
            .par_iter()
            .enumerate()
            .map(|(i, &s)| {
                let rng = stream(job.seed, Domain::NestedPoint, 0, first + i as u64);
                kernel::draw(&setting, &kept, s, rng)
            })
            .collect();
        let born: Vec<Newborn> = born.into_iter().collect::<Result<_>>()?;
        if setting.kernel != Kernel::Uniform && !bounds.is_empty() && !born.is_empty() {
            tuning.learn(setting.kernel, bounds, &kept, &seeds, &born, &mut rng);
        }
        self.tuning = tuning;
        if let Some(bounds) = refitted {
            self.bounds = bounds;
            self.ln_x_at_fit = ln_x;
            self.efficiency_at_fit = None;
        }
        self.count(&born);
        self.commit(&batch, &born, &mut rng);
        // Steps that the user chose stay.
        if job.settings.steps.is_none() {
            let window = 5 * job.settings.n_live;
            self.tuning
                .watch(&self.ranks, window, 10 * job.first_steps());
        }
        Ok(())
    }

    /// One block of independent prior draws, until a batch of them has a likelihood.
    fn draw_first(&mut self, job: &Job<'_>) -> Result<()> {
        let count = job.settings.n_live;
        let mut likelihood = Likelihood::new(job.target);
        let mut points = vec![vec![0.0; job.target.dim()]; count];
        for (j, u) in (self.next_point..).zip(&mut points) {
            likelihood.draw_prior(&mut stream(job.seed, Domain::NestedPoint, 0, j), u)?;
        }
        let ln_l = likelihood.at_all(&points)?;
        for (u, ln_l) in points.iter().zip(ln_l) {
            let thread = u32::try_from(self.live.len()).unwrap_or(u32::MAX);
            self.live.push(u, ln_l, f64::NEG_INFINITY, thread);
        }
        self.calls += likelihood.tally.calls;
        likelihood.tally.add_to(&mut self.rejected);
        self.next_point += count as u64;
        let tries = self.live.len();
        let valid = self.live.ln_l.iter().filter(|l| **l > REJECTED).count();
        if valid == 0 && tries >= MAX_FIRST_DRAWS {
            let cause = self.rejected.iter().max_by_key(|(_, count)| **count);
            return Err(Error::NoStart {
                tries,
                cause: cause.map_or_else(String::new, |(cause, _)| cause.clone()),
            });
        }
        self.started = valid >= job.settings.batch_size() || tries >= MAX_FIRST_DRAWS;
        Ok(())
    }

    fn ln_x_after(&self, batch: &Batch) -> f64 {
        let alive = self.live.len();
        let fall: f64 = (0..batch.dying.len())
            .map(|i| 1.0 / (alive - i) as f64)
            .sum();
        self.ln_x - fall
    }

    /// New bounds around the survivors if they are due. `None`: keep the old ones, or go on with the prior.
    fn refit_if_due(&self, job: &Job<'_>, kept: &Points, ln_x: f64) -> Option<Vec<Bound>> {
        let kind = job.settings.bound;
        let due = if self.bounds.is_empty() {
            ln_x < FIRST_BOUND.ln()
        } else {
            ln_x < self.ln_x_at_fit - REFIT.ln()
                || self
                    .efficiency_at_fit
                    .is_some_and(|at_fit| self.efficiency < 0.5 * at_fit)
        };
        if !due {
            None
        } else if job.kernel() == Kernel::Uniform {
            Some(vec![Bound::for_draws(
                kept,
                kind,
                job.seed,
                self.iteration,
            )?])
        } else {
            Some(Bound::for_steps(kept, kind))
        }
    }

    fn count(&mut self, born: &[Newborn]) {
        let calls: u64 = born.iter().map(|b| b.tally.calls).sum();
        self.calls += calls;
        for b in born {
            b.tally.add_to(&mut self.rejected);
        }
        if calls > 0 {
            self.efficiency = born.len() as f64 / calls as f64;
        }
        if !self.bounds.is_empty() {
            self.efficiency_at_fit.get_or_insert(self.efficiency);
            self.bounded_points += born.len() as u64;
            self.bounded_calls += calls;
        }
    }

    /// Buries the dying, in order, and puts the newborn in their places.
    fn commit(&mut self, batch: &Batch, born: &[Newborn], rng: &mut Stream) {
        for (i, &row) in batch.dying.iter().enumerate() {
            let n = (self.live.len() - i) as f64;
            self.add_evidence(self.live.ln_l[row], n);
            self.dead.push_from(&self.live, row);
        }
        let mut sorted: Vec<f64> = batch.kept.iter().map(|&i| self.live.ln_l[i]).collect();
        sorted.sort_by(f64::total_cmp);
        for b in born {
            let below_it = sorted.partition_point(|l| *l < b.ln_l);
            let ties = sorted.partition_point(|l| *l <= b.ln_l) - below_it;
            let rank = below_it + below(rng, ties + 1);
            let narrow = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
            self.ranks.push(narrow(rank), narrow(sorted.len()));
            sorted.insert(rank, b.ln_l);
        }
        for (&row, b) in batch.dying.iter().zip(born) {
            self.live.replace(row, &b.u, b.ln_l, batch.contour);
        }
        if born.len() < batch.dying.len() {
            let mut gone = vec![false; self.live.len()];
            for &row in &batch.dying[born.len()..] {
                gone[row] = true;
            }
            let rows: Vec<usize> = (0..gone.len()).filter(|&i| !gone[i]).collect();
            self.live = self.live.select(&rows);
        }
        self.next_point += born.len() as u64;
        self.iteration += 1;
    }

    fn add_evidence(&mut self, ln_l: f64, n: f64) {
        if ln_l > REJECTED {
            let ln_w = ln_l + self.ln_x + (-(-1.0 / n).exp_m1()).ln();
            let before = self.ln_z;
            let top = before.max(ln_w);
            self.ln_z = top + ((before - top).exp() + (ln_w - top).exp()).ln();
            let p = (ln_w - self.ln_z).exp();
            // H = <l> - ln Z, so the mean of l is carried along.
            let mean = if before > f64::NEG_INFINITY {
                self.information + before
            } else {
                0.0
            };
            self.information = p * ln_l + (1.0 - p) * mean - self.ln_z;
        }
        self.ln_x -= 1.0 / n;
    }
}

/// `count` rows out of `available`, distinct as far as there are enough.
fn choose_seeds(rng: &mut Stream, available: usize, count: usize) -> Vec<usize> {
    if count > available {
        return (0..count).map(|_| below(rng, available)).collect();
    }
    let mut rows: Vec<usize> = (0..available).collect();
    for i in 0..count {
        let j = i + below(rng, available - i);
        rows.swap(i, j);
    }
    rows.truncate(count);
    rows
}

#[cfg(test)]
mod tests;
