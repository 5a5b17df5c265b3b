//! The mixture of two truncated normal distributions with ordered means.

use super::family::Family;
use super::hyperprior::{self, ANY, POSITIVE};
use super::truncated_gaussian::{DEVIATIONS, MEANS, TruncatedGaussian, TruncatedGaussianSettings};
use crate::error::Result;
use crate::scalar::Real;
use oblate_samplers::Marginal;
use serde::{Deserialize, Serialize};

/// Smallest standard deviation of a component under the default hyperprior. A narrower component could hold a single draw of one stream, whose
/// sum would grow without bound as the component shrinks to it.
const MIN_SIGMA: f64 = 0.02;

/// Hyperpriors of the family.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MixturePriors {
    /// Prior of the weight of the component with the lower mean; uniform on [0, 1].
    pub weight_pop: Marginal,
    /// Prior of the middle between the two means before truncation; uniform on [0.5, 1.5].
    pub mu_middle_pop: Marginal,
    /// Prior of the difference of the two means; uniform on [0, 1].
    pub mu_gap_pop: Marginal,
    /// Prior of the standard deviation before truncation of the component with the lower mean; uniform on [0.02, 1].
    pub sigma_lower_pop: Marginal,
    /// The same of the component with the upper mean; uniform on [0.02, 1].
    pub sigma_upper_pop: Marginal,
}

impl Default for MixturePriors {
    fn default() -> Self {
        let unit = Marginal::Uniform { lo: 0.0, hi: 1.0 };
        let sigma = Marginal::Uniform {
            lo: MIN_SIGMA,
            hi: 1.0,
        };
        Self {
            weight_pop: unit,
            mu_middle_pop: Marginal::Uniform { lo: 0.5, hi: 1.5 },
            mu_gap_pop: unit,
            sigma_lower_pop: sigma,
            sigma_upper_pop: sigma,
        }
    }
}

impl MixturePriors {
    /// Checks every number by itself, that the weight is between 0 and 1, and that the gap and the deviations are positive.
    ///
    /// # Errors
    /// [`Error::OutOfRange`](crate::Error::OutOfRange) or [`Error::Setting`](crate::Error::Setting) with the first key that is at fault.
    pub fn check(&self) -> Result<()> {
        let weights = 0.0..=1.0;
        for (key, prior, range, values) in [
            ("weight_pop", self.weight_pop, weights.clone(), weights),
            ("mu_middle_pop", self.mu_middle_pop, MEANS, ANY),
            ("mu_gap_pop", self.mu_gap_pop, DEVIATIONS, POSITIVE),
            (
                "sigma_lower_pop",
                self.sigma_lower_pop,
                DEVIATIONS,
                POSITIVE,
            ),
            (
                "sigma_upper_pop",
                self.sigma_upper_pop,
                DEVIATIONS,
                POSITIVE,
            ),
        ] {
            hyperprior::check(&format!("mixture.{key}"), &prior, &range, &values)?;
        }
        Ok(())
    }
}

/// `weight N(middle - gap / 2, sigma_lower) + (1 - weight) N(middle + gap / 2, sigma_upper)`, each truncated to the support and normalised
/// on it. The gap is positive, so that the two components cannot change places. The two means are the derived `mu_lower_pop` and
/// `mu_upper_pop`.
#[derive(Clone, Debug)]
pub struct Mixture {
    component: TruncatedGaussian,
    priors: MixturePriors,
}

impl Mixture {
    /// The family on a support `(q_min, q_max)`.
    ///
    /// # Errors
    /// Those of [`TruncatedGaussianSettings::check`] for the support, and of [`MixturePriors::check`].
    pub fn new((q_min, q_max): (f64, f64), priors: MixturePriors) -> Result<Self> {
        priors.check()?;
        let component = TruncatedGaussian::new(TruncatedGaussianSettings {
            q_min,
            q_max,
            ..TruncatedGaussianSettings::default()
        })?;
        Ok(Self { component, priors })
    }
}

/// `ln (e^a + e^b)`; NaN if one is.
fn ln_add_exp<S: Real>(a: S, b: S) -> S {
    let (top, other) = if a.re() < b.re() { (b, a) } else { (a, b) };
    if top.re() == f64::NEG_INFINITY || other.re() == f64::NEG_INFINITY {
        // The other one adds nothing, and its derivatives may be infinite.
        return top;
    }
    top + ((other - top).exp() + 1.0).ln()
}

impl Family<5> for Mixture {
    fn support(&self) -> (f64, f64) {
        self.component.support()
    }

    fn hyperparameters(&self) -> [(&'static str, Marginal); 5] {
        [
            ("weight_pop", self.priors.weight_pop),
            ("mu_middle_pop", self.priors.mu_middle_pop),
            ("mu_gap_pop", self.priors.mu_gap_pop),
            ("sigma_lower_pop", self.priors.sigma_lower_pop),
            ("sigma_upper_pop", self.priors.sigma_upper_pop),
        ]
    }

    fn ln_pdf<S: Real>(
        &self,
        [weight, middle, gap, sigma_lower, sigma_upper]: [S; 5],
    ) -> impl Fn(f64) -> S {
        let half = gap * 0.5;
        let lower = self.component.ln_pdf([middle - half, sigma_lower]);
        let upper = self.component.ln_pdf([middle + half, sigma_upper]);
        let (ln_weight, ln_rest) = (weight.ln(), (-weight + 1.0).ln());
        move |q| ln_add_exp(ln_weight + lower(q), ln_rest + upper(q))
    }

    fn derived_names(&self) -> &'static [&'static str] {
        &["mu_lower_pop", "mu_upper_pop"]
    }

    fn derived(&self, [_, middle, gap, _, _]: [f64; 5]) -> Vec<f64> {
        vec![middle - 0.5 * gap, middle + 0.5 * gap]
    }
}
