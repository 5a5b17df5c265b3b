//! A masked neural network in single precision (MADE: Germain, Gregor, Murray & Larochelle 2015): the outputs of a coordinate depend on the coordinates
//! before it only.

use super::conditional::OUTPUTS;
use crate::rng::{RandomStream, unit_open};
use crate::single::single;
use crate::valid::{Valid, ensure};
use multiversion::multiversion;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Hidden units of each of the two layers. Twice as many fit posteriors of streams no better (docs/decisions.md, section 3).
const UNITS: usize = 32;

/// Sums of a scalar product that are accumulated side by side.
const LANES: usize = 16;

/// Largest magnitude of a parameter that was read from a file.
const MAX_PARAMETER: f32 = 1e6;

/// The network. The weights of one input are neighbours: from the coordinates to the first layer, from there to the second, from there to the
/// outputs; then the biases of the three. Unit `j` of both layers has a degree between 1 and `dim - 1`, which grows with `j`: it sees so many
/// coordinates. An input of degree g feeds units of degree g or more.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Network {
    layout: Layout,
    parameters: Vec<f32>,
}

/// The units and outputs of one pass.
#[derive(Clone, Debug, Default)]
pub(super) struct Pass {
    first: Vec<f32>,
    second: Vec<f32>,
    /// Outputs, of which those of the coordinates after the ones that were taken are incomplete.
    pub outputs: Vec<f32>,
}

/// Space for a pass and for the derivatives of a result.
#[derive(Clone, Debug)]
pub(super) struct Derivatives {
    pub pass: Pass,
    /// Derivatives by the outputs, and by the sums of units.
    pub by_outputs: Vec<f32>,
    by_first: Vec<f32>,
    by_second: Vec<f32>,
    /// Derivatives by the coordinates.
    pub by_point: Vec<f64>,
}

/// Where the parameters are.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Layout {
    dim: usize,
    units: usize,
}

impl Layout {
    fn new(dim: usize) -> Self {
        let units = if dim > 1 { UNITS } else { 0 };
        Self { dim, units }
    }

    fn outputs(self) -> usize {
        self.dim * OUTPUTS
    }

    /// First unit whose degree is `degree` or more.
    fn unit(self, degree: usize) -> usize {
        // Unit j has degree 1 + j (dim - 1) / units, rounded down.
        ((degree - 1) * self.units)
            .div_ceil((self.dim - 1).max(1))
            .min(self.units)
    }

    /// Units of exactly this degree.
    fn of_degree(self, degree: usize) -> Range<usize> {
        self.unit(degree)..self.unit(degree + 1)
    }

    /// Places of the weights from a coordinate to the first layer, whose units from `from` on see it.
    fn to_first(self, coordinate: usize, from: usize) -> Range<usize> {
        let row = coordinate * self.units;
        row + from..row + self.units
    }

    /// Places of the weights from a unit to the second layer, whose units from `from` on see it.
    fn to_second(self, unit: usize, from: usize) -> Range<usize> {
        self.to_first(self.dim + unit, from)
    }

    /// Places of the weights from a unit to the outputs, of which those from `from` on see it.
    fn to_outputs(self, unit: usize, from: usize) -> Range<usize> {
        let row = (self.dim + self.units) * self.units + unit * self.outputs();
        row + from..row + self.outputs()
    }

    fn first_biases(self) -> Range<usize> {
        let start = (self.dim + self.units) * self.units + self.units * self.outputs();
        start..start + self.units
    }

    fn second_biases(self) -> Range<usize> {
        let start = self.first_biases().end;
        start..start + self.units
    }

    fn output_biases(self) -> Range<usize> {
        let start = self.second_biases().end;
        start..start + self.outputs()
    }

    fn len(self) -> usize {
        self.output_biases().end
    }
}

impl Derivatives {
    /// Space for those of this network.
    pub fn of(network: &Network) -> Self {
        let layout = network.layout;
        Self {
            pass: Pass::default(),
            by_outputs: vec![0.0; layout.outputs()],
            by_first: vec![0.0; layout.units],
            by_second: vec![0.0; layout.units],
            by_point: vec![0.0; layout.dim],
        }
    }
}

impl Network {
    /// A network of weights of random sign; the outputs of every coordinate are about `outputs`.
    pub fn new(dim: usize, outputs: [f32; OUTPUTS], rng: &mut RandomStream) -> Self {
        let layout = Layout::new(dim);
        let mut parameters = vec![0.0; layout.len()];
        let mut set = |places: Range<usize>, inputs: usize, by: f64| {
            for p in &mut parameters[places] {
                *p = single(by * (2.0 * unit_open(rng) - 1.0) / (inputs.max(1) as f64).sqrt());
            }
        };
        for i in 0..layout.dim {
            set(layout.to_first(i, layout.unit(i + 1)), layout.dim, 1.0);
        }
        for degree in 1..layout.dim {
            let units = layout.of_degree(degree);
            for unit in units.clone() {
                set(layout.to_second(unit, units.start), layout.units, 1.0);
                set(layout.to_outputs(unit, degree * OUTPUTS), layout.units, 0.1);
            }
        }
        set(layout.first_biases(), layout.dim, 1.0);
        set(layout.second_biases(), layout.units, 1.0);
        for biases in parameters[layout.output_biases()].chunks_exact_mut(OUTPUTS) {
            biases.copy_from_slice(&outputs);
        }
        Self { layout, parameters }
    }

    /// Checks a network that was read from a file.
    pub fn check(&self, dim: usize) -> Valid {
        ensure(
            self.layout == Layout::new(dim)
                && self.parameters.len() == self.layout.len()
                && self.parameters.iter().all(|p| p.abs() <= MAX_PARAMETER),
            "a density has another dimension, or is not finite",
        )
    }

    /// Weights and biases.
    pub fn parameters(&self) -> &[f32] {
        &self.parameters
    }

    /// Weights and biases, to be changed.
    pub fn parameters_mut(&mut self) -> &mut [f32] {
        &mut self.parameters
    }

    /// Begins a pass, without a coordinate yet.
    pub fn start(&self, pass: &mut Pass) {
        let layout = self.layout;
        for (to, biases) in [
            (&mut pass.first, layout.first_biases()),
            (&mut pass.second, layout.second_biases()),
            (&mut pass.outputs, layout.output_biases()),
        ] {
            to.clear();
            to.extend_from_slice(&self.parameters[biases]);
        }
    }

    /// Takes coordinate `i` into a pass: then the outputs of the next one are known.
    pub fn take(&self, pass: &mut Pass, i: usize, y: f64) {
        take(self.layout, &self.parameters, pass, i, single(y));
    }

    /// From the derivatives of a result by the outputs of a whole pass those by all sums of units; those by the coordinates are added to what is
    /// there.
    pub fn backward(&self, derivatives: &mut Derivatives) {
        backward(self.layout, &self.parameters, derivatives);
    }

    /// Adds the derivatives by the parameters, after [`backward`](Self::backward) at the coordinates `y`, to `by_parameters`.
    pub fn add_by_parameters(
        &self,
        y: &[f64],
        derivatives: &Derivatives,
        by_parameters: &mut [f32],
    ) {
        add_by_parameters(self.layout, y, derivatives, by_parameters);
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2"))]
fn take(layout: Layout, parameters: &[f32], pass: &mut Pass, i: usize, y: f32) {
    let units = layout.of_degree(i + 1);
    let (from, outputs) = (units.start, (i + 1) * OUTPUTS);
    add(
        &mut pass.first[from..],
        &parameters[layout.to_first(i, from)],
        y,
    );
    for unit in units.clone() {
        let value = activated(pass.first[unit]);
        pass.first[unit] = value;
        add(
            &mut pass.second[from..],
            &parameters[layout.to_second(unit, from)],
            value,
        );
    }
    for unit in units {
        let value = activated(pass.second[unit]);
        pass.second[unit] = value;
        add(
            &mut pass.outputs[outputs..],
            &parameters[layout.to_outputs(unit, outputs)],
            value,
        );
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2"))]
fn backward(layout: Layout, parameters: &[f32], derivatives: &mut Derivatives) {
    let Derivatives {
        pass,
        by_first,
        by_second,
        by_outputs,
        by_point,
    } = derivatives;
    // A unit is seen by the second layer's units of its degree or more, and by the outputs of the coordinates after so many.
    for degree in (1..layout.dim).rev() {
        let outputs = degree * OUTPUTS;
        for unit in layout.of_degree(degree) {
            let weights = &parameters[layout.to_outputs(unit, outputs)];
            by_second[unit] = slope(pass.second[unit]) * dot(weights, &by_outputs[outputs..]);
        }
    }
    for degree in (1..layout.dim).rev() {
        let units = layout.of_degree(degree);
        let from = units.start;
        for unit in units {
            let weights = &parameters[layout.to_second(unit, from)];
            by_first[unit] = slope(pass.first[unit]) * dot(weights, &by_second[from..]);
        }
    }
    for (i, by_point) in by_point.iter_mut().enumerate() {
        let from = layout.unit(i + 1);
        let weights = &parameters[layout.to_first(i, from)];
        *by_point += f64::from(dot(weights, &by_first[from..]));
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2"))]
fn add_by_parameters(
    layout: Layout,
    y: &[f64],
    derivatives: &Derivatives,
    by_parameters: &mut [f32],
) {
    let Derivatives {
        pass,
        by_first,
        by_second,
        by_outputs,
        ..
    } = derivatives;
    for (i, y) in y.iter().enumerate() {
        let from = layout.unit(i + 1);
        add(
            &mut by_parameters[layout.to_first(i, from)],
            &by_first[from..],
            single(*y),
        );
    }
    for degree in 1..layout.dim {
        let units = layout.of_degree(degree);
        let (from, outputs) = (units.start, degree * OUTPUTS);
        for unit in units {
            let (first, second) = (pass.first[unit], pass.second[unit]);
            add(
                &mut by_parameters[layout.to_second(unit, from)],
                &by_second[from..],
                first,
            );
            add(
                &mut by_parameters[layout.to_outputs(unit, outputs)],
                &by_outputs[outputs..],
                second,
            );
        }
    }
    add(&mut by_parameters[layout.first_biases()], by_first, 1.0);
    add(&mut by_parameters[layout.second_biases()], by_second, 1.0);
    add(&mut by_parameters[layout.output_biases()], by_outputs, 1.0);
}

/// A unit from its sum: a sigmoid without an exponential.
#[inline(always)]
fn activated(sum: f32) -> f32 {
    sum / (1.0 + sum * sum).sqrt()
}

/// Derivative of a unit by its sum, from the unit.
#[inline(always)]
fn slope(unit: f32) -> f32 {
    let rest = (1.0 - unit * unit).max(0.0);
    rest * rest.sqrt()
}

/// Adds `factor` times `from` to `to`.
#[inline(always)]
fn add(to: &mut [f32], from: &[f32], factor: f32) {
    for (to, from) in to.iter_mut().zip(from) {
        *to += factor * from;
    }
}

/// The scalar product, as sums side by side.
#[inline(always)]
fn dot(a: &[f32], b: &[f32]) -> f32 {
    let (a, rest_a) = a.as_chunks::<LANES>();
    let (b, rest_b) = b.as_chunks::<LANES>();
    let mut sums = [0.0; LANES];
    for (a, b) in a.iter().zip(b) {
        for k in 0..LANES {
            sums[k] += a[k] * b[k];
        }
    }
    let rest: f32 = rest_a.iter().zip(rest_b).map(|(a, b)| a * b).sum();
    rest + sums.iter().sum::<f32>()
}
