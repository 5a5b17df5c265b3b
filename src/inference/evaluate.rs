//! ln L at points that a user chooses, for samplers of other programs: what `oblate evaluate` and the Python package give.

use super::target::StreamTarget;
use crate::error::Rejection;
use crate::params::{DIM, StreamParams};
use crate::stream::Threads;
use rayon::prelude::*;

/// What is computed at a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wanted {
    /// ln L.
    Value,
    /// ln L and its exact gradient.
    Gradient,
}

/// ln L at a point that is not rejected.
#[derive(Clone, Debug, PartialEq)]
pub struct Evaluated {
    /// ln L.
    pub ln_likelihood: f64,
    /// Its derivatives by all parameters, per unit of each, if they were wanted.
    pub gradient: Option<[f64; DIM]>,
}

impl StreamTarget {
    /// ln L at one point, which may lie anywhere, on all threads of the present rayon pool. The result has the same bits for any number of
    /// threads.
    ///
    /// # Errors
    /// Those of [`StreamPrior::check_point`](crate::params::StreamPrior::check_point) and of
    /// [`StreamLikelihood::ln_likelihood`](crate::likelihood::StreamLikelihood::ln_likelihood).
    pub fn evaluate(
        &self,
        params: &StreamParams<f64>,
        wanted: Wanted,
    ) -> Result<Evaluated, Rejection> {
        self.evaluate_on(Threads::All, params, wanted)
    }

    /// As [`evaluate`](Self::evaluate) at many points, in their order, on one thread each. The results have the same bits.
    #[must_use]
    pub fn evaluate_all(
        &self,
        points: impl IndexedParallelIterator<Item = StreamParams<f64>>,
        wanted: Wanted,
    ) -> Vec<Result<Evaluated, Rejection>> {
        points
            .map(|params| self.evaluate_on(Threads::One, &params, wanted))
            .collect()
    }

    fn evaluate_on(
        &self,
        threads: Threads,
        params: &StreamParams<f64>,
        wanted: Wanted,
    ) -> Result<Evaluated, Rejection> {
        self.stream_prior().check_point(params)?;
        let (likelihood, theta) = (self.likelihood(), params.to_array());
        let with_gradient = |(evaluation, gradient)| (evaluation, Some(gradient));
        let (evaluation, gradient) = match (wanted, threads) {
            (Wanted::Value, Threads::One) => (likelihood.ln_likelihood(&theta)?, None),
            (Wanted::Value, Threads::All) => (likelihood.ln_likelihood_in_parallel(&theta)?, None),
            (Wanted::Gradient, Threads::One) => with_gradient(likelihood.gradient(&theta)?),
            (Wanted::Gradient, Threads::All) => {
                with_gradient(likelihood.gradient_in_parallel(&theta)?)
            }
        };
        Ok(Evaluated {
            ln_likelihood: evaluation.ln_likelihood,
            gradient,
        })
    }
}
