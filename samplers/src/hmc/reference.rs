//! The reference of an annealing path: the prior, or a mixture that resembles the posterior and can be drawn from
//! directly as well (a variational reference; Surjanovic, Syed, Bouchard-Cote & Campbell 2022).
//!
//! At inverse temperature beta the density is `reference^(1 - beta) (prior L)^beta`. With the log ratio of reference to
//! prior, `ln_over_prior`, it is `prior exp{beta ln L + (1 - beta) ln_over_prior}`; the log ratio is 0 on a path from the
//! prior. The integral over the whole path is the evidence, whatever the reference.

use crate::diagnostics::ln_sum_exp;
use crate::mixture::{Mixture, Rows};
use crate::normal;
use crate::rng::{RandomStream, standard_normal, unit_open};
use crate::valid::Valid;
use serde::{Deserialize, Serialize};

/// Weight of the prior in a reference: the reference is at least this fraction of the prior everywhere, so that every
/// mode can be reached.
const PRIOR_WEIGHT: f64 = 0.05;

/// Factor by which the components of the best-fitting mixture are widened: where the reference has too little density,
/// replicas stay for long (docs/validation.md, section 5, parallel tempering).
const WIDENING: f64 = 1.3;

/// Maximum number of components of a mixture.
const MAX_COMPONENTS: usize = 64;

/// The distribution at beta = 0.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Reference(Option<Mixture>);

/// The prior as reference.
pub(super) const PRIOR: &Reference = &Reference(None);

impl Reference {
    /// The mixture, made a little wider, that fits two independent sets of `dim` standard-normal coordinates per point, one after the
    /// other, and a little of the prior; `rng` gives the stream for each size of the mixture. None if they are too few or do not span
    /// their space.
    pub fn resembling(
        halves: &[Vec<f64>; 2],
        dim: usize,
        rng: impl Fn(usize) -> RandomStream,
    ) -> Option<Self> {
        let [first, second] = halves.clone().map(|values| Rows { dim, values });
        let mixture = Mixture::choose([&first, &second], MAX_COMPONENTS, rng)?;
        Some(Self(Some(mixture.widened(WIDENING)?)))
    }

    /// Checks a reference that was read from a file.
    pub(crate) fn check(&self, dim: usize) -> Valid {
        self.0.as_ref().map_or(Ok(()), |mixture| mixture.check(dim))
    }

    /// Whether it is the prior.
    #[must_use]
    pub fn is_prior(&self) -> bool {
        self.0.is_none()
    }

    /// Components of the mixture; 0 for the prior.
    #[must_use]
    pub fn components(&self) -> usize {
        self.0.as_ref().map_or(0, Mixture::len)
    }

    /// Log ratio of the reference to the prior; 0 for the prior.
    #[must_use]
    pub fn ln_over_prior(&self, z: &[f64]) -> f64 {
        self.0
            .as_ref()
            .map_or(0.0, |mixture| blend(mixture.ln_density(z) - ln_prior(z)).0)
    }

    /// The log ratio of reference to prior, with its gradient written into `gradient`, which stays empty for the prior.
    pub fn ln_over_prior_and_gradient(&self, z: &[f64], gradient: &mut Vec<f64>) -> f64 {
        gradient.clear();
        let Some(mixture) = &self.0 else {
            return 0.0;
        };
        gradient.resize(z.len(), 0.0);
        let over_prior = mixture.ln_density_and_gradient(z, gradient) - ln_prior(z);
        let (ln_over_prior, fraction) = blend(over_prior);
        for (g, z) in gradient.iter_mut().zip(z) {
            *g = fraction * (*g + z);
        }
        ln_over_prior
    }

    /// Draws `z` from the reference.
    pub fn draw(&self, z: &mut [f64], rng: &mut RandomStream) {
        match &self.0 {
            Some(mixture) if unit_open(rng) >= PRIOR_WEIGHT => {
                z.copy_from_slice(&mixture.draw(rng))
            }
            _ => z.iter_mut().for_each(|z| *z = standard_normal(rng)),
        }
    }
}

/// The log ratio to the prior of mixture and prior by their weights, from that of the mixture alone; and the part of the
/// mixture in it.
fn blend(over_prior: f64) -> (f64, f64) {
    let mixture = over_prior + (-PRIOR_WEIGHT).ln_1p();
    let ln_over_prior = ln_sum_exp(&[PRIOR_WEIGHT.ln(), mixture]);
    (ln_over_prior, (mixture - ln_over_prior).exp())
}

/// Log density of the prior.
fn ln_prior(z: &[f64]) -> f64 {
    z.iter().map(|z| normal::ln_pdf(*z)).sum()
}
