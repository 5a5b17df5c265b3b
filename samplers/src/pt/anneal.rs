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
use crate::error::Result;
use crate::hmc::{Evaluator, Metric, MetricKind, Point, Tally, explore_by_slices};
use crate::neighbours::Neighbours;
use crate::rng::{Domain, stream, unit_open};
use crate::target::{Symmetry, Target};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Effective share of a population that the weights of one cooling step leave.
const KEPT: f64 = 0.5;

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
    /// The longest step down from `beta` that leaves weights enough.
    fn longest_step(&self, most: f64) -> f64 {
        let enough = KEPT * self.points.len() as f64;
        if effective(&self.weights(most)) >= enough {
            return most;
        }
        let mut bracket = (0.0, most);
        for _ in 0..60 {
            let step = 0.5 * (bracket.0 + bracket.1);
            if effective(&self.weights(step)) < enough {
                bracket.1 = step;
            } else {
                bracket.0 = step;
            }
        }
        0.5 * (bracket.0 + bracket.1)
    }

    /// Resamples by the weights of a step.
    fn resample(&mut self, step: f64, uniform: f64) {
        let weights = self.weights(step);
        let sum: f64 = weights.iter().sum();
        self.ln_z += step * self.best() + (sum / self.points.len() as f64).ln();
        self.points = systematic(&weights, sum, uniform)
            .into_iter()
            .map(|i| self.points[i].clone())
            .collect();
    }

    fn best(&self) -> f64 {
        let l = self.points.iter().map(|p| p.ln_likelihood);
        l.fold(f64::NEG_INFINITY, f64::max)
    }

    fn weights(&self, step: f64) -> Vec<f64> {
        let best = self.best();
        let weight = |p: &Point| (step * (p.ln_likelihood - best)).exp();
        self.points.iter().map(weight).collect()
    }
}

/// Kish's effective number.
fn effective(weights: &[f64]) -> f64 {
    let sum: f64 = weights.iter().sum();
    sum * sum / weights.iter().map(|w| w * w).sum::<f64>()
}

/// As many indices as weights, each as often as its weight says or once more.
fn systematic(weights: &[f64], sum: f64, uniform: f64) -> Vec<usize> {
    let count = weights.len();
    let mut index = 0;
    let mut passed = weights[0];
    (0..count)
        .map(|j| {
            let at = (j as f64 + uniform) / count as f64 * sum;
            while passed < at && index + 1 < count {
                index += 1;
                passed += weights[index];
            }
            index
        })
        .collect()
}

/// The covariance of rows as a metric; the prior's if they do not span the space.
pub(super) fn metric_of(rows: &[f64], dim: usize, kind: MetricKind) -> Metric {
    let rows: Vec<DVector<f64>> = rows
        .chunks_exact(dim)
        .map(DVector::from_column_slice)
        .collect();
    let n = rows.len() as f64;
    let mean = rows.iter().sum::<DVector<f64>>() / n;
    let mut covariance = DMatrix::zeros(dim, dim);
    for row in &rows {
        let away = row - &mean;
        covariance += &away * away.transpose() / n;
    }
    Metric::from_covariance(kind, &covariance).unwrap_or_else(|| Metric::identity(kind, dim))
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
        let steps = self.populations.iter().map(|p| p.longest_step(most));
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
        self.metrics = [0, 1].map(|half| metric_of(&others[half], dim, kind));
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn resampling_takes_each_as_often_as_its_weight_says() {
        let weights = [0.5, 0.0, 2.5, 1.0];
        assert_eq!(systematic(&weights, 4.0, 0.4), [0, 2, 2, 3]);
        assert_eq!(systematic(&weights, 4.0, 0.6), [2, 2, 2, 3]);
        assert!((effective(&[1.0, 1.0, 0.0, 0.0]) - 2.0).abs() < 1e-12);
    }

    #[test]
    fn the_metric_of_rows_is_their_covariance() {
        let rows = [1.0, 0.0, -1.0, 0.0, 0.0, 2.0, 0.0, -2.0];
        let metric = metric_of(&rows, 2, MetricKind::Dense).covariance();
        assert!((metric[(0, 0)] - 0.5).abs() < 1e-12 && (metric[(1, 1)] - 2.0).abs() < 1e-12);
        // Rows on a line span nothing.
        let line = metric_of(&[1.0, 1.0, -1.0, -1.0], 2, MetricKind::Dense);
        assert_eq!(line, Metric::identity(MetricKind::Dense, 2));
    }
}
