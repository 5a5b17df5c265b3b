//! One scan: local moves of every chain, then swaps of neighbouring temperatures.

use super::path::{self, CORNER};
use super::record::{Local, Record};
use super::schedule::first_schedule;
use super::smc::{Level, SmcSamplers};
use super::state::{Chain, State, Targets, Temperature};
use super::surrogate_points::states_near_posterior;
use super::{Settings, swap};
use crate::error::{Error, Result};
use crate::hmc::{self, Evaluator, LocalSampler, Metric, Plan, Point, StepSize};
use crate::output::{Calls, Cost};
use crate::rng::{Domain, RandomStream, stream, unit_open};
use crate::surrogate::Examples;
use crate::target::Target;
use rayon::prelude::*;

/// Maximum number of draws of the prior in search of one with a likelihood.
const START_TRIES: usize = 100_000;

/// Maximum number of leapfrog steps of a transition in an early round.
const EARLY_LEAPFROGS: usize = 32;

/// Energy error of an early round that is accepted, as a fraction of the depth that a trajectory descended.
const EARLY_SLACK: f64 = 0.05;

/// HMC transitions along the surrogate where the reference has a weight, in units of those at the surrogate's posterior.
const WITH_REFERENCE: f64 = 0.4;

/// Moves along the surrogate in each scan, at each temperature between it and ln L. Each costs a value, and has half of the transitions of a
/// scan at the surrogate's posterior: effective draws grow with the number of moves, and hardly with that of transitions.
const MOVES_TO_TARGET: usize = 3;

/// Energy range of a trajectory above which it is divergent, in all other rounds.
const MAX_ENERGY_RANGE: f64 = 1000.0;

/// Result of the moves of one chain in one scan.
struct Explored {
    point: Point,
    local: Local,
    calls: Calls,
    /// Every state on the way, if a mixture is to be fitted to them.
    trail: Vec<f64>,
    /// Values of ln L on the way, if a surrogate is to be fitted to them.
    examples: Examples,
}

impl State {
    /// Draws every chain from the prior, repeatedly until it has a likelihood where it needs one.
    pub(super) fn start(targets: Targets<'_>, settings: &Settings, seed: u64) -> Result<Self> {
        let dim = targets.target.dim();
        let schedule = first_schedule(settings.temperatures);
        let temperatures: Vec<Temperature> = schedule
            .iter()
            .map(|&place| Temperature {
                place,
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
            equilibrating: 0,
            extensions: 0,
            passed_before: false,
            clock: 0,
            references: Default::default(),
            training: Default::default(),
            surrogate: None,
            examples: Default::default(),
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
            cost: Cost::default(),
        };
        if settings.smc_particles > 0 {
            let clusters = settings.clusters();
            let smc_samplers =
                state.first_points(targets.coarse, clusters, settings.particles_per_sampler())?;
            state.smc_samplers = Some(SmcSamplers::new(smc_samplers));
            return Ok(state);
        }
        let temperatures = state.temperatures.len();
        for chain_set in state.first_points(targets.target, settings.chain_sets, temperatures)? {
            state.chains.extend(
                chain_set
                    .into_iter()
                    .enumerate()
                    .map(|(replica, point)| Chain { point, replica }),
            );
        }
        Ok(state)
    }

    /// Draws of the prior for each chain set, or for each SMC sampler; all have a likelihood but the first of a chain
    /// set, which becomes the one at beta = 0.
    fn first_points(
        &mut self,
        target: &dyn Target,
        chain_sets: usize,
        per_chain_set: usize,
    ) -> Result<Vec<Vec<Point>>> {
        let mut evaluator = Evaluator::new(target);
        let mut points = vec![Point::new(target.dim()); chain_sets * per_chain_set];
        let mut streams: Vec<RandomStream> = (0..points.len())
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
                    cause: {
                        self.cost.count(&evaluator.calls);
                        self.cost.main_cause()
                    },
                });
            }
        }
        self.cost.count(&evaluator.calls);
        Ok(points
            .chunks(per_chain_set)
            .map(<[Point]>::to_vec)
            .collect())
    }

    /// The random stream of chain or pair number `index` (chain-set-major over temperatures) at a scan.
    fn stream(&self, domain: Domain, index: usize, scan: u64) -> RandomStream {
        let temperatures = self.temperatures.len();
        let task = ((index / temperatures) << 20) + index % temperatures;
        stream(self.seed, domain, task as u64, scan)
    }

    /// Extends the last round: with the same settings on a path from the prior, with settings fitted anew on a path from
    /// a mixture, and along a surrogate that is fitted anew. `passed` says whether all checks of the draws so far have passed. On an error
    /// nothing has changed.
    pub(super) fn go_on(&mut self, targets: Targets<'_>, passed: bool) -> Result<()> {
        self.changed(|next| {
            next.passed_before = next.looks_passed(passed) > 0;
            next.extensions += 1;
            if next.mixture_next() {
                next.next_surrogate(targets.coarse, next.visited_states())?;
                next.adapt(targets.target)?;
            }
            Ok(())
        })
    }

    /// Changes the state, or not at all on an error.
    fn changed(&mut self, change: impl FnOnce(&mut Self) -> Result<()>) -> Result<()> {
        let mut next = self.clone();
        change(&mut next)?;
        *self = next;
        Ok(())
    }

    /// One scan, and the adaptation before it if a round has just ended. On an error the state is that before the
    /// scan.
    pub(super) fn advance(&mut self, targets: Targets<'_>) -> Result<()> {
        let Targets { target, coarse } = targets;
        if let Some(mut smc_samplers) = self.smc_samplers.take() {
            let advanced = self.advance_smc(&mut smc_samplers, targets);
            if self.chains.is_empty() {
                self.smc_samplers = Some(smc_samplers);
            }
            return advanced;
        }
        if self.scan == self.scans() {
            self.changed(|next| {
                next.next_surrogate(coarse, next.visited_states())?;
                next.adapt(target)
            })?;
        }
        let explored: Vec<Result<Explored>> = (0..self.chains.len())
            .into_par_iter()
            .map(|chain| self.explore(target, chain))
            .collect();
        let explored: Vec<Explored> = explored.into_iter().collect::<Result<_>>()?;

        let temperatures = self.temperatures.len();
        let counts = self.equilibrating == 0;
        let mut locals = vec![Local::default(); temperatures];
        for (index, explored) in explored.into_iter().enumerate() {
            self.chains[index].point = explored.point;
            locals[index % temperatures].add(&explored.local);
            self.record.trails[index / temperatures].extend(explored.trail);
            self.cost.count(&explored.calls);
            self.examples.append(explored.examples);
        }
        self.clock += 1;
        let places = self.places();
        for chain_set in 0..self.settings.chain_sets {
            let points = self.chains[chain_set * temperatures..(chain_set + 1) * temperatures]
                .iter()
                .map(|chain| &chain.point);
            if counts {
                self.record.extension_mut().note(chain_set, points);
            }
            self.swap(chain_set, &places);
        }
        if !counts {
            self.equilibrating -= 1;
            return Ok(());
        }
        let (frozen, early) = (self.is_last_round(), self.is_early_round());
        let scans = self.scans();
        for (temperature, local) in locals.iter().enumerate() {
            self.record.extension_mut().locals[temperature].add(local);
            if frozen || temperature == 0 {
                continue;
            }
            // In later rounds a rejected point is taken for a discontinuity of the likelihood, for which no step is
            // short enough; in an early round it may be the overflow of a step that is far too long.
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

    /// One MCMC step of the SMC samplers, and the beginning of the first round once they have reached the posterior.
    fn advance_smc(&mut self, smc_samplers: &mut SmcSamplers, targets: Targets<'_>) -> Result<()> {
        let Targets { target, coarse } = targets;
        if !smc_samplers.done() {
            let mcmc_steps = self.settings.mcmc_steps(target.dim());
            let learns = self.settings.surrogate_points > 0;
            let (calls, examples) = smc_samplers.advance(coarse, mcmc_steps, self.seed, learns)?;
            self.cost.count(&calls);
            self.examples.append(examples);
            self.examples.keep_last(self.settings.examples_kept());
        }
        if smc_samplers.done() {
            let levels: Vec<Vec<Level>> = smc_samplers.levels().map(<[Level]>::to_vec).collect();
            let states = states_near_posterior(&levels, target.dim());
            self.changed(|next| {
                next.next_surrogate(coarse, states)?;
                next.begin(&levels, target)
            })?;
        }
        Ok(())
    }

    /// Local moves of one chain: an independent draw at beta = 0; else involutions and redraws along orbits, slice
    /// updates, then HMC transitions. Between a surrogate and ln L, moves along the surrogate.
    fn explore(&self, target: &dyn Target, chain: usize) -> Result<Explored> {
        let temperature = &self.temperatures[chain % self.temperatures.len()];
        let (place, metric) = (temperature.place, &temperature.metric);
        let beta = path::beta(place);
        let mut rng = self.stream(Domain::PtExplore, chain, self.clock + 1);
        let surrogate = self.surrogate.as_ref();
        let evaluator = Evaluator::from_reference(target, self.reference(chain));
        let mut evaluator = evaluator.with_surrogate(surrogate);
        let mut point = self.chains[chain].point.clone();
        let mut local = Local::default();
        let mut trail = Vec::new();
        let corner = place.to_bits() == CORNER.to_bits();
        let trailed = corner && self.mixture_next() && !self.is_last_round();
        let mut visit = |at: &Point| {
            if trailed {
                trail.extend_from_slice(&at.z);
            }
        };
        let mut of_target = Evaluator::new(target).keeping_examples(surrogate.is_some());
        if chain.is_multiple_of(self.temperatures.len()) {
            evaluator.draw_reference(&mut point.z, &mut rng);
            point.ln_likelihood = evaluator.value(&point.z)?;
            point.ln_over_prior = self.reference(chain).ln_over_prior(&point.z);
            point.has_gradient = false;
        } else if place > CORNER {
            let along = Evaluator::new(target).with_surrogate(surrogate);
            let mut along = LocalSampler::of(along, beta, metric);
            let plan = self.plan(temperature);
            for _ in 0..MOVES_TO_TARGET {
                hmc::surrogate_move(
                    &mut of_target,
                    &mut along,
                    path::fraction(place),
                    &plan,
                    self.settings.hmc_transitions.div_ceil(2),
                    &mut point,
                    &mut rng,
                    |moved| local.note(moved),
                )?;
            }
        } else {
            let pool = &temperature.pools[self.half(chain)];
            let slices = self.settings.slice_updates;
            hmc::involutions_and_slice_updates(
                &mut evaluator,
                beta,
                metric,
                pool,
                slices,
                &mut point,
                &mut rng,
                &mut visit,
            )?;
            let plan = self.plan(temperature);
            // At beta = 1 the reference has no weight, and its gradient costs more than that of a surrogate.
            let without_reference = corner && surrogate.is_some();
            if without_reference {
                evaluator = Evaluator::new(target).with_surrogate(surrogate);
            }
            let mut local_sampler = LocalSampler::of(evaluator, beta, metric);
            for _ in 0..self.transitions(beta) {
                let moved = local_sampler.transition(&mut point, &plan, &mut rng)?;
                local.note(&moved);
                visit(&point);
            }
            evaluator = local_sampler.evaluator;
            if without_reference {
                point.gap = of_target.value(&point.z)? - point.ln_likelihood;
            }
        }
        if surrogate.is_some() && place >= CORNER {
            let reference = self.reference(chain);
            point.ln_over_prior =
                reference.ln_over_prior_and_gradient(&point.z, &mut point.ln_over_prior_gradient);
        }
        let (mut calls, examples) = of_target.into_calls_and_examples();
        calls.add(&evaluator.calls);
        Ok(Explored {
            point,
            local,
            calls,
            trail,
            examples,
        })
    }

    /// HMC transitions at a temperature. Along a surrogate they are fewer where the reference has most of the weight, which costs
    /// more than the surrogate, and from which states are drawn anew.
    fn transitions(&self, beta: f64) -> usize {
        let most = self.settings.hmc_transitions;
        if self.surrogate.is_none() || beta >= CORNER {
            return most;
        }
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a few"
        )]
        let transitions = (WITH_REFERENCE * most as f64 * beta.sqrt()).ceil() as usize;
        transitions.max(1)
    }

    pub(super) fn plan(&self, temperature: &Temperature) -> Plan {
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

    /// Even pairs of temperatures in even scans, odd pairs in odd scans.
    fn swap(&mut self, chain_set: usize, places: &[f64]) {
        let temperatures = places.len();
        let parity = (self.scan + self.equilibrating) % 2;
        for gap in (parity..temperatures - 1).step_by(2) {
            let hot = chain_set * temperatures + gap;
            let l = |chain: usize| path::slope(&self.chains[chain].point, places[gap + 1]);
            let accept = swap::acceptance(places[gap + 1] - places[gap], l(hot), l(hot + 1));
            let mut rng = self.stream(Domain::PtSwap, hot, self.clock);
            if unit_open(&mut rng) < accept {
                self.chains.swap(hot, hot + 1);
            }
        }
        if self.equilibrating > 0 {
            return;
        }
        self.record.extension_mut().index_processes[chain_set].note(
            self.chains[chain_set * temperatures].replica,
            self.chains[(chain_set + 1) * temperatures - 1].replica,
        );
    }
}
