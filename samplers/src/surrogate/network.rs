//! A fully connected neural network in single precision, with its exact derivatives by inputs and by parameters.

use crate::rng::{RandomStream, unit_open};
use crate::single::single;
use crate::valid::{Valid, ensure};
use multiversion::multiversion;
use nalgebra::{DMatrixView, DMatrixViewMut};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Hidden layers, and the units of each.
const HIDDEN: usize = 3;
const UNITS: usize = 96;

/// Layers of weights: to each hidden layer and to the outputs.
const LAYERS: usize = HIDDEN + 1;

/// Units whose sums are accumulated together, in registers, or twice or three times so many: more sums wait less for each other.
const LANES: usize = 32;
const TWICE: usize = 2 * LANES;
const THRICE: usize = 3 * LANES;

/// Largest magnitude of a parameter that was read from a file.
const MAX_PARAMETER: f32 = 1e6;

/// The network.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Network {
    inputs: usize,
    outputs: usize,
    /// Layer by layer: the weights, those of one input neighbours, then the biases.
    parameters: Vec<f32>,
    /// The weights of each layer, those of one unit neighbours, for [`backward`](Self::backward), which needs them after
    /// [`prepare`](Self::prepare).
    #[serde(skip)]
    transposed: [Vec<f32>; LAYERS],
}

/// What one pass through a network computes. Rows of units are padded to whole [`LANES`].
#[derive(Clone, Debug, Default)]
pub(super) struct Pass {
    /// Inputs of each layer.
    inputs: [Vec<f32>; LAYERS],
    /// Derivative of each hidden unit by its sum.
    slopes: [Vec<f32>; HIDDEN],
    /// The outputs.
    pub(super) outputs: Vec<f32>,
    /// Derivatives of the result by the sums of a layer, and by its inputs.
    sums_bar: Vec<f32>,
    inputs_bar: Vec<f32>,
}

/// What one pass of many points through a network computes, a column for each.
#[derive(Clone, Debug, Default)]
pub(super) struct Batch {
    /// Inputs of each layer.
    inputs: [Vec<f32>; LAYERS],
    /// Derivative of each hidden unit by its sum.
    slopes: [Vec<f32>; HIDDEN],
    /// The outputs.
    pub(super) outputs: Vec<f32>,
    /// Sums of a layer, or derivatives by them, and by its inputs.
    sums: Vec<f32>,
    inputs_bar: Vec<f32>,
    /// Space for a transposed matrix.
    transposed: Vec<f32>,
}

/// Where a layer's parameters are: weights `first + input * width + unit` and biases `first + inputs * width + unit`.
#[derive(Clone, Copy)]
struct Layer {
    first: usize,
    inputs: usize,
    /// Units, padded to whole [`LANES`].
    width: usize,
}

/// A matrix of weights: where it is among the parameters, column by column.
pub(super) struct Weights {
    pub range: Range<usize>,
    pub rows: usize,
    pub columns: usize,
}

impl Layer {
    fn biases(self) -> usize {
        self.first + self.inputs * self.width
    }

    fn end(self) -> usize {
        self.biases() + self.width
    }
}

fn padded(units: usize) -> usize {
    units.next_multiple_of(LANES)
}

impl Network {
    /// A network of random weights.
    pub fn new(inputs: usize, outputs: usize, rng: &mut RandomStream) -> Self {
        let mut network = Self::of_parameters(inputs, outputs, Vec::new());
        network.parameters = vec![0.0; network.layer(LAYERS - 1).end()];
        for number in 0..LAYERS {
            let layer = network.layer(number);
            let units = if number < HIDDEN { UNITS } else { outputs };
            let most = 1.0 / (layer.inputs as f64).sqrt();
            for input in 0..=layer.inputs {
                let row = layer.first + input * layer.width;
                for p in &mut network.parameters[row..row + units] {
                    *p = single(most * (2.0 * unit_open(rng) - 1.0));
                }
            }
        }
        network
    }

    /// A network of these parameters, which may be the wrong ones ([`check`](Self::check)).
    pub fn of_parameters(inputs: usize, outputs: usize, parameters: Vec<f32>) -> Self {
        Self {
            inputs,
            outputs,
            parameters,
            transposed: Default::default(),
        }
    }

    /// Checks a network that was read from a file.
    pub fn check(&self, inputs: usize) -> Valid {
        ensure(
            self.inputs == inputs
                && (1..1 << 20).contains(&self.outputs)
                && self.parameters.len() == self.layer(LAYERS - 1).end()
                && self.parameters.iter().all(|p| p.abs() <= MAX_PARAMETER),
            "a network has another shape, or is not finite",
        )
    }

    /// Number of outputs.
    pub fn outputs(&self) -> usize {
        self.outputs
    }

    /// Weights and biases.
    pub fn parameters(&self) -> &[f32] {
        &self.parameters
    }

    /// Weights and biases, to be changed.
    pub fn parameters_mut(&mut self) -> &mut [f32] {
        &mut self.parameters
    }

    /// Where the weights and the biases of each layer are among the parameters.
    pub fn weights_and_biases(&self) -> Vec<(Weights, Range<usize>)> {
        let places = (0..LAYERS).map(|number| {
            let layer = self.layer(number);
            let weights = Weights {
                range: layer.first..layer.biases(),
                rows: layer.width,
                columns: layer.inputs,
            };
            (weights, layer.biases()..layer.end())
        });
        places.collect()
    }

    fn layer(&self, number: usize) -> Layer {
        let mut layer = Layer {
            first: 0,
            inputs: self.inputs,
            width: padded(UNITS),
        };
        for next in 1..=number {
            layer = Layer {
                first: layer.end(),
                inputs: UNITS,
                width: padded(if next < HIDDEN { UNITS } else { self.outputs }),
            };
        }
        layer
    }

    /// Prepares derivatives by inputs, after the parameters have changed or were read.
    pub fn prepare(&mut self) {
        for number in 0..LAYERS {
            let layer = self.layer(number);
            let units = if number < HIDDEN { UNITS } else { self.outputs };
            let width = padded(layer.inputs);
            // A row for each unit, and zeros in place of biases.
            let mut rows = vec![0.0; (units + 1) * width];
            for unit in 0..units {
                for input in 0..layer.inputs {
                    rows[unit * width + input] =
                        self.parameters[layer.first + input * layer.width + unit];
                }
            }
            self.transposed[number] = rows;
        }
    }

    /// The outputs at `x`.
    pub fn forward(&self, x: &[f32], pass: &mut Pass) {
        pass.inputs[0].clear();
        pass.inputs[0].extend_from_slice(x);
        for number in 0..LAYERS {
            let layer = self.layer(number);
            let mut sums = std::mem::take(&mut pass.outputs);
            sums.resize(layer.width, 0.0);
            let parameters = &self.parameters[layer.first..layer.end()];
            weighted_sums(parameters, &pass.inputs[number], &mut sums);
            if number < HIDDEN {
                let next = &mut pass.inputs[number + 1];
                next.resize(UNITS, 0.0);
                pass.slopes[number].resize(UNITS, 0.0);
                activate(&sums[..UNITS], next, &mut pass.slopes[number]);
            } else {
                sums.truncate(self.outputs);
            }
            pass.outputs = sums;
        }
    }

    /// From the derivatives of a result by the outputs of the last pass those by its inputs.
    pub fn backward(&self, outputs_bar: &[f32], pass: &mut Pass, x_bar: &mut [f32]) {
        pass.sums_bar.clear();
        pass.sums_bar.extend_from_slice(outputs_bar);
        for number in (0..LAYERS).rev() {
            let layer = self.layer(number);
            pass.inputs_bar.clear();
            pass.inputs_bar.resize(padded(layer.inputs), 0.0);
            weighted_sums(
                &self.transposed[number],
                &pass.sums_bar,
                &mut pass.inputs_bar,
            );
            if number > 0 {
                pass.sums_bar.clear();
                let slopes = &pass.slopes[number - 1];
                let both = pass.inputs_bar.iter().zip(slopes);
                pass.sums_bar.extend(both.map(|(bar, slope)| bar * slope));
            } else {
                x_bar.copy_from_slice(&pass.inputs_bar[..layer.inputs]);
            }
        }
    }

    /// The outputs at many points, a column each, as [`forward`](Self::forward) up to rounding.
    pub fn forward_many(&self, x: &[f32], batch: &mut Batch) {
        let count = x.len() / self.inputs;
        batch.inputs[0].clear();
        batch.inputs[0].extend_from_slice(x);
        for number in 0..LAYERS {
            let layer = self.layer(number);
            let sums = &mut batch.sums;
            sums.clear();
            for _ in 0..count {
                sums.extend_from_slice(&self.parameters[layer.biases()..layer.end()]);
            }
            let weights = &self.parameters[layer.first..layer.biases()];
            let weights = DMatrixView::from_slice(weights, layer.width, layer.inputs);
            let inputs = DMatrixView::from_slice(&batch.inputs[number], layer.inputs, count);
            DMatrixViewMut::from_slice(sums, layer.width, count).gemm(1.0, &weights, &inputs, 1.0);
            if number < HIDDEN {
                let next = &mut batch.inputs[number + 1];
                next.resize(sums.len(), 0.0);
                batch.slopes[number].resize(sums.len(), 0.0);
                activate(sums, next, &mut batch.slopes[number]);
            } else {
                batch.outputs.clear();
                let outputs = sums.chunks_exact(layer.width);
                (batch.outputs).extend(outputs.flat_map(|column| &column[..self.outputs]));
            }
        }
    }

    /// From the derivatives of a result by the outputs of the last pass of a batch those by the parameters, added to
    /// `parameters_bar`.
    pub fn backward_many(
        &self,
        outputs_bar: &[f32],
        batch: &mut Batch,
        parameters_bar: &mut [f32],
    ) {
        let count = outputs_bar.len() / self.outputs;
        let width = self.layer(LAYERS - 1).width;
        batch.sums.clear();
        for column in outputs_bar.chunks_exact(self.outputs) {
            batch.sums.extend_from_slice(column);
            batch
                .sums
                .resize(batch.sums.len().next_multiple_of(width), 0.0);
        }
        for number in (0..LAYERS).rev() {
            let layer = self.layer(number);
            let sums_bar = DMatrixView::from_slice(&batch.sums, layer.width, count);
            transpose(&batch.inputs[number], layer.inputs, &mut batch.transposed);
            let inputs = DMatrixView::from_slice(&batch.transposed, count, layer.inputs);
            let (weights_bar, biases_bar) =
                parameters_bar[layer.first..layer.end()].split_at_mut(layer.inputs * layer.width);
            DMatrixViewMut::from_slice(weights_bar, layer.width, layer.inputs)
                .gemm(1.0, &sums_bar, &inputs, 1.0);
            for column in batch.sums.chunks_exact(layer.width) {
                for (bar, s) in biases_bar.iter_mut().zip(column) {
                    *bar += s;
                }
            }
            if number > 0 {
                let weights = &self.parameters[layer.first..layer.biases()];
                transpose(weights, layer.width, &mut batch.transposed);
                let weights = DMatrixView::from_slice(&batch.transposed, layer.inputs, layer.width);
                let bar = &mut batch.inputs_bar;
                bar.resize(layer.inputs * count, 0.0);
                DMatrixViewMut::from_slice(bar, layer.inputs, count)
                    .gemm(1.0, &weights, &sums_bar, 0.0);
                batch.sums.clear();
                let both = batch.inputs_bar.iter().zip(&batch.slopes[number - 1]);
                batch.sums.extend(both.map(|(bar, slope)| bar * slope));
            }
        }
    }
}

/// Biases plus weights times inputs, for a whole number of [`LANES`] of units.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2"))]
fn weighted_sums(parameters: &[f32], inputs: &[f32], sums: &mut [f32]) {
    let width = sums.len();
    let mut first = 0;
    while first < width {
        first += match width - first {
            LANES => sums_of::<LANES>(parameters, inputs, first, sums),
            TWICE => sums_of::<TWICE>(parameters, inputs, first, sums),
            _ => sums_of::<THRICE>(parameters, inputs, first, sums),
        };
    }
}

/// The sums of `COUNT` units from number `first` on. Returns `COUNT`.
#[inline(always)]
fn sums_of<const COUNT: usize>(
    parameters: &[f32],
    inputs: &[f32],
    first: usize,
    sums: &mut [f32],
) -> usize {
    let width = sums.len();
    let rows = &parameters[first..];
    let mut lanes = [0.0; COUNT];
    lanes.copy_from_slice(&rows[inputs.len() * width..][..COUNT]);
    for (x, row) in inputs.iter().zip(rows.chunks(width)) {
        let row = &row[..COUNT];
        for k in 0..COUNT {
            lanes[k] += x * row[k];
        }
    }
    sums[first..first + COUNT].copy_from_slice(&lanes);
    COUNT
}

/// Writes the columns of `rows` numbers of a matrix as rows. (A view with strides would save the copy; nalgebra 0.35 writes outside
/// of its memory when it multiplies one of five columns or fewer.)
fn transpose(columns: &[f32], rows: usize, transposed: &mut Vec<f32>) {
    transposed.clear();
    for row in 0..rows {
        transposed.extend(columns[row..].iter().step_by(rows));
    }
}

/// `x (1 + x / sqrt(1 + x^2)) / 2`, and its derivative: smooth, and without an exponential.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2"))]
fn activate(sums: &[f32], units: &mut [f32], slopes: &mut [f32]) {
    let count = sums.len();
    let (units, slopes) = (&mut units[..count], &mut slopes[..count]);
    for k in 0..count {
        let x = sums[k];
        let root = 1.0 / (1.0 + x * x).sqrt();
        let half = 0.5 * (1.0 + x * root);
        units[k] = x * half;
        slopes[k] = half + 0.5 * x * root * root * root;
    }
}
