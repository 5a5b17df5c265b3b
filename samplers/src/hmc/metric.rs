//! The metric of one temperature: an estimate `V = L L'` of the covariance there.
//!
//! Estimated as the geodesic mean of two guesses, the covariance of positions and the inverse covariance of scores (the
//! minimiser of the Fisher divergence: Seyboldt, Carlson & Carpenter 2024, the rule of nutpie). On a Gaussian it is
//! exact for any draws, mixed or not, once there are more than dimensions: `Cov(score) = P Cov(z) P`, and the mean of
//! `C` and `(P C P)^-1` is `P^-1`. So the scales are found before the states of a temperature are in equilibrium.

use super::Moments;
use crate::valid::{Valid, ensure, moderate, triangle};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use serde::{Deserialize, Serialize};

/// `V = L L'`, as the lower triangle of `L`, row by row; see the module.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Metric(Vec<f64>);

impl Metric {
    /// The prior's metric, `V = I`.
    #[must_use]
    pub fn identity(dim: usize) -> Self {
        Self(packed(&DMatrix::identity(dim, dim)))
    }

    /// The metric with this covariance; `None` unless it is positive definite and finite.
    #[must_use]
    pub fn from_covariance(covariance: &DMatrix<f64>) -> Option<Self> {
        cholesky(covariance).map(|c| Self(packed(&c.l())))
    }

    /// The covariance of rows of coordinates, one after the other, as a metric; the prior's if they do not span the space.
    #[must_use]
    pub fn of_rows(rows: &[f64], dim: usize) -> Self {
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
        Self::from_covariance(&covariance).unwrap_or_else(|| Self::identity(dim))
    }

    /// Checks a metric that was read from a file.
    pub(crate) fn check(&self, dim: usize) -> Valid {
        ensure(
            self.0.len() == triangle(dim) && moderate(&self.0),
            "a metric has another shape, or is not finite",
        )
    }

    /// `out = L r`.
    pub fn velocity(&self, momentum: &[f64], out: &mut [f64]) {
        let mut rest = self.0.as_slice();
        for (i, o) in out.iter_mut().enumerate() {
            let (row, tail) = rest.split_at(i + 1);
            rest = tail;
            *o = row.iter().zip(momentum).map(|(l, r)| l * r).sum();
        }
    }

    /// `out = L' f`.
    pub fn whiten_force(&self, force: &[f64], out: &mut [f64]) {
        out.fill(0.0);
        let mut rest = self.0.as_slice();
        for (i, f) in force.iter().enumerate() {
            let (row, tail) = rest.split_at(i + 1);
            rest = tail;
            for (o, l) in out.iter_mut().zip(row) {
                *o += l * f;
            }
        }
    }

    /// `L` as a matrix.
    #[must_use]
    pub fn lower(&self) -> DMatrix<f64> {
        let lower = &self.0;
        let dim = (0..).take_while(|n| n * (n + 1) / 2 < lower.len()).count();
        let mut l = DMatrix::zeros(dim, dim);
        for i in 0..dim {
            for j in 0..=i {
                l[(i, j)] = lower[i * (i + 1) / 2 + j];
            }
        }
        l
    }

    /// `V = L L'`.
    #[must_use]
    pub fn covariance(&self) -> DMatrix<f64> {
        let l = self.lower();
        &l * l.transpose()
    }

    /// The metric from `moments`, estimated in this metric's whitened coordinates and there shrunk towards the diagonal
    /// with weight `1 / (1 + (draws / dim)^2)`: strongly for few draws; for many so little that narrow directions keep
    /// their digits. `None` if the draws do not span the space (no transition was accepted): this metric is kept then.
    #[must_use]
    pub fn refined(&self, moments: &Moments) -> Option<Self> {
        let l = self.lower();
        let position = Self::shrunk(
            &whitened(&l, &moments.position_covariance())?,
            moments.weight,
        );
        let score = Self::shrunk(
            &(l.transpose() * moments.score_covariance() * &l),
            moments.weight,
        );
        let mean = geodesic(&position, &cholesky(&score)?.inverse(), 0.5)?;
        Self::from_covariance(&symmetric(&(&l * mean * l.transpose())))
    }

    /// The metric at the fraction `t` of the geodesic to `other`; this one if either cannot be used.
    #[must_use]
    pub fn between(&self, other: &Self, t: f64) -> Self {
        geodesic(&self.covariance(), &other.covariance(), t)
            .and_then(|v| Self::from_covariance(&v))
            .unwrap_or_else(|| self.clone())
    }

    /// `ln` of the largest factor by which any direction is longer in `other` than here: what a step in metric units
    /// must shrink by to be no longer than it was.
    #[must_use]
    pub fn ln_stretch(&self, other: &Self) -> f64 {
        whitened(&self.lower(), &other.covariance()).map_or(0.0, |ratio| {
            let largest = ratio.symmetric_eigenvalues().max();
            0.5 * largest.max(f64::MIN_POSITIVE).ln()
        })
    }

    fn shrunk(covariance: &DMatrix<f64>, weight: f64) -> DMatrix<f64> {
        let per_draw = covariance.nrows() as f64 / weight.max(1.0);
        let keep = 1.0 / (1.0 + per_draw * per_draw);
        let diagonal = DMatrix::from_diagonal(&covariance.diagonal());
        covariance * keep + diagonal * (1.0 - keep)
    }
}

/// The point at `t` of the geodesic from `a` to `b` among positive matrices, `A^1/2 (A^-1/2 B A^-1/2)^t A^1/2`; for
/// t = 1/2 their geometric mean. `None` unless both are positive definite and finite.
fn geodesic(a: &DMatrix<f64>, b: &DMatrix<f64>, t: f64) -> Option<DMatrix<f64>> {
    let l = cholesky(a)?.l();
    let ratio = whitened(&l, b)?.symmetric_eigen();
    if !ratio.eigenvalues.iter().all(|e| e.is_finite() && *e > 0.0) {
        return None;
    }
    let axes = &l * &ratio.eigenvectors;
    let powers = DMatrix::from_diagonal(&ratio.eigenvalues.map(|e| e.powf(t)));
    Some(symmetric(&(&axes * powers * axes.transpose())))
}

/// `L^-1 C L^-T`; `None` if `L` is singular or a number is not finite.
fn whitened(l: &DMatrix<f64>, c: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let half = l.solve_lower_triangular(c)?;
    let whole = l.solve_lower_triangular(&half.transpose())?;
    whole
        .iter()
        .all(|x| x.is_finite())
        .then(|| symmetric(&whole))
}

fn cholesky(matrix: &DMatrix<f64>) -> Option<Cholesky<f64, Dyn>> {
    if matrix.iter().all(|x| x.is_finite()) {
        Cholesky::new(matrix.clone())
    } else {
        None
    }
}

/// The symmetric part: rounding makes products of matrices slightly asymmetric.
fn symmetric(matrix: &DMatrix<f64>) -> DMatrix<f64> {
    (matrix + matrix.transpose()) * 0.5
}

fn packed(lower: &DMatrix<f64>) -> Vec<f64> {
    (0..lower.nrows())
        .flat_map(|i| (0..=i).map(move |j| (i, j)))
        .map(|at| lower[at])
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Domain, standard_normal, stream};

    fn precision() -> DMatrix<f64> {
        let mut rng = stream(1, Domain::Test, 0, 0);
        let basis = DMatrix::from_fn(5, 5, |_, _| standard_normal(&mut rng))
            .qr()
            .q();
        let scales = DMatrix::from_diagonal(&[1.0, 10.0, 100.0, 1e4, 1e5].to_vec().into());
        symmetric(&(&basis * scales * basis.transpose()))
    }

    #[test]
    fn scores_find_the_scales_of_a_gaussian_from_draws_that_are_far_off() {
        let p = precision();
        let mut metric = Metric::identity(5);
        let mut rng = stream(2, Domain::Test, 0, 0);
        for _ in 0..9 {
            let mut moments = Moments::new(5);
            for _ in 0..40 {
                // Draws of the prior: variances wrong by up to 1e5.
                let z = DMatrix::from_fn(5, 1, |_, _| standard_normal(&mut rng));
                let score = -(&p * &z);
                moments.push(z.as_slice(), score.as_slice());
            }
            metric = metric.refined(&moments).unwrap();
        }
        let l = metric.lower();
        let left = (l.transpose() * p * l).symmetric_eigenvalues();
        assert!(left.max() / left.min() < 2.0, "{left}");
        assert!((left.max() * left.min()).ln().abs() < 1.0, "{left}");
    }

    #[test]
    fn velocity_and_force_use_the_factor_and_its_transpose() {
        let covariance = precision();
        {
            let metric = Metric::from_covariance(&covariance).unwrap();
            let l = metric.lower();
            let x = [0.3, -1.0, 2.0, 0.7, -0.2];
            let (mut v, mut f) = ([0.0; 5], [0.0; 5]);
            metric.velocity(&x, &mut v);
            metric.whiten_force(&x, &mut f);
            let column = DMatrix::from_column_slice(5, 1, &x);
            let (lv, lf) = (&l * &column, l.transpose() * &column);
            for i in 0..5 {
                assert!((v[i] - lv[i]).abs() < 1e-9 && (f[i] - lf[i]).abs() < 1e-9);
            }
            assert!((metric.covariance()[(0, 0)] - covariance[(0, 0)]).abs() < 1e-6);
        }
    }

    fn diagonal(sd: [f64; 2]) -> Metric {
        let variances = sd.map(|s| s * s).to_vec();
        Metric::from_covariance(&DMatrix::from_diagonal(&variances.into())).unwrap()
    }

    #[test]
    fn the_stretch_is_the_largest_ratio_of_lengths() {
        let narrow = diagonal([0.1, 2.0]);
        let wide = diagonal([0.5, 1.0]);
        assert!((narrow.ln_stretch(&wide) - 5_f64.ln()).abs() < 1e-12);
        assert!((wide.ln_stretch(&narrow) - 2_f64.ln()).abs() < 1e-12);
        let half = narrow.between(&wide, 0.5).covariance();
        assert!((half[(0, 0)] - 0.05).abs() < 1e-12 && (half[(1, 1)] - 2.0).abs() < 1e-12);
    }

    #[test]
    fn draws_that_do_not_move_leave_the_metric_alone() {
        let mut moments = Moments::new(2);
        for _ in 0..10 {
            moments.push(&[0.3, 0.1], &[1.0, 2.0]);
        }
        assert!(Metric::identity(2).refined(&moments).is_none());
    }

    #[test]
    fn the_metric_of_rows_is_their_covariance() {
        let rows = [1.0, 0.0, -1.0, 0.0, 0.0, 2.0, 0.0, -2.0];
        let metric = Metric::of_rows(&rows, 2).covariance();
        assert!((metric[(0, 0)] - 0.5).abs() < 1e-12 && (metric[(1, 1)] - 2.0).abs() < 1e-12);
        // Rows on a line do not span the plane.
        let line = Metric::of_rows(&[1.0, 1.0, -1.0, -1.0], 2);
        assert_eq!(line, Metric::identity(2));
    }
}
