//! One ellipsoid around points of the cube.

use crate::nested::live::Points;
use crate::rng::{RandomStream, standard_normal, unit_open};
use crate::valid::{Valid, ensure, moderate, triangle};
use nalgebra::{DMatrix, SymmetricEigen};
use serde::{Deserialize, Serialize};

/// Ridge added to a covariance, relative to its mean eigenvalue: condition numbers beyond 1e12 are lost in the rounding
/// of doubles.
const RIDGE: f64 = 1e-12;

/// The set `{c + A y : |y| <= 1}` with a lower triangular A.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(in crate::nested) struct Ellipsoid {
    center: Vec<f64>,
    /// A, rows of the lower triangle one after the other.
    axes: Vec<f64>,
    /// The inverse of A, stored alike.
    inverse: Vec<f64>,
    /// ln det A: the log volume in units of the unit ball's.
    pub ln_volume: f64,
}

impl Ellipsoid {
    /// The smallest multiple of the covariance ellipsoid of `rows` that holds them all. `None` without extent: fewer
    /// than two different points.
    pub fn fit(points: &Points, rows: &[usize]) -> Option<Self> {
        let d = points.dim();
        let count = rows.len() as f64;
        let mut center = vec![0.0; d];
        for &i in rows {
            for (c, x) in center.iter_mut().zip(points.row(i)) {
                *c += x / count;
            }
        }
        let mut covariance = DMatrix::<f64>::zeros(d, d);
        let mut offset = vec![0.0; d];
        for &i in rows {
            for ((o, x), c) in offset.iter_mut().zip(points.row(i)).zip(&center) {
                *o = x - c;
            }
            for a in 0..d {
                for b in 0..=a {
                    covariance[(a, b)] += offset[a] * offset[b] / count;
                }
            }
        }
        for a in 0..d {
            for b in 0..a {
                covariance[(b, a)] = covariance[(a, b)];
            }
        }
        let mean_eigenvalue = covariance.trace() / d as f64;
        if !(mean_eigenvalue.is_finite() && mean_eigenvalue > f64::MIN_POSITIVE) {
            return None;
        }
        let lower = (0..13).find_map(|k| {
            let ridge = mean_eigenvalue * RIDGE * 10_f64.powi(k);
            let regular = &covariance + DMatrix::identity(d, d) * ridge;
            regular.cholesky().map(|c| c.l())
        })?;
        let inverse = lower.solve_lower_triangular(&DMatrix::identity(d, d))?;
        let pack = |m: &DMatrix<f64>| -> Vec<f64> {
            (0..d)
                .flat_map(|a| (0..=a).map(move |b| m[(a, b)]))
                .collect()
        };
        let mut ellipsoid = Self {
            center,
            ln_volume: (0..d).map(|a| lower[(a, a)].ln()).sum(),
            axes: pack(&lower),
            inverse: pack(&inverse),
        };
        let farthest = rows
            .iter()
            .map(|&i| ellipsoid.distance(points.row(i)))
            .fold(0.0, f64::max);
        // Slightly more, so that rounding leaves no point outside.
        ellipsoid.enlarge(farthest * (1.0 + 1e-12));
        Some(ellipsoid)
    }

    /// The ball around the cube's centre through its corners: the metric of the cube itself.
    pub fn around_cube(dim: usize) -> Self {
        let d = dim as f64;
        let identity: Vec<f64> = (0..dim)
            .flat_map(|a| (0..=a).map(move |b| f64::from(u8::from(a == b))))
            .collect();
        let mut ball = Self {
            center: vec![0.5; dim],
            axes: identity.clone(),
            inverse: identity,
            ln_volume: 0.0,
        };
        ball.enlarge(0.5 * d.sqrt());
        ball
    }

    /// Checks an ellipsoid that was read from a file.
    pub fn check(&self, dim: usize) -> Valid {
        ensure(
            self.center.len() == dim
                && self.axes.len() == triangle(dim)
                && self.inverse.len() == triangle(dim),
            "an ellipsoid has another number of axes",
        )?;
        let all = (self.center.iter())
            .chain(&self.axes)
            .chain(&self.inverse)
            .chain([&self.ln_volume]);
        ensure(moderate(all), "an ellipsoid is not finite")
    }

    fn dim(&self) -> usize {
        self.center.len()
    }

    /// Multiplies every axis.
    pub fn enlarge(&mut self, factor: f64) {
        self.axes.iter_mut().for_each(|a| *a *= factor);
        self.inverse.iter_mut().for_each(|a| *a /= factor);
        self.ln_volume += self.dim() as f64 * factor.ln();
    }

    /// `|A^-1 (x - c)|`: 1 on the surface.
    pub fn distance(&self, x: &[f64]) -> f64 {
        self.norm2_up_to(x, &self.center, f64::INFINITY).sqrt()
    }

    /// `|A^-1 (x - y)|`.
    pub fn distance_between(&self, x: &[f64], y: &[f64]) -> f64 {
        self.norm2_up_to(x, y, f64::INFINITY).sqrt()
    }

    /// Whether `x` is inside.
    pub fn contains(&self, x: &[f64]) -> bool {
        self.norm2_up_to(x, &self.center, 1.0) <= 1.0
    }

    /// The square of `|A^-1 (x - y)|`, or any number above `limit` as soon as it is known to be above.
    fn norm2_up_to(&self, x: &[f64], y: &[f64], limit: f64) -> f64 {
        let mut sum = 0.0;
        let mut start = 0;
        for a in 0..self.dim() {
            let row = &self.inverse[start..=start + a];
            let component: f64 = row
                .iter()
                .zip(x.iter().zip(y))
                .map(|(r, (x, y))| r * (x - y))
                .sum();
            sum += component * component;
            if sum > limit {
                break;
            }
            start += a + 1;
        }
        sum
    }

    /// `out = A y`.
    pub fn stretch(&self, y: &[f64], out: &mut [f64]) {
        let mut start = 0;
        for (a, o) in out.iter_mut().enumerate() {
            let row = &self.axes[start..=start + a];
            *o = row.iter().zip(y).map(|(r, y)| r * y).sum();
            start += a + 1;
        }
    }

    /// `out = A' a`: the covector `a` in the coordinates y of [`stretch`](Self::stretch).
    pub fn whiten_covector(&self, a: &[f64], out: &mut [f64]) {
        out.fill(0.0);
        let mut start = 0;
        for (i, a) in a.iter().enumerate() {
            let row = &self.axes[start..=start + i];
            for (o, r) in out.iter_mut().zip(row) {
                *o += r * a;
            }
            start += i + 1;
        }
    }

    /// A uniform draw from the inside.
    pub fn draw(&self, rng: &mut RandomStream, ball: &mut [f64], out: &mut [f64]) {
        draw_in_ball(rng, ball);
        self.stretch(ball, out);
        for (o, c) in out.iter_mut().zip(&self.center) {
            *o += c;
        }
    }

    /// The two ends of the longest axis.
    pub fn ends_of_major_axis(&self) -> (Vec<f64>, Vec<f64>) {
        let d = self.dim();
        let mut axes = DMatrix::<f64>::zeros(d, d);
        let mut start = 0;
        for a in 0..d {
            for b in 0..=a {
                axes[(a, b)] = self.axes[start + b];
            }
            start += a + 1;
        }
        let eigen = SymmetricEigen::new(&axes * axes.transpose());
        let longest = (0..d).fold(0, |best, k| {
            if eigen.eigenvalues[k] > eigen.eigenvalues[best] {
                k
            } else {
                best
            }
        });
        let length = eigen.eigenvalues[longest].max(0.0).sqrt();
        let end = |sign: f64| {
            self.center
                .iter()
                .zip(eigen.eigenvectors.column(longest).iter())
                .map(|(c, v)| c + sign * length * v)
                .collect()
        };
        (end(-1.0), end(1.0))
    }
}

/// A uniform direction: a point on the unit sphere.
pub(in crate::nested) fn draw_direction(rng: &mut RandomStream, out: &mut [f64]) {
    loop {
        let mut norm2 = 0.0;
        for o in out.iter_mut() {
            *o = standard_normal(rng);
            norm2 += *o * *o;
        }
        if norm2 > 0.0 {
            let scale = 1.0 / norm2.sqrt();
            out.iter_mut().for_each(|o| *o *= scale);
            return;
        }
    }
}

/// A uniform point of the unit ball.
fn draw_in_ball(rng: &mut RandomStream, out: &mut [f64]) {
    draw_direction(rng, out);
    let radius = unit_open(rng).powf(1.0 / out.len() as f64);
    out.iter_mut().for_each(|o| *o *= radius);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Domain, stream};

    #[test]
    fn a_fit_holds_its_points_with_the_farthest_on_the_surface() {
        let mut rng = stream(1, Domain::Test, 0, 0);
        let mut points = Points::new(4);
        for _ in 0..60 {
            let x = unit_open(&mut rng);
            // A ridge: the second coordinate nearly repeats the first.
            let u = [
                x,
                x + 1e-7 * unit_open(&mut rng),
                unit_open(&mut rng),
                0.3 + 1e-3 * x,
            ];
            points.push(&u, 0.0, 0.0, 0_u32);
        }
        let rows: Vec<usize> = (0..60).collect();
        let e = Ellipsoid::fit(&points, &rows).unwrap();
        let farthest = rows
            .iter()
            .map(|&i| e.distance(points.row(i)))
            .fold(0.0, f64::max);
        assert!(rows.iter().all(|&i| e.contains(points.row(i))));
        assert!((farthest - 1.0).abs() < 1e-9, "{farthest}");
    }

    #[test]
    fn draws_fill_the_ellipsoid_and_repeated_points_have_none() {
        let mut points = Points::new(3);
        for u in [
            [0.1, 0.2, 0.3],
            [0.5, 0.1, 0.9],
            [0.7, 0.8, 0.2],
            [0.4, 0.4, 0.6],
            [0.2, 0.9, 0.5],
        ] {
            points.push(&u, 0.0, 0.0, 0_u32);
        }
        let e = Ellipsoid::fit(&points, &[0, 1, 2, 3, 4]).unwrap();
        let mut rng = stream(2, Domain::Test, 0, 0);
        let (mut ball, mut x) = ([0.0; 3], [0.0; 3]);
        // The cube of the distance is uniform: its mean is 1/2 within 3 of 0.2887 / 100.
        let mean = (0..10_000)
            .map(|_| {
                e.draw(&mut rng, &mut ball, &mut x);
                e.distance(&x).powi(3)
            })
            .sum::<f64>()
            / 1e4;
        assert!((mean - 0.5).abs() < 0.0087, "{mean}");
        points.push(&[0.1, 0.2, 0.3], 0.0, 0.0, 0_u32);
        assert!(Ellipsoid::fit(&points, &[0, 5]).is_none());
    }

    #[test]
    fn a_covector_on_a_stretched_vector_is_the_whitened_one_on_the_vector() {
        let mut rng = stream(3, Domain::Test, 0, 0);
        let mut points = Points::new(3);
        for _ in 0..10 {
            let u = [(); 3].map(|()| unit_open(&mut rng));
            points.push(&u, 0.0, 0.0, 0);
        }
        let e = Ellipsoid::fit(&points, &(0..10).collect::<Vec<_>>()).unwrap();
        let (a, y) = ([0.3, -2.0, 1.1], [0.7, 0.2, -0.4]);
        let (mut whitened, mut stretched) = ([f64::NAN; 3], [0.0; 3]);
        e.whiten_covector(&a, &mut whitened);
        e.stretch(&y, &mut stretched);
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        assert!((dot(&a, &stretched) - dot(&whitened, &y)).abs() < 1e-14);
    }
}
