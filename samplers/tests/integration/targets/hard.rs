//! Targets with plateaus, ridges and many peaks; no gradients. Evidences by quadrature.

use oblate_samplers::{Marginal, Outcome, Prior, Target};
use std::f64::consts::PI;

type LnL = Box<dyn Fn(&[f64]) -> Outcome + Sync + Send>;

/// A likelihood over a box with uniform prior, and its evidence.
pub struct Hard {
    prior: Prior,
    ln_l: LnL,
    /// The exact ln Z.
    pub ln_z: f64,
}

impl Hard {
    /// Any log-likelihood on the unit cube; its evidence is not known.
    pub fn with<F>(dim: usize, ln_l: F) -> Self
    where
        F: Fn(&[f64]) -> f64 + Sync + Send + 'static,
    {
        hard(dim, 0.0, 1.0, f64::NAN, ln_l)
    }
}

impl Target for Hard {
    fn prior(&self) -> &Prior {
        &self.prior
    }
    fn ln_likelihood(&self, theta: &[f64]) -> Outcome {
        (self.ln_l)(theta)
    }
}

fn hard<F>(dim: usize, lo: f64, hi: f64, ln_z: f64, ln_l: F) -> Hard
where
    F: Fn(&[f64]) -> f64 + Sync + Send + 'static,
{
    let names = (0..dim).map(|k| (format!("x{}", k + 1), "", Marginal::Uniform { lo, hi }));
    Hard {
        prior: Prior::new(names).unwrap(),
        ln_l: Box::new(move |x| Outcome::from_ln_likelihood(ln_l(x))),
        ln_z,
    }
}

/// L = 1 on the unit cube.
pub fn constant(dim: usize) -> Hard {
    hard(dim, 0.0, 1.0, 0.0, |_| 0.0)
}

/// L = 1 - x^2 on (0, 1): 2/3.
pub fn power() -> Hard {
    hard(1, 0.0, 1.0, (2.0_f64 / 3.0).ln(), |x| {
        (1.0 - x[0] * x[0]).ln()
    })
}

/// L = 1 on the first quarter of (0, 1), rejected elsewhere.
pub fn quarter() -> Hard {
    Hard {
        ln_l: Box::new(|x| {
            if x[0] < 0.25 {
                Outcome::Value(0.0)
            } else {
                Outcome::Reject("beyond the quarter")
            }
        }),
        ..hard(1, 0.0, 1.0, 0.25_f64.ln(), |_| 0.0)
    }
}

/// A box of 18 equal peaks, two of them cut at its faces.
pub fn eggbox() -> Hard {
    hard(2, 0.0, 10.0 * PI, 235.855_940, |x| {
        (2.0 + (0.5 * x[0]).cos() * (0.5 * x[1]).cos()).powi(5)
    })
}

fn rosenbrock(x: &[f64]) -> f64 {
    (1.0 - x[0]).powi(2) + 100.0 * (x[1] - x[0] * x[0]).powi(2)
}

/// A normal peak with a standard deviation of 0.1 in the unit cube, times exp(sin) with a period of a tenth of that: no smooth function says
/// which of two neighbours is higher. The mean of exp(sin) is I0(1) = 1.266066.
pub fn rough(dim: usize) -> Hard {
    const SD: f64 = 0.1;
    let peak = dim as f64 * (SD * (2.0 * PI).sqrt()).ln();
    hard(dim, 0.0, 1.0, peak + 1.266_066_f64.ln(), |x| {
        let square: f64 = x.iter().map(|x| ((x - 0.5) / SD).powi(2)).sum();
        let phase: f64 = (1..).zip(x).map(|(k, x)| f64::from(k) * x).sum();
        (2.0 * PI * phase / (0.1 * SD)).sin() - 0.5 * square
    })
}

/// Rosenbrock's valley on (-5, 5)^2.
pub fn rosen() -> Hard {
    hard(2, -5.0, 5.0, -5.804_132, |x| -rosenbrock(x))
}

/// Rosenbrock's valley on (-10, 10)^2.
pub fn rosen_wide() -> Hard {
    hard(2, -10.0, 10.0, -7.150_436, |x| -rosenbrock(x))
}

/// Half as steep, on (-5, 5)^2.
pub fn rosen_half() -> Hard {
    hard(2, -5.0, 5.0, -5.185_180, |x| -0.5 * rosenbrock(x))
}

/// Half as steep, on (-10, 10)^2.
pub fn rosen_half_wide() -> Hard {
    hard(2, -10.0, 10.0, -6.471_617, |x| -0.5 * rosenbrock(x))
}

/// ln of a normal density of unit variance.
fn ln_normal(x: f64, mean: f64) -> f64 {
    -0.5 * (x - mean).powi(2) - 0.5 * (2.0 * PI).ln()
}

/// ln of the density of the logarithm of an exponential variate, shifted.
fn ln_log_gamma(x: f64, shift: f64) -> f64 {
    (x - shift) - (x - shift).exp()
}

fn ln_mean(a: f64, b: f64) -> f64 {
    let top = a.max(b);
    top + (0.5 * ((a - top).exp() + (b - top).exp())).ln()
}

/// Four modes with one-sided tails on (-30, 30)^dim; normalised, so that ln Z = 0 but for the tails cut off.
pub fn log_gamma(dim: usize) -> Hard {
    hard(dim, -30.0, 30.0, -1.0e-9, move |x| {
        let skewed = 2 + (dim - 2) / 2;
        let first = ln_mean(ln_log_gamma(x[0], 10.0), ln_log_gamma(x[0], -10.0));
        let second = ln_mean(ln_normal(x[1], 10.0), ln_normal(x[1], -10.0));
        let rest: f64 = (2..dim)
            .map(|k| {
                if k < skewed {
                    ln_log_gamma(x[k], 10.0)
                } else {
                    ln_normal(x[k], 10.0)
                }
            })
            .sum();
        first + second + rest + dim as f64 * 60.0_f64.ln()
    })
}

/// A wedding cake: nested cubes of constant likelihood, each with 0.7 of the volume of the next, in `dim` 2 or 5.
pub fn cake(dim: usize) -> Hard {
    let ln_z = if dim == 2 { -1.335_302 } else { -2.098_453 };
    hard(dim, 0.0, 1.0, ln_z, move |x| {
        cake_ln_l(
            x.iter().map(|x| 2.0 * (x - 0.5).abs()).fold(0.0, f64::max),
            dim,
        )
    })
}

/// The cake's log-likelihood at distance `r` from the centre, in (0, 1).
fn cake_ln_l(r: f64, dim: usize) -> f64 {
    let d = dim as f64;
    let tier = (d * r.ln() / 0.7_f64.ln()).floor();
    -0.7_f64.powf(2.0 * tier / d) / (8.0 * 0.2 * 0.2)
}
