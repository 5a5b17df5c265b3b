//! The whole of a run between two scans: what a checkpoint holds and a scan advances.

mod adapt;

use super::evidence::{Estimate, Traces, estimate};
use super::record::{Local, Record};
use super::schedule::first_schedule;
use super::smc::{Level, SmcSamplers};
use super::{Settings, swap};
use crate::checkpointer::Time;
use crate::control::Event;
use crate::difference_pool::DifferencePool;
use crate::error::{Error, Result};
use crate::hmc::{self, Evaluator, LocalSampler, Metric, Plan, Point, Reference, StepSize, Tally};
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

/// Fraction of a fall that an energy error may be in an early round.
const EARLY_SLACK: f64 = 0.05;

/// Energy range of a path that marks it as divergent in all other rounds.
const MAX_ENERGY_RANGE: f64 = 1000.0;

/// One temperature.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Temperature {
    pub(super) beta: f64,
    metric: Metric,
    pub(super) step: StepSize,
    /// Where the round before stood at this temperature: its odd clusters for the even ones, and the other way round.
    pools: [DifferencePool; 2],
}

/// One place of one chain set: states stay, replicas travel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Chain {
    point: Point,
    replica: usize,
}

/// What a finished round came to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Finished {
    pub(super) communication_barrier: f64,
    pub(super) ln_z: f64,
}

/// See the module's words.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct State {
    settings: Settings,
    pub(super) seed: u64,
    /// The SMC samplers that the chain sets start from, until they are cold.
    smc_samplers: Option<SmcSamplers>,
    /// Present round, and its scans done.
    pub(super) round: usize,
    pub(super) scan: usize,
    /// Times that the last round has gone on for as long again.
    extensions: usize,
    /// Scans done in all rounds: the index of the random streams.
    clock: u64,
    /// Where the chain sets begin.
    pub(super) reference: Reference,
    /// The halves of the draws that it was fitted to.
    training: [Vec<f64>; 2],
    pub(super) temperatures: Vec<Temperature>,
    /// Chain-set-major.
    chains: Vec<Chain>,
    pub(super) record: Record,
    pub(super) history: Vec<Finished>,
    pub(super) tally: Tally,
    pub(super) time: Time,
}

/// What exploring one chain gave.
struct Explored {
    point: Point,
    local: Local,
    tally: Tally,
    /// Every place on the way, where a mixture is to be fitted to them.
    trail: Vec<f64>,
}

impl State {
    /// Draws every chain from the prior, again and again until it has a likelihood where it needs one.
    pub(super) fn start(target: &dyn Target, settings: &Settings, seed: u64) -> Result<Self> {
        let dim = target.dim();
        let schedule = first_schedule(settings.temperatures);
        let temperatures: Vec<Temperature> = schedule
            .iter()
            .map(|&beta| Temperature {
                beta,
                metric: Metric::identity(dim),
                step: StepSize::new(0.5),
                pools: Default::default(),
            })
            .collect();
        let mut state = Self {
            settings: settings.clone(),
            seed,
            smc_samplers: None,
            round: 0,
            scan: 0,
            extensions: 0,
            clock: 0,
            reference: Reference::default(),
            training: Default::default(),
            record: Record::new(
                dim,
                settings.chain_sets,
                settings.clusters(),
                &schedule,
                settings.scans(0),
            ),
            chains: Vec::new(),
            temperatures,
            history: Vec::new(),
            tally: Tally::default(),
            time: Time::default(),
        };
        if settings.smc_particles > 0 {
            let clusters = settings.clusters();
            let smc_samplers =
                state.first_points(target, clusters, settings.particles_per_sampler())?;
            state.smc_samplers = Some(SmcSamplers::new(smc_samplers));
            return Ok(state);
        }
        let temperatures = state.temperatures.len();
        for chain_set in state.first_points(target, settings.chain_sets, temperatures)? {
            state.chains.extend(
                chain_set
                    .into_iter()
                    .enumerate()
                    .map(|(replica, point)| Chain { point, replica }),
            );
        }
        Ok(state)
    }

    /// As many draws of the prior for each chain set, or for each SMC sampler; all have a likelihood but the first of a
    /// chain set, which becomes the one at beta = 0.
    fn first_points(
        &mut self,
        target: &dyn Target,
        chain_sets: usize,
        per_chain_set: usize,
    ) -> Result<Vec<Vec<Point>>> {
        let mut evaluator = Evaluator::new(target);
        let mut points = vec![Point::new(target.dim()); chain_sets * per_chain_set];
        let mut streams: Vec<Stream> = (0..points.len())
            .map(|i| {
                let task = ((i / per_chain_set) << 20) + i % per_chain_set;
                stream(self.seed, Domain::PtExplore, task as u64, 0)
            })
            .collect();
        let prior = |i: usize| i.is_multiple_of(per_chain_set) && self.settings.smc_particles == 0;
        let mut wanting: Vec<usize> = (0..points.len()).collect();
        let (mut tries, mut found) = (0, 0);
        while !wanting.is_empty() {
            for &i in &wanting {
                evaluator.draw_reference(&mut points[i].z, &mut streams[i]);
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
        Ok(points
            .chunks(per_chain_set)
            .map(<[Point]>::to_vec)
            .collect())
    }

    /// The stream of chain or gap number `index` (chain-set-major over temperatures) at a scan.
    fn stream(&self, domain: Domain, index: usize, scan: u64) -> Stream {
        let temperatures = self.temperatures.len();
        let task = ((index / temperatures) << 20) + index % temperatures;
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
    pub(super) fn smc_samplers(&self) -> bool {
        self.smc_samplers.is_some()
    }

    /// Whether the present round has anything to show.
    pub(super) fn scanned(&self) -> bool {
        self.scan > 0
    }

    pub(super) fn is_last_round(&self) -> bool {
        self.round + 1 == self.settings.rounds
    }

    /// Groups of chain sets that are independent of each other.
    pub(super) fn clusters(&self) -> usize {
        self.settings.clusters()
    }

    /// Whether slices explore beside HMC transitions.
    pub(super) fn slices(&self) -> bool {
        self.settings.slice_updates > 0
    }

    /// Whether the chain sets of this round were to begin at a mixture.
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
        self.temperatures
            .iter()
            .map(|temperature| temperature.beta)
            .collect()
    }

    pub(super) fn evidence(&self) -> Estimate {
        let extensions = self.record.telling();
        let extensions: Vec<(&[f64], &Traces)> = extensions
            .map(|extension| (extension.beta.as_slice(), &extension.traces))
            .collect();
        estimate(&extensions, self.settings.clusters())
    }

    /// What an observer is told after a scan; evidence and communication barrier are NaN before a round has finished.
    pub(super) fn progress(&self) -> Event {
        if let Some(smc_samplers) = &self.smc_samplers {
            let (beta, ln_z) = smc_samplers.progress();
            let calls = self.tally.calls;
            return Event::Smc { beta, ln_z, calls };
        }
        let last = self.history.last();
        Event::Tempered {
            round: self.round,
            scan: self.scan.saturating_sub(1),
            scans: self.scans(),
            communication_barrier: last.map_or(f64::NAN, |r| r.communication_barrier),
            round_trips: self.record.round_trips(),
            ln_z: last.map_or(f64::NAN, |r| r.ln_z),
            gradients: self.tally.gradients,
        }
    }

    /// One scan, and the adaptation before it if a round has just ended. On an error the state is that before the
    /// scan.
    pub(super) fn advance(&mut self, target: &dyn Target) -> Result<()> {
        if let Some(smc_samplers) = &mut self.smc_samplers {
            let mcmc_steps = self.settings.mcmc_steps(target.dim());
            let tally = smc_samplers.advance(target, mcmc_steps, self.seed)?;
            self.tally.merge(&tally);
            if smc_samplers.done() {
                let levels: Vec<Vec<Level>> =
                    smc_samplers.levels().map(<[Level]>::to_vec).collect();
                self.begin(&levels, target);
                self.smc_samplers = None;
            }
            return Ok(());
        }
        if self.scan == self.scans() {
            self.adapt(target);
        }
        let explored: Vec<Result<Explored>> = (0..self.chains.len())
            .into_par_iter()
            .map(|chain| self.explore(target, chain))
            .collect();
        let explored: Vec<Explored> = explored.into_iter().collect::<Result<_>>()?;

        let temperatures = self.temperatures.len();
        let mut locals = vec![Local::default(); temperatures];
        for (index, explored) in explored.into_iter().enumerate() {
            self.chains[index].point = explored.point;
            locals[index % temperatures].add(&explored.local);
            self.record.trails[index / temperatures].extend(explored.trail);
            self.tally.merge(&explored.tally);
        }
        self.clock += 1;
        let beta = self.beta();
        for chain_set in 0..self.settings.chain_sets {
            let points = self.chains[chain_set * temperatures..(chain_set + 1) * temperatures]
                .iter()
                .map(|chain| &chain.point);
            self.record.extension_mut().note(chain_set, points);
            self.swap(chain_set, &beta);
        }
        let (frozen, early) = (self.is_last_round(), self.is_early_round());
        let scans = self.scans();
        for (temperature, local) in locals.iter().enumerate() {
            self.record.extension_mut().locals[temperature].add(local);
            if frozen || temperature == 0 {
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
                self.temperatures[temperature].step.learn(
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

    /// Explores one chain: a fresh draw at beta = 0; symmetries, then slices, then HMC transitions elsewhere.
    fn explore(&self, target: &dyn Target, chain: usize) -> Result<Explored> {
        let temperature = &self.temperatures[chain % self.temperatures.len()];
        let mut rng = self.stream(Domain::PtExplore, chain, self.clock + 1);
        let evaluator = Evaluator::from_reference(target, &self.reference);
        let mut local_sampler = LocalSampler::of(evaluator, temperature.beta, &temperature.metric);
        let mut point = self.chains[chain].point.clone();
        let mut local = Local::default();
        let mut trail = Vec::new();
        let cold = (chain + 1).is_multiple_of(self.temperatures.len());
        let trailed = cold && self.mixture_next() && !self.is_last_round();
        let mut visit = |at: &Point| {
            if trailed {
                trail.extend_from_slice(&at.z);
            }
        };
        if chain.is_multiple_of(self.temperatures.len()) {
            local_sampler
                .evaluator
                .draw_reference(&mut point.z, &mut rng);
            point.ln_likelihood = local_sampler.evaluator.value(&point.z)?;
            point.ln_over_prior = self.reference.ln_over_prior(&point.z);
            point.has_gradient = false;
        } else {
            let cluster = chain / self.temperatures.len() % self.settings.clusters();
            let (metric, pool) = (&temperature.metric, &temperature.pools[cluster % 2]);
            let (evaluator, slices) = (&mut local_sampler.evaluator, self.settings.slice_updates);
            hmc::involutions_and_slice_updates(
                evaluator,
                temperature.beta,
                metric,
                pool,
                slices,
                &mut point,
                &mut rng,
                &mut visit,
            )?;
            let plan = self.plan(temperature);
            for _ in 0..self.settings.hmc_transitions {
                let moved = local_sampler.transition(&mut point, &plan, &mut rng)?;
                local.note(&moved);
                visit(&point);
            }
        }
        Ok(Explored {
            point,
            local,
            tally: Tally::of(&local_sampler.evaluator),
            trail,
        })
    }

    fn plan(&self, temperature: &Temperature) -> Plan {
        let early = self.is_early_round();
        let most = self.settings.max_leapfrogs;
        Plan {
            step: temperature.step.step(),
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
    fn swap(&mut self, chain_set: usize, beta: &[f64]) {
        let temperatures = beta.len();
        for gap in (self.scan % 2..temperatures - 1).step_by(2) {
            let hot = chain_set * temperatures + gap;
            let l = |chain: usize| self.chains[chain].point.ln_ratio();
            let accept = swap::acceptance(beta[gap + 1] - beta[gap], l(hot), l(hot + 1));
            let mut rng = self.stream(Domain::PtSwap, hot, self.clock);
            if unit_open(&mut rng) < accept {
                self.chains.swap(hot, hot + 1);
            }
        }
        self.record.extension_mut().index_processes[chain_set].note(
            self.chains[chain_set * temperatures].replica,
            self.chains[(chain_set + 1) * temperatures - 1].replica,
        );
    }

    fn next_round(&mut self, dim: usize) {
        self.round += 1;
        self.scan = 0;
        self.record = self.new_record(dim, self.round);
    }

    fn new_record(&self, dim: usize, round: usize) -> Record {
        let (chain_sets, clusters) = (self.settings.chain_sets, self.settings.clusters());
        let scans = self.settings.scans(round);
        Record::new(dim, chain_sets, clusters, &self.beta(), scans)
    }
}
