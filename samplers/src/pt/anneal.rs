//! Where ladders start: populations cooled from the prior to the posterior (sequential Monte Carlo; Del
//! Moral, Doucet & Jasra 2006).
//!
//! States drawn from the prior and put at a cold temperature settle in the nearest hollow, and a ladder needs many round
//! trips to replace them. A population that is cooled step by step loses such states at each step, by resampling, and
//! ends in hollows by their weight. It is only a start: the rounds that follow are exact whatever it was. Ladders that share
//! a population are of one family, and only families count as independent.
//!
//! All populations cool together, and members of the even ones take metric and directions from the odd ones and the other way
//! round: a population is full of relatives, and a slice that is led by its own relatives does not keep the law it should.

use super::ladder::{barrier, locate, respaced};
use super::swap;
use crate::cooling::Cooling;
use crate::error::Result;
use crate::hmc::{Evaluator, Metric, MetricKind, Point, Tally, explore_by_slices};
use crate::neighbours::Neighbours;
use crate::rng::{Domain, stream, unit_open};
use crate::target::{Symmetry, Target};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// A population at one temperature, after its sweeps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Level {
    pub(super) beta: f64,
    /// Rows of coordinates, one after the other.
    pub(super) z: Vec<f64>,
    pub(super) ln_likelihood: Vec<f64>,
}

impl Level {
    fn of(beta: f64, points: &[Point]) -> Self {
        Self {
            beta,
            z: points.iter().flat_map(|p| p.z.iter().copied()).collect(),
            ln_likelihood: points.iter().map(|p| p.ln_likelihood).collect(),
        }
    }

    /// Member number `i`.
    pub(super) fn point(&self, i: usize) -> Point {
        let dim = self.z.len() / self.ln_likelihood.len();
        let mut point = Point::new(dim);
        point.z.copy_from_slice(&self.z[i * dim..(i + 1) * dim]);
        point.ln_likelihood = self.ln_likelihood[i];
        point
    }
}

/// Mean rejection of swaps between members of two neighbouring levels: the barrier between them.
fn rejection(hot: &Level, cold: &Level) -> f64 {
    let gap = cold.beta - hot.beta;
    let pairs = (hot.ln_likelihood.len() * cold.ln_likelihood.len()) as f64;
    let sum: f64 = hot
        .ln_likelihood
        .iter()
        .flat_map(|h| cold.ln_likelihood.iter().map(move |c| (*h, *c)))
        .map(|(h, c)| 1.0 - swap::acceptance(gap, h, c))
        .sum();
    sum / pairs
}

/// The communication barrier from the prior to each temperature that a population passed.
#[derive(Clone, Debug)]
pub(super) struct Barrier {
    beta: Vec<f64>,
    lambda: Vec<f64>,
}

impl Barrier {
    /// Of one population's levels.
    pub(super) fn of(levels: &[Level]) -> Self {
        let between: Vec<f64> = levels.windows(2).map(|l| rejection(&l[0], &l[1])).collect();
        Self {
            beta: levels.iter().map(|level| level.beta).collect(),
            lambda: barrier(&between),
        }
    }

    /// The mean of several populations' barriers, at all their temperatures.
    pub(super) fn mean(barriers: &[Self]) -> Self {
        let mut beta: Vec<f64> = barriers
            .iter()
            .flat_map(|b| b.beta.iter().copied())
            .collect();
        beta.sort_by(f64::total_cmp);
        // Populations share their first and last temperature.
        beta.dedup_by(|a, b| a.to_bits() == b.to_bits());
        let mean = |b: &f64| barriers.iter().map(|l| l.at(*b)).sum::<f64>() / barriers.len() as f64;
        Self {
            lambda: beta.iter().map(mean).collect(),
            beta,
        }
    }

    /// From the prior to inverse temperature `beta`.
    pub(super) fn at(&self, beta: f64) -> f64 {
        let (i, t) = locate(&self.beta, beta);
        self.lambda[i] * (1.0 - t) + self.lambda[i + 1] * t
    }

    /// To the posterior.
    pub(super) fn total(&self) -> f64 {
        self.at(1.0)
    }

    /// This many temperatures, evenly spaced in the barrier.
    pub(super) fn schedule(&self, count: usize) -> Vec<f64> {
        respaced(&self.beta, &self.lambda, count)
    }
}

/// One population.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Population {
    points: Vec<Point>,
    ln_z: f64,
    levels: Vec<Level>,
}

impl Population {
    /// How members weigh at lower temperatures.
    fn cooling(&self) -> Cooling {
        Cooling::new(self.points.iter().map(|p| p.ln_likelihood).collect())
    }

    /// Resamples by the weights of a step.
    fn resample(&mut self, step: f64, uniform: f64) {
        let cooling = self.cooling();
        self.ln_z += cooling.ln_mean_weight(step);
        let drawn = cooling.resample(step, uniform).into_iter();
        self.points = drawn.map(|i| self.points[i].clone()).collect();
    }
}

/// All populations.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Annealing {
    beta: f64,
    /// Sweeps done at this temperature.
    sweeps: usize,
    populations: Vec<Population>,
    /// What members of the even and of the odd populations move by.
    metrics: [Metric; 2],
    pools: [Neighbours; 2],
    /// Sweeps done, over all temperatures: the index of the random streams.
    clock: u64,
}

impl Annealing {
    /// From draws of the prior, population by population.
    pub(super) fn new(points: Vec<Vec<Point>>, kind: MetricKind) -> Self {
        let metric = Metric::identity(kind, points[0][0].z.len());
        let population = |points: Vec<Point>| Population {
            ln_z: 0.0,
            levels: vec![Level::of(0.0, &points)],
            points,
        };
        Self {
            beta: 0.0,
            sweeps: 0,
            populations: points.into_iter().map(population).collect(),
            metrics: [metric.clone(), metric],
            pools: Default::default(),
            clock: 0,
        }
    }

    /// Whether all have arrived at the posterior.
    pub(super) fn done(&self) -> bool {
        let last = self.populations.iter().filter_map(|p| p.levels.last());
        last.into_iter().all(|level| level.beta >= 1.0)
    }

    /// The inverse temperature, and the mean of the estimates of ln Z so far.
    pub(super) fn progress(&self) -> (f64, f64) {
        let sum: f64 = self.populations.iter().map(|p| p.ln_z).sum();
        (self.beta, sum / self.populations.len() as f64)
    }

    /// Each population's levels, from the prior on.
    pub(super) fn levels(&self) -> impl Iterator<Item = &[Level]> {
        self.populations.iter().map(|p| p.levels.as_slice())
    }

    /// Lowers the temperature as far as every population's weights allow, and resamples.
    fn cool(&mut self, target: &dyn Target, kind: MetricKind, seed: u64) {
        let most = 1.0 - self.beta;
        let steps = self
            .populations
            .iter()
            .map(|p| p.cooling().longest_step(most));
        let step = steps.fold(most, f64::min);
        // A step of almost all that is left takes it all: what remains weighs nothing.
        self.beta = if step >= most * (1.0 - 1e-9) {
            1.0
        } else {
            self.beta + step
        };
        for (number, population) in self.populations.iter_mut().enumerate() {
            let task = (number as u64) << 20 | 0xf_ffff;
            let mut rng = stream(seed, Domain::PtAnneal, task, self.clock);
            population.resample(step, unit_open(&mut rng));
        }
        let dim = target.dim();
        let orbit = Symmetry::first_orbit(target.symmetries());
        let rows = self.populations.iter().map(|p| {
            let z = p.points.iter().map(|point| point.z.as_slice());
            z.collect::<Vec<_>>().concat()
        });
        let others = of_others(rows);
        self.metrics = [0, 1].map(|half| Metric::of_rows(kind, &others[half], dim));
        self.pools = [0, 1].map(|half| Neighbours::new(&others[half], dim, orbit));
        self.sweeps = 0;
    }

    /// One sweep: every member of every population moves by one slice; cooling before it where it is due. On an error
    /// no member has moved, and the same sweep can be tried again.
    pub(super) fn advance(
        &mut self,
        target: &dyn Target,
        kind: MetricKind,
        sweeps: usize,
        seed: u64,
    ) -> Result<Tally> {
        if self.beta <= 0.0 || self.sweeps == sweeps {
            self.cool(target, kind, seed);
        }
        let tasks: Vec<(usize, usize)> = self
            .populations
            .iter()
            .enumerate()
            .flat_map(|(number, p)| (0..p.points.len()).map(move |i| (number, i)))
            .collect();
        let moved: Vec<Result<(Point, Evaluator<'_>)>> = tasks
            .par_iter()
            .map(|&(number, i)| {
                let task = (number as u64) << 20 | i as u64;
                let mut rng = stream(seed, Domain::PtAnneal, task, self.clock);
                let mut evaluator = Evaluator::new(target);
                let mut point = self.populations[number].points[i].clone();
                let half = number % 2;
                explore_by_slices(
                    &mut evaluator,
                    self.beta,
                    &self.metrics[half],
                    &self.pools[half],
                    1,
                    &mut point,
                    &mut rng,
                    |_| (),
                )?;
                Ok((point, evaluator))
            })
            .collect();
        let moved: Vec<(Point, Evaluator<'_>)> = moved.into_iter().collect::<Result<_>>()?;
        let mut tally = Tally::default();
        for (&(number, i), (point, evaluator)) in tasks.iter().zip(moved) {
            self.populations[number].points[i] = point;
            tally.add(&evaluator);
        }
        self.sweeps += 1;
        if self.sweeps == sweeps {
            for population in &mut self.populations {
                let level = Level::of(self.beta, &population.points);
                population.levels.push(level);
            }
        }
        self.clock += 1;
        Ok(tally)
    }
}

/// The rows of families for those of the other half: of the odd ones for the even, and of the even ones for the odd. A family
/// without others has its own.
pub(super) fn of_others<R: AsRef<[f64]>>(rows: impl Iterator<Item = R>) -> [Vec<f64>; 2] {
    let mut halves: [Vec<f64>; 2] = Default::default();
    for (family, rows) in rows.enumerate() {
        halves[1 - family % 2].extend_from_slice(rows.as_ref());
    }
    let [even, odd] = halves;
    if even.is_empty() {
        [odd.clone(), odd]
    } else {
        [even, odd]
    }
}
