//! The likelihood of a nested run: on the cube, with every call and every rejection counted.

use super::live::REJECTED;
use crate::error::Result;
use crate::normal;
use crate::output::Calls;
use crate::rng::{RandomStream, unit_open};
use crate::surrogate::Examples;
use crate::target::{Outcome, Target};

/// Values of a chain that a surrogate learns from: the last ones.
const EXAMPLES: usize = 12;

/// The target, for the calls of one task.
pub(super) struct Likelihood<'a> {
    target: &'a dyn Target,
    theta: Vec<f64>,
    pub calls: Calls,
    /// The last values, if a surrogate learns from them.
    pub examples: Option<Examples>,
}

impl<'a> Likelihood<'a> {
    pub fn new(target: &'a dyn Target) -> Self {
        Self {
            target,
            theta: vec![0.0; target.dim()],
            calls: Calls::default(),
            examples: None,
        }
    }

    /// The same, which also keeps its last values as examples for a surrogate, if so.
    pub fn keeping_examples(self, so: bool) -> Self {
        Self {
            examples: so.then(Examples::default),
            ..self
        }
    }

    /// ln L at a point of the cube; [`REJECTED`] where there is none.
    pub fn at(&mut self, u: &[f64]) -> Result<f64> {
        self.target.prior().theta_from_u(u, &mut self.theta);
        let Some(examples) = &mut self.examples else {
            let outcome = self.target.ln_likelihood(&self.theta);
            return settle(&mut self.calls, &outcome, &self.theta);
        };
        let mut residuals = Vec::new();
        let outcome = self
            .target
            .ln_likelihood_and_residuals(&self.theta, &mut residuals);
        let ln_l = settle(&mut self.calls, &outcome, &self.theta)?;
        if ln_l > REJECTED {
            let z: Vec<f64> = u.iter().map(|u| normal::quantile(*u)).collect();
            let mut features = vec![0.0; self.target.feature_count()];
            self.target.features(&z, &self.theta, &mut features);
            examples.push(&features, ln_l, &residuals);
            examples.keep_last(EXAMPLES);
        }
        Ok(ln_l)
    }

    /// The gradient of ln L with respect to `u`, into `gradient`; false where there is none: no likelihood, or a
    /// derivative that is not finite.
    pub fn gradient_at(&mut self, u: &[f64], gradient: &mut [f64]) -> Result<bool> {
        let prior = self.target.prior();
        prior.theta_from_u(u, &mut self.theta);
        self.calls.gradients += 1;
        let outcome = self
            .target
            .ln_likelihood_and_gradient(&self.theta, gradient);
        if outcome.ln_likelihood(&self.theta)? == f64::NEG_INFINITY {
            return Ok(false);
        }
        prior.gradient_to_u(u, gradient);
        Ok(gradient.iter().all(|g| g.is_finite()))
    }

    /// ln L at many points of the cube; [`REJECTED`] where there is none.
    pub fn at_all(&mut self, points: &[Vec<f64>]) -> Result<Vec<f64>> {
        let prior = self.target.prior();
        let theta = |u: &Vec<f64>| {
            let mut theta = vec![0.0; u.len()];
            prior.theta_from_u(u, &mut theta);
            theta
        };
        let thetas: Vec<Vec<f64>> = points.iter().map(theta).collect();
        let outcomes = self.target.ln_likelihoods(&thetas);
        let both = outcomes.iter().zip(&thetas);
        both.map(|(outcome, theta)| settle(&mut self.calls, outcome, theta))
            .collect()
    }
}

/// The ln L of a call, counted; [`REJECTED`] for a rejection.
fn settle(calls: &mut Calls, outcome: &Outcome, theta: &[f64]) -> Result<f64> {
    calls.values += 1;
    let ln_l = outcome.ln_likelihood(theta)?;
    calls.note(outcome);
    Ok(if outcome.cause().is_some() {
        REJECTED
    } else {
        ln_l
    })
}

/// Writes an independent draw of the prior into `u`.
pub(super) fn draw_prior(rng: &mut RandomStream, u: &mut [f64]) {
    u.iter_mut().for_each(|u| *u = unit_open(rng));
}
