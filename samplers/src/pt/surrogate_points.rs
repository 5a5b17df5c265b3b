//! The points that a surrogate of ln L is fitted to: states at all temperatures, moved by differences of others at the same
//! temperature over a wide range of lengths; then points that trajectories along the surrogate come to, where it may be wrong.

use super::Settings;
use super::smc::Level;
use super::state::State;
use crate::diagnostics::column_moments;
use crate::error::Result;
use crate::hmc::{Evaluator, LocalSampler, Metric, Plan, Point};
use crate::rng::{Domain, RandomStream, below, standard_normal, stream, unit_open};
use crate::surrogate::{DEPTH, Surrogate};
use crate::target::Target;
use rayon::prelude::*;

/// Range of the decimal logarithm of the length of a move, in units of half a difference.
const LENGTHS: [f64; 2] = [-1.5, 0.1];

/// Range of the decimal logarithm of the step of trajectories along the surrogate, in metric units.
const STEPS: [f64; 2] = [-2.0, -0.7];

/// Error of the surrogate, in units of ln L, that is added to that of each state: no state is left out.
const LEAST_ERROR: f64 = 0.2;

/// Error above which all states count alike.
const MOST_ERROR: f64 = 10.0;

/// States at one temperature.
pub(super) struct States {
    beta: f64,
    /// Rows of coordinates.
    rows: Vec<f64>,
    /// ln L of each, once it has been needed.
    ln_likelihood: Vec<f64>,
    /// Sums of the weights with which the states are chosen: all alike, or more where the surrogate is wrong.
    sums: Vec<f64>,
}

impl States {
    fn new(beta: f64, rows: Vec<f64>, dim: usize) -> Self {
        let sums = (1..=rows.len() / dim).map(|count| count as f64).collect();
        Self {
            beta,
            rows,
            ln_likelihood: Vec::new(),
            sums,
        }
    }

    /// Weighs the states by the errors of a surrogate. ln L of the states is computed the first time.
    fn weigh(&mut self, evaluator: &mut Evaluator<'_>, surrogate: &Surrogate) -> Result<()> {
        let dim = evaluator.target().dim();
        let places: Vec<&[f64]> = self.rows.chunks_exact(dim).collect();
        if self.ln_likelihood.is_empty() {
            self.ln_likelihood = evaluator.values(&places)?;
        }
        let mut sum = 0.0;
        let weighed = places.iter().zip(&self.ln_likelihood).map(|(z, value)| {
            let error = self.beta * (value - evaluator.surrogate_value(z, surrogate)).abs();
            // A state without a likelihood has an infinite error.
            sum += LEAST_ERROR + error.min(MOST_ERROR);
            sum
        });
        self.sums = weighed.collect();
        Ok(())
    }

    /// A state, by the weights.
    fn weighted(&self, dim: usize, rng: &mut RandomStream) -> &[f64] {
        let place = unit_open(rng) * self.sums.last().copied().unwrap_or(0.0);
        let row = self.sums.partition_point(|sum| *sum < place);
        &self.rows[row * dim..(row + 1) * dim]
    }

    /// A state, all alike.
    fn any(&self, dim: usize, rng: &mut RandomStream) -> &[f64] {
        let row = below(rng, self.rows.len() / dim);
        &self.rows[row * dim..(row + 1) * dim]
    }
}

impl State {
    /// States of the last round, or extension, at each temperature but the first.
    pub(super) fn visited_states(&self) -> Vec<States> {
        let visits = self.record.extension().visits.iter();
        let dim = self.chains.first().map_or(1, |chain| chain.point.z.len());
        let states = visits.zip(self.beta());
        let states = states.map(|(visits, beta)| States::new(beta, visits.concat(), dim));
        states.skip(1).collect()
    }

    /// Fits the surrogate, where the settings ask for one, to ln L near states and along itself. The present one remains where
    /// ln L is finite at too few points.
    pub(super) fn next_surrogate(
        &mut self,
        target: &dyn Target,
        mut states: Vec<States>,
    ) -> Result<()> {
        let count = self.settings.surrogate_points;
        if count == 0 || states.iter().all(|s| s.rows.is_empty()) {
            return Ok(());
        }
        let dim = target.dim();
        let mut examples = self.examples.clone();
        let mut surrogate = self.surrogate.clone();
        let mut evaluator = Evaluator::new(target);
        // A first surrogate is fitted to points near states alone, and then at once again.
        for turn in 0.. {
            let rng = |part: u64| {
                let part = 4 * turn + part;
                stream(self.seed, Domain::PtSurrogate, self.clock, part)
            };
            if let Some(surrogate) = &surrogate {
                for states in &mut states {
                    states.weigh(&mut evaluator, surrogate)?;
                }
            }
            let mut points = points_near(&states, dim, count / 2, &mut rng(0));
            if let Some(surrogate) = &surrogate {
                points.extend(
                    self.points_along(target, surrogate, &states, count / 2, |i| {
                        stream(
                            self.seed,
                            Domain::PtSurrogate,
                            (turn + 1) << 40 | i,
                            self.clock,
                        )
                    })?,
                );
            }
            examples.append(evaluator.examples(&points)?);
            examples.keep_last(Settings::EXAMPLES_KEPT * count);
            let fitted = Surrogate::fit(&examples, surrogate.as_ref(), &mut rng(1));
            let first = surrogate.is_none();
            surrogate = fitted.or(surrogate);
            if !first || surrogate.is_none() {
                break;
            }
        }
        self.examples = examples;
        self.surrogate = surrogate;
        self.cost.count(&evaluator.calls);
        Ok(())
    }

    /// Rows of points after each HMC transition along a surrogate, from states at temperatures chosen in proportion to beta.
    fn points_along(
        &self,
        target: &dyn Target,
        surrogate: &Surrogate,
        states: &[States],
        count: usize,
        rng: impl Fn(u64) -> RandomStream + Sync,
    ) -> Result<Vec<f64>> {
        let dim = target.dim();
        let metrics: Vec<Metric> = states
            .iter()
            .map(|s| Metric::of_rows(&s.rows, dim))
            .collect();
        let transitions = self.settings.hmc_transitions.max(1);
        let found: Vec<Result<Vec<f64>>> = (0..count.div_ceil(transitions) as u64)
            .into_par_iter()
            .map(|i| {
                let mut rng = rng(i);
                let which = chosen(states, &mut rng);
                let beta = states[which].beta;
                let evaluator = Evaluator::new(target).with_surrogate(surrogate);
                let mut along = LocalSampler::of(evaluator, beta, &metrics[which]);
                let mut point = Point::new(dim);
                point
                    .z
                    .copy_from_slice(states[which].weighted(dim, &mut rng));
                let plan = Plan {
                    step: 10_f64.powf(STEPS[0] + (STEPS[1] - STEPS[0]) * unit_open(&mut rng)),
                    length: self.settings.trajectory,
                    max_leapfrogs: self.settings.max_leapfrogs,
                    max_energy_range: f64::INFINITY,
                    slack: 0.0,
                };
                let mut points = Vec::new();
                for _ in 0..transitions {
                    along.transition(&mut point, &plan, &mut rng)?;
                    points.extend_from_slice(&point.z);
                }
                Ok(points)
            })
            .collect();
        let found: Vec<Vec<f64>> = found.into_iter().collect::<Result<_>>()?;
        Ok(found.concat())
    }
}

/// The states of the levels whose mean ln L is no further below that of the posterior than a surrogate is fitted to, those of
/// all SMC samplers together.
pub(super) fn states_near_posterior(levels: &[Vec<Level>], dim: usize) -> Vec<States> {
    let count = levels.first().map_or(0, Vec::len);
    let mean = |k: usize| {
        let all = levels.iter().flat_map(|l| &l[k].ln_likelihood);
        all.clone().sum::<f64>() / all.count() as f64
    };
    let least = if count > 0 {
        mean(count - 1) - DEPTH
    } else {
        0.0
    };
    (0..count)
        .filter(|&k| mean(k) > least)
        .map(|k| {
            let rows = levels.iter().flat_map(|l| l[k].z.iter().copied());
            States::new(levels[0][k].beta, rows.collect(), dim)
        })
        .collect()
}

/// A temperature, in proportion to beta.
fn chosen(states: &[States], rng: &mut RandomStream) -> usize {
    let total: f64 = states.iter().map(|s| s.beta).sum();
    let mut place = total * unit_open(rng);
    let found = states.iter().position(|s| {
        place -= s.beta;
        place < 0.0
    });
    found.unwrap_or(states.len() - 1)
}

/// Rows of `count` points near states.
fn points_near(states: &[States], dim: usize, count: usize, rng: &mut RandomStream) -> Vec<f64> {
    let sds: Vec<Vec<f64>> = (states.iter())
        .map(|states| {
            let moments = column_moments(&states.rows, dim).into_iter();
            moments.map(|(_, variance)| variance.sqrt()).collect()
        })
        .collect();
    let mut points = Vec::with_capacity(count * dim);
    for _ in 0..count {
        let which = chosen(states, rng);
        let at = states[which].weighted(dim, rng);
        let [from, to] = [0; 2].map(|_| states[which].any(dim, rng));
        let length = 0.5 * 10_f64.powf(LENGTHS[0] + (LENGTHS[1] - LENGTHS[0]) * unit_open(rng));
        // Along a difference, in some of the coordinates, or in all of them independently.
        let kind = below(rng, 3);
        let fraction = 0.1 + 0.9 * unit_open(rng);
        for i in 0..dim {
            let difference = to[i] - from[i];
            let step = match kind {
                0 => difference,
                1 if unit_open(rng) < fraction => difference,
                1 => 0.0,
                _ => sds[which][i] * standard_normal(rng),
            };
            points.push(at[i] + length * step);
        }
    }
    points
}
