//! A mixture of multivariate Student distributions: fitted to draws, evaluated, drawn from.

use crate::diagnostics::ln_sum_exp;
use crate::rng::{RandomStream, below, standard_normal, unit_open};
use crate::valid::{Valid, ensure, moderate, triangle};
use nalgebra::{Cholesky, DMatrix, DVector};
use rayon::prelude::*;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};
use std::f64::consts::PI;

/// Degrees of freedom of every component: tails heavy enough for importance weights, a centre still close to a
/// Gaussian.
const DEGREES_OF_FREEDOM: u32 = 5;

/// Rows to be fitted, per dimension, below which no mixture is fitted.
const MIN_ROWS_PER_DIM: usize = 10;

/// Maximum number of iterations of expectation-maximisation.
const MAX_ROUNDS: usize = 100;

/// The fit ends when the mean log density grows by less than this in an iteration.
const SETTLED: f64 = 1e-3;

/// Added to the diagonal of every covariance, in units of the draws' own, because draws of a chain may repeat.
const RIDGE: f64 = 1e-9;

/// Draws, row by row.
#[derive(Clone, Debug)]
pub(crate) struct Rows {
    pub dim: usize,
    pub values: Vec<f64>,
}

impl Rows {
    pub fn len(&self) -> usize {
        self.values.len() / self.dim
    }

    pub fn iter(&self) -> impl Iterator<Item = &[f64]> {
        self.values.chunks_exact(self.dim)
    }

    /// The rows of both.
    pub fn with(&self, other: &Self) -> Self {
        Self {
            dim: self.dim,
            values: [self.values.as_slice(), &other.values].concat(),
        }
    }
}

/// One Student distribution and its weight.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Component {
    weight: f64,
    mean: DVector<f64>,
    /// `L` of the scale matrix `L L'`.
    #[serde(deserialize_with = "matrix")]
    lower: DMatrix<f64>,
    /// Its inverse, row by row up to the diagonal.
    inverse: Vec<f64>,
    /// Log density at the mean.
    ln_peak: f64,
}

/// A matrix from its numbers and its shape, in nalgebra's form, which itself multiplies the two sides without a bound.
fn matrix<'de, D: Deserializer<'de>>(source: D) -> Result<DMatrix<f64>, D::Error> {
    let (numbers, rows, columns): (Vec<f64>, usize, usize) = Deserialize::deserialize(source)?;
    if rows.checked_mul(columns) == Some(numbers.len()) {
        Ok(DMatrix::from_vec(rows, columns, numbers))
    } else {
        Err(D::Error::custom("a matrix of another shape"))
    }
}

impl Component {
    /// Checks a component that was read from a file.
    fn check(&self, dim: usize) -> Valid {
        ensure(
            self.mean.len() == dim
                && self.lower.shape() == (dim, dim)
                && self.inverse.len() == triangle(dim),
            "a component of the mixture has another dimension",
        )?;
        let all = (self.mean.iter())
            .chain(self.lower.iter())
            .chain(&self.inverse)
            .chain([&self.ln_peak]);
        ensure(
            moderate(all) && self.weight > 0.0 && self.weight <= 1.0,
            "a component of the mixture is not finite",
        )
    }

    /// None unless the scale matrix is positive definite.
    fn new(weight: f64, mean: DVector<f64>, scale: DMatrix<f64>) -> Option<Self> {
        let lower = Cholesky::new(scale)?.unpack();
        Self::of_lower(weight, mean, lower)
    }

    fn of_lower(weight: f64, mean: DVector<f64>, lower: DMatrix<f64>) -> Option<Self> {
        let dim = mean.len() as f64;
        let degrees_of_freedom = f64::from(DEGREES_OF_FREEDOM);
        let inverse = lower.solve_lower_triangular(&DMatrix::identity(mean.len(), mean.len()))?;
        let inverse = (0..mean.len())
            .flat_map(|i| (0..=i).map(move |j| (i, j)))
            .map(|place| inverse[place])
            .collect();
        let ln_peak = libm::lgamma(0.5 * (degrees_of_freedom + dim))
            - libm::lgamma(0.5 * degrees_of_freedom)
            - 0.5 * dim * (degrees_of_freedom * PI).ln()
            - lower.diagonal().iter().map(|l| l.ln()).sum::<f64>();
        Some(Self {
            weight,
            mean,
            lower,
            inverse,
            ln_peak,
        })
    }

    /// Squared distance from the mean in units of the scale.
    fn distance2(&self, x: &[f64]) -> f64 {
        let mut sum = 0.0;
        self.whiten(x, |_, y| sum += y * y);
        sum
    }

    /// Every coordinate of a point in units of the scale about the mean: `each` has its row of the inverse and
    /// its value.
    fn whiten(&self, x: &[f64], mut each: impl FnMut(&[f64], f64)) {
        let mean = self.mean.as_slice();
        let mut rest = self.inverse.as_slice();
        for i in 0..x.len() {
            let (row, tail) = rest.split_at(i + 1);
            rest = tail;
            let y = row
                .iter()
                .zip(x)
                .zip(mean)
                .map(|((l, x), m)| l * (x - m))
                .sum();
            each(row, y);
        }
    }

    /// Log of the density at this squared distance times the component's weight.
    fn ln_density(&self, distance2: f64) -> f64 {
        let degrees_of_freedom = f64::from(DEGREES_OF_FREEDOM);
        let power = 0.5 * (degrees_of_freedom + self.mean.len() as f64);
        self.weight.ln() + self.ln_peak - power * (distance2 / degrees_of_freedom).ln_1p()
    }
}

/// A mixture; weights add up to 1.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Mixture {
    components: Vec<Component>,
}

/// The result of the M step for one component.
struct Learned {
    /// Draws that belong to it.
    count: f64,
    mean: DVector<f64>,
    covariance: DMatrix<f64>,
}

impl Mixture {
    /// The mixture of at most this many components that fits the rows best, by expectation-maximisation from centres
    /// that are far from each other. Covariances are shrunk towards their common mean with the weight of one draw per
    /// dimension. None if the rows do not span their space.
    pub fn fit(rows: &Rows, count: usize, rng: &mut RandomStream) -> Option<Self> {
        let dim = rows.dim;
        let n = rows.len() as f64;
        // In the rows' own units every tolerance is a pure number.
        let whole = learn(rows, |_| (1.0, 1.0));
        let units = Cholesky::new(whole.covariance)?.unpack();
        let white = whiten(rows, &whole.mean, &units)?;
        let mut mixture = Self::around(&far_apart(&white, count, rng), dim)?;
        let mut last = f64::NEG_INFINITY;
        for _ in 0..MAX_ROUNDS {
            let (belongs, mean_ln_density) = mixture.expect(&white);
            if mean_ln_density - last < SETTLED {
                break;
            }
            last = mean_ln_density;
            mixture = Self::maximise(&white, &belongs, n)?;
        }
        mixture.in_units(&whole.mean, &units)
    }

    /// The mixture whose size, a power of 2 up to `max`, is chosen by the rows that were not used to fit it, then fitted again to
    /// all of them; `rng` gives the stream of each size. None if the rows do not span their space, or if fewer than ten per
    /// dimension are to be fitted.
    pub fn choose(
        [first, second]: [&Rows; 2],
        most: usize,
        rng: impl Fn(usize) -> RandomStream,
    ) -> Option<Self> {
        let (dim, few) = (first.dim, first.len());
        if few < MIN_ROWS_PER_DIM * dim || second.len() == 0 {
            return None;
        }
        let mut best: Option<(f64, usize)> = None;
        let mut count = 1;
        // A component needs enough draws for its covariance.
        while count <= most && count * dim <= few {
            if let Some(mixture) = Self::fit(first, count, &mut rng(count)) {
                let score = mixture.mean_ln_density(second);
                if best.is_none_or(|(known, _)| score > known) {
                    best = Some((score, count));
                }
            }
            count *= 2;
        }
        let (_, count) = best?;
        Self::fit(&first.with(second), count, &mut rng(count))
    }

    /// Equal components about these centres, each as wide as its fraction of the unit ball.
    fn around(centres: &[Vec<f64>], dim: usize) -> Option<Self> {
        let weight = 1.0 / centres.len() as f64;
        let width = weight.powf(2.0 / dim as f64);
        let components = centres.iter().map(|centre| {
            let scale = DMatrix::identity(dim, dim) * width;
            Component::new(weight, DVector::from_column_slice(centre), scale)
        });
        Some(Self {
            components: components.collect::<Option<_>>()?,
        })
    }

    /// E step: the responsibility of every component for every row, with the weight that Student's tails give the row there; and
    /// the mean log density.
    fn expect(&self, rows: &Rows) -> (Vec<Vec<(f64, f64)>>, f64) {
        let degrees_of_freedom = f64::from(DEGREES_OF_FREEDOM);
        let heavy = degrees_of_freedom + rows.dim as f64;
        let mut belongs: Vec<Vec<(f64, f64)>> = self
            .components
            .par_iter()
            .map(|component| {
                let place = |x: &[f64]| {
                    let distance2 = component.distance2(x);
                    (
                        component.ln_density(distance2),
                        heavy / (degrees_of_freedom + distance2),
                    )
                };
                rows.iter().map(place).collect()
            })
            .collect();
        let mut total = 0.0;
        let mut here = vec![0.0; belongs.len()];
        for row in 0..rows.len() {
            for (here, component) in here.iter_mut().zip(&belongs) {
                *here = component[row].0;
            }
            let sum = ln_sum_exp(&here);
            total += sum;
            for component in &mut belongs {
                component[row].0 = (component[row].0 - sum).exp();
            }
        }
        (belongs, total / rows.len() as f64)
    }

    /// M step: the best components, given the responsibilities. A component responsible for less than one row is dropped.
    fn maximise(rows: &Rows, belongs: &[Vec<(f64, f64)>], n: f64) -> Option<Self> {
        let dim = rows.dim;
        let learned: Vec<Learned> = belongs
            .par_iter()
            .map(|component| learn(rows, |row| component[row]))
            .filter(|learned| learned.count >= 1.0)
            .collect();
        let kept: f64 = learned.iter().map(|l| l.count).sum();
        let mut common = DMatrix::identity(dim, dim) * RIDGE;
        for l in &learned {
            common += &l.covariance * (l.count / n);
        }
        let pull = dim as f64;
        let components = learned.into_iter().map(|l| {
            let scale = (l.covariance * l.count + &common * pull) / (l.count + pull);
            Component::new(l.count / kept, l.mean, scale)
        });
        Some(Self {
            components: components.collect::<Option<_>>()?,
        })
    }

    /// The same mixture in the units in which the rows were.
    fn in_units(&self, mean: &DVector<f64>, units: &DMatrix<f64>) -> Option<Self> {
        self.moved(|c| (mean + units * &c.mean, units * &c.lower))
    }

    /// The same mixture, every component this many times as wide about its mean. None if one is then too wide or too narrow for an
    /// inverse.
    pub fn widened(&self, by: f64) -> Option<Self> {
        self.moved(|c| (c.mean.clone(), &c.lower * by))
    }

    /// Every component with another mean and scale. None if a scale has no inverse.
    fn moved(&self, to: impl Fn(&Component) -> (DVector<f64>, DMatrix<f64>)) -> Option<Self> {
        let components = self.components.iter().map(|c| {
            let (mean, lower) = to(c);
            Component::of_lower(c.weight, mean, lower)
        });
        Some(Self {
            components: components.collect::<Option<_>>()?,
        })
    }

    /// Checks a mixture that was read from a file.
    pub fn check(&self, dim: usize) -> Valid {
        ensure(!self.components.is_empty(), "a mixture has no component")?;
        self.components.iter().try_for_each(|c| c.check(dim))
    }

    /// Number of components.
    pub fn len(&self) -> usize {
        self.components.len()
    }

    /// Log of the density of every component at a point times its weight.
    fn ln_densities(&self, x: &[f64]) -> Vec<f64> {
        let ln_density = |c: &Component| c.ln_density(c.distance2(x));
        self.components.iter().map(ln_density).collect()
    }

    /// Log density.
    pub fn ln_density(&self, x: &[f64]) -> f64 {
        ln_sum_exp(&self.ln_densities(x))
    }

    /// Log density, with its gradient written into `gradient`.
    pub fn ln_density_and_gradient(&self, x: &[f64], gradient: &mut [f64]) -> f64 {
        let degrees_of_freedom = f64::from(DEGREES_OF_FREEDOM);
        let here = self.ln_densities(x);
        let sum = ln_sum_exp(&here);
        gradient.fill(0.0);
        for (component, ln_density) in self.components.iter().zip(here) {
            let belongs = (ln_density - sum).exp();
            // Components below the rounding of the sum are skipped.
            if belongs > f64::EPSILON {
                let distance2 = component.distance2(x);
                let pull = belongs * (degrees_of_freedom + x.len() as f64)
                    / (degrees_of_freedom + distance2);
                component.whiten(x, |row, y| {
                    for (g, l) in gradient.iter_mut().zip(row) {
                        *g -= pull * l * y;
                    }
                });
            }
        }
        sum
    }

    /// Mean log density of rows.
    pub fn mean_ln_density(&self, rows: &Rows) -> f64 {
        rows.iter().map(|x| self.ln_density(x)).sum::<f64>() / rows.len() as f64
    }

    /// A draw.
    pub fn draw(&self, rng: &mut RandomStream) -> Vec<f64> {
        let mut place = unit_open(rng);
        let chosen = self.components.iter().find(|c| {
            place -= c.weight;
            place < 0.0
        });
        // Rounding can leave the sum of the weights just below 1.
        let Some(chosen) = chosen.or(self.components.last()) else {
            return Vec::new();
        };
        let normals = DVector::from_fn(chosen.mean.len(), |_, _| standard_normal(rng));
        let chi2: f64 = (0..DEGREES_OF_FREEDOM)
            .map(|_| standard_normal(rng).powi(2))
            .sum();
        let stretch = (f64::from(DEGREES_OF_FREEDOM) / chi2).sqrt();
        (&chosen.mean + &chosen.lower * normals * stretch)
            .iter()
            .copied()
            .collect()
    }
}

/// Weighted mean and covariance of the rows: `weigh` gives the responsibility for a row and the weight of the row.
fn learn(rows: &Rows, weigh: impl Fn(usize) -> (f64, f64)) -> Learned {
    let dim = rows.dim;
    let (mut count, mut sum) = (0.0, 0.0);
    let mut mean = DVector::zeros(dim);
    for (row, x) in rows.iter().enumerate() {
        let (belongs, counts) = weigh(row);
        count += belongs;
        let weight = belongs * counts;
        sum += weight;
        if weight > 0.0 {
            for (m, x) in mean.iter_mut().zip(x) {
                *m += (x - *m) * (weight / sum);
            }
        }
    }
    let mut covariance: DMatrix<f64> = DMatrix::zeros(dim, dim);
    let mut deviation = vec![0.0; dim];
    for (row, x) in rows.iter().enumerate() {
        let (belongs, counts) = weigh(row);
        let weight = belongs * counts / count;
        if weight > 1e-12 {
            for ((a, x), m) in deviation.iter_mut().zip(x).zip(mean.iter()) {
                *a = x - m;
            }
            let columns = covariance.as_mut_slice().chunks_exact_mut(dim);
            for ((column, a), i) in columns.zip(&deviation).zip(1..) {
                for (c, b) in column.iter_mut().zip(&deviation[..i]) {
                    *c += weight * a * b;
                }
            }
        }
    }
    covariance.fill_lower_triangle_with_upper_triangle();
    Learned {
        count,
        mean,
        covariance,
    }
}

/// Rows about this mean in these units.
fn whiten(rows: &Rows, mean: &DVector<f64>, units: &DMatrix<f64>) -> Option<Rows> {
    let mut values = Vec::with_capacity(rows.values.len());
    for x in rows.iter() {
        let deviation = DVector::from_column_slice(x) - mean;
        values.extend(units.solve_lower_triangular(&deviation)?.iter());
    }
    Some(Rows {
        dim: rows.dim,
        values,
    })
}

/// At most this many different rows, each new one drawn with the square of its distance from the nearest (k-means++).
fn far_apart(rows: &Rows, count: usize, rng: &mut RandomStream) -> Vec<Vec<f64>> {
    let Some(first) = rows.iter().nth(below(rng, rows.len())) else {
        return Vec::new();
    };
    let mut centres = vec![first.to_vec()];
    let mut nearest = vec![f64::INFINITY; rows.len()];
    while centres.len() < count {
        let last = &centres[centres.len() - 1];
        for (nearest, x) in nearest.iter_mut().zip(rows.iter()) {
            let d2: f64 = x.iter().zip(last).map(|(x, c)| (x - c).powi(2)).sum();
            *nearest = nearest.min(d2);
        }
        let mut place = unit_open(rng) * nearest.iter().sum::<f64>();
        let next = rows.iter().zip(&nearest).find(|(_, d2)| {
            place -= **d2;
            place < 0.0
        });
        match next {
            Some((x, _)) => centres.push(x.to_vec()),
            None => break,
        }
    }
    centres
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Domain, stream};

    /// Draws of two normals of deviation 0.1 at -+ 1 along the first axis, three quarters of them at +1.
    fn twins(count: usize) -> Rows {
        let mut rng = stream(1, Domain::Test, 2, 0);
        let mut values = Vec::new();
        for i in 0..count {
            let centre = if i % 4 == 0 { -1.0 } else { 1.0 };
            values.push(centre + 0.1 * standard_normal(&mut rng));
            values.push(5.0 + 0.1 * standard_normal(&mut rng));
        }
        Rows { dim: 2, values }
    }

    #[test]
    fn two_clumps_are_two_components_with_their_weights() {
        let rows = twins(2000);
        let two = Mixture::fit(&rows, 2, &mut stream(1, Domain::Test, 3, 0)).unwrap();
        let mut weights: Vec<f64> = two.components.iter().map(|c| c.weight).collect();
        weights.sort_by(f64::total_cmp);
        assert!((weights[0] - 0.25).abs() < 1e-3, "{weights:?}");
        for c in &two.components {
            assert!((c.mean[0].abs() - 1.0).abs() < 0.02, "{}", c.mean);
            assert!((c.mean[1] - 5.0).abs() < 0.02, "{}", c.mean);
        }
        let one = Mixture::fit(&rows, 1, &mut stream(1, Domain::Test, 3, 0)).unwrap();
        assert!(two.mean_ln_density(&rows) > one.mean_ln_density(&rows) + 1.0);
        let here = two.ln_densities(&[1.0, 5.0]);
        let sum = ln_sum_exp(&here);
        let belongs: Vec<f64> = here.iter().map(|l| (l - sum).exp()).collect();
        assert!((belongs.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        assert!(belongs.iter().any(|b| *b > 0.999));
    }

    #[test]
    fn a_wider_mixture_has_its_draws_farther_out() {
        let rows = twins(500);
        let mixture = Mixture::fit(&rows, 1, &mut stream(1, Domain::Test, 6, 0)).unwrap();
        let wide = mixture.widened(1.5).unwrap();
        // Density at the mean falls by the volume.
        let mean = mixture.components[0].mean.as_slice().to_vec();
        let fall = mixture.ln_density(&mean) - wide.ln_density(&mean);
        assert!((fall - 2.0 * 1.5_f64.ln()).abs() < 1e-12, "{fall}");
        let (mut rng, mut other) = (stream(1, Domain::Test, 7, 0), stream(1, Domain::Test, 7, 0));
        for _ in 0..10 {
            let (near, far) = (mixture.draw(&mut rng), wide.draw(&mut other));
            for ((near, far), mean) in near.iter().zip(&far).zip(&mean) {
                assert!((far - mean - 1.5 * (near - mean)).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn the_density_is_that_of_the_draws() {
        // The mean of prior over density is 1 for draws of the density. Its own error decides.
        let mixture = Mixture::fit(&twins(500), 2, &mut stream(1, Domain::Test, 4, 0)).unwrap();
        let ln_other = |x: &[f64]| -0.5 * ((x[0] / 0.7).powi(2) + ((x[1] - 5.0) / 0.07).powi(2));
        let ln_norm = (2.0 * PI * 0.7 * 0.07).ln();
        let ratios: Vec<f64> = (0..20_000)
            .map(|i| {
                let x = mixture.draw(&mut stream(1, Domain::Test, 5, i));
                // Where the mixture has almost no density, the variance of the ratio would not be finite.
                let inside = x[0].abs() < 1.5 && x[0].abs() > 0.5;
                if inside {
                    (ln_other(&x) - ln_norm - mixture.ln_density(&x)).exp()
                } else {
                    0.0
                }
            })
            .collect();
        let n = ratios.len() as f64;
        let mean = ratios.iter().sum::<f64>() / n;
        let variance = ratios.iter().map(|r| (r - mean).powi(2)).sum::<f64>() / n;
        let cdf = |x: f64| crate::normal::cdf(x / 0.7);
        let truth = 2.0 * (cdf(1.5) - cdf(0.5));
        assert!(
            (mean - truth).abs() < 3.0 * (variance / n).sqrt(),
            "{mean} {truth}"
        );
    }

    #[test]
    fn the_gradient_is_that_of_the_density() {
        let mixture = Mixture::fit(&twins(500), 2, &mut stream(1, Domain::Test, 7, 0)).unwrap();
        let mut gradient = [0.0; 2];
        for x in [[0.9, 5.05], [0.1, 4.8], [-1.3, 5.2]] {
            let value = mixture.ln_density_and_gradient(&x, &mut gradient);
            assert!((value - mixture.ln_density(&x)).abs() < 1e-12);
            for i in 0..2 {
                let at = |h: f64| {
                    let mut x = x;
                    x[i] += h;
                    mixture.ln_density(&x)
                };
                let slope = (at(1e-5) - at(-1e-5)) / 2e-5;
                assert!(
                    (gradient[i] - slope).abs() < 1e-5 * (1.0 + slope.abs()),
                    "{x:?} {i}"
                );
            }
        }
    }

    #[test]
    fn rows_that_do_not_span_their_space_have_no_mixture() {
        let rows = Rows {
            dim: 2,
            values: (0..100).flat_map(|i| [f64::from(i), 2.0]).collect(),
        };
        assert!(Mixture::fit(&rows, 2, &mut stream(1, Domain::Test, 6, 0)).is_none());
    }
}
