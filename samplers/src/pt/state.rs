//! The whole of a run between two scans: what a checkpoint holds and a scan advances.

use super::anneal::{Annealing, Barrier, Level, of_others};
use super::evidence::{Estimate, estimate};
use super::ladder::{barrier, first_schedule, locate, respaced};
use super::record::{Local, Record};
use super::{Settings, swap};
use crate::control::Event;
use crate::error::{Error, Result};
use crate::hmc::{self, Evaluator, Explorer, Metric, Plan, Point, Reference, StepSize, Tally};
use crate::keeper::Time;
use crate::neighbours::Neighbours;
use crate::rng::{Domain, Stream, below, stream, unit_open};
use crate::target::{Symmetry, Target};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// A target where fewer draws of the prior than one in so many have a likelihood is taken to have none.
const START_TRIES: usize = 100_000;

/// A round of fewer scans is early: it only has to find the scales, so its trajectories are short, and energies far
/// from equilibrium may vary as they like.
const EARLY_SCANS: usize = 32;

/// Most leapfrog steps of a move in an early round.
const EARLY_LEAPFROGS: usize = 32;

/// Most rows of half of the ladders that a mixture is fitted to; of those before half as many are kept, so that what was
/// drawn long ago, fewer and less sure, is forgotten by and by.
const MOST_TRAINING: usize = 5_000;

/// Step that Hamiltonian moves begin with in a population's metric: ridges are narrower than the population.
const FIRST_STEP: f64 = 0.1;

/// Share of a fall that an energy error may be in an early round.
const EARLY_SLACK: f64 = 0.05;

/// Energy range of a path that marks it as divergent in all other rounds.
const MAX_ENERGY_RANGE: f64 = 1000.0;

/// One temperature.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Rung {
    pub(super) beta: f64,
    metric: Metric,
    pub(super) step: StepSize,
    /// Where the round before stood at this temperature: its odd families for the even ones, and the other way round.
    pools: [Neighbours; 2],
}

/// One place of one ladder: states stay, machines travel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Slot {
    point: Point,
    machine: usize,
}

/// What a finished round came to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Finished {
    pub(super) barrier: f64,
    pub(super) ln_z: f64,
}

/// See the module's words.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct State {
    settings: Settings,
    pub(super) seed: u64,
    /// The populations that the ladders start from, until they are cold.
    annealing: Option<Annealing>,
    /// Present round, and its scans done.
    pub(super) round: usize,
    pub(super) scan: usize,
    /// Times that the last round has gone on for as long again.
    extensions: usize,
    /// Scans done in all rounds: the index of the random streams.
    clock: u64,
    /// Where the ladders begin.
    pub(super) reference: Reference,
    /// The halves of the draws that it was fitted to.
    training: [Vec<f64>; 2],
    pub(super) rungs: Vec<Rung>,
    /// Ladder-major.
    slots: Vec<Slot>,
    pub(super) record: Record,
    pub(super) history: Vec<Finished>,
    pub(super) tally: Tally,
    pub(super) time: Time,
}

/// What exploring one slot gave.
struct Explored {
    point: Point,
    local: Local,
    tally: Tally,
    /// Every place on the way, where a mixture is to be fitted to them.
    trail: Vec<f64>,
}

impl State {
    /// Draws every slot from the prior, again and again until it has a likelihood where it needs one.
    pub(super) fn start(target: &dyn Target, settings: &Settings, seed: u64) -> Result<Self> {
        let dim = target.dim();
        let rungs: Vec<Rung> = first_schedule(settings.temperatures)
            .into_iter()
            .map(|beta| Rung {
                beta,
                metric: Metric::identity(settings.metric, dim),
                step: StepSize::new(0.5),
                pools: Default::default(),
            })
            .collect();
        let mut state = Self {
            settings: settings.clone(),
            seed,
            annealing: None,
            round: 0,
            scan: 0,
            extensions: 0,
            clock: 0,
            reference: Reference::default(),
            training: Default::default(),
            record: Record::new(
                dim,
                settings.ladders,
                settings.families(),
                rungs.len(),
                settings.scans(0),
            ),
            slots: Vec::new(),
            rungs,
            history: Vec::new(),
            tally: Tally::default(),
            time: Time::default(),
        };
        if settings.annealing > 0 {
            let families = settings.families();
            let populations = state.first_points(target, families, settings.members())?;
            state.annealing = Some(Annealing::new(populations, settings.metric));
            return Ok(state);
        }
        let rungs = state.rungs.len();
        for ladder in state.first_points(target, settings.ladders, rungs)? {
            state.slots.extend(
                ladder
                    .into_iter()
                    .enumerate()
                    .map(|(machine, point)| Slot { point, machine }),
            );
        }
        Ok(state)
    }

    /// As many draws of the prior for each ladder, or for each population; all have a likelihood but the first of a
    /// ladder, which becomes the one at beta = 0.
    fn first_points(
        &mut self,
        target: &dyn Target,
        ladders: usize,
        per_ladder: usize,
    ) -> Result<Vec<Vec<Point>>> {
        let mut evaluator = Evaluator::new(target);
        let mut points = vec![Point::new(target.dim()); ladders * per_ladder];
        let mut streams: Vec<Stream> = (0..points.len())
            .map(|i| {
                let task = ((i / per_ladder) << 20) + i % per_ladder;
                stream(self.seed, Domain::PtExplore, task as u64, 0)
            })
            .collect();
        let prior = |i: usize| i.is_multiple_of(per_ladder) && self.settings.annealing == 0;
        let mut wanting: Vec<usize> = (0..points.len()).collect();
        let (mut tries, mut found) = (0, 0);
        while !wanting.is_empty() {
            for &i in &wanting {
                evaluator.draw_reference(&mut points[i].z, &mut streams[i])?;
            }
            let places: Vec<&[f64]> = wanting.iter().map(|&i| points[i].z.as_slice()).collect();
            let values = evaluator.values(&places)?;
            for (&i, value) in wanting.iter().zip(values) {
                points[i].ln_likelihood = value;
                found += usize::from(value.is_finite());
            }
            tries += wanting.len();
            wanting.retain(|&i| !points[i].ln_likelihood.is_finite() && !prior(i));
            if tries / START_TRIES > found {
                let mut tally = Tally::default();
                tally.add(&evaluator);
                return Err(Error::NoStart {
                    tries,
                    cause: tally.main_cause(),
                });
            }
        }
        self.tally.add(&evaluator);
        Ok(points.chunks(per_ladder).map(<[Point]>::to_vec).collect())
    }

    /// The stream of slot or gap number `index` (ladder-major over rungs) at a scan.
    fn stream(&self, domain: Domain, index: usize, scan: u64) -> Stream {
        let rungs = self.rungs.len();
        let task = ((index / rungs) << 20) + index % rungs;
        stream(self.seed, domain, task as u64, scan)
    }

    /// Scans of the present round.
    fn scans(&self) -> usize {
        self.settings.scans(self.round) * (1 + self.extensions)
    }

    /// Whether the last round is done, as far as it has been extended.
    pub(super) fn finished(&self) -> bool {
        self.is_last_round() && self.scan == self.scans()
    }

    /// Whether the last round may go on once it is done.
    pub(super) fn may_extend(&self) -> bool {
        self.extensions < self.settings.extensions
    }

    /// Lets the last round go on for as long again.
    pub(super) fn extend(&mut self) {
        self.extensions += 1;
    }

    /// Whether the first scan is still to come.
    pub(super) fn annealing(&self) -> bool {
        self.annealing.is_some()
    }

    /// Whether the present round has anything to show.
    pub(super) fn scanned(&self) -> bool {
        self.scan > 0
    }

    pub(super) fn is_last_round(&self) -> bool {
        self.round + 1 == self.settings.rounds
    }

    /// Groups of ladders that are independent of each other.
    pub(super) fn families(&self) -> usize {
        self.settings.families()
    }

    /// Whether slices explore beside Hamiltonian moves.
    pub(super) fn slices(&self) -> bool {
        self.settings.slices > 0
    }

    /// Whether the ladders of this round were to begin at a mixture.
    pub(super) fn mixture_due(&self) -> bool {
        self.settings.mixes(self.round)
    }

    /// Whether a mixture is to be fitted after this round. The last round keeps the one that it has: its temperatures are those
    /// that the round before found on the same path.
    fn mixture_next(&self) -> bool {
        let next = self.round + 1;
        !self.is_last_round()
            && self.settings.mixes(next)
            && (next + 1 < self.settings.rounds || self.reference.is_prior())
    }

    fn is_early_round(&self) -> bool {
        !self.is_last_round() && self.settings.scans(self.round) < EARLY_SCANS
    }

    pub(super) fn beta(&self) -> Vec<f64> {
        self.rungs.iter().map(|rung| rung.beta).collect()
    }

    pub(super) fn evidence(&self) -> Estimate {
        estimate(&self.beta(), &self.record.traces, self.settings.families())
    }

    /// What an observer is told after a scan; evidence and barrier are NaN before a round has finished.
    pub(super) fn progress(&self) -> Event {
        if let Some(annealing) = &self.annealing {
            let (beta, ln_z) = annealing.progress();
            let calls = self.tally.calls;
            return Event::Annealing { beta, ln_z, calls };
        }
        let last = self.history.last();
        Event::Tempered {
            round: self.round,
            scan: self.scan.saturating_sub(1),
            scans: self.scans(),
            barrier: last.map_or(f64::NAN, |r| r.barrier),
            round_trips: self.record.round_trips(),
            ln_z: last.map_or(f64::NAN, |r| r.ln_z),
            gradients: self.tally.gradients,
        }
    }

    /// One scan, and the adaptation before it if a round has just ended. On an error the state is that before the
    /// scan.
    pub(super) fn advance(&mut self, target: &dyn Target) -> Result<()> {
        if let Some(annealing) = &mut self.annealing {
            let sweeps = self.settings.sweeps(target.dim());
            let tally = annealing.advance(target, self.settings.metric, sweeps, self.seed)?;
            self.tally.merge(&tally);
            if annealing.done() {
                let levels: Vec<Vec<Level>> = annealing.levels().map(<[Level]>::to_vec).collect();
                self.begin(&levels, target);
                self.annealing = None;
            }
            return Ok(());
        }
        if self.scan == self.scans() {
            self.adapt(target);
        }
        let explored: Vec<Result<Explored>> = (0..self.slots.len())
            .into_par_iter()
            .map(|slot| self.explore(target, slot))
            .collect();
        let explored: Vec<Explored> = explored.into_iter().collect::<Result<_>>()?;

        let rungs = self.rungs.len();
        let mut locals = vec![Local::default(); rungs];
        for (index, explored) in explored.into_iter().enumerate() {
            self.slots[index].point = explored.point;
            locals[index % rungs].add(&explored.local);
            self.record.trails[index / rungs].extend(explored.trail);
            self.tally.merge(&explored.tally);
        }
        self.clock += 1;
        let beta = self.beta();
        for ladder in 0..self.settings.ladders {
            let points = self.slots[ladder * rungs..(ladder + 1) * rungs]
                .iter()
                .map(|slot| &slot.point);
            self.record.note(ladder, &beta, points);
            self.swap(ladder, &beta);
        }
        let (frozen, early) = (self.is_last_round(), self.is_early_round());
        let scans = self.scans();
        for (rung, local) in locals.iter().enumerate() {
            self.record.locals[rung].add(local);
            if frozen || rung == 0 {
                continue;
            }
            // Later on a rejected point is taken for a cliff, which no step is short enough for; an early one may
            // well be the overflow of a step that is far too long.
            let met = if early {
                local.moves
            } else {
                local.moves - local.rejected
            };
            if met > 0 {
                self.rungs[rung].step.learn(
                    local.acceptance / met as f64,
                    self.settings.target_acceptance,
                    self.scan,
                    scans,
                );
            }
        }
        self.scan += 1;
        Ok(())
    }

    /// Begins the first round where populations ended: temperatures evenly spaced in the barrier between their levels, the
    /// members of the nearest levels as states, metric and pool.
    fn begin(&mut self, populations: &[Vec<Level>], target: &dyn Target) {
        let dim = target.dim();
        let orbit = Symmetry::first_orbit(target.symmetries());
        let barriers: Vec<Barrier> = populations.iter().map(|l| Barrier::of(l)).collect();
        let path = Barrier::mean(&barriers);
        let count = self.enough_temperatures(path.total());
        let nearest = |levels: &[Level], place: f64| {
            (0..levels.len()).min_by(|i, j| {
                let away = |i: usize| (path.at(levels[i].beta) - place).abs();
                away(*i).total_cmp(&away(*j))
            })
        };
        let ladders = self.settings.ladders;
        let mut rungs = Vec::with_capacity(count);
        let mut slots = vec![Vec::with_capacity(count); ladders];
        for (k, beta) in path.schedule(count).into_iter().enumerate() {
            let mut rows = vec![Vec::new(); populations.len()];
            for (family, levels) in populations.iter().enumerate() {
                let place = path.total() * k as f64 / (count - 1) as f64;
                if let Some(level) = nearest(levels, place).map(|i| &levels[i]) {
                    let task = (family << 20) + k;
                    let mut rng = stream(self.seed, Domain::PtAnneal, task as u64, u64::MAX);
                    let members = level.ln_likelihood.len();
                    let first = below(&mut rng, members);
                    // Ladders of one family take members far apart: those of one ancestor are next to each other.
                    let own: Vec<usize> = (family..ladders).step_by(populations.len()).collect();
                    for (turn, ladder) in own.iter().enumerate() {
                        let member = (first + turn * members / own.len()) % members;
                        slots[*ladder].push(Slot {
                            point: level.point(member),
                            machine: k,
                        });
                    }
                    rows[family].clone_from(&level.z);
                }
            }
            rungs.push(Rung {
                beta,
                metric: Metric::of_rows(self.settings.metric, &rows.concat(), dim),
                step: StepSize::new(FIRST_STEP),
                pools: of_others(rows.iter()).map(|r| Neighbours::new(&r, dim, orbit)),
            });
        }
        self.rungs = rungs;
        self.slots = slots.concat();
        self.record = self.new_record(dim, 0);
        if self.settings.mixes(0) {
            self.begin_at_mixture(populations, target);
        }
    }

    /// Has the first round begin at a mixture that resembles the populations' coldest level, in states of that level.
    fn begin_at_mixture(&mut self, populations: &[Vec<Level>], target: &dyn Target) {
        let coldest: Vec<&Level> = populations.iter().filter_map(|l| l.last()).collect();
        let rows = of_others(coldest.iter().map(|level| &level.z));
        let Some(reference) = self.resembling(rows, target.dim()) else {
            return;
        };
        self.one_metric();
        let rungs = self.rungs.len();
        for slot in 0..self.slots.len() {
            let (ladder, k) = (slot / rungs, slot % rungs);
            let level = coldest[ladder % coldest.len()];
            let turn = k * self.settings.ladders + ladder;
            let members = level.ln_likelihood.len();
            let most = rungs * self.settings.ladders;
            self.slots[slot].point = level.point(turn * members / most);
        }
        self.take_reference(reference);
    }

    /// The reference that resembles new halves of draws, and what is kept of those before; none if there are too few.
    fn resembling(&mut self, halves: [Vec<f64>; 2], dim: usize) -> Option<Reference> {
        for (known, new) in self.training.iter_mut().zip(halves) {
            *known = thinned(known, dim, MOST_TRAINING / 2);
            known.extend(thinned(&new, dim, MOST_TRAINING));
        }
        let rng = |count: usize| stream(self.seed, Domain::PtReference, self.clock, count as u64);
        Reference::resembling(&self.training, dim, rng)
    }

    /// Ladders begin at this reference from now on.
    fn take_reference(&mut self, reference: Reference) {
        for slot in &mut self.slots {
            slot.point.tilt = reference.tilt(&slot.point.z);
            slot.point.has_gradient = false;
        }
        self.reference = reference;
    }

    /// Explores one slot: a fresh draw at beta = 0; symmetries, then slices, then Hamiltonian moves elsewhere.
    fn explore(&self, target: &dyn Target, slot: usize) -> Result<Explored> {
        let rung = &self.rungs[slot % self.rungs.len()];
        let mut rng = self.stream(Domain::PtExplore, slot, self.clock + 1);
        let evaluator = Evaluator::from_reference(target, &self.reference);
        let mut explorer = Explorer::of(evaluator, rung.beta, &rung.metric);
        let mut point = self.slots[slot].point.clone();
        let mut local = Local::default();
        let mut trail = Vec::new();
        let cold = (slot + 1).is_multiple_of(self.rungs.len());
        let mut visit = |at: &Point| {
            if cold && self.mixture_next() {
                trail.extend_from_slice(&at.z);
            }
        };
        if slot.is_multiple_of(self.rungs.len()) {
            explorer.evaluator.draw_reference(&mut point.z, &mut rng)?;
            point.ln_likelihood = explorer.evaluator.value(&point.z)?;
            point.tilt = self.reference.tilt(&point.z);
            point.has_gradient = false;
        } else {
            let family = slot / self.rungs.len() % self.settings.families();
            let (metric, pool) = (&rung.metric, &rung.pools[family % 2]);
            let (evaluator, slices) = (&mut explorer.evaluator, self.settings.slices);
            hmc::explore_by_slices(
                evaluator, rung.beta, metric, pool, slices, &mut point, &mut rng, &mut visit,
            )?;
            let plan = self.plan(rung);
            for _ in 0..self.settings.moves {
                let moved = if self.settings.no_u_turn && !self.is_early_round() {
                    explorer.no_u_turn(&mut point, &plan, &mut rng)?
                } else {
                    explorer.transition(&mut point, &plan, &mut rng)?
                };
                local.note(&moved);
                visit(&point);
            }
        }
        let mut tally = Tally::default();
        tally.add(&explorer.evaluator);
        Ok(Explored {
            point,
            local,
            tally,
            trail,
        })
    }

    fn plan(&self, rung: &Rung) -> Plan {
        let early = self.is_early_round();
        let most = self.settings.max_leapfrogs;
        Plan {
            step: rung.step.step(),
            length: self.settings.trajectory,
            max_leapfrogs: if early {
                most.min(EARLY_LEAPFROGS)
            } else {
                most
            },
            max_energy_range: if early {
                f64::INFINITY
            } else {
                MAX_ENERGY_RANGE
            },
            slack: if early { EARLY_SLACK } else { 0.0 },
        }
    }

    /// Even gaps in even scans, odd gaps in odd ones.
    fn swap(&mut self, ladder: usize, beta: &[f64]) {
        let rungs = beta.len();
        for gap in (self.scan % 2..rungs - 1).step_by(2) {
            let hot = ladder * rungs + gap;
            let l = |slot: usize| self.slots[slot].point.ln_ratio();
            let accept = swap::acceptance(beta[gap + 1] - beta[gap], l(hot), l(hot + 1));
            let mut rng = self.stream(Domain::PtSwap, hot, self.clock);
            if unit_open(&mut rng) < accept {
                self.slots.swap(hot, hot + 1);
            }
        }
        self.record.journeys[ladder].note(
            self.slots[ladder * rungs].machine,
            self.slots[(ladder + 1) * rungs - 1].machine,
        );
    }

    /// Ends a round: new temperatures, metrics and steps from what it recorded, and states carried over.
    fn adapt(&mut self, target: &dyn Target) {
        let dim = target.dim();
        let orbit = Symmetry::first_orbit(target.symmetries());
        let old = barrier(&self.record.mean_rejection());
        let total = old[old.len() - 1];
        self.history.push(Finished {
            barrier: total,
            ln_z: self.evidence().ln_z,
        });
        if self.settings.annealing > 0 && self.is_early_round() {
            // What populations tell of temperatures, metrics and directions is better than what a few scans do.
            for rung in &mut self.rungs {
                rung.step = StepSize::new(rung.step.ln_found().exp());
            }
            self.next_reference(target);
            self.next_round(dim);
            return;
        }
        let (beta, found) = (self.beta(), self.found(dim));
        let count = self.next_temperatures(total);
        let schedule = respaced(&beta, &old, count);
        // Where a new temperature lies among the old ones.
        let places: Vec<(usize, f64)> = (0..count)
            .map(|k| locate(&old, total * k as f64 / (count - 1) as f64))
            .collect();
        let nearest = |(i, t): (usize, f64)| i + usize::from(t >= 0.5);
        self.rungs = schedule
            .into_iter()
            .zip(&places)
            .map(|(beta, &(i, t))| {
                let ln_step = found[i].1 * (1.0 - t) + found[i + 1].1 * t;
                Rung {
                    beta,
                    metric: found[i].0.between(&found[i + 1].0, t),
                    step: StepSize::new(ln_step.exp()),
                    pools: of_others(self.record.visits[nearest((i, t))].iter())
                        .map(|rows| Neighbours::new(&rows, dim, orbit)),
                }
            })
            .collect();
        self.slots = (0..self.settings.ladders * count)
            .map(|slot| {
                let (ladder, k) = (slot / count, slot % count);
                let from = if count == beta.len() {
                    k
                } else {
                    nearest(places[k])
                };
                Slot {
                    point: self.slots[ladder * beta.len() + from].point.clone(),
                    machine: k,
                }
            })
            .collect();
        self.next_reference(target);
        self.next_round(dim);
    }

    /// In the last rounds, if asked for: a reference that resembles what the round just ended has drawn at beta = 1.
    fn next_reference(&mut self, target: &dyn Target) {
        if !self.mixture_next() {
            return;
        }
        let rows = of_others(self.record.trails.iter());
        // Of draws that no mixture fits, none is made: the path stays what it was, and the result says so.
        let Some(reference) = self.resembling(rows, target.dim()) else {
            return;
        };
        if self.reference.is_prior() {
            self.leave_prior();
        }
        self.take_reference(reference);
    }

    /// Every temperature of a path from a reference that resembles the posterior is like the coldest, to begin with.
    fn one_metric(&mut self) {
        let rungs = self.rungs.len();
        let cold = self.rungs[rungs - 1].clone();
        for (rung, beta) in self.rungs.iter_mut().zip(first_schedule(rungs)) {
            *rung = Rung {
                beta,
                ..cold.clone()
            };
        }
    }

    /// Has all temperatures begin where the coldest has been.
    fn leave_prior(&mut self) {
        self.one_metric();
        let rungs = self.rungs.len();
        let last = self.record.traces.rungs() - 1;
        let dim = self.slots[0].point.z.len();
        for (slot, place) in self.slots.iter_mut().enumerate() {
            let (ladder, k) = (slot / rungs, slot % rungs);
            let trace = self.record.traces.of(ladder, last);
            let row = (trace.len() * (k + 1)).div_ceil(rungs) - 1;
            let z = &self.record.draws[ladder][row * dim..(row + 1) * dim];
            place.point.z.copy_from_slice(z);
            place.point.ln_likelihood = trace[row];
        }
    }

    fn next_round(&mut self, dim: usize) {
        self.round += 1;
        self.scan = 0;
        self.record = self.new_record(dim, self.round);
    }

    fn new_record(&self, dim: usize, round: usize) -> Record {
        let (ladders, families) = (self.settings.ladders, self.settings.families());
        let scans = self.settings.scans(round);
        Record::new(dim, ladders, families, self.rungs.len(), scans)
    }

    /// `1 + ceil(2 barrier)` temperatures make a round trip cheapest (Syed et al. 2022); their number is left alone
    /// in early rounds, which know the barrier badly, and before the last, which must be in equilibrium.
    fn next_temperatures(&self, barrier: f64) -> usize {
        let settled = self.settings.scans(self.round) >= EARLY_SCANS;
        if !settled || self.round + 2 >= self.settings.rounds {
            return self.rungs.len();
        }
        self.enough_temperatures(barrier)
    }

    fn enough_temperatures(&self, barrier: f64) -> usize {
        let (least, most) = (
            self.settings.min_temperatures,
            self.settings.max_temperatures,
        );
        (least..most)
            .find(|n| (*n - 1) as f64 >= 2.0 * barrier)
            .unwrap_or(most)
    }

    /// The metric and the logarithm of the step that the round just ended found for each of its temperatures.
    fn found(&self, dim: usize) -> Vec<(Metric, f64)> {
        let moments = &self.record.moments;
        let enough = 10.0 * dim as f64;
        self.rungs
            .iter()
            .enumerate()
            .map(|(k, rung)| {
                let mut pooled = moments[k].clone();
                if k > 0 && pooled.weight < enough {
                    for neighbour in [k - 1, k + 1] {
                        if let Some(other) = moments.get(neighbour).filter(|m| m.weight > 1.0) {
                            pooled.pool(other, 0.5);
                        }
                    }
                }
                let metric = if k == 0 {
                    None
                } else {
                    rung.metric.refined(&pooled)
                };
                let metric = metric.unwrap_or_else(|| rung.metric.clone());
                let ln_step = rung.step.ln_found() - rung.metric.ln_stretch(&metric);
                (metric, ln_step)
            })
            .collect()
    }
}

/// At most so many rows of coordinates, spread evenly over those given.
fn thinned(rows: &[f64], dim: usize, most: usize) -> Vec<f64> {
    let count = rows.len() / dim;
    let kept = count.min(most);
    let row = |k: usize| &rows[k * count / kept * dim..][..dim];
    (0..kept).flat_map(row).copied().collect()
}
