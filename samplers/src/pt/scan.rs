//! One scan: local moves of every chain, then swaps of neighbouring temperatures.

use super::record::{Local, Record};
use super::schedule::first_schedule;
use super::settings::EXAMPLES_KEPT;
use super::smc::{MovesAlong, SmcSamplers};
use super::state::{Chain, State, Temperature};
use super::surrogate_moves::surrogate_moves;
use super::{Settings, swap};
use crate::error::{Error, Result};
use crate::hmc::{self, Evaluator, LocalSampler, Metric, Point, Screened, StepSize};
use crate::output::{Calls, Cost};
use crate::rng::{Domain, RandomStream, stream, unit_open};
use crate::surrogate::Examples;
use crate::target::Target;
use rayon::prelude::*;

/// Maximum number of draws of the prior in search of one with a likelihood.
const START_TRIES: usize = 100_000;

/// Inverse temperature below which there are no moves along a surrogate: hardly any would be accepted.
const LEAST_BETA: f64 = 0.15;

/// Scans from involutions and a slice update of a chain with moves along a surrogate to the next. They cost more values than these
/// moves and go a small part of their way, but also where the surrogate is wrong (docs/decisions.md, section 3).
const SLICE_SCANS: u64 = 4;

/// Fits of the surrogate within a long extension, and least number of scans from one to the next (docs/decisions.md, section 2).
const SURROGATE_FITS: usize = 8;
const SURROGATE_SCANS: usize = 128;

/// Values of ln L that such a fit learns from: it begins with the surrogate of some hundred scans ago, which knows the others. All of them would cost an easy
/// run more than its values.
const EXAMPLES_REFITTED: usize = EXAMPLES_KEPT / 4;

/// About how many values of ln L a chain computes in a scan with moves along a surrogate.
const VALUES_OF_A_CHAIN: usize = 5;

/// Result of the moves of one chain in one scan.
struct Explored {
    point: Point,
    local: Local,
    /// Gradient of the log density that trajectories follow, if there are any.
    score: Option<Vec<f64>>,
    calls: Calls,
    /// The draws of a screened reference.
    screened: Screened,
    /// Every state on the way, if a mixture is to be fitted to them.
    trail: Vec<f64>,
    /// Values of ln L on the way, if a surrogate is to be fitted to them.
    examples: Examples,
}

impl State {
    /// Draws every chain from the prior, repeatedly until it has a likelihood where it needs one.
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
            passed_before: false,
            clock: 0,
            references: Default::default(),
            training: Vec::new(),
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

    /// Extends the last round: with the same settings on a path from the prior, with settings and surrogate fitted anew on a path from
    /// a mixture. `passed` says whether all checks of the draws so far have passed, and `ln_z` is their estimate. On an error nothing has
    /// changed.
    pub(super) fn go_on(&mut self, target: &dyn Target, passed: bool, ln_z: f64) -> Result<()> {
        self.changed(|next| {
            next.passed_before = next.looks_passed(passed) > 0;
            if next.burns_in() && !next.settled_at(ln_z) {
                next.record.lengthen_burn_in();
            }
            next.extensions += 1;
            if next.mixture_next() {
                next.next_surrogate(EXAMPLES_KEPT)?;
                next.adapt(target, ln_z)?;
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
    pub(super) fn advance(&mut self, target: &dyn Target) -> Result<()> {
        if let Some(mut smc_samplers) = self.smc_samplers.take() {
            let advanced = self.advance_smc(&mut smc_samplers, target);
            if self.chains.is_empty() {
                self.smc_samplers = Some(smc_samplers);
            }
            return advanced;
        }
        if self.scan == self.scans() || self.part_ended() {
            self.changed(|next| {
                next.next_surrogate(EXAMPLES_KEPT)?;
                next.adapt(target, next.evidence().ln_z)
            })?;
        }
        let explored: Vec<Result<Explored>> = (0..self.chains.len())
            .into_par_iter()
            .map(|chain| self.explore(target, chain))
            .collect();
        let explored: Vec<Explored> = explored.into_iter().collect::<Result<_>>()?;

        let temperatures = self.temperatures.len();
        let mut locals = vec![Local::default(); temperatures];
        for (index, explored) in explored.into_iter().enumerate() {
            if let Some(score) = explored.score {
                let temperature = index % temperatures;
                (self.record.part_mut()).note_score(temperature, &explored.point, score);
            }
            let traces = &mut self.record.part_mut().traces;
            traces.push_screened(index / temperatures, &explored.screened);
            self.chains[index].point = explored.point;
            locals[index % temperatures].add(&explored.local);
            self.record.trails[index / temperatures].extend(explored.trail);
            self.cost.count(&explored.calls);
            self.learn(explored.examples);
        }
        self.clock += 1;
        let beta = self.beta();
        for chain_set in 0..self.settings.chain_sets {
            let points = self.chains[chain_set * temperatures..(chain_set + 1) * temperatures]
                .iter()
                .map(|chain| &chain.point);
            self.record.part_mut().note(chain_set, points);
            self.swap(chain_set, &beta);
        }
        let (frozen, early) = (self.is_last_round(), self.is_early_round());
        let scans = self.scans();
        for (temperature, local) in locals.iter().enumerate() {
            self.record.part_mut().locals[temperature].add(local);
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
        if self.surrogate_due() {
            self.next_surrogate(EXAMPLES_REFITTED)?;
        }
        Ok(())
    }

    /// One MCMC step of the SMC samplers, and the beginning of the first round once they have reached the posterior.
    fn advance_smc(&mut self, smc_samplers: &mut SmcSamplers, target: &dyn Target) -> Result<()> {
        if !smc_samplers.done() {
            let mcmc_steps = self.settings.mcmc_steps(target.dim());
            let learns = self.settings.surrogate;
            if learns && smc_samplers.rests() {
                // Where ln L is finite at too few points, particles make slice updates.
                self.fit_surrogate(EXAMPLES_KEPT, smc_samplers.clock());
            }
            let moves_along = MovesAlong {
                surrogate: self.surrogate.as_ref(),
                target_acceptance: self.settings.target_acceptance,
            };
            let (calls, examples) =
                smc_samplers.advance(target, mcmc_steps, self.seed, learns, moves_along)?;
            self.cost.count(&calls);
            self.learn(examples);
        }
        if smc_samplers.done() {
            self.changed(|next| {
                next.next_surrogate(EXAMPLES_KEPT)?;
                next.begin(smc_samplers, target)
            })?;
        }
        Ok(())
    }

    /// Local moves of one chain: an independent draw at beta = 0; else involutions and redraws along orbits, slice
    /// updates, then moves along the surrogate, or HMC transitions without one.
    fn explore(&self, target: &dyn Target, chain: usize) -> Result<Explored> {
        let temperature = &self.temperatures[chain % self.temperatures.len()];
        let (beta, metric) = (temperature.beta, &temperature.metric);
        let mut rng = self.stream(Domain::PtExplore, chain, self.clock + 1);
        let evaluator = Evaluator::from_reference(target, self.reference(chain));
        let learns = self.surrogate.is_some() && self.clock.is_multiple_of(self.learn_every());
        let mut evaluator = evaluator.keeping_examples(learns);
        let mut point = self.chains[chain].point.clone();
        let mut local = Local::default();
        let mut score = None;
        let mut trail = Vec::new();
        let cold = (chain + 1).is_multiple_of(self.temperatures.len());
        let trailed = cold && self.mixture_next() && !self.is_last_round();
        let mut visit = |at: &Point| {
            if trailed {
                trail.extend_from_slice(&at.z);
            }
        };
        if chain.is_multiple_of(self.temperatures.len()) {
            evaluator.draw_reference(&mut point.z, &mut rng);
            point.ln_likelihood = evaluator.value(&point.z)?;
            point.ln_over_prior = evaluator.ln_over_prior(&point.z);
            point.has_gradient = false;
        } else {
            let pool = &temperature.pools[self.half(chain)];
            let surrogate = self.surrogate.as_ref().filter(|_| beta >= LEAST_BETA);
            let slices = if surrogate.is_none() || self.clock.is_multiple_of(SLICE_SCANS) {
                // Moves along a surrogate have involutions of their own, but where it is wrong.
                hmc::try_involutions(&mut evaluator, beta, &mut point, &mut rng)?;
                self.settings.slice_updates
            } else {
                0
            };
            hmc::slice_updates(
                &mut evaluator,
                beta,
                metric,
                pool,
                slices,
                &mut point,
                &mut rng,
                &mut visit,
            )?;
            if let Some(surrogate) = surrogate {
                let along = Evaluator::new(target).with_surrogate(surrogate);
                let mut along = LocalSampler::of(along, 1.0, metric);
                surrogate_moves(
                    &mut evaluator,
                    &mut along,
                    beta,
                    temperature.step.step(),
                    &hmc::MOVE_LENGTHS,
                    &mut point,
                    &mut rng,
                    &mut local,
                    &mut visit,
                )?;
                score = along.score(&point)?;
            } else {
                let plan = self.plan(temperature);
                let mut along = LocalSampler::of(evaluator, beta, metric);
                for _ in 0..self.settings.hmc_transitions {
                    let moved = along.transition(&mut point, &plan, &mut rng)?;
                    local.note(&moved);
                    visit(&point);
                }
                if point.has_gradient {
                    score = along.score(&point)?;
                }
                evaluator = along.evaluator;
            }
        }
        let screened = evaluator.screened;
        let (calls, examples) = evaluator.into_calls_and_examples();
        Ok(Explored {
            point,
            local,
            score,
            calls,
            screened,
            trail,
            examples,
        })
    }

    /// Adds examples for the next fit of the surrogate, and drops the oldest of too many: not each time, since those that stay are moved in
    /// memory.
    fn learn(&mut self, examples: Examples) {
        self.examples.append(examples);
        if self.examples.len() > EXAMPLES_KEPT + EXAMPLES_KEPT / 4 {
            self.examples.keep_last(EXAMPLES_KEPT);
        }
    }

    /// Whether the surrogate is to be fitted again within an extension: a state whose ln L it underestimates by far is left only by slice
    /// updates, whose values then teach it.
    fn surrogate_due(&self) -> bool {
        let done = self.record.part().traces.scans();
        let every = SURROGATE_SCANS.max(self.newest_scans() / SURROGATE_FITS);
        let goes_on = self.is_last_round() && self.scan < self.scans();
        goes_on && !self.part_ended() && done.is_multiple_of(every)
    }

    /// A surrogate learns from the values of one in so many scans, so that all examples that it may have are spread over the whole round or
    /// extension: those of the newest scans alone lack the rare places, which the surrogate would then forget. The number is odd, so that scans
    /// with slice updates have their share.
    fn learn_every(&self) -> u64 {
        let scans = if self.is_last_round() {
            self.newest_scans()
        } else {
            self.scans()
        };
        let values = scans * self.chains.len() * VALUES_OF_A_CHAIN;
        values.div_ceil(EXAMPLES_KEPT) as u64 | 1
    }

    /// Even pairs of temperatures in even scans, odd pairs in odd scans.
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
        self.record.part_mut().index_processes[chain_set].note(
            self.chains[chain_set * temperatures].replica,
            self.chains[(chain_set + 1) * temperatures - 1].replica,
        );
    }
}
