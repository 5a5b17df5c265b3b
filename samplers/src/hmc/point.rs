//! States of chains, and the target in standard-normal coordinates with its calls counted.

use super::reference::{PRIOR, Reference};
use super::screen::{Screen, Screened};
use crate::error::Result;
use crate::output::Calls;
use crate::rng::{RandomStream, unit_open};
use crate::surrogate::{Examples, Scratch, Surrogate};
use crate::target::Target;
use crate::valid::{Valid, ensure, moderate};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// A state of a chain.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// Standard-normal coordinates.
    pub z: Vec<f64>,
    /// ln L there, or the estimate of a surrogate that a trajectory follows; minus infinity where it was rejected.
    pub ln_likelihood: f64,
    /// Gradient of ln L with respect to `z`; meaningless unless [`has_gradient`](Self::has_gradient).
    pub gradient: Vec<f64>,
    /// Whether the gradients belong to `z`: moves that need none do not compute them.
    pub has_gradient: bool,
    /// [`Reference::ln_over_prior`] there.
    pub ln_over_prior: f64,
    /// Its gradient; empty on a path from the prior, and meaningless unless [`has_gradient`](Self::has_gradient).
    pub ln_over_prior_gradient: Vec<f64>,
}

impl Point {
    /// A point at the origin, to be filled.
    #[must_use]
    pub fn new(dim: usize) -> Self {
        Self {
            z: vec![0.0; dim],
            ln_likelihood: f64::NEG_INFINITY,
            gradient: vec![0.0; dim],
            has_gradient: false,
            ln_over_prior: 0.0,
            ln_over_prior_gradient: Vec::new(),
        }
    }

    /// Checks a point that was read from a file, of a path from `reference`; only at some temperatures may it have no likelihood.
    pub(crate) fn check(&self, dim: usize, reference: &Reference, rejected: bool) -> Valid {
        ensure(
            self.z.len() == dim && self.gradient.len() == dim && moderate(&self.z),
            "a point has another dimension, or is not finite",
        )?;
        ensure(
            self.ln_likelihood.is_finite() || rejected && self.ln_likelihood == f64::NEG_INFINITY,
            "a point has no likelihood",
        )?;
        let tilts = if reference.is_prior() { 0 } else { dim };
        let mut all = self.gradient.iter().chain(&self.ln_over_prior_gradient);
        ensure(
            !self.has_gradient
                || self.ln_over_prior_gradient.len() == tilts && all.all(|g| g.is_finite()),
            "a gradient has another dimension, or is not finite",
        )?;
        ensure(
            self.ln_over_prior.is_finite(),
            "a point has no density of the reference",
        )
    }

    /// Log density at an inverse temperature, up to a constant of the temperature.
    #[must_use]
    pub fn ln_density(&self, beta: f64) -> f64 {
        ln_density(beta, &self.z, self.ln_likelihood, self.ln_over_prior)
    }

    /// ln of prior times likelihood over the reference: what swaps and estimates of the evidence use.
    #[must_use]
    pub fn ln_ratio(&self) -> f64 {
        self.ln_likelihood - self.ln_over_prior
    }

    /// Takes over another point of the same dimension without allocating.
    pub fn copy_from(&mut self, other: &Self) {
        self.z.copy_from_slice(&other.z);
        self.ln_likelihood = other.ln_likelihood;
        self.gradient.copy_from_slice(&other.gradient);
        self.has_gradient = other.has_gradient;
        self.ln_over_prior = other.ln_over_prior;
        self.ln_over_prior_gradient
            .clone_from(&other.ln_over_prior_gradient);
    }
}

/// Log density at an inverse temperature, up to a constant of the temperature, from ln L and the log ratio of reference
/// to prior.
pub(super) fn ln_density(beta: f64, z: &[f64], ln_likelihood: f64, ln_over_prior: f64) -> f64 {
    beta * ln_likelihood + (1.0 - beta) * ln_over_prior - 0.5 * z.iter().map(|z| z * z).sum::<f64>()
}

/// A target in standard-normal coordinates, owned by one task, with its count of calls and its buffers.
pub struct Evaluator<'a> {
    target: &'a dyn Target,
    reference: &'a Reference,
    surrogate: Option<&'a Surrogate>,
    scratch: Scratch,
    theta: Vec<f64>,
    features: Vec<f64>,
    features_bar: Vec<f64>,
    /// Calls so far.
    pub calls: Calls,
    /// The draws of a screened reference so far.
    pub screened: Screened,
    /// The values of ln L so far, if they are to be learned from.
    examples: Option<Examples>,
}

impl<'a> Evaluator<'a> {
    /// An evaluator with counts at zero, for an annealing path from the prior.
    #[must_use]
    pub fn new(target: &'a dyn Target) -> Self {
        Self::from_reference(target, PRIOR)
    }

    /// An evaluator with counts at zero, for an annealing path from `reference`.
    #[must_use]
    pub fn from_reference(target: &'a dyn Target, reference: &'a Reference) -> Self {
        Self {
            target,
            reference,
            surrogate: None,
            scratch: Scratch::default(),
            theta: vec![0.0; target.dim()],
            features: vec![0.0; target.feature_count()],
            features_bar: vec![0.0; target.feature_count()],
            calls: Calls::default(),
            screened: Screened::default(),
            examples: None,
        }
    }

    /// The same, which also keeps every value of ln L as an example for a surrogate, if so.
    #[must_use]
    pub fn keeping_examples(self, so: bool) -> Self {
        Self {
            examples: so.then(Examples::default),
            ..self
        }
    }

    /// The same with a surrogate of ln L in its place, which is not counted.
    #[must_use]
    pub fn with_surrogate(self, surrogate: &'a Surrogate) -> Self {
        Self {
            surrogate: Some(surrogate),
            ..self
        }
    }

    /// Whether a surrogate is in the place of ln L.
    #[must_use]
    pub fn follows_surrogate(&self) -> bool {
        self.surrogate.is_some()
    }

    /// The target.
    #[must_use]
    pub fn target(&self) -> &'a dyn Target {
        self.target
    }

    /// The reference.
    #[must_use]
    pub fn reference(&self) -> &'a Reference {
        self.reference
    }

    /// ln L at `z`; minus infinity if rejected.
    ///
    /// # Errors
    /// [`Error::Fatal`](crate::Error::Fatal) or [`Error::Infinite`](crate::Error::Infinite) from the target.
    pub fn value(&mut self, z: &[f64]) -> Result<f64> {
        if let Some(surrogate) = self.surrogate {
            return Ok(self.surrogate_value(z, surrogate));
        }
        self.target.prior().theta_from_z(z, &mut self.theta);
        self.calls.values += 1;
        let Some(examples) = &mut self.examples else {
            let outcome = self.target.ln_likelihood(&self.theta);
            self.calls.note(&outcome);
            return outcome.ln_likelihood(&self.theta);
        };
        let mut residuals = Vec::new();
        let outcome = self
            .target
            .ln_likelihood_and_residuals(&self.theta, &mut residuals);
        self.calls.note(&outcome);
        let ln_likelihood = outcome.ln_likelihood(&self.theta)?;
        if ln_likelihood.is_finite() {
            self.target.features(z, &self.theta, &mut self.features);
            examples.push(&self.features, ln_likelihood, &residuals);
        }
        Ok(ln_likelihood)
    }

    /// The calls so far and the examples that were kept.
    #[must_use]
    pub fn into_calls_and_examples(self) -> (Calls, Examples) {
        (self.calls, self.examples.unwrap_or_default())
    }

    /// ln L at many points; minus infinity where rejected.
    ///
    /// # Errors
    /// As [`value`](Self::value).
    pub fn values(&mut self, places: &[&[f64]]) -> Result<Vec<f64>> {
        let prior = self.target.prior();
        let theta = |z: &&[f64]| {
            let mut theta = vec![0.0; z.len()];
            prior.theta_from_z(z, &mut theta);
            theta
        };
        let thetas: Vec<Vec<f64>> = places.iter().map(theta).collect();
        self.calls.values += thetas.len() as u64;
        let outcomes = self.target.ln_likelihoods(&thetas);
        outcomes.iter().for_each(|outcome| self.calls.note(outcome));
        let both = outcomes.iter().zip(&thetas);
        both.map(|(outcome, theta)| outcome.ln_likelihood(theta))
            .collect()
    }

    /// The estimate of ln L at `z` by a surrogate.
    fn surrogate_value(&mut self, z: &[f64], surrogate: &Surrogate) -> f64 {
        self.locate(z);
        surrogate.ln_likelihood(&self.features, &mut self.scratch)
    }

    /// Physical parameters and features at `z`, into their buffers.
    fn locate(&mut self, z: &[f64]) {
        self.target.prior().theta_from_z(z, &mut self.theta);
        self.target.features(z, &self.theta, &mut self.features);
    }

    /// Computes ln L, the log ratio of reference to prior and the gradients of `point` at its `z`; ln L is minus
    /// infinity if rejected, also where a derivative is not finite.
    ///
    /// # Errors
    /// [`Error::Fatal`](crate::Error::Fatal) or [`Error::Infinite`](crate::Error::Infinite) from the target.
    pub fn fill(&mut self, point: &mut Point) -> Result<()> {
        match self.surrogate {
            Some(surrogate) => self.fill_from_surrogate(point, surrogate),
            None => self.fill_from_target(point)?,
        }
        point.ln_over_prior = self
            .reference
            .ln_over_prior_and_gradient(&point.z, &mut point.ln_over_prior_gradient);
        Ok(())
    }

    /// The estimate of ln L by a surrogate, with its gradient.
    fn fill_from_surrogate(&mut self, point: &mut Point, surrogate: &Surrogate) {
        self.locate(&point.z);
        point.ln_likelihood = surrogate.ln_likelihood_and_gradient(
            &self.features,
            &mut self.features_bar,
            &mut self.scratch,
        );
        self.target.features_vjp(
            &point.z,
            &self.theta,
            &self.features_bar,
            &mut point.gradient,
        );
        let finite = point.gradient.iter().all(|g| g.is_finite());
        point.has_gradient = point.ln_likelihood.is_finite() && finite;
    }

    /// ln L with its gradient.
    fn fill_from_target(&mut self, point: &mut Point) -> Result<()> {
        let prior = self.target.prior();
        prior.theta_from_z(&point.z, &mut self.theta);
        self.calls.gradients += 1;
        let outcome = self
            .target
            .ln_likelihood_and_gradient(&self.theta, &mut point.gradient);
        self.calls.note(&outcome);
        point.ln_likelihood = outcome.ln_likelihood(&self.theta)?;
        point.has_gradient = point.ln_likelihood > f64::NEG_INFINITY;
        if point.has_gradient {
            prior.gradient_to_z(&point.z, &mut point.gradient);
            if point.gradient.iter().any(|g| !g.is_finite()) {
                self.calls.reject("gradient not finite", 1);
                point.ln_likelihood = f64::NEG_INFINITY;
                point.has_gradient = false;
            }
        }
        Ok(())
    }

    /// Draws `z` from the reference; no likelihood call.
    pub fn draw_reference(&mut self, z: &mut [f64], rng: &mut RandomStream) {
        loop {
            self.reference.draw(z, rng);
            let Some(screen) = self.reference.screen() else {
                return;
            };
            let ln_ratio = self.screened_ratio(z, screen, self.reference.ln_over_prior(z));
            self.screened.note(screen.ln_over_density(ln_ratio));
            if unit_open(rng).ln() < screen.ln_kept(ln_ratio) {
                return;
            }
        }
    }

    /// Log ratio of the reference to the prior.
    pub fn ln_over_prior(&mut self, z: &[f64]) -> f64 {
        let ln_over_prior = self.reference.ln_over_prior(z);
        let Some(screen) = self.reference.screen() else {
            return ln_over_prior;
        };
        ln_over_prior + screen.ln_over_density(self.screened_ratio(z, screen, ln_over_prior))
    }

    /// ln of prior times likelihood over the reference, where a surrogate gives the likelihood, at draws of the reference.
    pub fn ln_ratios_of_draws(
        &mut self,
        surrogate: &Surrogate,
        count: usize,
        rng: &mut RandomStream,
    ) -> Vec<f64> {
        let mut z = vec![0.0; self.theta.len()];
        let mut ln_ratio = || {
            self.draw_reference(&mut z, rng);
            let ln_over_prior = self.ln_over_prior(&z);
            self.surrogate_value(&z, surrogate) - ln_over_prior
        };
        (0..count).map(|_| ln_ratio()).collect()
    }

    fn screened_ratio(&mut self, z: &[f64], screen: &Screen, ln_over_prior: f64) -> f64 {
        self.surrogate_value(z, &screen.surrogate) - ln_over_prior
    }
}

/// Draws by which one task sets a screen.
const SCREENED_TASK: usize = 500;

/// The screen of a reference by a surrogate, set by the draws of so many tasks; `rng` gives the stream of each. None if no draw has a finite
/// value.
#[must_use]
pub fn screen(
    reference: &Reference,
    surrogate: &Surrogate,
    target: &dyn Target,
    tasks: usize,
    rng: impl Fn(usize) -> RandomStream + Sync,
) -> Option<Screen> {
    let ln_ratios: Vec<f64> = (0..tasks)
        .into_par_iter()
        .flat_map_iter(|task| {
            let mut evaluator = Evaluator::from_reference(target, reference);
            evaluator.ln_ratios_of_draws(surrogate, SCREENED_TASK, &mut rng(task))
        })
        .collect();
    Screen::new(surrogate, &ln_ratios)
}
