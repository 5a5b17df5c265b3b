//! What the fits of a study will cost, from a pilot: the speed of the models of a few of them.

use super::plan::PlannedFit;
use crate::error::{Error, Result};
use crate::inference::Speed;

/// Largest number of fits whose models are timed.
const MOST: usize = 8;

/// The predicted cost of the fits of a study that have no result or go on from one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cost {
    /// Number of fits.
    pub fits: usize,
    /// Number of those whose models were timed.
    pub timed: usize,
    /// CPU seconds of all of them.
    pub cpu_seconds: f64,
    /// Least and largest CPU seconds of a fit.
    pub range: [f64; 2],
}

/// Times the models of a few fits, a part of a second each, on one thread, unless the work is `interrupted` meanwhile; `None` if there is no
/// fit, or none of those timed has a value.
///
/// # Errors
/// As of [`Speed::of_fit`]; [`Error::Setting`] if no thread can be started.
pub(super) fn pilot(
    fits: &[&PlannedFit],
    interrupted: &(dyn Fn() -> bool + Sync),
) -> Result<Option<Cost>> {
    let step = fits.len().div_ceil(MOST).max(1);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let pool = pool.map_err(|e| Error::Setting {
        key: "threads".to_owned(),
        value: "1".to_owned(),
        remedy: e.to_string(),
    })?;
    let timed = fits.iter().step_by(step).map(|fit| {
        let speed = pool.install(|| Speed::of_fit(&fit.track, &fit.settings, interrupted))?;
        Ok(speed.seconds_of_fit())
    });
    let mut timed = timed.collect::<Result<Vec<_>>>()?;
    timed.retain(|seconds| seconds.iter().all(|s| s.is_finite()));
    if timed.is_empty() {
        return Ok(None);
    }
    let mean = timed.iter().map(|[_, mean, _]| mean).sum::<f64>() / timed.len() as f64;
    let least = timed.iter().map(|seconds| seconds[0]);
    let most = timed.iter().map(|seconds| seconds[2]);
    Ok(Some(Cost {
        fits: fits.len(),
        timed: timed.len(),
        cpu_seconds: mean * fits.len() as f64,
        range: [
            least.fold(f64::INFINITY, f64::min),
            most.fold(0.0, f64::max),
        ],
    }))
}
