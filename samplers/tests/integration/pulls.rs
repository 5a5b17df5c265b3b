//! How far estimates are from the truth, in units of the errors they quote.

use oblate_samplers::Run;

/// Mean and standard deviation.
pub fn scatter(values: &[f64]) -> (f64, f64) {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let square: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
    (mean, (square / (count - 1.0)).sqrt())
}

/// (ln Z - truth) / error of a run.
pub fn pull(run: &Run, truth: f64) -> f64 {
    (run.evidence.ln_z - truth) / run.evidence.error
}
