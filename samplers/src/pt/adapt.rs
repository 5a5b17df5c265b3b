//! Adaptation between rounds: temperatures, metrics, steps, difference pools and the reference, from the round before or
//! from the SMC samplers.

use super::path;
use super::schedule::{communication_barrier, first_schedule, locate, respaced};
use super::smc::{CommunicationBarrier, Level, of_others};
use super::state::{Chain, EARLY_SCANS, Finished, State, Temperature};
use crate::difference_pool::DifferencePool;
use crate::error::{Error, Result};
use crate::hmc::{Evaluator, Metric, Reference, StepSize};
use crate::rng::{Domain, below, stream};
use crate::target::{Symmetry, Target};

/// Maximum number of rows that a reference is fitted to. Half as many rows of earlier rounds
/// are kept, so that the oldest, which are the least accurate, lose their influence.
const MAX_TRAINING: usize = 5_000;

/// First step of HMC transitions in the metric of an SMC sampler: ridges are narrower than the distribution of all
/// particles.
const FIRST_STEP: f64 = 0.1;

/// Temperatures of the second part of the path in the first rounds.
pub(super) const FIRST_OF_SECOND_PART: usize = 6;

/// The fewest of them later on.
const FEWEST_OF_SECOND_PART: usize = 2;

/// An extension along a surrogate begins after scans that do not count, fewer than its own by this factor: their first states are those of
/// the surrogate before.
const EQUILIBRATION: usize = 8;

impl State {
    /// Begins the first round from the SMC samplers: temperatures evenly spaced in their communication barrier, and the
    /// particles of the nearest levels as states, metric and difference pool.
    pub(super) fn begin(&mut self, smc_samplers: &[Vec<Level>], target: &dyn Target) -> Result<()> {
        let dim = target.dim();
        let orbit = Symmetry::first_orbit(target.symmetries());
        let communication_barriers: Vec<CommunicationBarrier> = smc_samplers
            .iter()
            .map(|l| CommunicationBarrier::of(l))
            .collect();
        let path = CommunicationBarrier::mean(&communication_barriers);
        let [count, _] = self.enough_temperatures([path.total(), 0.0]);
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
            let mut rows = vec![Vec::new(); smc_samplers.len()];
            for (cluster, levels) in smc_samplers.iter().enumerate() {
                let place = path.total() * k as f64 / (count - 1) as f64;
                if let Some(level) = nearest(levels, place).map(|i| &levels[i]) {
                    let task = (cluster << 20) + k;
                    let mut rng = stream(self.seed, Domain::PtSmc, task as u64, u64::MAX);
                    let particles = level.ln_likelihood.len();
                    let first = below(&mut rng, particles);
                    // Chain sets of one cluster take particles far apart in number: those of one ancestor have neighbouring
                    // numbers.
                    let own: Vec<usize> =
                        (cluster..chain_sets).step_by(smc_samplers.len()).collect();
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
                place: beta,
                metric: Metric::of_rows(&rows.concat(), dim),
                step: StepSize::new(FIRST_STEP),
                pools: of_others(rows.iter()).map(|r| DifferencePool::new(&r, dim, orbit)),
            });
        }
        self.temperatures = temperatures;
        self.chains = chains.concat();
        if self.settings.mixes(0) {
            self.begin_at_mixture(smc_samplers, target);
        }
        self.follow_surrogate(target)?;
        self.record = self.new_record(dim, 0);
        Ok(())
    }

    /// Gives the first round references fitted to the SMC particles at their last temperature, and takes
    /// its states from them.
    fn begin_at_mixture(&mut self, smc_samplers: &[Vec<Level>], target: &dyn Target) {
        let coldest: Vec<&Level> = smc_samplers.iter().filter_map(|l| l.last()).collect();
        let rows = of_others(coldest.iter().map(|level| &level.z));
        let Some(references) = self.resembling(rows, target.dim()) else {
            return;
        };
        self.one_metric();
        let temperatures = self.temperatures.len();
        for chain in 0..self.chains.len() {
            let (chain_set, k) = (chain / temperatures, chain % temperatures);
            let level = coldest[chain_set % coldest.len()];
            let turn = k * self.settings.chain_sets + chain_set;
            let particles = level.ln_likelihood.len();
            let most = temperatures * self.settings.chain_sets;
            self.chains[chain].point = level.point(turn * particles / most);
        }
        self.take_references(references);
    }

    /// Ends a round, or an extension of the last: new temperatures, metrics and steps from its record.
    ///
    /// # Errors
    /// Those of the target.
    pub(super) fn adapt(&mut self, target: &dyn Target) -> Result<()> {
        let dim = target.dim();
        let orbit = Symmetry::first_orbit(target.symmetries());
        let old = communication_barrier(&self.record.extension().mean_rejection());
        let total = old[old.len() - 1];
        self.history.push(Finished {
            communication_barrier: total,
            ln_z: self.evidence().ln_z,
        });
        if self.settings.smc_particles > 0 && self.is_early_round() {
            // The SMC samplers give better temperatures, metrics and directions than a few scans do.
            for temperature in &mut self.temperatures {
                temperature.step = StepSize::new(temperature.step.ln_found().exp());
            }
            self.next_reference(target);
            self.follow_surrogate(target)?;
            self.next_round(dim);
            return Ok(());
        }
        let (places, found) = (self.places(), self.found(dim));
        let first = path::first_part(&places);
        let corner = first - 1;
        let counts = self.next_temperatures([old[corner], total - old[corner]]);
        let mut schedule = spaced(0, &places[..first], &old[..first], counts[0]);
        let second = spaced(corner, &places[corner..], &old[corner..], counts[1] + 1);
        schedule.extend(second.into_iter().skip(1));
        let nearest = |(i, t): (usize, f64)| i + usize::from(t >= 0.5);
        let count = schedule.len();
        self.temperatures = schedule
            .iter()
            .map(|&(place, (i, t))| {
                let ln_step = found[i].1 * (1.0 - t) + found[i + 1].1 * t;
                Temperature {
                    place,
                    metric: found[i].0.between(&found[i + 1].0, t),
                    step: StepSize::new(ln_step.exp()),
                    pools: of_others(self.record.extension().visits[nearest((i, t))].iter())
                        .map(|rows| DifferencePool::new(&rows, dim, orbit)),
                }
            })
            .collect();
        let same = [first, places.len() - first] == counts;
        self.chains = (0..self.settings.chain_sets * count)
            .map(|chain| {
                let (chain_set, k) = (chain / count, chain % count);
                let (place, at) = schedule[k];
                // A state of the surrogate's posterior may have no likelihood.
                let least = if place > path::CORNER { first } else { 0 };
                let from = if same { k } else { nearest(at).max(least) };
                let old = &self.chains[chain_set * places.len() + from];
                Chain {
                    point: old.point.clone(),
                    replica: if same { old.replica } else { k },
                }
            })
            .collect();
        self.next_reference(target);
        self.follow_surrogate(target)?;
        if self.is_last_round() {
            let scans = self.settings.scans_of_extension(self.extensions);
            let places = self.places();
            self.record.begin_extension(dim, &places, scans);
            if self.surrogate.is_some() {
                self.equilibrating = scans / EQUILIBRATION;
            }
        } else {
            self.next_round(dim);
        }
        Ok(())
    }

    /// Lets all chains follow the surrogate, if there is one: with its estimates in place of ln L, and a second part of the path.
    ///
    /// # Errors
    /// Those of the target; [`Error::NoStart`] if no state of the second part has a likelihood.
    fn follow_surrogate(&mut self, target: &dyn Target) -> Result<()> {
        let Some(surrogate) = &self.surrogate else {
            return Ok(());
        };
        let first = path::first_part(&self.places());
        if first == self.temperatures.len() {
            let chain_sets = self.chains.chunks_exact(first);
            let extended = chain_sets.map(|chain_set| {
                let more = (first..).zip(vec![chain_set[first - 1].clone(); FIRST_OF_SECOND_PART]);
                let more = more.map(|(replica, chain)| Chain { replica, ..chain });
                chain_set.iter().cloned().chain(more).collect::<Vec<_>>()
            });
            self.chains = extended.flatten().collect();
            let corner = self.temperatures[first - 1].clone();
            for k in 1..=FIRST_OF_SECOND_PART {
                let place = path::CORNER + k as f64 / FIRST_OF_SECOND_PART as f64;
                self.temperatures.push(Temperature {
                    place,
                    ..corner.clone()
                });
            }
        }
        let places = self.places();
        let mut along = Evaluator::new(target).with_surrogate(Some(surrogate));
        let mut evaluator = Evaluator::new(target);
        for (chain, place) in self.chains.iter_mut().zip(places.iter().cycle()) {
            let point = &mut chain.point;
            point.ln_likelihood = along.value(&point.z)?;
            point.gap = if *place < path::CORNER {
                0.0
            } else {
                evaluator.value(&point.z)? - point.ln_likelihood
            };
            point.has_gradient = false;
        }
        self.cost.count(&evaluator.calls);
        self.replace_rejected(&places)
    }

    /// Gives chains of the second part of the path the state of another one, where theirs has no likelihood.
    ///
    /// # Errors
    /// [`Error::NoStart`] if none has a likelihood.
    fn replace_rejected(&mut self, places: &[f64]) -> Result<()> {
        let second = |chain: usize| places[chain % places.len()] > path::CORNER;
        let has = |chain: &Chain| chain.point.gap.is_finite();
        let all = 0..self.chains.len();
        let sound: Vec<usize> = all
            .filter(|k| second(*k) && has(&self.chains[*k]))
            .collect();
        let mut turns = sound.iter().cycle();
        for chain in 0..self.chains.len() {
            if second(chain) && !has(&self.chains[chain]) {
                let from = turns.next().ok_or_else(|| Error::NoStart {
                    tries: self.chains.len(),
                    cause: self.cost.main_cause(),
                })?;
                self.chains[chain].point = self.chains[*from].point.clone();
            }
        }
        Ok(())
    }

    /// Fits the next reference to the draws at beta = 1 of the round, or of all extensions of the last, where the settings
    /// ask for one.
    fn next_reference(&mut self, target: &dyn Target) {
        if !self.mixture_next() {
            return;
        }
        let rows = if self.is_last_round() {
            of_others(self.record.all_draws().iter())
        } else {
            of_others(self.record.trails.iter())
        };
        // Without a mixture that fits, the references stay what they were, and the result has a warning.
        let Some(references) = self.resembling(rows, target.dim()) else {
            return;
        };
        if self.path_from_prior() {
            self.leave_prior();
        }
        self.take_references(references);
    }

    /// References fitted to the new draws of each half of the clusters and to the kept ones of earlier rounds; none if they are
    /// too few. Draws of the last round are not kept: they are among those of its next extension.
    fn resembling(&mut self, halves: [Vec<f64>; 2], dim: usize) -> Option<[Reference; 2]> {
        let mut training = self.training.clone();
        for (known, new) in training.iter_mut().zip(halves) {
            *known = thinned(known, dim, MAX_TRAINING / 2);
            known.extend(thinned(&new, dim, MAX_TRAINING));
        }
        let fit = |half: usize| {
            let rng = |part: usize| {
                let part = (part * 2 + half) as u64;
                stream(self.seed, Domain::PtReference, self.clock, part)
            };
            Reference::resembling(&training[half], dim, rng)
        };
        let references = rayon::join(|| fit(0), || fit(1));
        if !self.is_last_round() {
            self.training = training;
        }
        Some([references.0?, references.1?])
    }

    /// Sets the references.
    fn take_references(&mut self, references: [Reference; 2]) {
        self.references = references;
        let ln_over_prior: Vec<f64> = (0..self.chains.len())
            .map(|chain| {
                let reference = self.reference(chain);
                reference.ln_over_prior(&self.chains[chain].point.z)
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
        let first = path::first_part(&self.places());
        let schedule = first_schedule(first);
        for (k, temperature) in self.temperatures.iter_mut().enumerate() {
            *temperature = Temperature {
                place: schedule.get(k).copied().unwrap_or(temperature.place),
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
            let extension = self.record.extension();
            let ln_likelihood = &extension.ln_likelihood[chain_set];
            let row = (ln_likelihood.len() * (k + 1)).div_ceil(temperatures) - 1;
            let z = &extension.draws[chain_set][row * dim..(row + 1) * dim];
            place.point.z.copy_from_slice(z);
            place.point.ln_likelihood = ln_likelihood[row];
        }
    }

    /// Numbers of temperatures of both parts of the path. `1 + ceil(2 communication_barrier)` make a round trip cheapest (Syed et al.
    /// 2022); they are left alone in early rounds, where the communication barrier is inaccurate, and before the last, which must be in
    /// equilibrium.
    fn next_temperatures(&self, communication_barriers: [f64; 2]) -> [usize; 2] {
        let settled = self.settings.scans(self.round) >= EARLY_SCANS;
        if !settled || self.round + 2 >= self.settings.rounds {
            let first = path::first_part(&self.places());
            return [first, self.temperatures.len() - first];
        }
        self.enough_temperatures(communication_barriers)
    }

    /// Those of each part of the path; the second has none without a surrogate.
    fn enough_temperatures(&self, communication_barriers: [f64; 2]) -> [usize; 2] {
        let (min, max) = (
            self.settings.min_temperatures,
            self.settings.max_temperatures,
        );
        let enough = |min: usize, max: usize, barrier: f64| {
            let found = (min..max).find(|n| (*n - 1) as f64 >= 2.0 * barrier);
            found.unwrap_or(max)
        };
        let first = enough(min, max, communication_barriers[0]);
        if self.surrogate.is_none() {
            return [first, 0];
        }
        let more = enough(FEWEST_OF_SECOND_PART, max, communication_barriers[1]);
        [first, more]
    }

    /// The metric and the logarithm of the step that the round found for each of its temperatures.
    fn found(&self, dim: usize) -> Vec<(Metric, f64)> {
        let moments = &self.record.extension().moments;
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
                let local = &self.record.extension().locals[k];
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

/// So many temperatures on one part of the path, evenly spaced in the communication barrier `old` of its present `places`: the place of
/// each, and where it lies among the present ones, of which the part begins with number `from`.
fn spaced(from: usize, places: &[f64], old: &[f64], count: usize) -> Vec<(f64, (usize, f64))> {
    if places.len() < 2 {
        return Vec::new();
    }
    let lengths: Vec<f64> = old.iter().map(|length| length - old[0]).collect();
    let total = lengths[lengths.len() - 1];
    let schedule = respaced(places, &lengths, count).into_iter().enumerate();
    schedule
        .map(|(k, place)| {
            let (i, t) = locate(&lengths, total * k as f64 / (count - 1) as f64);
            (place, (from + i, t))
        })
        .collect()
}

/// At most so many rows of coordinates, evenly spaced among those given.
fn thinned(rows: &[f64], dim: usize, max: usize) -> Vec<f64> {
    let count = rows.len() / dim;
    let kept = count.min(max);
    let row = |k: usize| &rows[k * count / kept * dim..][..dim];
    (0..kept).flat_map(row).copied().collect()
}
