//! The input of a sampler: a likelihood over a product prior, its gradient where it has one, and its symmetries.

mod prior;
mod symmetry;

pub use prior::{Marginal, Prior};
pub use symmetry::{Involution, Orbit, Symmetry};

use rayon::prelude::*;

/// Why a point has no likelihood: a short name, counted and reported.
pub type Cause = &'static str;

/// The answer of a target at one point.
#[derive(Clone, Debug, PartialEq)]
pub enum Outcome {
    /// The natural logarithm of the likelihood; finite.
    Value(f64),
    /// The likelihood is zero here, with the cause.
    Reject(Cause),
    /// The run cannot continue, whatever the point.
    Fatal(String),
}

impl Outcome {
    /// An outcome from a bare number: NaN becomes a rejection, minus infinity too.
    #[must_use]
    pub fn from_ln_likelihood(ln_likelihood: f64) -> Self {
        let value = Self::Value(ln_likelihood);
        value.cause().map_or(value, Self::Reject)
    }

    /// The cause of a rejection; none if there is a likelihood, or if the target failed.
    #[must_use]
    pub fn cause(&self) -> Option<Cause> {
        match self {
            Self::Reject(cause) => Some(cause),
            Self::Value(l) if l.is_nan() => Some("nan"),
            Self::Value(f64::NEG_INFINITY) => Some("zero likelihood"),
            Self::Value(_) | Self::Fatal(_) => None,
        }
    }

    /// The log-likelihood with minus infinity for a rejection.
    ///
    /// # Errors
    /// [`Error::Fatal`](crate::Error::Fatal) for a failed target, [`Error::Infinite`](crate::Error::Infinite) for
    /// plus infinity; a NaN value counts as a rejection.
    pub fn ln_likelihood(&self, theta: &[f64]) -> crate::Result<f64> {
        match self {
            Self::Value(l) if l.is_nan() => Ok(f64::NEG_INFINITY),
            Self::Value(l) if *l == f64::INFINITY => Err(crate::Error::Infinite {
                theta: theta.to_vec(),
            }),
            Self::Value(l) => Ok(*l),
            Self::Reject(_) => Ok(f64::NEG_INFINITY),
            Self::Fatal(why) => Err(crate::Error::Fatal(why.clone())),
        }
    }
}

/// A posterior to sample: `prior x likelihood`.
///
/// Contract: deterministic in `theta`; the same bits whatever else is computed beside it; a NaN is a
/// [`Outcome::Reject`].
pub trait Target: Sync {
    /// The prior, and with it the number, names and units of the parameters.
    fn prior(&self) -> &Prior;

    /// Number of parameters.
    fn dim(&self) -> usize {
        self.prior().dim()
    }

    /// ln L at the physical parameters `theta`, of length [`dim`](Self::dim).
    fn ln_likelihood(&self, theta: &[f64]) -> Outcome;

    /// An upper bound of ln L, if one is known. Samplers do not evaluate points that could not be accepted even at this bound: a
    /// tight bound saves calls and changes no result.
    fn ln_likelihood_bound(&self) -> Option<f64> {
        None
    }

    /// ln L at many points, in their order, each the outcome that it has alone; over all threads of the present rayon pool.
    /// Samplers use it where points do not depend on each other.
    fn ln_likelihoods(&self, thetas: &[Vec<f64>]) -> Vec<Outcome> {
        thetas.par_iter().map(|t| self.ln_likelihood(t)).collect()
    }

    /// ln L and its gradient with respect to the physical parameters, written into `gradient` of length
    /// [`dim`](Self::dim). Only called if [`gradient_cost`](Self::gradient_cost) is some.
    fn ln_likelihood_and_gradient(&self, theta: &[f64], gradient: &mut [f64]) -> Outcome {
        let _ = gradient;
        let _ = theta;
        Outcome::Fatal("this target has no gradient".to_owned())
    }

    /// Cost of a value with gradient in units of one value; `None`: there is no gradient.
    fn gradient_cost(&self) -> Option<f64> {
        None
    }

    /// ln L as of [`ln_likelihood`](Self::ln_likelihood), with numbers r appended to `residuals`, always as many, that are smooth in
    /// `theta` and for which `ln L + |r|^2 / 2` varies little: a surrogate of ln L learns them instead of ln L.
    fn ln_likelihood_and_residuals(&self, theta: &[f64], residuals: &mut Vec<f64>) -> Outcome {
        let _ = residuals;
        self.ln_likelihood(theta)
    }

    /// Number of [`features`](Self::features).
    fn feature_count(&self) -> usize {
        self.dim()
    }

    /// Numbers of which ln L and its residuals are functions, as smooth and as few as the target knows, at `theta` with its
    /// standard-normal coordinates `z`: a surrogate of ln L learns from them. By default the coordinates themselves.
    fn features(&self, z: &[f64], theta: &[f64], features: &mut [f64]) {
        let _ = theta;
        features.copy_from_slice(z);
    }

    /// From the derivatives of a result by the features those by `z`.
    fn features_vjp(&self, z: &[f64], theta: &[f64], features_bar: &[f64], z_bar: &mut [f64]) {
        let _ = (z, theta);
        z_bar.copy_from_slice(features_bar);
    }

    /// Symmetry moves, exact or approximate.
    fn symmetries(&self) -> &[Symmetry] {
        &[]
    }

    /// Names and units of quantities derived from the parameters, in the order of [`derived`](Self::derived).
    fn derived_names(&self) -> Vec<(String, String)> {
        Vec::new()
    }

    /// Derived quantities at `theta`, appended to `out`.
    fn derived(&self, theta: &[f64], out: &mut Vec<f64>) {
        let _ = (theta, out);
    }
}
