//! The Beta distribution on the support.

use super::family::Family;
use super::hyperprior::{self, ANY};
use crate::error::Result;
use crate::scalar::Real;
use oblate_samplers::Marginal;
use serde::{Deserialize, Serialize};
use statrs::function::gamma::digamma;
use std::ops::RangeInclusive;

/// Logarithms of the exponents that a hyperprior may name.
const LN_EXPONENTS: RangeInclusive<f64> = -10.0..=10.0;

/// Largest exponent. The Beta distribution of two such exponents is 1e-4 of the support wide, and its logarithm has still eight digits.
const MAX_EXPONENT: f64 = 1e7;

/// Hyperpriors of the family.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BetaPriors {
    /// Prior of ln alpha; normal with mean 1 and standard deviation 1.5.
    pub ln_alpha_pop: Marginal,
    /// Prior of ln beta; the same.
    pub ln_beta_pop: Marginal,
}

impl Default for BetaPriors {
    fn default() -> Self {
        let prior = Marginal::Normal { mean: 1.0, sd: 1.5 };
        Self {
            ln_alpha_pop: prior,
            ln_beta_pop: prior,
        }
    }
}

impl BetaPriors {
    /// Checks every number by itself.
    ///
    /// # Errors
    /// [`Error::OutOfRange`](crate::Error::OutOfRange) or [`Error::Setting`](crate::Error::Setting) with the first key that is at fault.
    pub fn check(&self) -> Result<()> {
        hyperprior::check("beta.ln_alpha_pop", &self.ln_alpha_pop, &LN_EXPONENTS, &ANY)?;
        hyperprior::check("beta.ln_beta_pop", &self.ln_beta_pop, &LN_EXPONENTS, &ANY)
    }
}

/// `x^(alpha - 1) (1 - x)^(beta - 1)`, normalised, with `x = (q - q_min) / (q_max - q_min)`. Hyperparameters `ln_alpha_pop` and
/// `ln_beta_pop`; the mean and the standard deviation of q are the derived `mean_pop` and `sd_pop`.
#[derive(Clone, Debug)]
pub struct Beta {
    support: (f64, f64),
    priors: BetaPriors,
}

impl Beta {
    /// The family on a support `(q_min, q_max)`.
    ///
    /// # Errors
    /// Those of [`BetaPriors::check`].
    pub fn new(support: (f64, f64), priors: BetaPriors) -> Result<Self> {
        priors.check()?;
        Ok(Self { support, priors })
    }
}

/// The exponent; NaN, a member without a density, where it is too large for its logarithmic density to have digits.
fn exponent<S: Real>(ln_exponent: S) -> S {
    if ln_exponent.re() < MAX_EXPONENT.ln() {
        ln_exponent.exp()
    } else {
        S::from_f64(f64::NAN)
    }
}

fn ln_gamma<S: Real>(x: S) -> S {
    x.with_derivative(libm::lgamma(x.re()), digamma(x.re()))
}

impl Family<2> for Beta {
    fn support(&self) -> (f64, f64) {
        self.support
    }

    fn hyperparameters(&self) -> [(&'static str, Marginal); 2] {
        [
            ("ln_alpha_pop", self.priors.ln_alpha_pop),
            ("ln_beta_pop", self.priors.ln_beta_pop),
        ]
    }

    fn ln_pdf<S: Real>(&self, alpha: [S; 2]) -> impl Fn(f64) -> S {
        let (lo, hi) = self.support;
        let [alpha, beta] = alpha.map(exponent);
        let constant = ln_gamma(alpha + beta) - ln_gamma(alpha) - ln_gamma(beta) - (hi - lo).ln();
        let (below, above) = (alpha - 1.0, beta - 1.0);
        // A draw that rounds to an end of the support is within half a unit of rounding of it.
        let ln = move |part: f64| (part / (hi - lo)).max(f64::EPSILON).ln();
        move |q| below * ln(q - lo) + above * ln(hi - q) + constant
    }

    fn derived_names(&self) -> &'static [&'static str] {
        &["mean_pop", "sd_pop"]
    }

    fn derived(&self, alpha: [f64; 2]) -> Vec<f64> {
        let (lo, hi) = self.support;
        let [alpha, beta] = alpha.map(f64::exp);
        let sum = alpha + beta;
        let (mean, variance) = (alpha / sum, alpha * beta / (sum * sum * (sum + 1.0)));
        vec![lo + (hi - lo) * mean, (hi - lo) * variance.sqrt()]
    }
}
