//! Running first and second moments of positions and scores: what a metric is estimated from.

use crate::valid::{Valid, ensure, moderate, rows};
use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};

/// Moments of positions `z` and of scores `grad ln pi_beta`, updated one draw at a time (Welford).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Moments {
    /// Weight of the draws taken in; their number, unless pooled.
    pub weight: f64,
    position: Scatter,
    score: Scatter,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Scatter {
    mean: Vec<f64>,
    /// Sum of outer products about the mean, row-major.
    sum: Vec<f64>,
    /// Space for one deviation.
    deviation: Vec<f64>,
}

impl Scatter {
    fn new(dim: usize) -> Self {
        Self {
            mean: vec![0.0; dim],
            sum: vec![0.0; dim * dim],
            deviation: vec![0.0; dim],
        }
    }

    fn check(&self, dim: usize) -> Valid {
        ensure(
            self.mean.len() == dim && self.deviation.len() == dim && rows(self.sum.len(), dim, dim),
            "moments have another dimension",
        )?;
        ensure(moderate(&self.mean), "moments are not finite")
    }

    fn push(&mut self, x: &[f64], count: f64) {
        for ((d, m), x) in self.deviation.iter_mut().zip(&mut self.mean).zip(x) {
            *d = x - *m;
            *m += *d / count;
        }
        // sum (x - old mean)(x - new mean)' = (1 - 1/n) d d'
        let fraction = 1.0 - 1.0 / count;
        for (row, di) in self
            .sum
            .chunks_exact_mut(self.deviation.len())
            .zip(&self.deviation)
        {
            for (s, dj) in row.iter_mut().zip(&self.deviation) {
                *s += fraction * di * dj;
            }
        }
    }

    fn pool(&mut self, other: &Self, weight: f64) {
        for (s, o) in self.sum.iter_mut().zip(&other.sum) {
            *s += weight * o;
        }
    }

    fn covariance(&self, degrees_of_freedom: f64) -> DMatrix<f64> {
        let dim = self.mean.len();
        DMatrix::from_row_slice(dim, dim, &self.sum) / degrees_of_freedom
    }
}

impl Moments {
    /// No draws yet.
    #[must_use]
    pub fn new(dim: usize) -> Self {
        Self {
            weight: 0.0,
            position: Scatter::new(dim),
            score: Scatter::new(dim),
        }
    }

    /// Checks moments that were read from a file.
    pub(crate) fn check(&self, dim: usize) -> Valid {
        ensure(
            self.weight >= 0.0 && self.weight.is_finite(),
            "moments are of no number of draws",
        )?;
        self.position.check(dim)?;
        self.score.check(dim)
    }

    /// Takes in one draw.
    pub fn push(&mut self, z: &[f64], score: &[f64]) {
        self.weight += 1.0;
        self.position.push(z, self.weight);
        self.score.push(score, self.weight);
    }

    /// Adds the second moments of another temperature about its own mean, with this weight: means of neighbouring
    /// temperatures may differ, their covariances hardly.
    pub fn pool(&mut self, other: &Self, weight: f64) {
        self.position.pool(&other.position, weight);
        self.score.pool(&other.score, weight);
        self.weight += weight * (other.weight - 1.0).max(0.0);
    }

    /// Covariance of positions.
    #[must_use]
    pub fn position_covariance(&self) -> DMatrix<f64> {
        self.position.covariance((self.weight - 1.0).max(1.0))
    }

    /// Covariance of scores: the mean curvature, for a density that vanishes at infinity.
    #[must_use]
    pub fn score_covariance(&self) -> DMatrix<f64> {
        self.score.covariance((self.weight - 1.0).max(1.0))
    }
}
