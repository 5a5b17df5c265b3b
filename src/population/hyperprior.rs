//! The check of a hyperprior that a user has written.

use crate::error::{Error, Result};
use oblate_samplers::Marginal;
use std::ops::RangeInclusive;

/// A positive hyperparameter: values allowed for its hyperprior, which may reach to infinity.
pub(super) const POSITIVE: RangeInclusive<f64> = 0.0..=f64::INFINITY;

/// A hyperparameter of any sign.
pub(super) const ANY: RangeInclusive<f64> = f64::NEG_INFINITY..=f64::INFINITY;

/// Checks that the numbers of a hyperprior are in `range`, that they define a distribution, and that its values are in
/// `values`. `key` is below `family`.
///
/// # Errors
/// [`Error::OutOfRange`] or [`Error::Setting`] with the key.
pub(super) fn check(
    key: &str,
    prior: &Marginal,
    range: &RangeInclusive<f64>,
    values: &RangeInclusive<f64>,
) -> Result<()> {
    let key = format!("family.{key}");
    prior.check_range(&key, range)?;
    let refuse = |remedy: String| {
        Err(Error::Setting {
            key: key.clone(),
            value: format!("{prior:?}"),
            remedy,
        })
    };
    if !prior.is_valid() {
        return refuse("give lo < hi, and standard deviations above zero".to_owned());
    }
    let (lo, hi) = prior.support();
    if values.contains(&lo) && values.contains(&hi) {
        return Ok(());
    }
    if *values == POSITIVE {
        return refuse("give a uniform with lo of at least 0, or a half_normal".to_owned());
    }
    let (lo, hi) = (values.start(), values.end());
    refuse(format!("give a uniform between {lo} and {hi}"))
}
