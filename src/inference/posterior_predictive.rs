//! A posterior predictive check after the fit: whether data that the model makes are as far from it as the data of the fit.

use super::best_fit::Diagnostics;
use super::target::StreamTarget;
use oblate_samplers::Run;
use oblate_samplers::diagnostics::chi2_tail;
use rayon::prelude::*;

/// Number of posterior draws of equal weight.
const DRAWS: usize = 256;

/// Probability below which the model does not fit. Under a model that is right it is lower less often than that, since the posterior follows the
/// data (Gelman, Meng and Stern 1996).
const LIMIT: f64 = 0.005;

/// The posterior predictive p-value: the probability, over the posterior, that data made by the model have a larger sum of squares of their residuals,
/// in standard errors, than the data of the fit. For normal errors the sum has a chi-square distribution with as many degrees of freedom as data. A bin that the model does not cover
/// has the residual of the coverage rule.
/// `None` if no draw has a track.
#[must_use]
pub fn posterior_predictive_p(target: &StreamTarget, run: &Run) -> Option<f64> {
    let tail = |row: usize| {
        let params = target.params(run.draws.theta_row(row)).to_array();
        let squares = target.likelihood().squares(&params).ok()?;
        Some(chi2_tail(squares.iter().sum(), squares.len() as f64))
    };
    let rows = run.draws.resample(DRAWS, 0.5).into_par_iter();
    let tails: Vec<f64> = rows.filter_map(tail).collect();
    (!tails.is_empty()).then(|| tails.iter().sum::<f64>() / tails.len() as f64)
}

/// Adds the p-value, and a warning if it is small.
pub(super) fn check_posterior_predictive(
    target: &StreamTarget,
    run: &Run,
    found: &mut Diagnostics,
) {
    let Some(p) = posterior_predictive_p(target, run) else {
        return;
    };
    found.insert("posterior_predictive_p", p);
    if p < LIMIT {
        found.warnings.push(format!(
            "the model does not fit the data: data that it makes are farther from it with a probability of {p:.1e} only: check the errors and the sense \
             of phi, allow for a scatter beyond the errors by `prior.marginals.jitter`, or fit another host"
        ));
    }
}
