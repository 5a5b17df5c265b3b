//! A nested run between two batches: everything that a checkpoint holds, and the step from one batch to the next.

use super::bound::Bound;
use super::dynamic::{Span, Survey};
use super::kernel::{self, Newborn, Setting};
use super::likelihood::{Likelihood, Tally};
use super::live::{self, Batch, Kin, Points, REJECTED, narrow};
use super::rank::Ranks;
use super::settings::{Kernel, Settings};
use super::tuning::Tuning;
use crate::error::{Error, Result};
use crate::keeper::Time;
use crate::rng::{Domain, Stream, below, stream};
use crate::target::Target;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Prior draws without a likelihood after which a run gives up.
const MAX_FIRST_DRAWS: usize = 100_000;

/// Prior volume from which on bounds are used; plain draws of the prior above it cost less than any chain.
const FIRST_BOUND: f64 = 0.1;

/// Share of the clans that must be left, in effect, or else they are founded anew. Chance alone makes more and more points
/// relatives, until the scatter of two or three clans says nothing; what a chain forgets is forgotten by then.
const LEAST_CLANS: f64 = 0.3;

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

    pub fn lineages(&self) -> usize {
        live::lineages(self.settings.n_live)
    }

    /// The kin of live point number `i` if it has no seed.
    pub fn kin(&self, i: usize) -> Kin {
        Kin::from(narrow(i % self.lineages()))
    }

    pub fn first_steps(&self) -> usize {
        let default = self.settings.kernel.default_steps(self.target.dim());
        self.settings.steps.unwrap_or(default)
    }
}

/// What new points are drawn from.
struct Ground<'a> {
    /// Points above the contour, where chains start.
    kept: &'a Points,
    contour: f64,
    bounds: &'a [Bound],
    /// Slices, flights or walk steps.
    steps: usize,
}

/// Whether chains draw the points, from whose motion step lengths are learned.
fn learns(job: &Job<'_>, bounds: &[Bound]) -> bool {
    job.kernel() != Kernel::Uniform && !bounds.is_empty()
}

/// The run so far.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct State {
    pub live: Points,
    pub dead: Points,
    /// Whether the first draws are complete.
    started: bool,
    /// Strands begun so far.
    pub strands: usize,
    /// What the present strand spans; none: it is the first one, from the prior to the peak.
    span: Option<Span>,
    /// What the first strand left, once there are more.
    left: Option<f64>,
    pub iteration: u64,
    next_point: u64,
    /// Expected log prior volume of the live points.
    pub ln_x: f64,
    /// Evidence and information of the dead, by left Riemann sums, or of all points once there are more strands: for the
    /// stopping rule and for observers.
    pub ln_z: f64,
    pub information: f64,
    /// None, one to draw from, or two metrics: see [`Setting::bounds`].
    bounds: Vec<Bound>,
    ln_x_at_fit: f64,
    /// Clans founded so far.
    founded: u32,
    /// Points per call in the first batch after the fit, once known.
    efficiency_at_fit: Option<f64>,
    /// Points per call in the last batch.
    pub efficiency: f64,
    pub tuning: Tuning,
    pub ranks: Ranks,
    /// Likelihood values without a gradient, and with one.
    pub calls: u64,
    pub gradients: u64,
    pub rejected: BTreeMap<String, u64>,
    /// Points drawn with a bound, and their calls.
    pub bounded_points: u64,
    pub bounded_calls: u64,
    pub time: Time,
}

impl State {
    pub fn new(job: &Job<'_>) -> Self {
        let dim = job.target.dim();
        Self {
            live: Points::new(dim),
            dead: Points::new(dim),
            started: false,
            strands: 1,
            span: None,
            left: None,
            iteration: 0,
            next_point: 0,
            ln_x: 0.0,
            ln_z: f64::NEG_INFINITY,
            information: 0.0,
            bounds: Vec::new(),
            ln_x_at_fit: 0.0,
            founded: narrow(job.lineages()),
            efficiency_at_fit: None,
            efficiency: 1.0,
            tuning: Tuning::new(job.first_steps(), job.kernel(), job.target.dim()),
            ranks: Ranks::default(),
            calls: 0,
            gradients: 0,
            rejected: BTreeMap::new(),
            bounded_points: 0,
            bounded_calls: 0,
            time: Time::default(),
        }
    }

    /// All points of the run.
    pub fn points(&self) -> Points {
        let mut points = self.dead.clone();
        for i in 0..self.live.len() {
            points.push_from(&self.live, i);
        }
        points
    }

    /// How much the live points could still raise ln Z when the first strand ended, or can now; 0 on a final plateau, whose
    /// volume the deaths already share.
    pub fn delta_ln_z(&self, settings: &Settings) -> f64 {
        self.left.unwrap_or_else(|| self.delta_ln_z_now(settings))
    }

    fn delta_ln_z_now(&self, settings: &Settings) -> f64 {
        let best = self.live.best();
        if !self.started || best <= REJECTED {
            return f64::INFINITY;
        }
        if self.on_last_plateau(settings) {
            return 0.0;
        }
        (best + self.ln_x - self.ln_z).exp().ln_1p()
    }

    /// Whether the next batch would take everyone.
    fn on_last_plateau(&self, settings: &Settings) -> bool {
        let best = self.live.best();
        let lower = self.live.ln_l.iter().filter(|l| **l < best).count();
        lower < settings.batch_size()
    }

    /// Whether the present strand has reached its end.
    pub fn rests(&self, settings: &Settings) -> bool {
        match &self.span {
            None => self.delta_ln_z(settings) < settings.dlnz,
            Some(span) => {
                let lowest = self.live.ln_l.iter().copied().fold(f64::INFINITY, f64::min);
                lowest > span.ceiling || self.on_last_plateau(settings)
            }
        }
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
        let mut tuning = self.tuning.clone();
        if let Some(new) = &refitted {
            tuning.keep_step_length(&self.bounds, new, &kept);
        }
        let mut rng = stream(job.seed, Domain::NestedSeeds, 0, self.iteration);
        let births = job.settings.n_live.saturating_sub(kept.len());
        let seeds = choose_seeds(&mut rng, kept.len(), births);
        let bounds = refitted.as_ref().unwrap_or(&self.bounds);
        let ground = Ground {
            kept: &kept,
            contour: batch.contour,
            bounds,
            steps: tuning.steps,
        };
        let born = self.draw(job, &ground, &tuning, &seeds)?;
        if learns(job, bounds) && !born.is_empty() {
            tuning.learn(job.kernel(), bounds, &kept, &seeds, &born, &mut rng);
        }
        self.tuning = tuning;
        if let Some(bounds) = refitted {
            self.bounds = bounds;
            self.ln_x_at_fit = ln_x;
            self.efficiency_at_fit = None;
        }
        self.count(&born);
        let kin: Vec<Kin> = if learns(job, &self.bounds) {
            seeds.iter().map(|&s| kept.kin[s]).collect()
        } else {
            batch.dying.iter().map(|&i| self.live.kin[i]).collect()
        };
        self.commit(&batch, &born, &kin, &mut rng);
        if self.live.effective_clans() < LEAST_CLANS * job.lineages() as f64 {
            self.found_clans(job);
        }
        // Steps that the user chose stay.
        if job.settings.steps.is_none() {
            let window = 5 * job.settings.n_live;
            self.tuning
                .watch(&self.ranks, window, 10 * job.first_steps());
        }
        Ok(())
    }

    /// New points above a contour, one from each seed.
    fn draw(
        &self,
        job: &Job<'_>,
        ground: &Ground<'_>,
        tuning: &Tuning,
        seeds: &[usize],
    ) -> Result<Vec<Newborn>> {
        let differences = job.kernel() == Kernel::Differential && !ground.bounds.is_empty();
        let halves = if differences {
            kernel::halves(job.target, ground.kept)
        } else {
            Default::default()
        };
        let setting = Setting {
            target: job.target,
            contour: ground.contour,
            kernel: job.kernel(),
            bounds: ground.bounds,
            halves: &halves,
            scale: tuning.scale,
            stride: tuning.stride,
            steps: ground.steps,
        };
        let first = self.next_point;
        let born: Vec<Result<Newborn>> = seeds
            .par_iter()
            .enumerate()
            .map(|(i, &s)| {
                let rng = stream(job.seed, Domain::NestedPoint, 0, first + i as u64);
                kernel::draw(&setting, ground.kept, s, rng)
            })
            .collect();
        born.into_iter().collect()
    }

    /// Buries everyone and begins a strand where, by a survey of the run, more points tell most. On an error nothing has
    /// changed.
    pub fn add_strand(&mut self, job: &Job<'_>, survey: Survey) -> Result<()> {
        let share = survey.posterior_share(job.settings);
        let span = Span::of(&survey.history, &survey.weighted, share);
        let Survey {
            points, weighted, ..
        } = survey;
        // Those alive at the floor, of whatever strand, are draws of the prior above it.
        let alive: Vec<usize> = (0..points.len())
            .filter(|&i| points.birth[i] <= span.floor && points.ln_l[i] > span.floor)
            .collect();
        let kept = points.select(&alive);
        let bounds = if span.ln_x < FIRST_BOUND.ln() {
            self.fit(job, &kept).unwrap_or_default()
        } else {
            Vec::new()
        };
        let mut rng = stream(job.seed, Domain::NestedSeeds, 0, self.iteration);
        let mut tuning = self.tuning.clone();
        tuning.forget_lengths(job.kernel(), job.target.dim());
        let count = job.settings.n_live;
        let mut live = Points::new(points.dim());
        if span.floor == f64::NEG_INFINITY {
            let (first, tally) = self.draw_prior(job)?;
            live = first;
            self.calls += tally.calls;
            tally.add_to(&mut self.rejected);
        } else {
            let seeds = choose_seeds(&mut rng, kept.len(), count);
            let ground = Ground {
                kept: &kept,
                contour: span.floor,
                bounds: &bounds,
                steps: tuning.steps,
            };
            let born = self.draw(job, &ground, &tuning, &seeds)?;
            if learns(job, &bounds) {
                tuning.learn(job.kernel(), &bounds, &kept, &seeds, &born, &mut rng);
            }
            for (i, b) in born.iter().enumerate() {
                let own = if learns(job, &bounds) {
                    kept.kin[seeds[i]]
                } else {
                    job.kin(i)
                };
                live.push(&b.u, b.ln_l, span.floor, own);
            }
            self.count(&born);
        }
        self.left = Some(self.delta_ln_z(job.settings));
        self.next_point += count as u64;
        self.iteration += 1;
        self.dead = points;
        self.live = live;
        // Another strand from the same seeds would have other volumes.
        self.found_clans(job);
        self.strands += 1;
        self.span = Some(span);
        self.ln_x = span.ln_x;
        self.ln_z = weighted.ln_z;
        self.information = weighted.information;
        self.bounds = bounds;
        self.ln_x_at_fit = span.ln_x;
        self.efficiency_at_fit = None;
        self.tuning = tuning;
        Ok(())
    }

    fn found_clans(&mut self, job: &Job<'_>) {
        let count = narrow(job.lineages());
        self.live.found(self.founded, count);
        self.founded += count;
    }

    /// One block of independent prior draws, until a batch of them has a likelihood.
    fn draw_first(&mut self, job: &Job<'_>) -> Result<()> {
        let count = job.settings.n_live;
        let (first, tally) = self.draw_prior(job)?;
        for i in 0..first.len() {
            self.live.push_from(&first, i);
        }
        self.calls += tally.calls;
        tally.add_to(&mut self.rejected);
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

    /// As many independent draws of the prior as there are to be live points.
    fn draw_prior(&self, job: &Job<'_>) -> Result<(Points, Tally)> {
        let mut likelihood = Likelihood::new(job.target);
        let mut places = vec![vec![0.0; job.target.dim()]; job.settings.n_live];
        for (j, u) in (self.next_point..).zip(&mut places) {
            likelihood.draw_prior(&mut stream(job.seed, Domain::NestedPoint, 0, j), u)?;
        }
        let mut points = Points::new(job.target.dim());
        for (i, ln_l) in likelihood.at_all(&places)?.into_iter().enumerate() {
            points.push(&places[i], ln_l, f64::NEG_INFINITY, job.kin(i));
        }
        Ok((points, likelihood.tally))
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
        let due = if self.bounds.is_empty() {
            ln_x < FIRST_BOUND.ln()
        } else {
            ln_x < self.ln_x_at_fit - REFIT.ln()
                || self
                    .efficiency_at_fit
                    .is_some_and(|at_fit| self.efficiency < 0.5 * at_fit)
        };
        if due { self.fit(job, kept) } else { None }
    }

    fn fit(&self, job: &Job<'_>, kept: &Points) -> Option<Vec<Bound>> {
        let kind = job.settings.bound;
        if job.kernel() == Kernel::Uniform {
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
            self.gradients += b.tally.gradients;
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

    /// Buries the dying, in order, and puts the newborn, of this kin, in their places.
    fn commit(&mut self, batch: &Batch, born: &[Newborn], kin: &[Kin], rng: &mut Stream) {
        for (i, &row) in batch.dying.iter().enumerate() {
            let n = (self.live.len() - i) as f64;
            if self.span.is_none() {
                self.add_evidence(self.live.ln_l[row], n);
            }
            self.ln_x -= 1.0 / n;
            self.dead.push_from(&self.live, row);
        }
        let mut sorted: Vec<f64> = batch.kept.iter().map(|&i| self.live.ln_l[i]).collect();
        sorted.sort_by(f64::total_cmp);
        for b in born {
            let below_it = sorted.partition_point(|l| *l < b.ln_l);
            let ties = sorted.partition_point(|l| *l <= b.ln_l) - below_it;
            let rank = below_it + below(rng, ties + 1);
            self.ranks.push(narrow(rank), narrow(sorted.len()));
            sorted.insert(rank, b.ln_l);
        }
        for ((&row, b), kin) in batch.dying.iter().zip(born).zip(kin) {
            self.live.replace(row, &b.u, b.ln_l, batch.contour, *kin);
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
