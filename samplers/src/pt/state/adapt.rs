//! What a round learns from the one before, or the first from populations: temperatures, metrics, steps, pools, and where its
//! ladders begin.

use super::super::anneal::{Barrier, Level, of_others};
use super::super::ladder::{barrier, first_schedule, locate, respaced};
use super::{EARLY_SCANS, Finished, Rung, Slot, State};
use crate::hmc::{Metric, Reference, StepSize};
use crate::neighbours::Neighbours;
use crate::rng::{Domain, below, stream};
use crate::target::{Symmetry, Target};

/// Most rows of half of the ladders that a mixture is fitted to; of those before half as many are kept, so that what was
/// drawn long ago, fewer and less sure, is forgotten by and by.
const MOST_TRAINING: usize = 5_000;

/// Step that Hamiltonian moves begin with in a population's metric: ridges are narrower than the population.
const FIRST_STEP: f64 = 0.1;

impl State {
    /// Begins the first round where populations ended: temperatures evenly spaced in the barrier between their levels, the
    /// members of the nearest levels as states, metric and pool.
    pub(super) fn begin(&mut self, populations: &[Vec<Level>], target: &dyn Target) {
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
        if self.settings.mixes(0) {
            self.begin_at_mixture(populations, target);
        }
        self.record = self.new_record(dim, 0);
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

    /// Ends a round, or a leg of the last: new temperatures, metrics and steps from what it recorded, and states carried over.
    pub(super) fn adapt(&mut self, target: &dyn Target) {
        let dim = target.dim();
        let orbit = Symmetry::first_orbit(target.symmetries());
        let old = barrier(&self.record.leg().mean_rejection());
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
                    pools: of_others(self.record.leg().visits[nearest((i, t))].iter())
                        .map(|rows| Neighbours::new(&rows, dim, orbit)),
                }
            })
            .collect();
        let same = count == beta.len();
        self.slots = (0..self.settings.ladders * count)
            .map(|slot| {
                let (ladder, k) = (slot / count, slot % count);
                let from = if same { k } else { nearest(places[k]) };
                let old = &self.slots[ladder * beta.len() + from];
                Slot {
                    point: old.point.clone(),
                    machine: if same { old.machine } else { k },
                }
            })
            .collect();
        self.next_reference(target);
        if self.is_last_round() {
            let (beta, scans) = (self.beta(), self.settings.scans(self.round));
            self.record.begin_leg(dim, &beta, scans);
        } else {
            self.next_round(dim);
        }
    }

    /// In the last rounds, if asked for: a reference that resembles what the round, or all legs of the last, have drawn at beta = 1.
    fn next_reference(&mut self, target: &dyn Target) {
        if !self.mixture_next() {
            return;
        }
        let rows = if self.is_last_round() {
            of_others(self.record.all_draws().iter())
        } else {
            of_others(self.record.trails.iter())
        };
        // Of draws that no mixture fits, none is made: the path stays what it was, and the result says so.
        let Some(reference) = self.resembling(rows, target.dim()) else {
            return;
        };
        if self.reference.is_prior() {
            self.leave_prior();
        }
        self.take_reference(reference);
    }

    /// The reference that resembles new halves of draws, and what is kept of those before; none if there are too few. Those of the
    /// last round are not kept: its next leg has them again among its own.
    fn resembling(&mut self, halves: [Vec<f64>; 2], dim: usize) -> Option<Reference> {
        let mut training = self.training.clone();
        for (known, new) in training.iter_mut().zip(halves) {
            *known = thinned(known, dim, MOST_TRAINING / 2);
            known.extend(thinned(&new, dim, MOST_TRAINING));
        }
        let rng = |count: usize| stream(self.seed, Domain::PtReference, self.clock, count as u64);
        let reference = Reference::resembling(&training, dim, rng);
        if !self.is_last_round() {
            self.training = training;
        }
        reference
    }

    /// Ladders begin at this reference from now on.
    fn take_reference(&mut self, reference: Reference) {
        for slot in &mut self.slots {
            slot.point.tilt = reference.tilt(&slot.point.z);
            slot.point.has_gradient = false;
        }
        self.reference = reference;
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
        let dim = self.slots[0].point.z.len();
        for (slot, place) in self.slots.iter_mut().enumerate() {
            let (ladder, k) = (slot / rungs, slot % rungs);
            let leg = self.record.leg();
            let ln_likelihood = &leg.ln_likelihood[ladder];
            let row = (ln_likelihood.len() * (k + 1)).div_ceil(rungs) - 1;
            let z = &leg.draws[ladder][row * dim..(row + 1) * dim];
            place.point.z.copy_from_slice(z);
            place.point.ln_likelihood = ln_likelihood[row];
        }
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
        let moments = &self.record.leg().moments;
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
