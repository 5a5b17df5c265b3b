//! A flexible density fitted to draws: a product of conditional densities, each a mixture of normals whose weights, means
//! and widths are functions of the coordinates before it, given by one masked neural network (MADE: Germain, Gregor, Murray &
//! Larochelle 2015, with the mixtures of RNADE: Uria, Murray & Larochelle 2013).
//!
//! A posterior of thin, bent ridges needs hundreds of ellipsoids; a conditional density follows the bend. Value and draw
//! cost one pass through the network, because each hidden unit needs only the coordinates before its own place.

use crate::diagnostics::{column_moments, ln_sum_exp};
use crate::rng::{RandomStream, below, standard_normal, unit_open};
use crate::valid::{Valid, ensure, moderate};
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;
use std::ops::Range;

/// Hidden units of each of the two layers. Twice as many fit posteriors of streams no better (docs/validation.md, section 5).
const UNITS: usize = 32;

/// Normals of each conditional density.
const NORMALS: usize = 4;

/// Numbers that describe a conditional density: log weights up to a constant, means, logarithms of widths.
const OUTPUTS: usize = 3 * NORMALS;

/// Range of the logarithm of a width, in units of the draws' standard deviation.
const LN_WIDTH: Range<f64> = -5.0..3.0;

/// Standard deviation, in units of the draws' own, of the noise that is added to every draw whenever it is used in the fit: the
/// density becomes a little wider, and the network does not learn single draws.
const NOISE: f64 = 0.1;

/// Step of the optimiser (Adam; Kingma & Ba 2015), its averaging factors, and its guard against division by zero.
const RATE: f64 = 2e-3;
const MOMENTS: [f64; 2] = [0.9, 0.999];
const TINY: f64 = 1e-8;

/// Draws per step of the optimiser.
const BATCH: usize = 256;

/// Maximum length of the mean gradient of a step.
const MAX_GRADIENT: f64 = 2.0;

/// The fit ends when the draws that are held out have not become more probable in so many passes, and at the latest after
/// [`MAX_PASSES`].
const PATIENCE: usize = 10;
const MAX_PASSES: usize = 120;

/// Fewest draws for a fit.
const MIN_ROWS: usize = 400;

/// The density of `dim` coordinates.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Autoregressive {
    /// Mean and standard deviation of each coordinate of the draws.
    mean: Vec<f64>,
    sd: Vec<f64>,
    /// Weights and biases, in the order of [`Layout`].
    parameters: Vec<f64>,
}

/// Where the parameters of the network are. The weights of one input are neighbours: from the coordinates to the first layer, from
/// there to the second, from there to the outputs; then the biases of the three. Unit `j` of both layers has a degree between 1
/// and `dim - 1`, which grows with `j`: it sees so many coordinates. An input of degree g feeds units of degree g or more.
#[derive(Clone, Copy)]
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

    fn degree(self, unit: usize) -> usize {
        1 + unit * (self.dim - 1) / self.units
    }

    /// Units of exactly this degree.
    fn of_degree(self, degree: usize) -> Range<usize> {
        self.unit(degree)..self.unit(degree + 1)
    }

    /// Places of the weights from a coordinate to the first layer, from its unit `first` on.
    fn to_first(self, coordinate: usize) -> (usize, Range<usize>) {
        let first = self.unit(coordinate + 1);
        let row = coordinate * self.units;
        (first, row + first..row + self.units)
    }

    fn to_second(self, unit: usize) -> (usize, Range<usize>) {
        let first = self.unit(self.degree(unit));
        let row = (self.dim + unit) * self.units;
        (first, row + first..row + self.units)
    }

    fn to_outputs(self, unit: usize) -> (usize, Range<usize>) {
        let first = self.degree(unit) * OUTPUTS;
        let row = (self.dim + self.units) * self.units + unit * self.outputs();
        (first, row + first..row + self.outputs())
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

/// The units and outputs of one pass.
struct Pass {
    first: Vec<f64>,
    second: Vec<f64>,
    outputs: Vec<f64>,
}

/// One conditional density.
struct Conditional<'a>(&'a [f64]);

impl Conditional<'_> {
    fn ln_weight(&self, k: usize) -> f64 {
        self.0[k]
    }

    fn mean(&self, k: usize) -> f64 {
        self.0[NORMALS + k]
    }

    fn ln_width(&self, k: usize) -> f64 {
        self.0[2 * NORMALS + k].clamp(LN_WIDTH.start, LN_WIDTH.end)
    }

    /// Log density of every normal at `x` times its weight, up to a common constant, and `(x - mean) / width`.
    fn terms(&self, x: f64) -> [(f64, f64); NORMALS] {
        std::array::from_fn(|k| {
            let u = (x - self.mean(k)) * (-self.ln_width(k)).exp();
            (self.ln_weight(k) - 0.5 * u * u - self.ln_width(k), u)
        })
    }

    fn ln_density(&self, x: f64) -> f64 {
        let terms = self.terms(x).map(|(term, _)| term);
        ln_sum_exp(&terms) - ln_sum_exp(&self.0[..NORMALS]) - 0.5 * (2.0 * PI).ln()
    }

    /// Log density and its derivative by `x`; those by the outputs are written into `gradient`.
    fn ln_density_and_slope(&self, x: f64, gradient: &mut [f64]) -> (f64, f64) {
        let terms = self.terms(x);
        let sum = ln_sum_exp(&terms.map(|(term, _)| term));
        let weights = ln_sum_exp(&self.0[..NORMALS]);
        let mut slope = 0.0;
        for (k, (term, u)) in terms.into_iter().enumerate() {
            let belongs = (term - sum).exp();
            let pull = belongs * u * (-self.ln_width(k)).exp();
            gradient[k] = belongs - (self.ln_weight(k) - weights).exp();
            gradient[NORMALS + k] = pull;
            let free = LN_WIDTH.contains(&self.0[2 * NORMALS + k]);
            gradient[2 * NORMALS + k] = if free { belongs * (u * u - 1.0) } else { 0.0 };
            slope -= pull;
        }
        (sum - weights - 0.5 * (2.0 * PI).ln(), slope)
    }

    fn draw(&self, rng: &mut RandomStream) -> f64 {
        let weights = ln_sum_exp(&self.0[..NORMALS]);
        let mut place = unit_open(rng);
        let chosen = (0..NORMALS).find(|k| {
            place -= (self.ln_weight(*k) - weights).exp();
            place < 0.0
        });
        // Rounding can leave the sum of the weights just below 1.
        let k = chosen.unwrap_or(NORMALS - 1);
        self.mean(k) + self.ln_width(k).exp() * standard_normal(rng)
    }
}

impl Autoregressive {
    /// Fits a density to rows of `dim` coordinates, until `held_out` rows do not become more probable. None if the rows are too
    /// few or have a coordinate that does not vary.
    pub fn fit(rows: &[f64], held_out: &[f64], dim: usize, rng: &mut RandomStream) -> Option<Self> {
        if rows.len() / dim < MIN_ROWS || held_out.is_empty() {
            return None;
        }
        let moments = column_moments(rows, dim);
        let (mean, sd): (Vec<f64>, Vec<f64>) = (moments.into_iter())
            .map(|(mean, variance)| (mean, variance.sqrt()))
            .unzip();
        if sd.iter().any(|sd| !sd.is_normal()) {
            return None;
        }
        let mut density = Self {
            mean,
            sd,
            parameters: first_parameters(Layout::new(dim), rng),
        };
        let standard = |rows: &[f64]| -> Vec<f64> {
            let rows = rows.chunks_exact(dim);
            rows.flat_map(|row| density.standard(row)).collect()
        };
        let (rows, held_out) = (standard(rows), standard(held_out));
        density.learn(&rows, &held_out, rng);
        let finite = density.parameters.iter().all(|p| p.is_finite());
        finite.then_some(density)
    }

    /// Checks a density that was read from a file.
    pub fn check(&self, dim: usize) -> Valid {
        ensure(
            self.mean.len() == dim
                && self.sd.len() == dim
                && self.parameters.len() == Layout::new(dim).len(),
            "a density has another dimension",
        )?;
        let all = self.mean.iter().chain(&self.sd).chain(&self.parameters);
        ensure(
            moderate(all) && self.sd.iter().all(|sd| sd.is_normal() && *sd > 0.0),
            "a density is not finite",
        )
    }

    /// Log density.
    pub fn ln_density(&self, x: &[f64]) -> f64 {
        self.ln_density_of_standard(&self.standard(x)) + self.ln_units()
    }

    /// Log density, with its gradient written into `gradient`.
    pub fn ln_density_and_gradient(&self, x: &[f64], gradient: &mut [f64]) -> f64 {
        let y = self.standard(x);
        let ln_density = self.gradients(&y, gradient, None);
        for (g, sd) in gradient.iter_mut().zip(&self.sd) {
            *g /= sd;
        }
        ln_density + self.ln_units()
    }

    /// A draw.
    pub fn draw(&self, rng: &mut RandomStream) -> Vec<f64> {
        let layout = self.layout();
        let mut pass = self.start();
        (0..layout.dim)
            .map(|i| {
                let y = Conditional(&pass.outputs[i * OUTPUTS..(i + 1) * OUTPUTS]).draw(rng);
                self.take(&mut pass, i, y);
                self.mean[i] + self.sd[i] * y
            })
            .collect()
    }

    fn layout(&self) -> Layout {
        Layout::new(self.mean.len())
    }

    /// A point in the draws' own units.
    fn standard(&self, x: &[f64]) -> Vec<f64> {
        let units = self.mean.iter().zip(&self.sd);
        x.iter().zip(units).map(|(x, (m, s))| (x - m) / s).collect()
    }

    /// Log of the Jacobian of [`standard`](Self::standard).
    fn ln_units(&self) -> f64 {
        -self.sd.iter().map(|sd| sd.ln()).sum::<f64>()
    }

    /// A pass that has no coordinate yet.
    fn start(&self) -> Pass {
        let layout = self.layout();
        Pass {
            first: self.parameters[layout.first_biases()].to_vec(),
            second: self.parameters[layout.second_biases()].to_vec(),
            outputs: self.parameters[layout.output_biases()].to_vec(),
        }
    }

    /// Takes coordinate `i` into a pass: then the outputs of the next one are known.
    fn take(&self, pass: &mut Pass, i: usize, y: f64) {
        let layout = self.layout();
        let (from, weights) = layout.to_first(i);
        add(&mut pass.first[from..], &self.parameters[weights], y);
        for unit in layout.of_degree(i + 1) {
            pass.first[unit] = pass.first[unit].tanh();
            let (from, weights) = layout.to_second(unit);
            let value = pass.first[unit];
            add(&mut pass.second[from..], &self.parameters[weights], value);
        }
        for unit in layout.of_degree(i + 1) {
            pass.second[unit] = pass.second[unit].tanh();
            let (from, weights) = layout.to_outputs(unit);
            let value = pass.second[unit];
            add(&mut pass.outputs[from..], &self.parameters[weights], value);
        }
    }

    fn ln_density_of_standard(&self, y: &[f64]) -> f64 {
        let mut pass = self.start();
        let mut sum = 0.0;
        for (i, y) in y.iter().enumerate() {
            sum += Conditional(&pass.outputs[i * OUTPUTS..(i + 1) * OUTPUTS]).ln_density(*y);
            self.take(&mut pass, i, *y);
        }
        sum
    }

    /// Log density of a standardised point, with its gradient by the point, and, if wanted, that by the parameters added to
    /// `parameters`.
    fn gradients(&self, y: &[f64], gradient: &mut [f64], parameters: Option<&mut [f64]>) -> f64 {
        let layout = self.layout();
        let mut pass = self.start();
        for (i, y) in y.iter().enumerate() {
            self.take(&mut pass, i, *y);
        }
        let mut by_outputs = vec![0.0; layout.outputs()];
        let mut sum = 0.0;
        for (i, y) in y.iter().enumerate() {
            let place = i * OUTPUTS..(i + 1) * OUTPUTS;
            let conditional = Conditional(&pass.outputs[place.clone()]);
            let (ln_density, slope) = conditional.ln_density_and_slope(*y, &mut by_outputs[place]);
            sum += ln_density;
            gradient[i] = slope;
        }
        let mut by_second = vec![0.0; layout.units];
        let mut by_first = vec![0.0; layout.units];
        for unit in 0..layout.units {
            let (from, weights) = layout.to_outputs(unit);
            let slope = dot(&self.parameters[weights], &by_outputs[from..]);
            by_second[unit] = slope * (1.0 - pass.second[unit].powi(2));
        }
        for unit in 0..layout.units {
            let (from, weights) = layout.to_second(unit);
            let slope = dot(&self.parameters[weights], &by_second[from..]);
            by_first[unit] = slope * (1.0 - pass.first[unit].powi(2));
        }
        for (i, g) in gradient.iter_mut().enumerate() {
            let (from, weights) = layout.to_first(i);
            *g += dot(&self.parameters[weights], &by_first[from..]);
        }
        if let Some(parameters) = parameters {
            for (i, y) in y.iter().enumerate() {
                let (from, weights) = layout.to_first(i);
                add(&mut parameters[weights], &by_first[from..], *y);
            }
            for unit in 0..layout.units {
                let (from, weights) = layout.to_second(unit);
                add(
                    &mut parameters[weights],
                    &by_second[from..],
                    pass.first[unit],
                );
                let (from, weights) = layout.to_outputs(unit);
                add(
                    &mut parameters[weights],
                    &by_outputs[from..],
                    pass.second[unit],
                );
            }
            add(&mut parameters[layout.first_biases()], &by_first, 1.0);
            add(&mut parameters[layout.second_biases()], &by_second, 1.0);
            add(&mut parameters[layout.output_biases()], &by_outputs, 1.0);
        }
        sum
    }

    /// Steps of the optimiser through the rows in random order, pass after pass. The parameters become those with which the
    /// rows held out were most probable.
    fn learn(&mut self, rows: &[f64], held_out: &[f64], rng: &mut RandomStream) {
        let dim = self.mean.len();
        let count = rows.len() / dim;
        let mut order: Vec<usize> = (0..count).collect();
        let mut averages = [
            vec![0.0; self.parameters.len()],
            vec![0.0; self.parameters.len()],
        ];
        let mut decay = [1.0; 2];
        let mut best = (f64::NEG_INFINITY, self.parameters.clone());
        let mut since = 0;
        let mut noisy = vec![0.0; dim];
        let mut by_point = vec![0.0; dim];
        for _ in 0..MAX_PASSES {
            for i in (1..count).rev() {
                order.swap(i, below(rng, i + 1));
            }
            for batch in order.chunks(BATCH) {
                let mut gradient = vec![0.0; self.parameters.len()];
                for row in batch {
                    for (noisy, y) in noisy.iter_mut().zip(&rows[row * dim..(row + 1) * dim]) {
                        *noisy = y + NOISE * standard_normal(rng);
                    }
                    self.gradients(&noisy, &mut by_point, Some(&mut gradient));
                }
                let length = dot(&gradient, &gradient).sqrt() / batch.len() as f64;
                let scale = (MAX_GRADIENT / length).min(1.0) / batch.len() as f64;
                for (decay, moment) in decay.iter_mut().zip(MOMENTS) {
                    *decay *= moment;
                }
                let [means, squares] = &mut averages;
                for (p, ((m, s), g)) in self
                    .parameters
                    .iter_mut()
                    .zip(means.iter_mut().zip(squares).zip(&gradient))
                {
                    let g = g * scale;
                    *m = MOMENTS[0] * *m + (1.0 - MOMENTS[0]) * g;
                    *s = MOMENTS[1] * *s + (1.0 - MOMENTS[1]) * g * g;
                    let mean = *m / (1.0 - decay[0]);
                    *p += RATE * mean / ((*s / (1.0 - decay[1])).sqrt() + TINY);
                }
            }
            let held_out = held_out.chunks_exact(dim);
            let score: f64 = held_out.map(|y| self.ln_density_of_standard(y)).sum();
            since += 1;
            if score > best.0 {
                best = (score, self.parameters.clone());
                since = 0;
            }
            if since == PATIENCE {
                break;
            }
        }
        self.parameters = best.1;
    }
}

/// Weights of random sign; the outputs are those of a few normals side by side, whatever the coordinates.
fn first_parameters(layout: Layout, rng: &mut RandomStream) -> Vec<f64> {
    let mut parameters = vec![0.0; layout.len()];
    let mut set = |places: Range<usize>, inputs: usize, by: f64| {
        for p in &mut parameters[places] {
            *p = by * (2.0 * unit_open(rng) - 1.0) / (inputs.max(1) as f64).sqrt();
        }
    };
    for i in 0..layout.dim {
        set(layout.to_first(i).1, layout.dim, 1.0);
    }
    for unit in 0..layout.units {
        set(layout.to_second(unit).1, layout.units, 1.0);
        set(layout.to_outputs(unit).1, layout.units, 0.1);
    }
    set(layout.first_biases(), layout.dim, 1.0);
    set(layout.second_biases(), layout.units, 1.0);
    for outputs in parameters[layout.output_biases()].chunks_exact_mut(OUTPUTS) {
        for k in 0..NORMALS {
            outputs[NORMALS + k] = 2.0 * k as f64 / (NORMALS - 1) as f64 - 1.0;
            outputs[2 * NORMALS + k] = -0.3;
        }
    }
    parameters
}

/// Adds `factor` times `from` to `to`.
fn add(to: &mut [f64], from: &[f64], factor: f64) {
    for (to, from) in to.iter_mut().zip(from) {
        *to += factor * from;
    }
}

/// The scalar product, as eight sums side by side.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 8];
    let (a8, b8) = (a.chunks_exact(8), b.chunks_exact(8));
    let rest = a8.remainder().iter().zip(b8.remainder());
    let rest: f64 = rest.map(|(a, b)| a * b).sum();
    for (a, b) in a8.zip(b8) {
        for (sum, (a, b)) in sums.iter_mut().zip(a.iter().zip(b)) {
            *sum += a * b;
        }
    }
    rest + sums.iter().sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Domain, stream};

    /// A bent ridge with two ends: x0 is one of two normals, x1 = x0^2 + noise, x2 is standard normal.
    fn bananas(count: usize, task: u64) -> Vec<f64> {
        let mut rng = stream(9, Domain::Test, task, 0);
        (0..count)
            .flat_map(|i| {
                let side = if i % 4 == 0 { -1.5 } else { 1.5 };
                let x = side + 0.4 * standard_normal(&mut rng);
                let y = x * x + 0.1 * standard_normal(&mut rng);
                [x, y, standard_normal(&mut rng)]
            })
            .collect()
    }

    fn fitted() -> Autoregressive {
        let (rows, held_out) = (bananas(2_000, 1), bananas(500, 2));
        Autoregressive::fit(&rows, &held_out, 3, &mut stream(9, Domain::Test, 3, 0)).unwrap()
    }

    #[test]
    fn a_bent_ridge_is_fitted_better_than_by_one_normal() {
        let density = fitted();
        let rows = bananas(2_000, 4);
        let mean = |f: &dyn Fn(&[f64]) -> f64| {
            rows.chunks_exact(3).map(f).sum::<f64>() / (rows.len() / 3) as f64
        };
        let fit = mean(&|x| density.ln_density(x));
        let exact = mean(&|x| {
            let normal = |x: f64, m: f64, s: f64| {
                -0.5 * ((x - m) / s).powi(2) - s.ln() - 0.5 * (2.0 * PI).ln()
            };
            let ends = [
                0.25_f64.ln() + normal(x[0], -1.5, 0.4),
                0.75_f64.ln() + normal(x[0], 1.5, 0.4),
            ];
            ln_sum_exp(&ends) + normal(x[1], x[0] * x[0], 0.1) + normal(x[2], 0.0, 1.0)
        });
        // The best normal has the variances of the draws: half a unit per coordinate, and their logarithms. x2 has unit
        // variance, and x0 and x1 are almost uncorrelated.
        let variance = |c: usize| {
            let column = || rows.iter().skip(c).step_by(3);
            let mean = column().sum::<f64>() / 2_000.0;
            column().map(|x| (x - mean).powi(2)).sum::<f64>() / 2_000.0
        };
        let units = 3.0 * (2.0 * PI).ln() + 3.0;
        let normal = -0.5 * (units + variance(0).ln() + variance(1).ln());
        assert!(fit < exact && fit > normal + 1.0, "{fit} {exact} {normal}");
    }

    #[test]
    fn draws_follow_the_density() {
        // The mean of other over density is 1 for draws of the density. Its own error decides.
        let density = fitted();
        let other = |x: &[f64]| {
            let u = [(x[0] - 1.5) / 0.3, (x[1] - x[0] * x[0]) / 0.1, x[2] / 0.8];
            -0.5 * u.iter().map(|u| u * u).sum::<f64>()
                - (0.3_f64 * 0.1 * 0.8).ln()
                - 1.5 * (2.0 * PI).ln()
        };
        let ratios: Vec<f64> = (0..20_000)
            .map(|i| {
                let x = density.draw(&mut stream(9, Domain::Test, 5, i));
                (other(&x) - density.ln_density(&x)).exp()
            })
            .collect();
        let n = ratios.len() as f64;
        let mean = ratios.iter().sum::<f64>() / n;
        let variance = ratios.iter().map(|r| (r - mean).powi(2)).sum::<f64>() / n;
        assert!(
            (mean - 1.0).abs() < 4.0 * (variance / n).sqrt() && variance < 30.0,
            "{mean} {variance}"
        );
    }

    #[test]
    fn gradients_are_those_of_the_density() {
        let density = fitted();
        let (mut by_point, mut by_parameter) = ([0.0; 3], vec![0.0; density.parameters.len()]);
        for x in [[1.4, 2.0, 0.3], [-1.0, 1.5, -2.0], [0.0, 0.0, 0.0]] {
            let value = density.ln_density_and_gradient(&x, &mut by_point);
            assert!((value - density.ln_density(&x)).abs() < 1e-12);
            for i in 0..3 {
                let at = |h: f64| {
                    let mut x = x;
                    x[i] += h;
                    density.ln_density(&x)
                };
                let slope = (at(1e-5) - at(-1e-5)) / 2e-5;
                assert!(
                    (by_point[i] - slope).abs() < 1e-5 * (1.0 + slope.abs()),
                    "{x:?} {i}"
                );
            }
            by_parameter.fill(0.0);
            let y = density.standard(&x);
            density.gradients(&y, &mut by_point, Some(&mut by_parameter));
            for i in 0..by_parameter.len() {
                let at = |h: f64| {
                    let mut other = density.clone();
                    other.parameters[i] += h;
                    other.ln_density_of_standard(&y)
                };
                let slope = (at(1e-5) - at(-1e-5)) / 2e-5;
                assert!(
                    (by_parameter[i] - slope).abs() < 1e-5 * (1.0 + slope.abs()),
                    "{x:?} {i}"
                );
            }
        }
    }

    #[test]
    fn one_coordinate_has_a_density_too() {
        let mut rng = stream(9, Domain::Test, 6, 0);
        let rows: Vec<f64> = (0..1_000)
            .map(|_| 2.0 + standard_normal(&mut rng))
            .collect();
        let density = Autoregressive::fit(&rows, &rows, 1, &mut rng).unwrap();
        let at = density.ln_density(&[2.0]);
        assert!((at + 0.5 * (2.0 * PI).ln()).abs() < 0.15, "{at}");
        assert!(density.check(1).is_ok() && density.check(2).is_err());
    }

    #[test]
    fn few_rows_or_a_constant_coordinate_have_none() {
        let mut rng = stream(9, Domain::Test, 7, 0);
        let rows = bananas(MIN_ROWS - 1, 8);
        assert!(Autoregressive::fit(&rows, &rows, 3, &mut rng).is_none());
        let flat: Vec<f64> = (0..500).flat_map(|i| [f64::from(i), 2.0]).collect();
        assert!(Autoregressive::fit(&flat, &flat, 2, &mut rng).is_none());
    }
}
