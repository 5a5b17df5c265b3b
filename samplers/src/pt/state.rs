//! The whole of a run between two scans: what a checkpoint holds and a scan advances.

mod adapt;

use super::anneal::{Annealing, Level};
use super::evidence::{Estimate, Traces, estimate};
use super::ladder::first_schedule;
use super::record::{Local, Record};
use super::{Settings, swap};
use crate::control::Event;
use crate::error::{Error, Result};
use crate::hmc::{self, Evaluator, Explorer, Metric, Plan, Point, Reference, StepSize, Tally};
use crate::keeper::Time;
use crate::neighbours::Neighbours;
use crate::rng::{Domain, Stream, stream, unit_open};
use crate::target::Target;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// A target where fewer draws of the prior than one in so many have a likelihood is taken to have none.
const START_TRIES: usize = 100_000;

/// A round of fewer scans is early: it only has to find the scales, so its trajectories are short, and energies far
/// from equilibrium may vary as they like.
const EARLY_SCANS: usize = 32;

/// Most leapfrog steps of a move in an early round.
const EARLY_LEAPFROGS: usize = 32;

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
        let schedule = first_schedule(settings.temperatures);
        let rungs: Vec<Rung> = schedule
            .iter()
            .map(|&beta| Rung {
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
                &schedule,
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
                return Err(Error::NoStart {
                    tries,
                    cause: Tally::of(&evaluator).main_cause(),
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

    /// Whether the last round is done, as far as it has gone on.
    pub(super) fn finished(&self) -> bool {
        self.is_last_round() && self.scan == self.scans()
    }

    /// The same state, whose last round may go on so many times.
    pub(super) fn allowed(mut self, extensions: usize) -> Self {
        self.settings.extensions = extensions;
        self
    }

    /// Whether the last round may go on once it is done.
    pub(super) fn may_extend(&self) -> bool {
        self.extensions < self.settings.extensions
    }

    /// Lets the last round go on for as long again: frozen as it is on a path from the prior, fitted anew on one from a mixture.
    pub(super) fn go_on(&mut self, target: &dyn Target) {
        self.extensions += 1;
        if self.mixture_next() {
            self.adapt(target);
        }
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

    /// Whether a mixture is to be fitted to what this round draws. The last but one does without: the last keeps the mixture that it
    /// has, and with it the temperatures that the round before has found on the same path.
    fn mixture_next(&self) -> bool {
        if self.is_last_round() {
            return self.settings.mixture_rounds > 0;
        }
        let next = self.round + 1;
        self.settings.mixes(next) && (next + 1 < self.settings.rounds || self.reference.is_prior())
    }

    fn is_early_round(&self) -> bool {
        !self.is_last_round() && self.settings.scans(self.round) < EARLY_SCANS
    }

    pub(super) fn beta(&self) -> Vec<f64> {
        self.rungs.iter().map(|rung| rung.beta).collect()
    }

    pub(super) fn evidence(&self) -> Estimate {
        let legs = self.record.telling();
        let legs: Vec<(&[f64], &Traces)> =
            legs.map(|leg| (leg.beta.as_slice(), &leg.traces)).collect();
        estimate(&legs, self.settings.families())
    }

    /// What an observer is told after a scan; evidence and barrier are NaN before a round has finished.
    pub(super) fn progress(&self) -> Event {
        if let Some(annealing) = &self.annealing {
            let (beta, ln_z) = annealing.progress();
            let calls = self.tally.calls;
            return Event::Smc { beta, ln_z, calls };
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
            self.record.leg_mut().note(ladder, points);
            self.swap(ladder, &beta);
        }
        let (frozen, early) = (self.is_last_round(), self.is_early_round());
        let scans = self.scans();
        for (rung, local) in locals.iter().enumerate() {
            self.record.leg_mut().locals[rung].add(local);
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
        let trailed = cold && self.mixture_next() && !self.is_last_round();
        let mut visit = |at: &Point| {
            if trailed {
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
        Ok(Explored {
            point,
            local,
            tally: Tally::of(&explorer.evaluator),
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
        self.record.leg_mut().journeys[ladder].note(
            self.slots[ladder * rungs].machine,
            self.slots[(ladder + 1) * rungs - 1].machine,
        );
    }

    fn next_round(&mut self, dim: usize) {
        self.round += 1;
        self.scan = 0;
        self.record = self.new_record(dim, self.round);
    }

    fn new_record(&self, dim: usize, round: usize) -> Record {
        let (ladders, families) = (self.settings.ladders, self.settings.families());
        let scans = self.settings.scans(round);
        Record::new(dim, ladders, families, &self.beta(), scans)
    }
}
