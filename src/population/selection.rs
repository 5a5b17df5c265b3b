//! The error of the correction for selection.

use super::family::Family;
use super::reweighting::{ERROR_DRAWS, MAX_VARIANCE};
use super::target::{PopulationTarget, equal_weight_members};
use oblate_samplers::diagnostics::weighted_moments;
use oblate_samplers::output::{Check, Draws};

/// Variance of the population's ln L by the errors of the selection, over the posterior. An error that is the same for all members does not
/// count. None without a selection.
pub(super) fn selection_variance<F: Family<N>, const N: usize>(
    target: &PopulationTarget<F, N>,
    draws: &Draws,
) -> Option<f64> {
    let cells = target.kept_cells()?;
    let members: Vec<[f64; N]> = equal_weight_members(draws, ERROR_DRAWS);
    let slopes: Vec<Vec<f64>> = members
        .iter()
        .map(|member| cells.slopes(&target.family().ln_pdf(*member)))
        .collect();
    let equal = vec![1.0 / members.len() as f64; members.len()];
    let streams = target.streams() as f64;
    let errors = cells.selection().error.iter().enumerate();
    let variances = errors.map(|(row, error)| {
        let of_row: Vec<f64> = slopes.iter().map(|slopes| slopes[row]).collect();
        let (_, variance) = weighted_moments(&of_row, &equal);
        variance * (streams * error).powi(2)
    });
    Some(variances.sum())
}

/// The check of that variance.
#[must_use]
pub fn selection_check(variance: f64) -> Check {
    Check::at_most(
        "selection-variance",
        variance,
        MAX_VARIANCE,
        "variance of the population's ln L by the errors of the selection; make the selection with more draws",
    )
}
