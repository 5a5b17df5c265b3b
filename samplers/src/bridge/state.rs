//! The particles of a bridge and how they are moved.

use super::Settings;
use super::batch::Batch;
use super::explore::{Moved, Moves};
use super::independent::{MAX_TRAINING, Proposals};
use super::particle::{Both, Particle};
use super::settings::{EXAMPLES_KEPT, FITTED_STEPS};
use crate::diagnostics::effective_kinds;
use crate::difference_pool::DifferencePool;
use crate::error::{Error, Result};
use crate::hmc::{Evaluator, Metric, Reference, StepSize, thinned};
use crate::output::{Calls, Cost, Run};
use crate::rng::{Domain, stream, unit_open};
use crate::smc_weights::{SmcWeights, after_step};
use crate::surrogate::{Examples, Surrogate};
use crate::target::{Symmetry, Target};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Indices, within a step, of the random streams of the resampling and, within an MCMC step, of the fit of the surrogate.
const RESAMPLING: u64 = u64::MAX;
const FIT: u64 = u64::MAX - 1;

/// First leapfrog step along the surrogate, in the metric of all particles, and the acceptance by the surrogate that later ones are
/// adapted to.
const FIRST_STEP: f64 = 0.05;
const ACCEPTANCE: f64 = 0.8;

/// One step of the bridge.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Level {
    pub(super) fraction: f64,
    /// ln Z here minus that of the coarse run.
    pub(super) ln_ratio: f64,
    /// Effective number of ancestors.
    pub(super) ancestors: f64,
    /// Correlation of `ln L_fine - ln L_coarse` before and after the MCMC steps.
    pub(super) correlation: f64,
}

/// The particles and the exponent reached: what a checkpoint holds.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct State {
    /// The batches before the present one.
    pub(super) batches: Vec<Batch>,
    /// Their particles, until those of the present batch are at the fine likelihood too.
    pub(super) waiting: Vec<Particle>,
    /// Exponent of the present batch, and its ln Z there minus that of the coarse run.
    pub(super) fraction: f64,
    pub(super) ln_ratio: f64,
    /// The particles that are moved: those of the present batch, and at the fine likelihood after those of the earlier ones.
    pub(super) particles: Vec<Particle>,
    /// MCMC steps of the present batch done at this exponent; none are due at 0, and more than elsewhere may be at 1.
    pub(super) mcmc_steps: usize,
    /// `ln L_fine - ln L_coarse` of every SMC particle before these MCMC steps.
    pub(super) gaps_before: Vec<f64>,
    /// Metrics for particles of even and of odd lineages; `pools` likewise.
    pub(super) metrics: Vec<Metric>,
    pub(super) pools: Vec<DifferencePool>,
    /// Of all batches, one after the other.
    pub(super) levels: Vec<Level>,
    /// The surrogate of the fine likelihood, at first that of the coarse one; none if the coarse run has none.
    pub(super) surrogate: Option<Surrogate>,
    /// Values of the fine likelihood, from which it learns.
    pub(super) examples: Examples,
    /// Leapfrog step along it; none before the first.
    pub(super) step: Option<StepSize>,
    /// Coordinates of the particles of even and of odd lineages after each of the first further MCMC steps along a surrogate since the present
    /// batch is at the fine likelihood.
    pub(super) visited: [Vec<f64>; 2],
    /// Some of those before.
    pub(super) visited_before: [Vec<f64>; 2],
    pub(super) cost: Cost,
}

impl State {
    /// `ln L_fine - ln L_coarse` of every SMC particle.
    fn gaps(&self) -> Vec<f64> {
        self.particles.iter().map(|m| m.both.gap()).collect()
    }

    /// All batches with the present one.
    pub(super) fn all_batches(&self) -> Vec<Batch> {
        let earlier = self.batches.iter();
        let particles: usize = earlier.clone().map(|batch| batch.particles).sum();
        let levels: usize = earlier.clone().map(|batch| batch.levels).sum();
        let all = self.waiting.len() + self.particles.len();
        let present = Batch {
            particles: all - particles,
            levels: self.levels.len() - levels,
            ln_ratio: self.ln_ratio,
        };
        earlier.copied().chain([present]).collect()
    }

    /// Fits metrics and pools to the particles of the other half of the lineages.
    fn fit_moves(&mut self, target: &dyn Target) {
        let (dim, orbit) = (target.dim(), Symmetry::first_orbit(target.symmetries()));
        let others = [1, 0].map(|parity| self.rows(parity));
        let rows = others.iter();
        self.metrics = rows
            .clone()
            .map(|rows| Metric::of_rows(rows, dim))
            .collect();
        self.pools = rows
            .map(|rows| DifferencePool::new(rows, dim, orbit))
            .collect();
    }

    /// Coordinates of the SMC particles of even (0) or odd (1) lineages; of all SMC particles where there are no such
    /// lineages.
    fn rows(&self, parity: u32) -> Vec<f64> {
        let of = |own: &dyn Fn(&Particle) -> bool| -> Vec<f64> {
            let particles = self.particles.iter().filter(|m| own(m));
            particles.flat_map(|m| m.z.iter().copied()).collect()
        };
        let half = of(&|m| m.lineage % 2 == parity);
        if half.is_empty() { of(&|_| true) } else { half }
    }
}

/// A bridge in progress.
pub(super) struct Bridge<'a> {
    pub(super) target: &'a dyn Target,
    pub(super) coarse: &'a dyn Target,
    pub(super) settings: &'a Settings,
    pub(super) seed: u64,
    pub(super) parent: &'a Run,
    /// For further MCMC steps: the numbers of earlier batches and of these steps to which they are fitted, and the proposals; none where the
    /// parent has too few draws.
    pub(super) proposals: Option<([usize; 2], Option<Proposals>)>,
    pub(super) state: State,
}

impl Bridge<'_> {
    /// Goes on from a state that was read from a file.
    pub(super) fn resume(&mut self, mut state: State) {
        if let Some(surrogate) = &mut state.surrogate {
            surrogate.prepare();
        }
        self.state = state;
    }

    /// MCMC steps at the fine likelihood beyond those that each exponent has; none before those are done.
    pub(super) fn further_mcmc_steps(&self) -> Option<usize> {
        let done = self.state.fraction >= 1.0;
        let further = self.state.mcmc_steps.checked_sub(self.settings.mcmc_steps);
        further.filter(|_| done)
    }

    /// Whether another batch comes next: the present one and those before have made all their further MCMC steps.
    fn next_batch_due(&self) -> bool {
        self.may_have_another_batch()
            && (self.further_mcmc_steps()).is_some_and(|f| f >= self.settings.further_mcmc_steps)
    }

    /// Whether the settings allow a batch after the present one.
    pub(super) fn may_have_another_batch(&self) -> bool {
        self.state.batches.len() + 1 < self.settings.max_batches
    }

    /// Begins a batch with draws of the parent. On an error nothing has changed.
    pub(super) fn begin(&mut self) -> Result<()> {
        let first = self.state.particles.is_empty();
        let (particles, examples, calls) = self.drawn(self.level() - u64::from(first))?;
        let state = &mut self.state;
        if first {
            state.surrogate.clone_from(&self.parent.surrogate);
        } else {
            state.batches = state.all_batches();
            state.waiting = std::mem::take(&mut state.particles);
            for (before, visited) in state.visited_before.iter_mut().zip(&mut state.visited) {
                before.append(visited);
                *before = thinned(before, self.target.dim(), MAX_TRAINING / 2);
            }
        }
        (state.fraction, state.ln_ratio) = (0.0, 0.0);
        state.cost.count(&calls);
        state.examples.append(examples);
        state.particles = particles;
        state.mcmc_steps = self.settings.mcmc_steps;
        Ok(())
    }

    /// Draws of the parent, resampled to equal weights, with their fine likelihoods, which are examples for a surrogate. `task` is that of
    /// the random stream.
    fn drawn(&self, task: u64) -> Result<(Vec<Particle>, Examples, Calls)> {
        let parent = self.parent;
        let draws = &parent.draws;
        let lineage = lineages(parent);
        let offset = unit_open(&mut stream(self.seed, Domain::Bridge, task, RESAMPLING));
        let mut particles = Vec::new();
        for row in draws.resample(self.settings.smc_particles, offset) {
            let mut z = vec![0.0; draws.dim];
            let prior = self.target.prior();
            prior.z_from_theta(draws.theta_row(row), &mut z);
            // Rounding can put a draw on the bound of its prior, where it has no coordinates.
            if z.iter().all(|z| z.is_finite()) {
                particles.push(Particle {
                    z,
                    both: Both {
                        coarse: draws.ln_likelihood[row],
                        fine: f64::NEG_INFINITY,
                    },
                    eve: row,
                    lineage: lineage(row),
                });
            }
        }
        let fine: Vec<Result<(f64, Calls, Examples)>> = (particles.par_iter())
            .map(|particle| {
                let evaluator = Evaluator::new(self.target);
                let mut evaluator = evaluator.keeping_examples(parent.surrogate.is_some());
                let fine = evaluator.value(&particle.z)?;
                let (calls, examples) = evaluator.into_calls_and_examples();
                Ok((fine, calls, examples))
            })
            .collect();
        let (mut calls, mut examples) = (Calls::default(), Examples::default());
        for (particle, fine) in particles.iter_mut().zip(fine) {
            let (fine, own_calls, own) = fine?;
            particle.both.fine = fine;
            calls.add(&own_calls);
            examples.append(own);
        }
        let nowhere = |particle: &Particle| particle.both.fine == f64::NEG_INFINITY;
        if particles.iter().all(nowhere) {
            return Err(Error::NoCommonSupport);
        }
        Ok((particles, examples, calls))
    }

    /// The beginning of another batch where it is due, else one MCMC step of every particle, after a step of the exponent where one is due. On an
    /// error no particle has moved, and the same can be repeated.
    pub(super) fn advance(&mut self) -> Result<()> {
        if self.next_batch_due() {
            return self.begin();
        }
        if self.state.fraction < 1.0 && self.state.mcmc_steps == self.settings.mcmc_steps {
            self.step()?;
        }
        self.state.examples.keep_last(EXAMPLES_KEPT);
        let surrogate = self.learned();
        let densities = surrogate.as_ref().and_then(|s| self.densities(s));
        self.mcmc_step(surrogate, densities.as_ref())?;
        let state = &mut self.state;
        state.mcmc_steps += 1;
        if state.mcmc_steps == self.settings.mcmc_steps {
            let level = Level {
                fraction: state.fraction,
                ln_ratio: state.ln_ratio,
                ancestors: effective_kinds(state.particles.iter().map(|m| m.eve)),
                correlation: correlation(&state.gaps_before, &state.gaps()),
            };
            state.levels.push(level);
            if state.fraction >= 1.0 && !state.waiting.is_empty() {
                let present = std::mem::take(&mut state.particles);
                state.particles = std::mem::take(&mut state.waiting);
                state.particles.extend(present);
                state.gaps_before = state.gaps();
                state.fit_moves(self.target);
            }
        }
        Ok(())
    }

    /// Number of the present step among those of all batches and their beginnings; that of the first step is 1.
    fn level(&self) -> u64 {
        (self.state.levels.len() + self.state.batches.len()) as u64 + 1
    }

    /// Reweights and resamples.
    ///
    /// # Errors
    /// As of [`after_step`], before anything has changed.
    fn step(&mut self) -> Result<()> {
        let level = self.level();
        let state = &mut self.state;
        let smc_weights = SmcWeights::new(state.gaps());
        let left = 1.0 - state.fraction;
        let step = smc_weights.longest_step(left);
        state.fraction = after_step(state.fraction, step, state.levels.len() + 1)?;
        state.ln_ratio += smc_weights.ln_mean_weight(step);
        let uniform = unit_open(&mut stream(self.seed, Domain::Bridge, level, RESAMPLING));
        let drawn = smc_weights.resample(step, uniform).into_iter();
        state.particles = drawn.map(|i| state.particles[i].clone()).collect();
        state.mcmc_steps = 0;
        state.gaps_before = state.gaps();
        state.fit_moves(self.target);
        Ok(())
    }

    /// The surrogate fitted anew, if there is one, to the values of the fine likelihood so far; the present one where they are too few.
    fn learned(&self) -> Option<Surrogate> {
        let state = &self.state;
        let present = state.surrogate.as_ref()?;
        let task = self.level() << 32 | state.mcmc_steps as u64;
        let mut rng = stream(self.seed, Domain::Bridge, task, FIT);
        let fitted = Surrogate::fit(&state.examples, Some(present), &mut rng);
        Some(fitted.unwrap_or_else(|| present.clone()))
    }

    /// The densities of independent proposals for the particles of each half, in further MCMC steps only.
    fn densities(&mut self, surrogate: &Surrogate) -> Option<[Reference; 2]> {
        let further = self.further_mcmc_steps()?;
        let (parent, target, seed) = (self.parent, self.target, self.seed);
        let task = self.level() << 32 | self.state.mcmc_steps as u64;
        // Fitted anew whenever there are twice as many steps.
        let kept = further.min(FITTED_STEPS);
        let steps = (kept.checked_ilog2()).map_or(0, |doublings| 1 << doublings);
        let fitted = [self.state.batches.len(), steps];
        if (self.proposals.as_ref()).is_none_or(|(to, _)| *to != fitted) {
            let State {
                visited,
                visited_before,
                ..
            } = &self.state;
            let visited = [0, 1].map(|half| {
                let present = &visited[half][..visited[half].len() / kept.max(1) * steps];
                [&visited_before[half], present].concat()
            });
            let lineage = lineages(parent);
            let proposals = Proposals::new(&parent.draws, visited, fitted, target, seed, lineage);
            self.proposals = Some((fitted, proposals));
        }
        let (_, proposals) = self.proposals.as_ref()?;
        proposals.as_ref()?.screened(surrogate, target, seed, task)
    }

    /// One MCMC step of every particle at the present exponent, along this surrogate, which is then the present one.
    fn mcmc_step(
        &mut self,
        surrogate: Option<Surrogate>,
        densities: Option<&[Reference; 2]>,
    ) -> Result<()> {
        let state = &self.state;
        let (level, mcmc_step) = (self.level(), state.mcmc_steps as u64);
        let further = self.further_mcmc_steps();
        let mut step = state.step.unwrap_or(StepSize::new(FIRST_STEP));
        let moves = [0, 1].map(|half| Moves {
            target: self.target,
            coarse: self.coarse,
            fraction: state.fraction,
            surrogate: surrogate.as_ref(),
            density: densities.map(|both| &both[half]),
            metric: &state.metrics[half],
            pool: &state.pools[half],
            step: step.step(),
            first: mcmc_step == 0,
            further: further.is_some(),
        });
        let moved: Vec<Result<Moved>> = (state.particles.par_iter().enumerate())
            .map(|(i, particle)| {
                let task = level << 32 | mcmc_step;
                let mut rng = stream(self.seed, Domain::Bridge, task, i as u64);
                moves[(particle.lineage % 2) as usize].explore(particle, &mut rng)
            })
            .collect();
        let moved: Vec<Moved> = moved.into_iter().collect::<Result<_>>()?;
        let acceptance = moved.iter().map(|own| own.acceptance).sum::<f64>() / moved.len() as f64;
        let before = state.levels.len() * self.settings.mcmc_steps + state.mcmc_steps;
        let state = &mut self.state;
        state.particles.clear();
        for own in moved {
            state.particles.push(own.particle);
            state.examples.append(own.examples);
            state.cost.count(&own.calls);
        }
        if further.is_some_and(|further| further < FITTED_STEPS) && surrogate.is_some() {
            for particle in &state.particles {
                state.visited[(particle.lineage % 2) as usize].extend_from_slice(&particle.z);
            }
        }
        state.surrogate = surrogate;
        if state.surrogate.is_some() {
            // The exponents yet to come are not known: every step counts as one of the first half.
            step.learn(acceptance, ACCEPTANCE, before, usize::MAX);
            state.step = Some(step);
        }
        Ok(())
    }
}

/// The lineage of each row of a parent: its cluster of dependent draws, or the row itself where there is only one.
fn lineages(parent: &Run) -> impl Fn(usize) -> u32 + '_ {
    let cluster = &parent.draws.cluster;
    let grouped = cluster.iter().any(|g| *g != cluster[0]);
    move |row| {
        if grouped {
            cluster[row]
        } else {
            u32::try_from(row).unwrap_or(u32::MAX)
        }
    }
}

/// Pearson's; 0 where one of the two does not vary.
fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let mean = |x: &[f64]| x.iter().sum::<f64>() / x.len() as f64;
    let (ma, mb) = (mean(a), mean(b));
    let sum = |f: &dyn Fn(f64, f64) -> f64| -> f64 {
        a.iter().zip(b).map(|(x, y)| f(x - ma, y - mb)).sum()
    };
    let scale = (sum(&|x, _| x * x) * sum(&|_, y| y * y)).sqrt();
    if scale > 0.0 {
        sum(&|x, y| x * y) / scale
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_that_rise_together_are_correlated() {
        assert!((correlation(&[1.0, 2.0, 3.0], &[2.0, 4.0, 6.0]) - 1.0).abs() < 1e-12);
        assert!(correlation(&[1.0, 1.0], &[2.0, 4.0]).abs() < 1e-12);
    }
}
