//! A histogram whose logarithm is a random walk over the cells: a flexible family with a smoothness prior.

use super::family::Family;
use super::hyperprior::{self, POSITIVE};
use crate::error::Result;
use crate::scalar::Real;
use oblate_samplers::Marginal;
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;

/// Number of cells, equally wide: as wide as a population that some tens of streams can resolve.
pub const CELLS: usize = 10;

/// Number of hyperparameters: the roughness, and one step between each two neighbours.
const N: usize = CELLS;

/// Roughnesses that the hyperprior may name.
const ROUGHNESSES: RangeInclusive<f64> = 0.0..=20.0;

/// Names of the steps, from the lowest cell up.
const STEPS: [&str; N - 1] = [
    "step_1_pop",
    "step_2_pop",
    "step_3_pop",
    "step_4_pop",
    "step_5_pop",
    "step_6_pop",
    "step_7_pop",
    "step_8_pop",
    "step_9_pop",
];

/// Hyperpriors of the family.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct HistogramPriors {
    /// Prior of the standard deviation of the difference of ln p(q) between neighbouring cells; half-normal with standard deviation 1.
    pub roughness_pop: Marginal,
}

impl Default for HistogramPriors {
    fn default() -> Self {
        Self {
            roughness_pop: Marginal::HalfNormal { sd: 1.0 },
        }
    }
}

impl HistogramPriors {
    /// Checks every number by itself, and that the roughness is positive.
    ///
    /// # Errors
    /// [`Error::OutOfRange`](crate::Error::OutOfRange) or [`Error::Setting`](crate::Error::Setting) with the first key that is at fault.
    pub fn check(&self) -> Result<()> {
        hyperprior::check(
            "histogram.roughness_pop",
            &self.roughness_pop,
            &ROUGHNESSES,
            &POSITIVE,
        )
    }
}

/// [`CELLS`] equal cells of constant density; ln p changes from one cell to the next by `roughness` times a step, and every step is a
/// standard normal a priori. With roughness 0 the density is uniform.
#[derive(Clone, Debug)]
pub struct Histogram {
    support: (f64, f64),
    priors: HistogramPriors,
}

impl Histogram {
    /// The family on a support `(q_min, q_max)`.
    ///
    /// # Errors
    /// Those of [`HistogramPriors::check`].
    pub fn new(support: (f64, f64), priors: HistogramPriors) -> Result<Self> {
        priors.check()?;
        Ok(Self { support, priors })
    }
}

impl Family<N> for Histogram {
    fn support(&self) -> (f64, f64) {
        self.support
    }

    fn hyperparameters(&self) -> [(&'static str, Marginal); N] {
        let step = Marginal::Normal { mean: 0.0, sd: 1.0 };
        std::array::from_fn(|i| match i {
            0 => ("roughness_pop", self.priors.roughness_pop),
            _ => (STEPS[i - 1], step),
        })
    }

    fn ln_pdf<S: Real>(&self, alpha: [S; N]) -> impl Fn(f64) -> S {
        let (lo, hi) = self.support;
        let mut ln_p = [S::zero(); CELLS];
        for cell in 1..CELLS {
            ln_p[cell] = ln_p[cell - 1] + alpha[0] * alpha[cell];
        }
        let top = ln_p.map(Real::re).into_iter().fold(0.0, f64::max);
        let mut sum = S::zero();
        for cell in ln_p {
            sum += (cell - top).exp();
        }
        let ln_mass = sum.ln() + (top + ((hi - lo) / CELLS as f64).ln());
        let density = ln_p.map(|cell| cell - ln_mass);
        let scale = CELLS as f64 / (hi - lo);
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "at least 0 inside the support, and the last cell at most"
        )]
        move |q| density[(((q - lo) * scale) as usize).min(CELLS - 1)]
    }
}
