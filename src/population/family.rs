//! The interface of a family of densities of q.

use crate::scalar::Real;
use oblate_samplers::Marginal;

/// A family of densities of q with `N` hyperparameters, normalised on its support.
pub trait Family<const N: usize>: Send + Sync {
    /// The interval on which every density of the family is normalised, for all hyperparameters.
    fn support(&self) -> (f64, f64);

    /// Names and prior distributions of the hyperparameters.
    fn hyperparameters(&self) -> [(&'static str, Marginal); N];

    /// The log density for given hyperparameters, as a function of q inside the [support](Self::support).
    ///
    /// Called once per evaluation; what does not depend on q should be computed before the returned function. The
    /// hyperparameters have derivatives, q does not. A member without a density (a negative width) returns NaN.
    fn ln_pdf<S: Real>(&self, alpha: [S; N]) -> impl Fn(f64) -> S;

    /// Names of quantities that follow from the hyperparameters, in the order of [`derived`](Self::derived).
    fn derived_names(&self) -> &'static [&'static str] {
        &[]
    }

    /// Those quantities for given hyperparameters.
    fn derived(&self, alpha: [f64; N]) -> Vec<f64> {
        let _ = alpha;
        Vec::new()
    }
}
