//! Adaptation between rounds: temperatures, metrics, steps, difference pools and the reference, from the round before or
//! from the SMC samplers.

use super::schedule::{communication_barrier, first_schedule, locate, respaced};
use super::settings::EXAMPLES_KEPT;
use super::smc::{CommunicationBarrier, FIRST_STEP, Level, SmcSamplers, of_others};
use super::state::{Chain, EARLY_SCANS, Finished, State, Temperature};
use crate::difference_pool::DifferencePool;
use crate::error::{Error, Result};
use crate::hmc::{
    Evaluator, Metric, Point, Reference, StepSize, screen, thinned, with_moved_copies,
};
use crate::rng::{Domain, below, stream};
use crate::surrogate::Surrogate;
use crate::target::{Symmetry, Target};

/// Maximum number of rows that a reference is fitted to. Half as many rows of earlier rounds
/// are kept, so that the oldest, which are the least accurate, lose their influence.
const MAX_TRAINING: usize = 5_000;

/// Tasks whose draws of a reference set its screen.
const SCREEN_TASKS: usize = 20;

/// More parts than a reference has, whose random streams are numbered.
const MAX_PARTS: usize = 64;

impl State {
    /// Begins the first round from the SMC samplers: temperatures evenly spaced in their communication barrier, and the
    /// particles of the nearest levels as states, metric and difference pool.
    pub(super) fn begin(&mut self, smc_samplers: &SmcSamplers, target: &dyn Target) -> Result<()> {
        let dim = target.dim();
        let orbit = Symmetry::first_orbit(target.symmetries());
        let samplers: Vec<&[Level]> = smc_samplers.levels().collect();
        let communication_barriers: Vec<CommunicationBarrier> = (samplers.iter())
            .map(|levels| CommunicationBarrier::of(levels))
            .collect();
        let path = CommunicationBarrier::mean(&communication_barriers);
        let count = self.enough_temperatures(path.total());
        let nearest = |levels: &[Level], place: f64| {
            (0..levels.len()).min_by(|i, j| {
                let away = |i: usize| (path.at(levels[i].beta) - place).abs();
                away(*i).total_cmp(&away(*j))
            })
        };
        let chain_sets = self.settings.chain_sets;
        let mut temperatures = Vec::with_capacity(count);
        let mut chains = vec![Vec::with_capacity(count); chain_sets];
        for (k, beta) in path.schedule(count).into_iter().enumerate() {
            let mut rows = vec![Vec::new(); samplers.len()];
            for (cluster, levels) in samplers.iter().enumerate() {
                let place = path.total() * k as f64 / (count - 1) as f64;
                if let Some(level) = nearest(levels, place).map(|i| &levels[i]) {
                    let task = (cluster << 20) + k;
                    let mut rng = stream(self.seed, Domain::PtSmc, task as u64, u64::MAX);
                    let particles = level.ln_likelihood.len();
                    let first = below(&mut rng, particles);
                    // Chain sets of one cluster take particles far apart in number: those of one ancestor have neighbouring
                    // numbers.
                    let own: Vec<usize> = (cluster..chain_sets).step_by(samplers.len()).collect();
                    for (turn, chain_set) in own.iter().enumerate() {
                        let particle = (first + turn * particles / own.len()) % particles;
                        chains[*chain_set].push(Chain {
                            point: level.point(particle),
                            replica: k,
                        });
                    }
                    rows[cluster].clone_from(&level.z);
                }
            }
            temperatures.push(Temperature {
                beta,
                metric: Metric::of_rows(&rows.concat(), dim),
                step: StepSize::new(FIRST_STEP),
                pools: of_others(rows.iter()).map(|r| DifferencePool::new(&r, dim, orbit)),
            });
        }
        self.temperatures = temperatures;
        self.chains = chains.concat();
        if self.settings.mixes(0) {
            self.begin_at_mixture(&smc_samplers.posterior(), target)?;
        }
        self.record = self.new_record(dim, 0);
        Ok(())
    }

    /// Gives the first round a reference fitted to these SMC particles at the posterior, and takes its states from them.
    fn begin_at_mixture(&mut self, posterior: &[Point], target: &dyn Target) -> Result<()> {
        let rows: Vec<f64> = posterior.iter().flat_map(|p| &p.z).copied().collect();
        let Some(references) = self.resembling_all(&rows, target)? else {
            return Ok(());
        };
        self.one_metric();
        // Neighbours, which may have one ancestor, go to different chain sets.
        let (temperatures, chains) = (self.temperatures.len(), self.chains.len());
        for (number, chain) in self.chains.iter_mut().enumerate() {
            let (chain_set, k) = (number / temperatures, number % temperatures);
            let turn = k * self.settings.chain_sets + chain_set;
            chain.point = posterior[turn * posterior.len() / chains].clone();
        }
        self.take_references(references, target);
        Ok(())
    }

    /// Ends a round, or a part of an extension of the last, with this ln Z: new temperatures, metrics and steps from its record.
    ///
    /// # Errors
    /// Those of the target.
    pub(super) fn adapt(&mut self, target: &dyn Target, ln_z: f64) -> Result<()> {
        let dim = target.dim();
        let orbit = Symmetry::first_orbit(target.symmetries());
        let old = communication_barrier(&self.record.part().mean_rejection());
        let total = old[old.len() - 1];
        self.history.push(Finished {
            communication_barrier: total,
            ln_z,
        });
        if self.settings.smc_particles > 0 && self.is_early_round() {
            // The SMC samplers give better temperatures, metrics and directions than a few scans do.
            for temperature in &mut self.temperatures {
                temperature.step = StepSize::new(temperature.step.ln_found().exp());
            }
            self.next_reference(target)?;
            self.next_round(dim);
            return Ok(());
        }
        let (beta, found) = (self.beta(), self.found(dim));
        let count = self.next_temperatures(total);
        let schedule = respaced(&beta, &old, count);
        // Where a new temperature lies among the old ones.
        let places: Vec<(usize, f64)> = (0..count)
            .map(|k| locate(&old, total * k as f64 / (count - 1) as f64))
            .collect();
        let nearest = |(i, t): (usize, f64)| i + usize::from(t >= 0.5);
        self.temperatures = schedule
            .into_iter()
            .zip(&places)
            .map(|(beta, &(i, t))| {
                let ln_step = found[i].1 * (1.0 - t) + found[i + 1].1 * t;
                Temperature {
                    beta,
                    metric: found[i].0.between(&found[i + 1].0, t),
                    step: StepSize::new(ln_step.exp()),
                    pools: of_others(self.record.part().visits[nearest((i, t))].iter())
                        .map(|rows| DifferencePool::new(&rows, dim, orbit)),
                }
            })
            .collect();
        let same = count == beta.len();
        self.chains = (0..self.settings.chain_sets * count)
            .map(|chain| {
                let (chain_set, k) = (chain / count, chain % count);
                let from = if same { k } else { nearest(places[k]) };
                let old = &self.chains[chain_set * beta.len() + from];
                Chain {
                    point: old.point.clone(),
                    replica: if same { old.replica } else { k },
                }
            })
            .collect();
        self.next_reference(target)?;
        if self.is_last_round() {
            let (beta, scans) = (self.beta(), self.scans_of_next_part());
            self.record.begin_part(dim, &beta, self.extensions, scans);
        } else {
            self.next_round(dim);
        }
        Ok(())
    }

    /// Fits the surrogate anew, where the settings ask for one, to at most so many values of ln L, newer ones more than older ones. The present one
    /// remains where ln L is finite at too few points.
    ///
    /// # Errors
    /// [`Error::Setting`] if ln L is finite at too few points for a first surrogate.
    pub(super) fn next_surrogate(&mut self, most: usize) -> Result<()> {
        if !self.settings.surrogate {
            return Ok(());
        }
        self.fit_surrogate(most, 0);
        if self.surrogate.is_none() {
            return Err(Error::Setting {
                name: "surrogate",
                value: self.settings.surrogate.to_string(),
                remedy: "ln L is finite at too few of the points of the SMC samplers: give more `smc_particles`, or no surrogate",
            });
        }
        Ok(())
    }

    /// The surrogate fitted to at most so many examples, as the fit of this number since the last scan; the one before remains where ln L is finite at too
    /// few points.
    pub(super) fn fit_surrogate(&mut self, most: usize, number: u64) {
        self.examples.keep_last(EXAMPLES_KEPT);
        let mut examples = self.examples.clone();
        examples.thin(most);
        let mut rng = stream(self.seed, Domain::PtSurrogate, self.clock, number);
        let fitted = Surrogate::fit(&examples, self.surrogate.as_ref(), &mut rng);
        if fitted.is_some() {
            self.surrogate = fitted;
        }
    }

    /// Fits the next reference to the draws at beta = 1 of the round, or of all extensions of the last, where the settings
    /// ask for one.
    fn next_reference(&mut self, target: &dyn Target) -> Result<()> {
        if !self.mixture_next() {
            return Ok(());
        }
        let references = if !self.is_last_round() {
            self.resembling_all(&self.record.trails.concat(), target)?
        } else if self.record.burns_in(self.extensions) {
            self.resembling_all(&self.record.part().draws.concat(), target)?
        } else {
            self.resembling_others(target)?
        };
        // Without a mixture that fits, the references stay what they were, and the result has a warning.
        let Some(references) = references else {
            return Ok(());
        };
        if self.path_from_prior() {
            self.leave_prior();
        }
        self.take_references(references, target);
        Ok(())
    }

    /// One reference for all chain sets until the burn-in ends, fitted to the new draws of all of them and to kept ones of earlier rounds; none if
    /// they are too few. A chain set that has come to a mode which only it has found leaves it by this reference. By one that is fitted to
    /// the draws of others alone it would not, and the result would have it for thousands of scans (docs/decisions.md, section 2).
    fn resembling_all(
        &mut self,
        rows: &[f64],
        target: &dyn Target,
    ) -> Result<Option<[Reference; 2]>> {
        let training = self.training_with(rows, target.dim());
        let reference = self.resembling(&training, 0, target)?;
        self.training = training;
        Ok(reference.map(|reference| [reference.clone(), reference]))
    }

    /// References of the draws that are the result: each half of the clusters has one that is fitted to the draws of the other half, and to the kept
    /// ones of the rounds before. None if they are too few.
    fn resembling_others(&self, target: &dyn Target) -> Result<Option<[Reference; 2]>> {
        let mut by_cluster = vec![Vec::new(); self.clusters()];
        for (chain_set, rows) in self.record.draws_since_burn_in().iter().enumerate() {
            by_cluster[chain_set % self.clusters()].extend_from_slice(rows);
        }
        let [even, odd] = of_others(by_cluster.iter());
        let fit = |half: usize, rows: &[f64]| {
            let training = self.training_with(rows, target.dim());
            self.resembling(&training, half, target)
        };
        let (even, odd) = rayon::join(|| fit(0, &even), || fit(1, &odd));
        Ok(even?.zip(odd?).map(|(even, odd)| [even, odd]))
    }

    /// The draws of earlier rounds, half as many as there may be, and the new ones.
    fn training_with(&self, rows: &[f64], dim: usize) -> Vec<f64> {
        let mut training = thinned(&self.training, dim, MAX_TRAINING / 2);
        training.extend(thinned(rows, dim, MAX_TRAINING));
        training
    }

    /// The reference of a half of the clusters that is fitted to these draws, and screened by the surrogate if there is one. If they are few,
    /// copies of them that were moved along the surrogate are added.
    fn resembling(
        &self,
        training: &[f64],
        half: usize,
        target: &dyn Target,
    ) -> Result<Option<Reference>> {
        let dim = target.dim();
        let rng = |part: usize| {
            let part = (part * 2 + half) as u64;
            stream(self.seed, Domain::PtReference, self.clock, part)
        };
        let reference = match (&self.surrogate, self.temperatures.last()) {
            (Some(surrogate), Some(cold)) => {
                let rng_of_row = |row: usize| rng(MAX_PARTS + SCREEN_TASKS + row);
                let rows = with_moved_copies(
                    training,
                    MAX_TRAINING + MAX_TRAINING / 2,
                    target,
                    surrogate,
                    &cold.metric,
                    cold.step.step(),
                    rng_of_row,
                )?;
                Reference::resembling(&rows, dim, rng)
            }
            _ => Reference::resembling(training, dim, rng),
        };
        Ok(reference.map(|reference| self.screened(reference, half, target)))
    }

    /// The reference of a half of the clusters, screened by the surrogate if there is one.
    fn screened(&self, reference: Reference, half: usize, target: &dyn Target) -> Reference {
        let Some(surrogate) = &self.surrogate else {
            return reference;
        };
        let screen = screen(&reference, surrogate, target, SCREEN_TASKS, |task| {
            let part = 2 * (MAX_PARTS + task) + half;
            stream(self.seed, Domain::PtReference, self.clock, part as u64)
        });
        reference.screened(screen)
    }

    /// Sets the references.
    fn take_references(&mut self, references: [Reference; 2], target: &dyn Target) {
        self.references = references;
        let ln_over_prior: Vec<f64> = (0..self.chains.len())
            .map(|chain| {
                let mut evaluator = Evaluator::from_reference(target, self.reference(chain));
                evaluator.ln_over_prior(&self.chains[chain].point.z)
            })
            .collect();
        for (chain, ln_over_prior) in self.chains.iter_mut().zip(ln_over_prior) {
            chain.point.ln_over_prior = ln_over_prior;
            chain.point.has_gradient = false;
        }
    }

    /// Gives all temperatures the metric and step of the posterior: on a path from a reference like the posterior they
    /// are similar.
    fn one_metric(&mut self) {
        let temperatures = self.temperatures.len();
        let cold = self.temperatures[temperatures - 1].clone();
        for (temperature, beta) in self
            .temperatures
            .iter_mut()
            .zip(first_schedule(temperatures))
        {
            *temperature = Temperature {
                beta,
                ..cold.clone()
            };
        }
    }

    /// Gives all temperatures states of the posterior.
    fn leave_prior(&mut self) {
        self.one_metric();
        let temperatures = self.temperatures.len();
        let dim = self.chains[0].point.z.len();
        for (chain, place) in self.chains.iter_mut().enumerate() {
            let (chain_set, k) = (chain / temperatures, chain % temperatures);
            let part = self.record.part();
            let ln_likelihood = &part.ln_likelihood[chain_set];
            let row = (ln_likelihood.len() * (k + 1)).div_ceil(temperatures) - 1;
            let z = &part.draws[chain_set][row * dim..(row + 1) * dim];
            place.point.z.copy_from_slice(z);
            place.point.ln_likelihood = ln_likelihood[row];
        }
    }

    /// `1 + ceil(2 communication_barrier)` temperatures make a round trip cheapest (Syed et al. 2022); their number is left alone
    /// in early rounds, where the communication barrier is inaccurate, and before the last, which must be in equilibrium.
    fn next_temperatures(&self, communication_barrier: f64) -> usize {
        let settled = self.settings.scans(self.round) >= EARLY_SCANS;
        if !settled || self.round + 2 >= self.settings.rounds {
            return self.temperatures.len();
        }
        self.enough_temperatures(communication_barrier)
    }

    fn enough_temperatures(&self, communication_barrier: f64) -> usize {
        let (min, max) = (
            self.settings.min_temperatures,
            self.settings.max_temperatures,
        );
        (min..max)
            .find(|n| (*n - 1) as f64 >= 2.0 * communication_barrier)
            .unwrap_or(max)
    }

    /// The metric and the logarithm of the step that the round found for each of its temperatures.
    fn found(&self, dim: usize) -> Vec<(Metric, f64)> {
        let moments = &self.record.part().moments;
        let enough = 10.0 * dim as f64;
        self.temperatures
            .iter()
            .enumerate()
            .map(|(k, temperature)| {
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
                    temperature.metric.refined(&pooled)
                };
                let metric = metric.unwrap_or_else(|| temperature.metric.clone());
                let local = &self.record.part().locals[k];
                let ln_found = if self.is_last_round() && local.moves > 0 {
                    let target = self.settings.target_acceptance;
                    (temperature.step).ln_corrected(local.mean_acceptance(), target)
                } else {
                    temperature.step.ln_found()
                };
                let ln_step = ln_found - temperature.metric.ln_stretch(&metric);
                (metric, ln_step)
            })
            .collect()
    }
}
