//! Do runs agree? Evidence, shape and cost of several runs, each against the first.

use crate::posterior::Summary;

/// One run of a comparison.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct CompareRow {
    /// The run's name.
    pub name: String,
    /// Whether it converged.
    pub converged: bool,
    /// ln Z.
    pub ln_z: f64,
    /// Its error.
    pub ln_z_error: f64,
    /// Difference of ln Z from the first run's in combined errors; `None` for the first.
    pub ln_z_sigma: Option<f64>,
    /// Median of q, where there is one.
    pub q: Option<f64>,
    /// Difference of the medians of q from the first run's, in halves of its 68 % interval; `None` for the first.
    pub q_shift: Option<f64>,
    /// The parameter whose median moved most against the first run, and by how many halves of its 68 % interval.
    pub worst: Option<(String, f64)>,
    /// Effective sample size.
    pub ess: f64,
    /// Likelihood calls without a gradient.
    pub calls: u64,
    /// Likelihood calls with one.
    pub gradients: u64,
    /// CPU time in seconds.
    pub cpu_seconds: f64,
}

/// Compares summaries with the first of them, by name.
#[must_use]
pub fn compare_rows(runs: &[(String, &Summary)]) -> Vec<CompareRow> {
    let Some((_, first)) = runs.first() else {
        return Vec::new();
    };
    runs.iter()
        .enumerate()
        .map(|(i, (name, s))| {
            let other = i > 0;
            let error = first.ln_z.error.hypot(s.ln_z.error);
            let shift = |a: &crate::posterior::Interval, b: &crate::posterior::Interval| {
                (b.median - a.median) / (0.5 * (a.hi68 - a.lo68))
            };
            let worst = first
                .parameters
                .iter()
                .filter_map(|(p, a)| {
                    let b = s.parameters.iter().find(|x| &x.0 == p)?;
                    Some((p.clone(), shift(a, &b.1)))
                })
                .max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
            CompareRow {
                name: name.clone(),
                converged: s.converged,
                ln_z: s.ln_z.value,
                ln_z_error: s.ln_z.error,
                ln_z_sigma: other.then(|| (s.ln_z.value - first.ln_z.value) / error),
                q: s.q.as_ref().map(|q| q.median),
                q_shift: match (&first.q, &s.q) {
                    (Some(a), Some(b)) if other => Some(shift(a, b)),
                    _ => None,
                },
                worst: worst.filter(|_| other),
                ess: s.ess,
                calls: s.cost.calls,
                gradients: s.cost.gradients,
                cpu_seconds: s.cost.cpu_seconds,
            }
        })
        .collect()
}
