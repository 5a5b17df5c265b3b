//! The points that a surrogate of ln L is fitted to: those of the SMC samplers; those that chains tried;
//! and states at all temperatures, moved by differences of others at the same temperature over a wide range of lengths.

use super::smc::Level;
use super::state::State;
use crate::diagnostics::column_moments;
use crate::error::{Error, Result};
use crate::hmc::Evaluator;
use crate::rng::{Domain, RandomStream, below, standard_normal, stream, unit_open};
use crate::surrogate::{DEPTH, Surrogate};
use crate::target::Target;

/// Range of the decimal logarithm of the length of a move, in units of half a difference.
const LENGTHS: [f64; 2] = [-1.5, 0.1];

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

    /// Fits the surrogate, where the settings ask for one, to ln L at all points so far and at new ones. The present one remains where
    /// ln L is finite at too few points.
    ///
    /// # Errors
    /// [`Error::Setting`] if ln L is finite at too few points for a first surrogate; those of the target.
    pub(super) fn next_surrogate(
        &mut self,
        target: &dyn Target,
        mut states: Vec<States>,
    ) -> Result<()> {
        let count = self.settings.surrogate_points;
        if count == 0 {
            return Ok(());
        }
        let dim = target.dim();
        // A first surrogate knows nothing of where it is wrong, and is fitted at once again.
        for turn in 0.. {
            let rng = |part: u64| {
                let part = 4 * turn + part;
                stream(self.seed, Domain::PtSurrogate, self.clock, part)
            };
            let mut evaluator = Evaluator::new(target);
            if let Some(surrogate) = &self.surrogate {
                for states in &mut states {
                    states.weigh(&mut evaluator, surrogate)?;
                }
            }
            let points = points_near(&states, dim, count, &mut rng(0));
            self.examples.append(evaluator.examples(&points)?);
            self.examples.keep_last(self.settings.examples_kept());
            let fitted = Surrogate::fit(&self.examples, self.surrogate.as_ref(), &mut rng(1));
            self.cost.count(&evaluator.calls);
            let first = self.surrogate.is_none();
            if fitted.is_some() {
                self.surrogate = fitted;
            }
            if self.surrogate.is_none() {
                return Err(self.no_surrogate());
            }
            if !first {
                break;
            }
        }
        Ok(())
    }

    fn no_surrogate(&self) -> Error {
        Error::Setting {
            name: "surrogate_points",
            value: self.settings.surrogate_points.to_string(),
            remedy: "ln L is finite at too few of the points for a surrogate: give more, or 0 for none",
        }
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
