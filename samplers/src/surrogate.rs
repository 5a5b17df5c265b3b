//! A surrogate of ln L: a neural network fitted to values of ln L at many points. It costs a hundredth of the likelihoods for
//! which it is meant, is smooth, and has a gradient. Moves that follow it are accepted by ln L itself, so that it decides how far
//! they go, and not what they sample.
//!
//! A likelihood of residuals, `ln L = rest - |r|^2 / 2`, is learned residual by residual: they are smooth where ln L itself is
//! steep.

mod muon;
mod network;

use crate::diagnostics::column_moments;
use crate::rng::{RandomStream, below};
use crate::single::single;
use crate::valid::{Valid, ensure, moderate, rows};
use muon::Muon;
use network::{Batch, Network, Pass};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Depth below the largest ln L at which points need only be known to be deep: only those at which a surrogate is too high are learned.
pub const DEPTH: f64 = 100.0;

/// Passes through the examples, and least steps of the optimiser where few examples want more passes: of a first fit, and of a fit
/// that begins with an earlier network.
const PASSES: [usize; 2] = [10, 4];
const LEAST_STEPS: [usize; 2] = [300, 60];

/// Step of the optimiser at the beginning, from where it falls as a cosine to zero.
const RATE: f32 = 3e-2;

/// Examples of a step, and those of a task of a step.
const BATCH: usize = 1024;
const TASK: usize = 128;

/// Relative error of ln L, below its largest value, that counts as much as an error of 1 there.
const RELATIVE: f32 = 0.1;

/// Weight of the errors of residuals beside those of ln L, and the relative error that counts as much as an error of 1 at zero.
const RESIDUALS_WEIGHT: f32 = 0.3;
const RESIDUALS_RELATIVE: f32 = 0.1;

/// Standard deviation below which a feature or a residual counts as constant.
const LEAST_SD: f64 = 1e-6;

/// Fewest examples of a fit.
const MIN_EXAMPLES: usize = 1_000;

/// Values of ln L at many points, in single precision.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Examples {
    /// Rows of features of the target.
    features: Vec<f32>,
    ln_likelihood: Vec<f32>,
    /// Rows of residuals.
    residuals: Vec<f32>,
}

impl Examples {
    /// Number of examples.
    #[must_use]
    pub fn len(&self) -> usize {
        self.ln_likelihood.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.ln_likelihood.is_empty()
    }

    /// Adds an example with a finite ln L; all have the same numbers of features and of residuals. One with a number too large for single precision is left out.
    pub fn push(&mut self, features: &[f64], ln_likelihood: f64, residuals: &[f64]) {
        let mut all = features.iter().chain(residuals).chain([&ln_likelihood]);
        if !all.all(|x| single(*x).is_finite()) {
            return;
        }
        self.features.extend(features.iter().copied().map(single));
        self.ln_likelihood.push(single(ln_likelihood));
        self.residuals.extend(residuals.iter().copied().map(single));
    }

    /// Adds others.
    pub fn append(&mut self, others: Self) {
        self.features.extend(others.features);
        self.ln_likelihood.extend(others.ln_likelihood);
        self.residuals.extend(others.residuals);
    }

    /// Keeps the last `count` examples.
    pub fn keep_last(&mut self, count: usize) {
        let present = self.len().max(1);
        let (width, per_row) = (
            self.features.len() / present,
            self.residuals.len() / present,
        );
        let gone = self.len().saturating_sub(count);
        self.features.drain(..gone * width);
        self.ln_likelihood.drain(..gone);
        self.residuals.drain(..gone * per_row);
    }

    /// Keeps at most `count` examples: the older an example, the less probable that it stays, but some of every age do.
    pub fn thin(&mut self, count: usize) {
        while self.len() > count {
            let half = self.len() / 2;
            self.retain(|i| i >= half || i % 2 == 1);
        }
    }

    /// Keeps the examples of these numbers.
    fn retain(&mut self, kept: impl Fn(usize) -> bool) {
        fn rows(values: &mut Vec<f32>, width: usize, kept: &impl Fn(usize) -> bool) {
            let mut i = 0;
            values.retain(|_| {
                i += 1;
                kept((i - 1) / width)
            });
        }
        let present = self.len().max(1);
        let (width, per_row) = (
            self.features.len() / present,
            self.residuals.len() / present,
        );
        rows(&mut self.features, width.max(1), &kept);
        rows(&mut self.residuals, per_row.max(1), &kept);
        rows(&mut self.ln_likelihood, 1, &kept);
    }

    /// Checks examples of so many features that were read from a file.
    pub(crate) fn check(&self, features: usize) -> Valid {
        let count = self.len();
        let all = self
            .features
            .iter()
            .chain(&self.ln_likelihood)
            .chain(&self.residuals);
        ensure(
            rows(self.features.len(), count, features)
                && self.residuals.len().is_multiple_of(count.max(1))
                && all.copied().all(f32::is_finite),
            "examples of a surrogate have other features, or are not finite",
        )
    }
}

/// The surrogate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Surrogate {
    /// Mean and standard deviation of each feature of the examples, and of each output.
    inputs: Vec<(f64, f64)>,
    outputs: Vec<(f64, f64)>,
    network: Network,
}

/// Space for the evaluations of one task.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    x: Vec<f32>,
    x_bar: Vec<f32>,
    y: Vec<f32>,
    outputs_bar: Vec<f32>,
    pass: Pass,
}

/// Space for a task of a step of the optimiser.
#[derive(Clone, Debug, Default)]
struct Task {
    x: Vec<f32>,
    y: Vec<f32>,
    outputs_bar: Vec<f32>,
    batch: Batch,
}

/// Examples in the units of a network.
struct Learned {
    x: Vec<f32>,
    y: Vec<f32>,
    ln_likelihood: Vec<f32>,
    /// Largest ln L.
    top: f32,
}

impl Surrogate {
    /// Fits a surrogate, beginning with an earlier one if there is one. None if the examples with a likelihood near the largest are
    /// too few.
    #[must_use]
    pub fn fit(
        examples: &Examples,
        earlier: Option<&Self>,
        rng: &mut RandomStream,
    ) -> Option<Self> {
        Self::fit_to_depth(examples, DEPTH, earlier, rng)
    }

    /// The same with another depth below the largest ln L than [`DEPTH`].
    #[must_use]
    pub fn fit_to_depth(
        examples: &Examples,
        depth: f64,
        earlier: Option<&Self>,
        rng: &mut RandomStream,
    ) -> Option<Self> {
        let count = examples.len();
        let top = examples
            .ln_likelihood
            .iter()
            .copied()
            .fold(f32::NEG_INFINITY, f32::max);
        let deep = |i: usize| examples.ln_likelihood[i] <= top - single(depth);
        if (0..count).filter(|&i| !deep(i)).count() < MIN_EXAMPLES {
            return None;
        }
        let width = examples.features.len() / count;
        let per_row = examples.residuals.len() / count;
        let kept: Vec<usize> = (0..count)
            .into_par_iter()
            .map_init(Scratch::default, |scratch, i| {
                let known = !deep(i);
                (
                    i,
                    known
                        || earlier.is_some_and(|e| {
                            e.is_near(
                                top - single(2.0 * depth),
                                &examples.features[i * width..(i + 1) * width],
                                scratch,
                            )
                        }),
                )
            })
            .filter_map(|(i, kept)| kept.then_some(i))
            .collect();
        let features: Vec<f64> = (kept.iter())
            .flat_map(|&i| &examples.features[i * width..(i + 1) * width])
            .copied()
            .map(f64::from)
            .collect();
        let y: Vec<f64> = kept
            .iter()
            .flat_map(|&i| {
                let residuals = &examples.residuals[i * per_row..(i + 1) * per_row];
                let residuals = residuals.iter().copied().map(f64::from);
                let square: f64 = residuals.clone().map(|r| r * r).sum();
                residuals.chain([f64::from(examples.ln_likelihood[i]) + 0.5 * square])
            })
            .collect();
        let mut surrogate = match earlier {
            Some(earlier) if earlier.network.outputs() == per_row + 1 => earlier.clone(),
            _ => Self {
                network: Network::new(width, per_row + 1, rng),
                inputs: units(&features, width),
                outputs: units(&y, per_row + 1),
            },
        };
        let standard = |row: &[f64]| -> Vec<f32> {
            let units = row.iter().zip(&surrogate.inputs);
            units
                .map(|(x, (mean, sd))| single((x - mean) / sd))
                .collect()
        };
        let learned = Learned {
            x: features.chunks_exact(width).flat_map(standard).collect(),
            y: y.into_iter().map(single).collect(),
            ln_likelihood: kept.iter().map(|&i| examples.ln_likelihood[i]).collect(),
            top,
        };
        let again = usize::from(earlier.is_some());
        let least = LEAST_STEPS[again].div_ceil(kept.len().div_ceil(BATCH));
        surrogate.learn(&learned, PASSES[again].max(least), rng);
        surrogate.network.prepare();
        let finite = surrogate.network.parameters().iter().all(|p| p.is_finite());
        finite.then_some(surrogate)
    }

    /// Whether the estimate at these features is higher than this.
    fn is_near(&self, lowest: f32, features: &[f32], scratch: &mut Scratch) -> bool {
        let features: Vec<f64> = features.iter().copied().map(f64::from).collect();
        self.ln_likelihood(&features, scratch) > f64::from(lowest)
    }

    /// The numbers that make a surrogate: mean and standard deviation of each feature, the same of each output, and the parameters of the
    /// network.
    #[must_use]
    pub fn numbers(&self) -> [Vec<f64>; 3] {
        let flat = |units: &[(f64, f64)]| units.iter().flat_map(|(a, b)| [*a, *b]).collect();
        let parameters = self.network.parameters().iter().copied().map(f64::from);
        [
            flat(&self.inputs),
            flat(&self.outputs),
            parameters.collect(),
        ]
    }

    /// The surrogate of these [`numbers`](Self::numbers); none if they do not belong together.
    #[must_use]
    pub fn of_numbers([inputs, outputs, parameters]: &[Vec<f64>; 3]) -> Option<Self> {
        let pairs = |flat: &[f64]| flat.chunks_exact(2).map(|p| (p[0], p[1])).collect();
        let (inputs, outputs): (Vec<_>, Vec<_>) = (pairs(inputs), pairs(outputs));
        let mut surrogate = Self {
            network: Network::of_parameters(
                inputs.len(),
                outputs.len(),
                parameters.iter().copied().map(single).collect(),
            ),
            inputs,
            outputs,
        };
        surrogate.check(surrogate.inputs.len()).ok()?;
        surrogate.prepare();
        Some(surrogate)
    }

    /// Number of features that it sees.
    #[must_use]
    pub fn features(&self) -> usize {
        self.inputs.len()
    }

    /// Prepares a surrogate that was read from a file for use.
    pub(crate) fn prepare(&mut self) {
        self.network.prepare();
    }

    /// Checks a surrogate of so many features that was read from a file.
    pub(crate) fn check(&self, features: usize) -> Valid {
        self.network.check(features)?;
        let units = self.inputs.iter().chain(&self.outputs);
        ensure(
            self.inputs.len() == features
                && self.outputs.len() == self.network.outputs()
                && units
                    .clone()
                    .all(|(mean, sd)| moderate([mean, sd]) && *sd > 0.0),
            "a surrogate has other features, or is not finite",
        )
    }

    /// The estimate of ln L from the features of a point.
    pub fn ln_likelihood(&self, features: &[f64], scratch: &mut Scratch) -> f64 {
        self.forward(features, scratch);
        let (rest, residuals) = split(&scratch.y);
        f64::from(rest) - 0.5 * f64::from(square(residuals))
    }

    /// The estimate of ln L, with its derivatives by the features written into `gradient`.
    pub fn ln_likelihood_and_gradient(
        &self,
        features: &[f64],
        gradient: &mut [f64],
        scratch: &mut Scratch,
    ) -> f64 {
        let value = self.ln_likelihood(features, scratch);
        let last = self.outputs.len() - 1;
        scratch.outputs_bar.clear();
        for (i, (y, (_, sd))) in scratch.y.iter().zip(&self.outputs).enumerate() {
            let by_y = if i == last { 1.0 } else { -y };
            scratch.outputs_bar.push(by_y * single(*sd));
        }
        scratch.x_bar.resize(features.len(), 0.0);
        self.network
            .backward(&scratch.outputs_bar, &mut scratch.pass, &mut scratch.x_bar);
        for ((g, x_bar), (_, sd)) in gradient.iter_mut().zip(&scratch.x_bar).zip(&self.inputs) {
            *g = f64::from(*x_bar) / sd;
        }
        value
    }

    /// Residuals and rest, into `scratch.y`.
    fn forward(&self, features: &[f64], scratch: &mut Scratch) {
        scratch.x.clear();
        let units = features.iter().zip(&self.inputs);
        scratch
            .x
            .extend(units.map(|(x, (mean, sd))| single((x - mean) / sd)));
        self.network.forward(&scratch.x, &mut scratch.pass);
        scratch.y.clear();
        self.in_units(&scratch.pass.outputs, &mut scratch.y);
    }

    /// Appends residuals and rest from the outputs of the network.
    fn in_units(&self, outputs: &[f32], y: &mut Vec<f32>) {
        let units = outputs.iter().zip(&self.outputs);
        y.extend(units.map(|(o, (mean, sd))| o * single(*sd) + single(*mean)));
    }

    /// Steps of the optimiser through the examples in random order, pass after pass.
    fn learn(&mut self, examples: &Learned, passes: usize, rng: &mut RandomStream) {
        let count = examples.ln_likelihood.len();
        let mut order: Vec<usize> = (0..count).collect();
        let size = self.network.parameters().len();
        let mut muon = Muon::new(size);
        let steps = passes * count.div_ceil(BATCH);
        let mut step = 0;
        let mut buffers = vec![(vec![0.0_f32; size], Task::default()); BATCH / TASK];
        for _ in 0..passes {
            for i in (1..count).rev() {
                order.swap(i, below(rng, i + 1));
            }
            for batch in order.chunks(BATCH) {
                // Tasks of fixed rows, summed in their order: the same bits on any number of threads.
                buffers.par_iter_mut().zip(batch.par_chunks(TASK)).for_each(
                    |((gradient, task), rows)| {
                        gradient.fill(0.0);
                        self.add_gradient(examples, rows, gradient, task);
                    },
                );
                let tasks = batch.len().div_ceil(TASK);
                let (first, others) = buffers.split_at_mut(1);
                let gradient = &mut first[0].0;
                for (other, _) in &others[..tasks - 1] {
                    for (g, o) in gradient.iter_mut().zip(other) {
                        *g += o;
                    }
                }
                let scale = 1.0 / batch.len() as f32;
                gradient.iter_mut().for_each(|g| *g *= scale);
                let place = single(step as f64 / steps as f64 * std::f64::consts::PI);
                let rate = 0.5 * RATE * (1.0 + place.cos());
                muon.step(&mut self.network, gradient, rate);
                step += 1;
            }
        }
    }

    /// Adds the gradient of the loss at some examples by the parameters: a Huber loss of ln L and the mean square of the residuals'
    /// errors, both relative far from the maximum.
    fn add_gradient(
        &self,
        examples: &Learned,
        rows: &[usize],
        gradient: &mut [f32],
        task: &mut Task,
    ) {
        let (inputs, outputs) = (self.inputs.len(), self.outputs.len());
        let Task {
            x,
            y,
            outputs_bar,
            batch,
        } = task;
        x.clear();
        for row in rows {
            x.extend_from_slice(&examples.x[row * inputs..(row + 1) * inputs]);
        }
        self.network.forward_many(x, batch);
        outputs_bar.clear();
        for (row, outputs_of_row) in rows.iter().zip(batch.outputs.chunks_exact(outputs)) {
            y.clear();
            self.in_units(outputs_of_row, y);
            let truth = &examples.y[row * outputs..(row + 1) * outputs];
            let (rest, residuals) = split(y);
            let deepest = examples.top - single(DEPTH);
            let ln_likelihood = examples.ln_likelihood[*row].max(deepest);
            let unit = 1.0 + RELATIVE * (examples.top - ln_likelihood);
            let mut error = (rest - 0.5 * square(residuals) - ln_likelihood) / unit;
            if examples.ln_likelihood[*row] < deepest {
                error = error.max(0.0);
            }
            let by_ln_likelihood = error.clamp(-1.0, 1.0) / unit;
            for (i, ((y, t), (_, sd))) in y.iter().zip(truth).zip(&self.outputs).enumerate() {
                let unit = 1.0 + RESIDUALS_RELATIVE * t.abs();
                let by_error = 2.0 * RESIDUALS_WEIGHT / outputs as f32 * (y - t) / (unit * unit);
                let by_y = if i + 1 == outputs { 1.0 } else { -y };
                outputs_bar.push((by_ln_likelihood * by_y + by_error) * single(*sd));
            }
        }
        self.network.backward_many(outputs_bar, batch, gradient);
    }
}

/// Mean and standard deviation of each column of rows; what is the same everywhere has no unit of its own.
fn units(rows: &[f64], width: usize) -> Vec<(f64, f64)> {
    let moments = column_moments(rows, width).into_iter();
    let units = moments.map(|(mean, variance)| (mean, variance.sqrt()));
    units
        .map(|(mean, sd)| (mean, if sd > LEAST_SD { sd } else { 1.0 }))
        .collect()
}

/// The rest, which is last, and the residuals.
fn split(y: &[f32]) -> (f32, &[f32]) {
    y.split_last()
        .map_or((0.0, y), |(rest, residuals)| (*rest, residuals))
}

fn square(residuals: &[f32]) -> f32 {
    residuals.iter().map(|r| r * r).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Domain, standard_normal, stream};

    const DIM: usize = 4;

    #[test]
    fn examples_too_large_for_single_precision_are_left_out() {
        let mut examples = Examples::default();
        for (feature, ln_likelihood) in [(0.0, -1e39), (1e39, -1.0), (0.0, -1.0)] {
            examples.push(&[feature], ln_likelihood, &[0.5]);
        }
        assert_eq!(examples.len(), 1);
        assert_eq!(examples.check(1), Ok(()));
    }

    /// ln L of residuals that are bent functions of the coordinates.
    fn ln_likelihood(z: &[f64]) -> (f64, Vec<f64>) {
        let residual = |i: usize| 6.0 * (z[i] - 0.3 * z[(i + 1) % DIM].powi(2));
        let residuals: Vec<f64> = (0..DIM).map(residual).collect();
        let square: f64 = residuals.iter().map(|r| r * r).sum();
        (0.2 * z[0] - 0.5 * square, residuals)
    }

    /// Values at points of a normal distribution, with residuals or without.
    fn examples(count: usize, with_residuals: bool, seed: u64) -> Examples {
        let mut rng = stream(seed, Domain::Test, 0, 0);
        let mut examples = Examples::default();
        for _ in 0..count {
            let z: Vec<f64> = (0..DIM).map(|_| standard_normal(&mut rng)).collect();
            let (l, residuals) = ln_likelihood(&z);
            examples.push(&z, l, if with_residuals { &residuals } else { &[] });
        }
        examples
    }

    fn fitted(with_residuals: bool) -> Surrogate {
        let mut rng = stream(1, Domain::Test, 1, 0);
        Surrogate::fit(&examples(10_000, with_residuals, 1), None, &mut rng).unwrap()
    }

    /// Root mean square error at other points, where ln L is within 30 of the largest.
    fn error(surrogate: &Surrogate) -> f64 {
        let others = examples(2_000, false, 2);
        let mut scratch = Scratch::default();
        let errors: Vec<f64> = (others.features.chunks_exact(DIM).zip(&others.ln_likelihood))
            .filter(|(_, l)| **l > -30.0)
            .map(|(z, l)| {
                let z: Vec<f64> = z.iter().copied().map(f64::from).collect();
                surrogate.ln_likelihood(&z, &mut scratch) - f64::from(*l)
            })
            .collect();
        (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt()
    }

    #[test]
    fn ln_likelihoods_are_learned_with_residuals_and_without() {
        // ln L of these points has a standard deviation of some 8. The errors were measured as a third of this limit.
        for with_residuals in [true, false] {
            let error = error(&fitted(with_residuals));
            assert!(error < 0.4, "{with_residuals} {error}");
        }
    }

    #[test]
    fn a_place_that_only_the_surrogate_likes_is_unlearned() {
        // ln L far away is extrapolated; then values there say that it is far too small to be of interest.
        let away = |k: usize| [4.0 + 0.01 * (k % 10) as f64, -4.0, 4.0, 4.0];
        let mut examples = examples(10_000, false, 1);
        for k in 0..500 {
            examples.push(&away(k), -1.0, &[]);
        }
        let mut rng = stream(1, Domain::Test, 2, 0);
        let wrong = Surrogate::fit(&examples, None, &mut rng).unwrap();
        let mut scratch = Scratch::default();
        assert!(wrong.ln_likelihood(&away(0), &mut scratch) > -50.0);
        let mut right = Examples::default();
        for k in 0..500 {
            right.push(&away(k), -2_000.0, &[]);
        }
        let mut all = self::examples(10_000, false, 1);
        all.append(right);
        let mut surrogate = wrong;
        for _ in 0..3 {
            surrogate = Surrogate::fit(&all, Some(&surrogate), &mut rng).unwrap();
        }
        assert!(surrogate.ln_likelihood(&away(0), &mut scratch) < -0.5 * DEPTH);
        assert!(error(&surrogate) < 0.8);
    }

    #[test]
    fn the_gradient_is_that_of_the_value() {
        let surrogate = fitted(true);
        let mut scratch = Scratch::default();
        let mut gradient = [0.0; DIM];
        let z = [0.3, -0.2, 0.5, 0.1];
        surrogate.ln_likelihood_and_gradient(&z, &mut gradient, &mut scratch);
        for i in 0..DIM {
            let mut at = |step: f64| {
                let mut z = z;
                z[i] += step;
                surrogate.ln_likelihood(&z, &mut scratch)
            };
            // In single precision a value has an error of some 1e-5, and the difference one of 1e-3.
            let difference = (at(0.01) - at(-0.01)) / 0.02;
            assert!(
                (gradient[i] - difference).abs() < 0.02 * (1.0 + difference.abs()),
                "{i}: {gradient:?} {difference}"
            );
        }
    }

    #[test]
    fn a_fit_has_the_same_bits_on_any_number_of_threads_and_after_reading() {
        let examples = examples(5_000, true, 1);
        let on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            pool.install(|| {
                let mut rng = stream(1, Domain::Test, 1, 0);
                Surrogate::fit(&examples, None, &mut rng).unwrap()
            })
        };
        let (one, three) = (on(1), on(3));
        assert_eq!(one, three);
        let mut read: Surrogate =
            postcard::from_bytes(&postcard::to_allocvec(&one).unwrap()).unwrap();
        assert_eq!(read.check(DIM), Ok(()));
        read.prepare();
        assert_eq!(read, one);
    }

    #[test]
    fn too_few_examples_give_none() {
        let mut rng = stream(1, Domain::Test, 1, 0);
        assert!(Surrogate::fit(&Examples::default(), None, &mut rng).is_none());
        assert!(Surrogate::fit(&examples(500, true, 1), None, &mut rng).is_none());
    }

    #[test]
    fn a_feature_that_is_the_same_everywhere_changes_nothing() {
        let mut rng = stream(1, Domain::Test, 1, 0);
        let mut flat = Examples::default();
        for _ in 0..5_000 {
            let x = standard_normal(&mut rng);
            flat.push(&[x, 1.0], -0.5 * x * x, &[x]);
        }
        let surrogate = Surrogate::fit(&flat, None, &mut rng).unwrap();
        let mut gradient = [0.0; 2];
        let value = surrogate.ln_likelihood_and_gradient(
            &[0.5, 1.0],
            &mut gradient,
            &mut Scratch::default(),
        );
        assert!((value + 0.125).abs() < 0.02, "{value}");
        assert!((gradient[0] + 0.5).abs() < 0.05, "{gradient:?}");
    }
}
