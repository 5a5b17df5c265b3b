//! Whether the errors of q depend on how far a track extends, as appendix A of Chemaly et al. (2026) asks.

use super::calibration::RankedFit;
use serde::Serialize;

/// Fewest fits to which a line is fitted.
const FEWEST: usize = 3;

/// The straight line through the errors of q over one number of the tracks, by least squares.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Trend {
    /// Name of the number ([`TrackExtent`](crate::data::TrackExtent)).
    pub name: String,
    /// Number of fits.
    pub fits: usize,
    /// Mean of the number over them, where the line has the mean error of q.
    pub mean: f64,
    /// Mean error of q: of each fit the mean over its posterior of |q - true q|.
    pub q_error: f64,
    /// Slope of the line, and its standard error.
    pub slope: f64,
    /// Standard error of the slope.
    pub slope_error: f64,
    /// Pearson's correlation of the two.
    pub correlation: f64,
}

/// One line for each number of the tracks, over the fits with an error of q that have passed their checks, or all of them where none has;
/// empty with fewer than three.
#[must_use]
pub fn trends(fits: &[RankedFit]) -> Vec<Trend> {
    let passed = fits.iter().any(|fit| fit.converged);
    let judged = fits.iter().filter(|fit| fit.converged == passed);
    let errors = judged.filter_map(|fit| Some((fit, fit.q_error?)));
    let (fits, errors): (Vec<&RankedFit>, Vec<f64>) = errors.unzip();
    if fits.len() < FEWEST {
        return Vec::new();
    }
    let names = fits[0].extent.named().map(|(name, _)| name);
    let trend = |(k, name): (usize, &str)| {
        let x: Vec<f64> = fits.iter().map(|fit| fit.extent.named()[k].1).collect();
        // A number that all tracks share has no trend, and neither has an error that all fits share.
        (varies(&x) && varies(&errors)).then(|| Trend::new(name, &x, &errors))
    };
    names.into_iter().enumerate().filter_map(trend).collect()
}

/// Whether not all values are the same.
fn varies(values: &[f64]) -> bool {
    values.windows(2).any(|w| w[0].to_bits() != w[1].to_bits())
}

impl Trend {
    fn new(name: &str, x: &[f64], errors: &[f64]) -> Self {
        let count = x.len() as f64;
        let mean_of = |values: &[f64]| values.iter().sum::<f64>() / count;
        let (mean, q_error) = (mean_of(x), mean_of(errors));
        let sum = |of: &dyn Fn(f64, f64) -> f64| -> f64 {
            let pairs = x.iter().zip(errors);
            pairs.map(|(x, e)| of(x - mean, e - q_error)).sum()
        };
        let (xx, xe, ee) = (sum(&|x, _| x * x), sum(&|x, e| x * e), sum(&|_, e| e * e));
        let slope = xe / xx;
        let left = (ee - slope * xe).max(0.0);
        Self {
            name: name.to_owned(),
            fits: x.len(),
            mean,
            q_error,
            slope,
            slope_error: (left / (count - 2.0) / xx).sqrt(),
            correlation: xe / (xx * ee).sqrt(),
        }
    }
}
