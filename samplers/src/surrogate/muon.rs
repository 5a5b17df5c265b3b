//! The optimiser of a network: Muon (Jordan et al. 2024) for its matrices of weights, Adam (Kingma & Ba 2015) for its biases.
//!
//! The step of a matrix is its averaged gradient with all singular values set to about one. It needs a fifth of the passes of
//! Adam to the same error (docs/decisions.md, section 3).

use super::network::Network;
use nalgebra::{DMatrix, DMatrixView};
use rayon::prelude::*;

/// Averaging factor of the gradients of weights, and those of the gradients of biases and of their squares.
const WEIGHTS_MOMENT: f32 = 0.95;
const BIASES_MOMENTS: [f32; 2] = [0.9, 0.999];

/// Guard against division by zero.
const TINY: f32 = 1e-8;

/// Newton-Schulz iterations, and the coefficients of their polynomial.
const ITERATIONS: usize = 5;
const COEFFICIENTS: [f32; 3] = [3.4445, -4.7750, 2.0315];

/// The averages of an optimisation.
pub(super) struct Muon {
    means: Vec<f32>,
    squares: Vec<f32>,
    steps: i32,
}

impl Muon {
    /// Averages at zero, of so many parameters.
    pub fn new(parameters: usize) -> Self {
        Self {
            means: vec![0.0; parameters],
            squares: vec![0.0; parameters],
            steps: 0,
        }
    }

    /// One step of length `rate` down the gradient of the mean loss.
    pub fn step(&mut self, network: &mut Network, gradient: &[f32], rate: f32) {
        self.steps += 1;
        let places = network.weights_and_biases();
        for (weights, _) in &places {
            for i in weights.range.clone() {
                self.means[i] = WEIGHTS_MOMENT * self.means[i] + gradient[i];
            }
        }
        // Each matrix by itself: the same bits on any number of threads.
        let means = &self.means;
        let steps: Vec<DMatrix<f32>> = places
            .par_iter()
            .map(|(weights, _)| {
                let averaged = weights.range.clone();
                let averaged = averaged.map(|i| gradient[i] + WEIGHTS_MOMENT * means[i]);
                orthogonal(
                    &averaged.collect::<Vec<f32>>(),
                    weights.rows,
                    weights.columns,
                )
            })
            .collect();
        let [first, second] = BIASES_MOMENTS.map(|moment| 1.0 - moment.powi(self.steps));
        let parameters = network.parameters_mut();
        for ((weights, biases), step) in places.into_iter().zip(steps) {
            let longer = (weights.rows as f32 / weights.columns as f32)
                .max(1.0)
                .sqrt();
            for (p, s) in parameters[weights.range].iter_mut().zip(step.iter()) {
                *p -= rate * longer * s;
            }
            for i in biases {
                let (g, [by, by_square]) = (gradient[i], BIASES_MOMENTS);
                self.means[i] = by * self.means[i] + (1.0 - by) * g;
                self.squares[i] = by_square * self.squares[i] + (1.0 - by_square) * g * g;
                let unit = (self.squares[i] / second).sqrt() + TINY;
                parameters[i] -= rate * self.means[i] / first / unit;
            }
        }
    }
}

/// The columns of a matrix with singular values of about one in place of its own, by Newton-Schulz iterations.
fn orthogonal(columns: &[f32], rows: usize, count: usize) -> DMatrix<f32> {
    let matrix = DMatrixView::from_slice(columns, rows, count);
    let tall = rows > count;
    let mut x = if tall {
        matrix.transpose()
    } else {
        matrix.into_owned()
    };
    let norm = x.norm() + TINY;
    x /= norm;
    let [linear, cubic, quintic] = COEFFICIENTS;
    for _ in 0..ITERATIONS {
        let square = &x * x.transpose();
        let mut factor = &square * cubic;
        factor.gemm(quintic, &square, &square, 1.0);
        let mut next = &x * linear;
        next.gemm(1.0, &factor, &x, 1.0);
        x = next;
    }
    if tall { x.transpose() } else { x }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Domain, standard_normal, stream};
    use crate::single::single;

    #[test]
    fn steps_have_singular_values_of_about_one() {
        let mut rng = stream(1, Domain::Test, 0, 0);
        for (rows, columns) in [(12, 7), (7, 12), (9, 9)] {
            let matrix: Vec<f32> = (0..rows * columns)
                .map(|_| single(standard_normal(&mut rng)))
                .collect();
            let before = DMatrix::from_column_slice(rows, columns, &matrix);
            let after = orthogonal(&matrix, rows, columns);
            // The coefficients are chosen for speed: the values come into a range around one, and do not converge to it.
            let condition = |m: &DMatrix<f32>| {
                let values = m.singular_values();
                values.max() / values.min()
            };
            let values = after.singular_values();
            assert!(
                values.iter().all(|v| (0.5..1.4).contains(v)),
                "{rows} {columns}: {values}, before {}",
                condition(&before)
            );
            // Singular vectors remain: the product with the matrix is symmetric.
            let product = after.transpose() * &before;
            let asymmetry = (&product - product.transpose()).norm() / product.norm();
            assert!(asymmetry < 1e-3, "{rows} {columns}: {asymmetry}");
        }
    }
}
