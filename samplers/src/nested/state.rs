//! A nested run between two iterations: everything that a checkpoint holds, and the step from one iteration to the next.

mod check;

use super::bound::Bound;
use super::dynamic::{LikelihoodRange, RunSummary};
use super::evidence::DeadPoints;
use super::kernel::{self, ChainContext, NewPoint};
use super::learning::Learner;
use super::likelihood::{self, Likelihood};
use super::live::{self, Genealogy, Points, REJECTED, Replacement, narrow};
use super::rank::Ranks;
use super::settings::{Kernel, Settings};
use super::tuning::Tuning;
use crate::error::{Error, Result};
use crate::output::{Calls, Cost};
use crate::rng::{Domain, RandomStream, below, stream};
use crate::target::Target;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Prior draws without a likelihood after which a run gives up.
const MAX_FIRST_DRAWS: usize = 100_000;

/// Prior volume below which ellipsoids are used; above it, draws of the prior cost less than any chain.
const FIRST_BOUND: f64 = 0.1;

/// Minimum effective number of recent lineages, as a fraction of the number of lineages; below it they are begun anew.
/// Random replacement reduces their number until the scatter of two or three is no estimate; by then the chains are
/// independent of the points with which these lineages began, as far as they ever are.
const MIN_RECENT_LINEAGES: f64 = 0.3;

/// Shrinkage of the volume after which the bound is fitted again.
const REFIT: f64 = 1.5;

/// What defines a run: it does not change.
#[derive(Clone, Copy)]
pub(super) struct Context<'a> {
    pub target: &'a dyn Target,
    pub settings: &'a Settings,
    pub seed: u64,
}

impl Context<'_> {
    pub fn kernel(&self) -> Kernel {
        self.settings.kernel.resolve(self.target.dim())
    }

    pub fn lineages(&self) -> usize {
        live::lineages(self.settings.n_live)
    }

    pub fn recent_lineages(&self) -> usize {
        live::recent_lineages(self.settings.n_live)
    }

    /// The genealogy of live point number `i` if it has no seed, of lineages from `first` on.
    pub fn genealogy(&self, i: usize, first: u32) -> Genealogy {
        Genealogy {
            lineage: first + narrow(i % self.lineages()),
            recent_lineage: narrow(i % self.recent_lineages()),
        }
    }

    pub fn first_steps(&self) -> usize {
        let default = self.settings.kernel.default_steps(self.target.dim());
        self.settings.steps.unwrap_or(default)
    }

    /// Number of steps from which on it is not raised, if the user has not chosen one.
    fn raised_below(&self) -> usize {
        10 * self.first_steps()
    }

    /// Largest number of steps that a run can come to: that which [`Tuning::raise_steps_if_needed`] raises last, by half.
    fn most_steps(&self) -> usize {
        match self.settings.steps {
            Some(chosen) => chosen,
            None => self.raised_below() + self.raised_below().div_ceil(2),
        }
    }
}

/// Where the chains of new points start, and above which bound.
struct Source<'a> {
    /// Points above the bound, where chains start.
    kept: &'a Points,
    contour: f64,
    bounds: &'a [Bound],
}

/// Whether chains draw the points, so that step lengths are adapted to them.
fn learns(context: &Context<'_>, bounds: &[Bound]) -> bool {
    context.kernel() != Kernel::Uniform && !bounds.is_empty()
}

/// The run so far.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct State {
    pub live: Points,
    pub dead: Points,
    /// Whether the first draws are complete.
    started: bool,
    /// Batches begun so far.
    pub batches: usize,
    /// Likelihood bounds of the present batch; none for the first, from the prior to the peak.
    range: Option<LikelihoodRange>,
    /// Remaining evidence at the end of the first batch, once there are more.
    left: Option<f64>,
    pub iteration: u64,
    next_point: u64,
    /// Expected log prior volume of the live points.
    pub ln_x: f64,
    /// Evidence and information of the dead points, by left Riemann sums, or of all points once there are more batches:
    /// for the stopping rule and for observers.
    pub ln_z: f64,
    pub information: f64,
    /// None, one to draw from, or two metrics: see [`ChainContext::bounds`].
    bounds: Vec<Bound>,
    ln_x_at_fit: f64,
    /// Lineages begun so far.
    begun: u32,
    /// Recent lineages begun so far.
    begun_recent: u32,
    /// Points per call in the first iteration after the fit, once known.
    efficiency_at_fit: Option<f64>,
    /// Points per call in the last iteration.
    pub efficiency: f64,
    pub tuning: Tuning,
    pub ranks: Ranks,
    /// The surrogates that trajectories follow.
    pub learner: Learner,
    pub cost: Cost,
    /// Points drawn with a bound, and their calls.
    pub bounded_points: u64,
    pub bounded_calls: u64,
}

impl State {
    pub fn new(context: &Context<'_>) -> Self {
        let dim = context.target.dim();
        Self {
            live: Points::new(dim),
            dead: Points::new(dim),
            started: false,
            batches: 1,
            range: None,
            left: None,
            iteration: 0,
            next_point: 0,
            ln_x: 0.0,
            ln_z: f64::NEG_INFINITY,
            information: 0.0,
            bounds: Vec::new(),
            ln_x_at_fit: 0.0,
            begun: narrow(context.lineages()),
            begun_recent: narrow(context.recent_lineages()),
            efficiency_at_fit: None,
            efficiency: 1.0,
            tuning: Tuning::new(
                context.first_steps(),
                context.kernel(),
                context.target.dim(),
            ),
            ranks: Ranks::default(),
            learner: Learner::default(),
            cost: Cost::default(),
            bounded_points: 0,
            bounded_calls: 0,
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

    /// How much the live points could still raise ln Z at the end of the first batch, or can now; 0 on a final plateau,
    /// whose volume is already divided among the deaths.
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

    /// Whether the next iteration would replace all live points.
    fn on_last_plateau(&self, settings: &Settings) -> bool {
        let best = self.live.best();
        let lower = self.live.ln_l.iter().filter(|l| **l < best).count();
        lower < settings.replaced_count()
    }

    /// Whether the present batch has reached its end.
    pub fn batch_ended(&self, settings: &Settings) -> bool {
        match &self.range {
            None => self.delta_ln_z(settings) < settings.dlnz,
            Some(range) => {
                let lowest = self.live.ln_l.iter().copied().fold(f64::INFINITY, f64::min);
                lowest > range.ceiling || self.on_last_plateau(settings)
            }
        }
    }

    /// Expected log prior volume at the end of the present batch; none for the first, whose end is not known.
    pub fn ln_x_at_end(&self) -> Option<f64> {
        let range = self.range?;
        let history = DeadPoints::of(&self.dead);
        let deaths = history.ln_l.partition_point(|l| *l <= range.ceiling);
        Some(history.expected_ln_t()[..deaths].iter().sum())
    }

    /// Batches done, with the part that is done of the present one, which ends at this log prior volume; 0 in the first batch.
    pub fn batches_done(&self, ln_x_at_end: Option<f64>) -> f64 {
        let part = match (self.range, ln_x_at_end) {
            (Some(range), Some(end)) if end < range.ln_x => {
                ((range.ln_x - self.ln_x) / (range.ln_x - end)).clamp(0.0, 1.0)
            }
            _ => 0.0,
        };
        (self.batches - 1) as f64 + part
    }

    /// One iteration: the lowest points die, and as many are born. On an error nothing has changed.
    pub fn advance(&mut self, context: &Context<'_>) -> Result<()> {
        if !self.started {
            return self.draw_first(context);
        }
        let replacement = live::lowest(&self.live, context.settings.replaced_count());
        let kept = self.live.select(&replacement.kept);
        let ln_x = self.ln_x_after(&replacement);
        let refitted = self.refit_if_due(context, &kept, ln_x);
        let mut tuning = self.tuning.clone();
        if let Some(new) = &refitted {
            tuning.keep_step_length(&self.bounds, new, &kept);
        }
        let mut rng = stream(context.seed, Domain::NestedSeeds, 0, self.iteration);
        let births = context.settings.n_live.saturating_sub(kept.len());
        let seeds = choose_seeds(&mut rng, kept.len(), births);
        let bounds = refitted.as_ref().unwrap_or(&self.bounds);
        let source = Source {
            kept: &kept,
            contour: replacement.contour,
            bounds,
        };
        let mut born = self.draw(context, &source, &tuning, &seeds)?;
        if learns(context, bounds) && !born.is_empty() {
            tuning.learn(context.kernel(), bounds, &kept, &seeds, &born, &mut rng);
        }
        self.tuning = tuning;
        if let Some(bounds) = refitted {
            self.bounds = bounds;
            self.ln_x_at_fit = ln_x;
            self.efficiency_at_fit = None;
        }
        self.count(&born);
        let genealogy: Vec<Genealogy> = if learns(context, &self.bounds) {
            seeds.iter().map(|&s| kept.genealogy[s]).collect()
        } else {
            replacement
                .dying
                .iter()
                .map(|&i| self.live.genealogy[i])
                .collect()
        };
        self.commit(&replacement, &born, &genealogy, &mut rng);
        if context.kernel() == Kernel::Surrogate {
            self.learn(context, &mut born, &genealogy);
        }
        let least = MIN_RECENT_LINEAGES * context.recent_lineages() as f64;
        if self.live.effective_recent_lineages() < least {
            self.begin_recent_lineages(context);
        }
        // A number of steps in the settings is not changed.
        if context.settings.steps.is_none() {
            let window = 5 * context.settings.n_live;
            self.tuning
                .raise_steps_if_needed(&self.ranks, window, context.raised_below());
        }
        Ok(())
    }

    /// New points above the likelihood bound, one from each seed.
    fn draw(
        &self,
        context: &Context<'_>,
        source: &Source<'_>,
        tuning: &Tuning,
        seeds: &[usize],
    ) -> Result<Vec<NewPoint>> {
        let kernel = context.kernel();
        let differences =
            matches!(kernel, Kernel::Differential | Kernel::Surrogate) && !source.bounds.is_empty();
        let halves = if differences {
            kernel::halves(context.target, source.kept)
        } else {
            Default::default()
        };
        let along = if source.bounds.is_empty() {
            None
        } else {
            self.learner.along(source.kept, source.contour, tuning)
        };
        let chain_context = ChainContext {
            target: context.target,
            contour: source.contour,
            kernel,
            bounds: source.bounds,
            halves: &halves,
            scale: tuning.scale,
            stride: tuning.stride,
            steps: if along.is_some() {
                tuning.steps_beside_trajectories()
            } else {
                tuning.steps
            },
            along: along.as_ref(),
        };
        let first = self.next_point;
        let born: Vec<Result<NewPoint>> = seeds
            .par_iter()
            .enumerate()
            .map(|(i, &s)| {
                let rng = stream(context.seed, Domain::NestedPoint, 0, first + i as u64);
                kernel::draw(&chain_context, source.kept, s, rng)
            })
            .collect();
        born.into_iter().collect()
    }

    /// Takes up the values of new points, and lets the surrogates learn if that is due.
    fn learn(&mut self, context: &Context<'_>, born: &mut [NewPoint], genealogy: &[Genealogy]) {
        for (b, genealogy) in born.iter_mut().zip(genealogy) {
            let examples = std::mem::take(&mut b.examples);
            self.learner.take(genealogy.lineage, examples);
        }
        if self.learner.is_due(self.ln_x) {
            let iteration = self.iteration;
            let rng = |task| stream(context.seed, Domain::NestedSurrogate, task, iteration);
            self.learner.learn(&self.live, self.ln_x, rng);
        }
    }

    /// Moves all live points to the dead ones and begins a batch where, by the summary of the run so far, more points
    /// reduce the errors most. On an error nothing has changed.
    pub fn add_batch(&mut self, context: &Context<'_>, summary: RunSummary) -> Result<()> {
        let range = summary.next_range(context.settings);
        let RunSummary {
            points, weighted, ..
        } = summary;
        // The points alive at the lower bound, of any batch, are draws of the prior above it.
        let alive: Vec<usize> = (0..points.len())
            .filter(|&i| points.birth[i] <= range.floor && points.ln_l[i] > range.floor)
            .collect();
        let kept = points.select(&alive);
        let bounds = if range.ln_x < FIRST_BOUND.ln() {
            self.fit(context, &kept).unwrap_or_default()
        } else {
            Vec::new()
        };
        let mut rng = stream(context.seed, Domain::NestedSeeds, 0, self.iteration);
        let mut tuning = self.tuning.clone();
        tuning.forget_lengths(context.kernel(), context.target.dim());
        let count = context.settings.n_live;
        let mut live = Points::new(points.dim());
        let mut born = Vec::new();
        if range.floor == f64::NEG_INFINITY {
            // Nothing is taken over before the last block: a target may fail at any.
            let (mut blocks, mut next_point) = (Vec::new(), self.next_point);
            while !are_enough(&live, context.settings) {
                blocks.push(draw_prior(context, next_point, self.begun, &mut live)?);
                next_point += count as u64;
            }
            blocks.iter().for_each(|calls| self.cost.count(calls));
            self.next_point = next_point;
            self.begun += narrow(context.lineages());
        } else {
            let seeds = choose_seeds(&mut rng, kept.len(), count);
            let source = Source {
                kept: &kept,
                contour: range.floor,
                bounds: &bounds,
            };
            born = self.draw(context, &source, &tuning, &seeds)?;
            if learns(context, &bounds) {
                tuning.learn(context.kernel(), &bounds, &kept, &seeds, &born, &mut rng);
            }
            for (i, b) in born.iter().enumerate() {
                let own = if learns(context, &bounds) {
                    kept.genealogy[seeds[i]]
                } else {
                    context.genealogy(i, 0)
                };
                live.push(&b.u, b.ln_l, range.floor, own);
            }
            self.next_point += count as u64;
        }
        self.left = Some(self.delta_ln_z(context.settings));
        self.iteration += 1;
        self.dead = points;
        self.live = live;
        // Recent lineages measure the volumes of one batch.
        self.begin_recent_lineages(context);
        self.batches += 1;
        self.range = Some(range);
        self.ln_x = range.ln_x;
        self.ln_z = weighted.ln_z;
        self.information = weighted.information;
        self.bounds = bounds;
        self.count(&born);
        self.ln_x_at_fit = range.ln_x;
        self.learner.begin_at(range.ln_x);
        self.efficiency_at_fit = None;
        self.tuning = tuning;
        Ok(())
    }

    fn begin_recent_lineages(&mut self, context: &Context<'_>) {
        let count = narrow(context.recent_lineages());
        self.live.begin_recent_lineages(self.begun_recent, count);
        self.begun_recent += count;
    }

    /// One block of independent prior draws, until an iteration of them has a likelihood.
    fn draw_first(&mut self, context: &Context<'_>) -> Result<()> {
        let calls = draw_prior(context, self.next_point, 0, &mut self.live)?;
        self.cost.count(&calls);
        self.next_point += context.settings.n_live as u64;
        let tries = self.live.len();
        let none = self.live.ln_l.iter().all(|l| *l <= REJECTED);
        if none && tries >= MAX_FIRST_DRAWS {
            let cause = self.cost.main_cause();
            return Err(Error::NoStart { tries, cause });
        }
        self.started = are_enough(&self.live, context.settings);
        Ok(())
    }

    fn ln_x_after(&self, replacement: &Replacement) -> f64 {
        let alive = self.live.len();
        let fall: f64 = (0..replacement.dying.len())
            .map(|i| 1.0 / (alive - i) as f64)
            .sum();
        self.ln_x - fall
    }

    /// New ellipsoids around the surviving points if they are due. `None`: keep the old ones, or continue with the prior.
    fn refit_if_due(&self, context: &Context<'_>, kept: &Points, ln_x: f64) -> Option<Vec<Bound>> {
        let due = if self.bounds.is_empty() {
            ln_x < FIRST_BOUND.ln()
        } else {
            ln_x < self.ln_x_at_fit - REFIT.ln()
                || self
                    .efficiency_at_fit
                    .is_some_and(|at_fit| self.efficiency < 0.5 * at_fit)
        };
        if due { self.fit(context, kept) } else { None }
    }

    fn fit(&self, context: &Context<'_>, kept: &Points) -> Option<Vec<Bound>> {
        if context.kernel() == Kernel::Uniform {
            Some(vec![Bound::for_draws(kept, context.seed, self.iteration)?])
        } else {
            Some(Bound::for_steps(kept))
        }
    }

    fn count(&mut self, born: &[NewPoint]) {
        let calls: u64 = born.iter().map(|b| b.calls.values).sum();
        for b in born {
            self.cost.count(&b.calls);
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

    /// Moves the dying points to the dead ones, in order, and puts the new points with their genealogy in their places.
    fn commit(
        &mut self,
        replacement: &Replacement,
        born: &[NewPoint],
        genealogy: &[Genealogy],
        rng: &mut RandomStream,
    ) {
        for (i, &row) in replacement.dying.iter().enumerate() {
            let n = (self.live.len() - i) as f64;
            if self.range.is_none() {
                self.add_evidence(self.live.ln_l[row], n);
            }
            self.ln_x -= 1.0 / n;
            self.dead.push_from(&self.live, row);
        }
        let mut sorted: Vec<f64> = replacement
            .kept
            .iter()
            .map(|&i| self.live.ln_l[i])
            .collect();
        sorted.sort_by(f64::total_cmp);
        for b in born {
            let below_it = sorted.partition_point(|l| *l < b.ln_l);
            let ties = sorted.partition_point(|l| *l <= b.ln_l) - below_it;
            let rank = below_it + below(rng, ties + 1);
            self.ranks.push(narrow(rank), narrow(sorted.len()));
            sorted.insert(rank, b.ln_l);
        }
        for ((&row, b), genealogy) in replacement.dying.iter().zip(born).zip(genealogy) {
            self.live
                .replace(row, &b.u, b.ln_l, replacement.contour, *genealogy);
        }
        if born.len() < replacement.dying.len() {
            let mut gone = vec![false; self.live.len()];
            for &row in &replacement.dying[born.len()..] {
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
            // H = <l> - ln Z, so the mean of l is updated as well.
            let mean = if before > f64::NEG_INFINITY {
                self.information + before
            } else {
                0.0
            };
            self.information = p * ln_l + (1.0 - p) * mean - self.ln_z;
        }
    }
}

/// Adds a block of independent draws of the prior to `points`, one for each live point, with numbers and lineages from these on.
fn draw_prior(
    context: &Context<'_>,
    first: u64,
    lineage: u32,
    points: &mut Points,
) -> Result<Calls> {
    let mut likelihood = Likelihood::new(context.target);
    let mut places = vec![vec![0.0; context.target.dim()]; context.settings.n_live];
    for (j, u) in (first..).zip(&mut places) {
        let mut rng = stream(context.seed, Domain::NestedPoint, 0, j);
        likelihood::draw_prior(&mut rng, u);
    }
    for (i, ln_l) in likelihood.at_all(&places)?.into_iter().enumerate() {
        let own = context.genealogy(i, lineage);
        points.push(&places[i], ln_l, f64::NEG_INFINITY, own);
    }
    Ok(likelihood.calls)
}

/// Whether draws of the prior are enough to begin with: an iteration of them has a likelihood, or there are as many as there may be.
fn are_enough(draws: &Points, settings: &Settings) -> bool {
    let valid = draws.ln_l.iter().filter(|l| **l > REJECTED).count();
    valid >= settings.replaced_count() || draws.len() >= MAX_FIRST_DRAWS
}

/// `count` rows out of `available`: each as often as the others, or once more.
fn choose_seeds(rng: &mut RandomStream, available: usize, count: usize) -> Vec<usize> {
    let mut rows: Vec<usize> = (0..available).collect();
    let distinct = count % available;
    for i in 0..distinct {
        let j = i + below(rng, available - i);
        rows.swap(i, j);
    }
    let rest = rows[..distinct].to_vec();
    let times = count / available;
    rows.sort_unstable();
    let mut seeds = rows.repeat(times);
    seeds.extend(rest);
    seeds
}

#[cfg(test)]
mod tests;
