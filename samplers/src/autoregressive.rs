//! A flexible density fitted to draws: a product of conditional densities, each a mixture of normals whose weights, means
//! and widths are functions of the coordinates before it, given by one masked neural network (MADE: Germain, Gregor, Murray &
//! Larochelle 2015, with the mixtures of RNADE: Uria, Murray & Larochelle 2013).
//!
//! A posterior of thin, bent ridges needs hundreds of ellipsoids; a conditional density follows the bend. Value and draw
//! cost one pass through the network, because each hidden unit needs only the coordinates before its own place. The network computes in
//! single precision; the conditional densities, and with them the integral of the whole, are in double precision.

mod adam;
mod conditional;
mod network;

use crate::diagnostics::column_moments;
use crate::rng::{RandomStream, below, standard_normal};
use crate::valid::{Valid, ensure, moderate};
use adam::Adam;
use conditional::{Conditional, OUTPUTS, side_by_side};
use network::{Derivatives, Network, Pass};
use serde::{Deserialize, Serialize};

/// Standard deviation, in units of the draws' own, of the noise that is added to every draw whenever it is used in the fit: the
/// density becomes a little wider, and the network does not learn single draws.
const NOISE: f64 = 0.1;

/// Step of the optimiser.
const RATE: f32 = 2e-3;

/// Draws per step of the optimiser.
const BATCH: usize = 256;

/// Maximum length of the mean gradient of a step.
const MAX_GRADIENT: f32 = 2.0;

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
    network: Network,
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
            network: Network::new(dim, side_by_side(), rng),
        };
        let standard = |rows: &[f64]| -> Vec<f64> {
            let rows = rows.chunks_exact(dim);
            rows.flat_map(|row| density.standard(row)).collect()
        };
        let (rows, held_out) = (standard(rows), standard(held_out));
        density.learn(&rows, &held_out, rng);
        let finite = density.network.parameters().iter().all(|p| p.is_finite());
        finite.then_some(density)
    }

    /// Checks a density that was read from a file.
    pub fn check(&self, dim: usize) -> Valid {
        self.network.check(dim)?;
        let units = self.mean.iter().chain(&self.sd);
        ensure(
            self.mean.len() == dim
                && self.sd.len() == dim
                && moderate(units)
                && self.sd.iter().all(|sd| sd.is_normal() && *sd > 0.0),
            "a density has another dimension, or is not finite",
        )
    }

    /// Log density.
    pub fn ln_density(&self, x: &[f64]) -> f64 {
        self.ln_density_of_standard(&self.standard(x), &mut Pass::default()) + self.ln_units()
    }

    /// Log density, with its gradient written into `gradient`.
    pub fn ln_density_and_gradient(&self, x: &[f64], gradient: &mut [f64]) -> f64 {
        let mut derivatives = Derivatives::of(&self.network);
        let ln_density = self.derive(&self.standard(x), &mut derivatives);
        for ((g, by_point), sd) in gradient.iter_mut().zip(derivatives.by_point).zip(&self.sd) {
            *g = by_point / sd;
        }
        ln_density + self.ln_units()
    }

    /// A draw.
    pub fn draw(&self, rng: &mut RandomStream) -> Vec<f64> {
        let mut pass = Pass::default();
        self.network.start(&mut pass);
        (0..self.mean.len())
            .map(|i| {
                let y = Conditional::of(&pass.outputs, i).draw(rng);
                self.network.take(&mut pass, i, y);
                self.mean[i] + self.sd[i] * y
            })
            .collect()
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

    fn ln_density_of_standard(&self, y: &[f64], pass: &mut Pass) -> f64 {
        self.network.start(pass);
        let mut sum = 0.0;
        for (i, y) in y.iter().enumerate() {
            sum += Conditional::of(&pass.outputs, i).ln_density(*y);
            self.network.take(pass, i, *y);
        }
        sum
    }

    /// Log density of a standardised point, with its derivatives by the point and by the sums of all units and outputs.
    fn derive(&self, y: &[f64], derivatives: &mut Derivatives) -> f64 {
        let pass = &mut derivatives.pass;
        self.network.start(pass);
        for (i, y) in y.iter().enumerate() {
            self.network.take(pass, i, *y);
        }
        let mut sum = 0.0;
        let places =
            (derivatives.by_outputs.chunks_exact_mut(OUTPUTS)).zip(&mut derivatives.by_point);
        for (i, ((by_outputs, by_point), y)) in places.zip(y).enumerate() {
            let conditional = Conditional::of(&pass.outputs, i);
            let (ln_density, slope) = conditional.ln_density_and_slope(*y, by_outputs);
            sum += ln_density;
            *by_point = slope;
        }
        self.network.backward(derivatives);
        sum
    }

    /// Steps of the optimiser through the rows in random order, pass after pass. The parameters become those with which the
    /// rows held out were most probable.
    fn learn(&mut self, rows: &[f64], held_out: &[f64], rng: &mut RandomStream) {
        let dim = self.mean.len();
        let count = rows.len() / dim;
        let mut order: Vec<usize> = (0..count).collect();
        let mut gradient = vec![0.0; self.network.parameters().len()];
        let mut adam = Adam::new(gradient.len());
        let mut best = (f64::NEG_INFINITY, self.network.clone());
        let mut since = 0;
        let mut noisy = vec![0.0; dim];
        let mut derivatives = Derivatives::of(&self.network);
        for _ in 0..MAX_PASSES {
            for i in (1..count).rev() {
                order.swap(i, below(rng, i + 1));
            }
            for batch in order.chunks(BATCH) {
                gradient.fill(0.0);
                for row in batch {
                    for (noisy, y) in noisy.iter_mut().zip(&rows[row * dim..(row + 1) * dim]) {
                        *noisy = y + NOISE * standard_normal(rng);
                    }
                    self.derive(&noisy, &mut derivatives);
                    (self.network).add_by_parameters(&noisy, &derivatives, &mut gradient);
                }
                let rows = batch.len() as f32;
                let length = gradient.iter().map(|g| g * g).sum::<f32>().sqrt() / rows;
                let scale = (MAX_GRADIENT / length).min(1.0) / rows;
                adam.step(self.network.parameters_mut(), &gradient, scale, RATE);
            }
            let held_out = held_out.chunks_exact(dim);
            let score: f64 = held_out
                .map(|y| self.ln_density_of_standard(y, &mut derivatives.pass))
                .sum();
            since += 1;
            if score > best.0 {
                best = (score, self.network.clone());
                since = 0;
            }
            if since == PATIENCE {
                break;
            }
        }
        self.network = best.1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnostics::ln_sum_exp;
    use crate::rng::{Domain, stream};
    use crate::single::single;
    use std::f64::consts::PI;

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
        // Differences of values in single precision have errors of some 1e-4 for this step.
        const STEP: f64 = 1e-2;
        let density = fitted();
        let close = |derivative: f64, value: &dyn Fn(f64) -> f64, what: &str| {
            let difference = (value(STEP) - value(-STEP)) / (2.0 * STEP);
            let error = (derivative - difference).abs();
            assert!(
                error < 2e-2 * (1.0 + difference.abs()),
                "{what}: {derivative} {difference}"
            );
        };
        let mut gradient = [0.0; 3];
        let mut derivatives = Derivatives::of(&density.network);
        let mut by_parameters = vec![0.0; density.network.parameters().len()];
        for x in [[1.4, 2.0, 0.3], [-1.0, 1.5, -2.0], [0.0, 0.0, 0.0]] {
            let value = density.ln_density_and_gradient(&x, &mut gradient);
            assert!((value - density.ln_density(&x)).abs() < 1e-12);
            for i in 0..3 {
                let at = |h: f64| {
                    let mut x = x;
                    x[i] += h * density.sd[i];
                    density.ln_density(&x)
                };
                close(gradient[i] * density.sd[i], &at, &format!("{x:?} {i}"));
            }
            by_parameters.fill(0.0);
            let y = density.standard(&x);
            density.derive(&y, &mut derivatives);
            (density.network).add_by_parameters(&y, &derivatives, &mut by_parameters);
            for i in 0..by_parameters.len() {
                let at = |h: f64| {
                    let mut other = density.clone();
                    other.network.parameters_mut()[i] += single(h);
                    other.ln_density_of_standard(&y, &mut Pass::default())
                };
                close(
                    f64::from(by_parameters[i]),
                    &at,
                    &format!("{x:?}, parameter {i}"),
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
