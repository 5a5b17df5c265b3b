//! The reference of an annealing path: the prior, or a density that resembles the posterior and can be drawn from
//! directly as well (a variational reference; Surjanovic, Syed, Bouchard-Cote & Campbell 2022).
//!
//! At inverse temperature beta the density is `reference^(1 - beta) (prior L)^beta`. With the log ratio of reference to
//! prior, `ln_over_prior`, it is `prior exp{beta ln L + (1 - beta) ln_over_prior}`; the log ratio is 0 on a path from the
//! prior. The integral over the whole path is the evidence, whatever the reference.

use super::screen::Screen;
use crate::autoregressive::Autoregressive;
use crate::diagnostics::ln_sum_exp;
use crate::mixture::{Mixture, Rows};
use crate::normal;
use crate::rng::{RandomStream, standard_normal, unit_open};
use crate::valid::Valid;
use serde::{Deserialize, Serialize};

/// Weight of the prior in a reference: the reference is at least this fraction of the prior everywhere, so that every
/// mode can be reached.
const PRIOR_WEIGHT: f64 = 0.05;

/// Weight of the mixture beside the autoregressive density: the latter follows the posterior closely, the former has
/// the tails that it lacks (docs/decisions.md, section 3).
const MIXTURE_WEIGHT: f64 = 0.3;

/// Factor by which the components of the best-fitting mixture are widened: where the reference has too little density,
/// replicas stay for long (docs/decisions.md, section 3).
const WIDENING: f64 = 1.3;

/// Maximum number of components of a mixture.
const MAX_COMPONENTS: usize = 16;

/// Rows that a mixture is fitted to; all of them would cost an easy run as much as its values of ln L.
const MIXTURE_ROWS: usize = 2_500;

/// Number of blocks of successive draws; one of `HELD_OUT` is held out when densities are fitted to the others.
const BLOCKS: usize = 20;
const HELD_OUT: usize = 4;

/// The distribution at beta = 0.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Reference(Option<Fitted>);

/// What a reference is made of besides the prior.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Fitted {
    mixture: Mixture,
    /// None if the draws were too few for it.
    autoregressive: Option<Autoregressive>,
    /// None without a surrogate.
    screen: Option<Screen>,
}

/// The prior as reference.
pub(super) const PRIOR: &Reference = &Reference(None);

impl Reference {
    /// The densities that fit rows of `dim` standard-normal coordinates per point, and a little of the prior; `rng` gives the
    /// stream for each size of the mixture, and for 0 that of the autoregressive density. None if the rows are too few or do
    /// not span their space.
    pub fn resembling(
        rows: &[f64],
        dim: usize,
        rng: impl Fn(usize) -> RandomStream + Sync,
    ) -> Option<Self> {
        let few = divided(&thinned(rows, dim, MIXTURE_ROWS), dim);
        let (rows, held_out) = divided(rows, dim);
        let (mixture, autoregressive) = rayon::join(
            || Mixture::choose([&few.0, &few.1], MAX_COMPONENTS, &rng)?.widened(WIDENING),
            || Autoregressive::fit(&rows.values, &held_out.values, dim, &mut rng(0)),
        );
        Some(Self(Some(Fitted {
            mixture: mixture?,
            autoregressive,
            screen: None,
        })))
    }

    /// The same, screened.
    #[must_use]
    pub fn screened(self, screen: Option<Screen>) -> Self {
        Self(self.0.map(|fitted| Fitted { screen, ..fitted }))
    }

    /// What its draws are kept by.
    pub(super) fn screen(&self) -> Option<&Screen> {
        self.0.as_ref()?.screen.as_ref()
    }

    /// Checks a reference that was read from a file.
    pub(crate) fn check(&self, dim: usize, features: usize) -> Valid {
        self.0.as_ref().map_or(Ok(()), |fitted| {
            fitted.mixture.check(dim)?;
            fitted.screen.iter().try_for_each(|s| s.check(features))?;
            let autoregressive = fitted.autoregressive.as_ref();
            autoregressive.map_or(Ok(()), |density| density.check(dim))
        })
    }

    /// Whether it is the prior.
    #[must_use]
    pub fn is_prior(&self) -> bool {
        self.0.is_none()
    }

    /// Components of the mixture; 0 for the prior.
    #[must_use]
    pub fn components(&self) -> usize {
        self.0.as_ref().map_or(0, |fitted| fitted.mixture.len())
    }

    /// Log ratio of the reference to the prior; 0 for the prior.
    #[must_use]
    pub fn ln_over_prior(&self, z: &[f64]) -> f64 {
        let Some(fitted) = &self.0 else {
            return 0.0;
        };
        let autoregressive = fitted.autoregressive.as_ref();
        fitted
            .blend(
                ln_prior(z),
                fitted.mixture.ln_density(z),
                autoregressive.map(|density| density.ln_density(z)),
            )
            .0
    }

    /// The log ratio of reference to prior, with its gradient written into `gradient`, which stays empty for the prior.
    pub fn ln_over_prior_and_gradient(&self, z: &[f64], gradient: &mut Vec<f64>) -> f64 {
        gradient.clear();
        let Some(fitted) = &self.0 else {
            return 0.0;
        };
        gradient.resize(z.len(), 0.0);
        let mut second = vec![0.0; z.len()];
        let mixture = fitted.mixture.ln_density_and_gradient(z, gradient);
        let autoregressive = fitted.autoregressive.as_ref();
        let autoregressive =
            autoregressive.map(|density| density.ln_density_and_gradient(z, &mut second));
        let (ln_over_prior, [first, other]) = fitted.blend(ln_prior(z), mixture, autoregressive);
        for ((g, second), z) in gradient.iter_mut().zip(&second).zip(z) {
            *g = first * (*g + z) + other * (second + z);
        }
        ln_over_prior
    }

    /// Draws `z` from the reference.
    pub fn draw(&self, z: &mut [f64], rng: &mut RandomStream) {
        let Some(fitted) = &self.0 else {
            z.iter_mut().for_each(|z| *z = standard_normal(rng));
            return;
        };
        let which = unit_open(rng);
        let mixture = PRIOR_WEIGHT + fitted.weights()[0];
        match &fitted.autoregressive {
            _ if which < PRIOR_WEIGHT => z.iter_mut().for_each(|z| *z = standard_normal(rng)),
            Some(density) if which >= mixture => z.copy_from_slice(&density.draw(rng)),
            _ => z.copy_from_slice(&fitted.mixture.draw(rng)),
        }
    }
}

impl Fitted {
    /// Weights of the mixture and of the autoregressive density; the rest is the prior's.
    fn weights(&self) -> [f64; 2] {
        let rest = 1.0 - PRIOR_WEIGHT;
        if self.autoregressive.is_some() {
            [MIXTURE_WEIGHT, rest - MIXTURE_WEIGHT]
        } else {
            [rest, 0.0]
        }
    }

    /// The log ratio to the prior of all parts by their weights, from their log densities; and the fractions of it that
    /// mixture and autoregressive density have.
    fn blend(&self, prior: f64, mixture: f64, autoregressive: Option<f64>) -> (f64, [f64; 2]) {
        let [of_mixture, of_autoregressive] = self.weights();
        let mixture = mixture - prior + of_mixture.ln();
        let autoregressive = autoregressive.map_or(f64::NEG_INFINITY, |ln_density| {
            ln_density - prior + of_autoregressive.ln()
        });
        let ln_over_prior = ln_sum_exp(&[PRIOR_WEIGHT.ln(), mixture, autoregressive]);
        let fraction = |part: f64| (part - ln_over_prior).exp();
        (ln_over_prior, [fraction(mixture), fraction(autoregressive)])
    }
}

/// At most so many rows of coordinates, evenly spaced among those given.
#[must_use]
pub fn thinned(rows: &[f64], dim: usize, max: usize) -> Vec<f64> {
    let row = |i: usize| &rows[i * dim..(i + 1) * dim];
    let kept = evenly_spaced(rows.len() / dim, max);
    kept.flat_map(row).copied().collect()
}

/// At most `max` of the numbers from 0 to `count - 1`, evenly spaced.
pub fn evenly_spaced(count: usize, max: usize) -> impl Iterator<Item = usize> {
    let kept = count.min(max);
    (0..kept).map(move |k| k * count / kept)
}

/// The rows of all blocks but those held out, and the latter.
fn divided(all: &[f64], dim: usize) -> (Rows, Rows) {
    let (mut rows, mut held_out) = (Vec::new(), Vec::new());
    let count = all.len() / dim;
    for block in 0..BLOCKS {
        let place = block * count / BLOCKS..(block + 1) * count / BLOCKS;
        let to = if block % HELD_OUT == HELD_OUT - 1 {
            &mut held_out
        } else {
            &mut rows
        };
        to.extend_from_slice(&all[place.start * dim..place.end * dim]);
    }
    (
        Rows { dim, values: rows },
        Rows {
            dim,
            values: held_out,
        },
    )
}

/// Log density of the prior.
fn ln_prior(z: &[f64]) -> f64 {
    z.iter().map(|z| normal::ln_pdf(*z)).sum()
}
