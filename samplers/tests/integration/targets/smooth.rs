//! Smooth targets with exact gradients and exactly known evidences.
//!
//! Where no closed form is quoted the evidence was computed by quadrature; Gaussian ones are computed here from
//! their matrices and compared with the quoted numbers in the tests below.

use nalgebra::{DMatrix, DVector};
use oblate_samplers::rng::{Domain, standard_normal, stream};
use oblate_samplers::target::Involution;
use oblate_samplers::{Marginal, Outcome, Prior, Symmetry, Target};
use std::f64::consts::PI;

/// A likelihood with a gradient, its prior and what is known about it.
pub struct Smooth {
    pub name: &'static str,
    pub ln_z: f64,
    prior: Prior,
    law: Law,
    symmetries: Vec<Symmetry>,
    bound: Option<f64>,
}

enum Law {
    /// `peak - (theta - mean)' P (theta - mean) / 2`.
    Gaussian {
        peak: f64,
        mean: DVector<f64>,
        precision: DMatrix<f64>,
    },
    /// `ln sum_k w_k exp(-|theta -+ a e1|^2 / (2 s_k^2))`, where `plus` is the posterior probability of the first.
    Twins {
        plus: f64,
        ln_weights: [f64; 2],
        variances: [f64; 2],
    },
    /// `y` successes of `n` with probability `theta_1 theta_2`, whole normalisation.
    Binomial { y: f64, n: f64, ln_choose: f64 },
    /// Sum of two normal shells of radius 2 and width 0.1 about `+- 3.5 e1`.
    Shells,
    /// 1 where `lo <= theta_1 <= hi`, no likelihood elsewhere.
    Flat { lo: f64, hi: f64 },
}

impl Smooth {
    fn new(name: &'static str, ln_z: f64, prior: Vec<Marginal>, law: Law) -> Self {
        let named = prior
            .into_iter()
            .enumerate()
            .map(|(i, m)| (format!("x{}", i + 1), "", m));
        Self {
            name,
            ln_z,
            prior: Prior::new(named).unwrap(),
            law,
            symmetries: Vec::new(),
            bound: None,
        }
    }

    /// Posterior probability of a positive first parameter, of targets with a mode on both sides.
    pub fn right(&self) -> Option<f64> {
        match self.law {
            Law::Twins { plus, .. } => Some(plus),
            Law::Shells => Some(0.5),
            Law::Gaussian { .. } | Law::Binomial { .. } | Law::Flat { .. } => None,
        }
    }

    /// The same target with an upper bound of ln L.
    pub fn bounded(mut self, bound: f64) -> Self {
        self.bound = Some(bound);
        self
    }

    /// The same target with declared symmetries.
    pub fn with_symmetries(mut self, symmetries: Vec<Symmetry>) -> Self {
        self.symmetries = symmetries;
        self
    }

    /// The value, and the gradient if there is a place for it.
    fn value(&self, theta: &[f64], gradient: Option<&mut [f64]>) -> Outcome {
        let mut nowhere = vec![0.0; theta.len()];
        let gradient = gradient.unwrap_or(&mut nowhere);
        gradient.fill(0.0);
        match &self.law {
            Law::Gaussian {
                peak,
                mean,
                precision,
            } => {
                let mut quadratic = 0.0;
                for (i, g) in gradient.iter_mut().enumerate() {
                    for (j, t) in theta.iter().enumerate() {
                        *g -= precision[(i, j)] * (t - mean[j]);
                    }
                    quadratic -= *g * (theta[i] - mean[i]);
                }
                Outcome::from_ln_likelihood(peak - 0.5 * quadratic)
            }
            Law::Twins {
                ln_weights: [ln_a, ln_b],
                variances: [v, v_b],
                ..
            } => {
                let rest: f64 = theta[1..].iter().map(|t| t * t).sum();
                let ln = |centre: f64, ln_w: f64, v: f64| {
                    ln_w - 0.5 * ((theta[0] - centre).powi(2) + rest) / v
                };
                let (a, b) = (ln(OFFSET, *ln_a, *v), ln(-OFFSET, *ln_b, *v_b));
                let top = a.max(b);
                let l = top + ((a - top).exp() + (b - top).exp()).ln();
                let probability = (a - l).exp();
                let other = (1.0 - probability) * (v / v_b);
                gradient[0] =
                    -(probability * (theta[0] - OFFSET) + other * (theta[0] + OFFSET)) / v;
                for (g, t) in gradient[1..].iter_mut().zip(&theta[1..]) {
                    *g = -t * (probability + other) / v;
                }
                Outcome::from_ln_likelihood(l)
            }
            Law::Binomial { y, n, ln_choose } => {
                let p = theta[0] * theta[1];
                let slope = y / p - (n - y) / (1.0 - p);
                gradient[0] = slope * theta[1];
                gradient[1] = slope * theta[0];
                Outcome::from_ln_likelihood(ln_choose + y * p.ln() + (n - y) * (-p).ln_1p())
            }
            Law::Shells => {
                let rest: f64 = theta[1..].iter().map(|t| t * t).sum();
                let radius = |c: f64| ((theta[0] - c).powi(2) + rest).sqrt();
                let (ra, rb) = (radius(3.5), radius(-3.5));
                let ln = |r: f64| -0.5 * ((r - 2.0) / 0.1).powi(2) - (0.1 * (2.0 * PI).sqrt()).ln();
                let top = ln(ra).max(ln(rb));
                let l = top + ((ln(ra) - top).exp() + (ln(rb) - top).exp()).ln();
                for (r, c) in [(ra, 3.5), (rb, -3.5)] {
                    let pull = -(ln(r) - l).exp() * (r - 2.0) / 0.01 / r;
                    gradient[0] += pull * (theta[0] - c);
                    for (g, t) in gradient[1..].iter_mut().zip(&theta[1..]) {
                        *g += pull * t;
                    }
                }
                Outcome::from_ln_likelihood(l)
            }
            Law::Flat { lo, hi } => {
                if (*lo..=*hi).contains(&theta[0]) {
                    Outcome::Value(0.0)
                } else {
                    Outcome::Reject("outside the flat top")
                }
            }
        }
    }
}

impl Target for Smooth {
    fn prior(&self) -> &Prior {
        &self.prior
    }
    fn ln_likelihood(&self, theta: &[f64]) -> Outcome {
        self.value(theta, None)
    }
    fn ln_likelihood_bound(&self) -> Option<f64> {
        self.bound
    }
    fn ln_likelihood_and_gradient(&self, theta: &[f64], gradient: &mut [f64]) -> Outcome {
        self.value(theta, Some(gradient))
    }
    fn gradient_cost(&self) -> Option<f64> {
        Some(2.0)
    }
    fn symmetries(&self) -> &[Symmetry] {
        &self.symmetries
    }
}

/// The reflection of the first coordinate, in `z`.
pub struct Flip;

impl Involution for Flip {
    fn name(&self) -> &str {
        "flip"
    }
    fn apply(&self, z: &mut [f64]) -> Option<f64> {
        z[0] = -z[0];
        Some(0.0)
    }
}

/// Standard normals as the prior.
pub fn normals(dim: usize, mean: f64) -> Vec<Marginal> {
    vec![Marginal::Normal { mean, sd: 1.0 }; dim]
}

/// `N(mean0, I)` prior with a Gaussian likelihood: the evidence is `N(mean0; mean, I + P^-1)` times the
/// likelihood's own normalisation.
fn gaussian(
    name: &'static str,
    mean0: f64,
    peak: f64,
    mean: DVector<f64>,
    precision: DMatrix<f64>,
) -> Smooth {
    let dim = mean.len();
    let posterior = &precision + DMatrix::identity(dim, dim);
    let shift = DVector::from_element(dim, mean0) - &mean;
    // (P^-1 + I)^-1 = P - P (P + I)^-1 P, stable for any P.
    let pulled = &precision * &shift;
    let factor = posterior.cholesky().unwrap();
    let quadratic = shift.dot(&pulled) - pulled.dot(&factor.solve(&pulled));
    let ln_z = peak - 0.5 * factor.ln_determinant() - 0.5 * quadratic;
    let law = Law::Gaussian {
        peak,
        mean,
        precision,
    };
    Smooth::new(name, ln_z, normals(dim, mean0), law)
}

/// A symmetric matrix with these eigenvalues in a fixed, randomly rotated basis.
fn rotated(eigenvalues: &[f64]) -> DMatrix<f64> {
    let dim = eigenvalues.len();
    let mut rng = stream(13, Domain::Test, 0, 0);
    let basis = DMatrix::from_fn(dim, dim, |_, _| standard_normal(&mut rng))
        .qr()
        .q();
    let matrix =
        &basis * DMatrix::from_diagonal(&DVector::from_row_slice(eigenvalues)) * basis.transpose();
    (&matrix + matrix.transpose()) * 0.5
}

/// `10^{lo..hi}` evenly in the logarithm.
fn decades(dim: usize, lo: f64, hi: f64) -> Vec<f64> {
    (0..dim)
        .map(|i| 10_f64.powf(lo + (hi - lo) * i as f64 / (dim - 1) as f64))
        .collect()
}

/// `N(0, I)`, `l = -4.5 |z|^2`: precision goes from 1 to 10 in every direction.
pub fn iso(dim: usize) -> Smooth {
    gaussian(
        "iso",
        0.0,
        0.0,
        DVector::zeros(dim),
        DMatrix::identity(dim, dim) * 9.0,
    )
}

/// `N(0, I)` to posterior precisions `10^{0.3..3}` in a rotated basis.
fn mvn(name: &'static str, dim: usize) -> Smooth {
    let likelihood: Vec<f64> = decades(dim, 0.3, 3.0).iter().map(|p| p - 1.0).collect();
    gaussian(name, 0.0, 0.0, DVector::zeros(dim), rotated(&likelihood))
}

/// Thirteen correlated parameters.
pub fn mvn13() -> Smooth {
    mvn("mvn13", 13)
}

/// Thirty correlated parameters.
pub fn mvn30() -> Smooth {
    mvn("mvn30", 30)
}

/// The stiff corner of a stream fit: `l = -(z - m)' P (z - m) / 2` with precisions `10^{1..5}`; ln L of prior draws
/// is about -1e5.
pub fn stiff13() -> Smooth {
    let mut rng = stream(13, Domain::Test, 1, 0);
    let mean = DVector::from_fn(13, |_, _| standard_normal(&mut rng));
    gaussian("stiff13", 0.0, 0.0, mean, rotated(&decades(13, 1.0, 5.0)))
}

/// `N(15, I)` prior, one datum at 0 with covariance `0.01 I + 0.99`: the posterior is 15 standard deviations out.
pub fn far8() -> Smooth {
    let covariance = DMatrix::from_element(8, 8, 0.99) + DMatrix::identity(8, 8) * 0.01;
    let factor = covariance.cholesky().unwrap();
    let peak = -4.0 * (2.0 * PI).ln() - 0.5 * factor.ln_determinant();
    gaussian("far8", 15.0, peak, DVector::zeros(8), factor.inverse())
}

/// `U(-10, 10)^3`, a normalised normal with correlations 0.95.
pub fn gauss3() -> Smooth {
    let covariance = DMatrix::from_element(3, 3, 0.95) + DMatrix::identity(3, 3) * 0.05;
    let factor = covariance.cholesky().unwrap();
    let law = Law::Gaussian {
        peak: -1.5 * (2.0 * PI).ln() - 0.5 * factor.ln_determinant(),
        mean: DVector::zeros(3),
        precision: factor.inverse(),
    };
    let prior = vec![
        Marginal::Uniform {
            lo: -10.0,
            hi: 10.0
        };
        3
    ];
    Smooth::new("gauss3", -3.0 * 20_f64.ln(), prior, law)
}

/// Distance of the twins from the centre of the prior.
const OFFSET: f64 = 1.5;

/// `ln` of the integral of `N(0, I)` times `exp(-|theta - a e1|^2 / (2 v))` in 13 dimensions, where a is [`OFFSET`].
fn ln_evidence_of_twin(v: f64) -> f64 {
    0.5 * 13.0 * (v / (1.0 + v)).ln() - 0.5 * OFFSET * OFFSET / (1.0 + v)
}

/// `N(0, I)` in 13 dimensions, modes of these variances at `+- 1.5 e1`, of `plus` and `1 - plus` of the posterior.
fn twins(name: &'static str, plus: f64, variances: [f64; 2], ln_z: f64) -> Smooth {
    let ln_weight = |p: f64, v: f64| p.ln() + (ln_z - ln_evidence_of_twin(v));
    let law = Law::Twins {
        plus,
        ln_weights: [
            ln_weight(plus, variances[0]),
            ln_weight(1.0 - plus, variances[1]),
        ],
        variances,
    };
    Smooth::new(name, ln_z, normals(13, 0.0), law)
}

/// Two narrow modes with weights `plus` and `1 - plus`.
pub fn twins13(plus: f64) -> Smooth {
    let v = 0.1 * 0.1;
    twins("twins13", plus, [v, v], ln_evidence_of_twin(v))
}

/// A wide mode on the right and a narrow one on the left, each of half of the posterior. At the inverse temperature 0.3 the narrow one has
/// 1.5 %: a sampler that comes from the prior meets it late.
pub fn emerging13() -> Smooth {
    twins("emerging13", 0.5, [0.05, 0.02], 0.0)
}

/// `U(0, 1)^2`, 50 successes of 100 with probability `p1 p2`: `E p1` = 0.716257, `E p1 p2` = 0.492978.
pub fn binomial() -> Smooth {
    Smooth {
        ln_z: -4.974_552,
        ..binomial_of(50)
    }
}

/// The same for another number of successes, of unknown evidence.
pub fn binomial_of(successes: u32) -> Smooth {
    let ln_choose = (1..=successes)
        .map(|i| (f64::from(100 - successes + i) / f64::from(i)).ln())
        .sum();
    let law = Law::Binomial {
        y: f64::from(successes),
        n: 100.0,
        ln_choose,
    };
    let prior = vec![Marginal::Uniform { lo: 0.0, hi: 1.0 }; 2];
    Smooth::new("binomial", f64::NAN, prior, law)
}

/// Two thin shells in `U(-6, 6)^d`.
///
/// # Panics
/// If the evidence of this dimension is not tabulated.
pub fn shells(dim: usize) -> Smooth {
    let ln_z = match dim {
        2 => -1.745_642,
        5 => -5.673_601,
        10 => -14.590_491,
        13 => -20.660_701,
        20 => -36.086_548,
        30 => -60.127_767,
        _ => panic!("no evidence known for shells in {dim} dimensions"),
    };
    Smooth::new(
        "shells",
        ln_z,
        vec![Marginal::Uniform { lo: -6.0, hi: 6.0 }; dim],
        Law::Shells,
    )
}

/// `N(0, I)` in two dimensions, L = 1 where `z1 >= 0.5`, nothing elsewhere: `Z = 1 - Phi(0.5)`.
pub fn half_plane() -> Smooth {
    let law = Law::Flat {
        lo: 0.5,
        hi: f64::INFINITY,
    };
    Smooth::new("half plane", -1.175_911_761_593_618, normals(2, 0.0), law)
}

/// `U(0, 1)`, L = 1 below 1/4, nothing above.
pub fn quarter() -> Smooth {
    let law = Law::Flat { lo: 0.0, hi: 0.25 };
    Smooth::new(
        "quarter",
        0.25_f64.ln(),
        vec![Marginal::Uniform { lo: 0.0, hi: 1.0 }],
        law,
    )
}
