//! Comparison of two runs of one target, or of two models of one track: evidence, marginals, mode weights, cost.

use super::columns::{Column, column, columns};
use super::modes::{Mode, Probability, mode_weights, prolate_probability};
use super::summary::ValueError;
use crate::error::{Error, Result};
use oblate_samplers::Run;
use oblate_samplers::diagnostics::{normal_deviate, wasserstein, weighted_quantile};
use serde::Serialize;

/// Runs disagree if they differ by more than this many combined standard errors.
pub const SIGMA_LIMIT: f64 = 3.0;

/// Smallest error of a mode weight in a comparison, because a run that has not found a small mode gives it an error of
/// zero.
const MIN_MODE_ERROR: f64 = 0.01;

/// One quantity in both runs.
#[derive(Clone, Debug, Serialize)]
pub struct MarginalRow {
    /// Its name.
    pub name: String,
    /// Medians in the two runs, in the parameter's unit.
    pub median: [f64; 2],
    /// Difference of the means in combined standard errors.
    pub sigma: f64,
    /// Shift: difference of the medians over the mean half-width of the 68 % intervals.
    pub shift: f64,
    /// First Wasserstein distance of the marginals over the same half-width.
    pub wasserstein: f64,
    /// Its expectation if both runs are draws of one posterior, as many as their effective sample sizes (the null expectation).
    pub wasserstein_expected: f64,
}

/// One orientation mode, or all that are prolate, in both runs.
#[derive(Clone, Debug, Serialize)]
pub struct ModeRow {
    /// Such as `dir_x+ dir_y- oblate`; `prolate`.
    pub name: String,
    /// Weights in the two runs, fractions of 1.
    pub weight: [f64; 2],
    /// Their standard errors.
    pub error: [f64; 2],
    /// Difference over the combined error, as the normal deviate with the same tail probability: either error may be a
    /// standard deviation of few clusters (Welch's degrees of freedom).
    pub sigma: f64,
}

/// What one run cost.
#[derive(Clone, Debug, Serialize)]
pub struct CostRow {
    /// Values without gradients.
    pub calls: u64,
    /// Values with gradients.
    pub gradients: u64,
    /// CPU time.
    pub cpu_seconds: f64,
    /// The effective sample size to quote.
    pub ess: f64,
    /// ESS of the mean of q per CPU second, where there is a q.
    pub q_ess_per_cpu_second: Option<f64>,
}

/// Two runs side by side.
#[derive(Clone, Debug, Serialize)]
pub struct Comparison {
    /// The runs.
    pub names: [String; 2],
    /// Evidences.
    pub ln_z: [ValueError; 2],
    /// Their difference in combined standard errors.
    pub ln_z_sigma: f64,
    /// Every parameter and derived quantity.
    pub marginals: Vec<MarginalRow>,
    /// Orientation modes and the prolate side, where the runs have them.
    pub modes: Vec<ModeRow>,
    /// Costs.
    pub cost: [CostRow; 2],
    /// Whether both runs have converged by their own checks.
    pub converged: [bool; 2],
    /// Whether the runs are of one model, so that they must agree.
    pub one_model: bool,
    /// Whether the runs are of the same data, so that the difference of ln Z is the evidence for one model over the other.
    pub same_data: bool,
}

impl Comparison {
    /// Whether the evidences agree within three combined standard errors, and every marginal mean and mode weight within 3.5 (there are many). Runs
    /// of two models need not agree.
    #[must_use]
    pub fn agree(&self) -> bool {
        let of_marginals = self.worst_marginal().map(|row| row.sigma);
        let of_modes = self.worst_mode().map(|row| row.sigma);
        let agrees = |sigma: f64| sigma.abs() <= SIGMA_LIMIT + 0.5;
        !self.one_model
            || self.ln_z_sigma.abs() <= SIGMA_LIMIT
                && of_marginals.into_iter().chain(of_modes).all(agrees)
    }

    /// The marginal whose means differ most in combined standard errors.
    #[must_use]
    pub fn worst_marginal(&self) -> Option<&MarginalRow> {
        self.marginals
            .iter()
            .max_by(|a, b| a.sigma.abs().total_cmp(&b.sigma.abs()))
    }

    /// The mode, or the prolate side, whose weights differ most.
    #[must_use]
    pub fn worst_mode(&self) -> Option<&ModeRow> {
        self.modes
            .iter()
            .max_by(|a, b| a.sigma.abs().total_cmp(&b.sigma.abs()))
    }

    /// The evidence for one of two models in words.
    fn odds(&self) -> String {
        let [a, b] = &self.ln_z;
        let difference = a.value - b.value;
        let better = usize::from(difference < 0.0);
        format!(
            "two models; ln Z {:+.2} +- {:.2}, odds of {} to 1 for {}",
            difference,
            a.error.hypot(b.error),
            odds_in_words(difference.abs()),
            self.names[better]
        )
    }

    /// The result in one sentence.
    #[must_use]
    pub fn verdict(&self) -> String {
        let mut text = if !self.same_data {
            "other data, so that they need not agree".to_owned()
        } else if !self.one_model {
            self.odds()
        } else if self.agree() {
            "they agree".to_owned()
        } else {
            "they DISAGREE".to_owned()
        };
        if let Some(worst) = self.worst_marginal().filter(|_| self.one_model) {
            text.push_str(&format!(
                " (ln Z by {:+.2} combined standard errors, the worst marginal is {} by {:+.2}",
                self.ln_z_sigma, worst.name, worst.sigma
            ));
            if let Some(mode) = self.worst_mode() {
                text.push_str(&format!(
                    ", the worst mode is {} by {:+.2}",
                    mode.name, mode.sigma
                ));
            }
            text.push(')');
        }
        for (name, converged) in self.names.iter().zip(self.converged) {
            if !converged {
                text.push_str(&format!("; {name} has not converged: see its checks"));
            }
        }
        text
    }
}

/// Odds with as many digits as errors of ln Z of a few tenths leave.
fn odds_in_words(ln_odds: f64) -> String {
    let odds = ln_odds.exp();
    if odds < 10.0 {
        format!("{odds:.1}")
    } else if odds < 1000.0 {
        format!("{odds:.0}")
    } else {
        format!("{odds:.0e}")
    }
}

/// Compares two runs of one target.
///
/// # Errors
/// [`Error::OtherParameters`] if they have different parameters; [`Error::NoDraws`] if one has no draws.
pub fn compare(name_a: &str, a: &Run, name_b: &str, b: &Run) -> Result<Comparison> {
    if a.names != b.names {
        return Err(Error::OtherParameters {
            first: name_a.to_owned(),
            first_names: a.names.clone(),
            second: name_b.to_owned(),
            second_names: b.names.clone(),
        });
    }
    Ok(Comparison {
        one_model: true,
        ..compare_models(name_a, a, name_b, b)?
    })
}

/// Compares runs of two models of one track, in the parameters that both have.
///
/// # Errors
/// [`Error::NoDraws`] if one has no draws.
pub fn compare_models(name_a: &str, a: &Run, name_b: &str, b: &Run) -> Result<Comparison> {
    for (name, run) in [(name_a, a), (name_b, b)] {
        if run.draws.is_empty() {
            return Err(Error::NoDraws {
                name: name.to_owned(),
            });
        }
    }
    let ln_z = [a, b].map(|r| ValueError {
        value: r.evidence.ln_z,
        error: r.evidence.error,
    });
    let (columns_a, columns_b) = (columns(a), columns(b));
    let weights = [a.draws.weights(), b.draws.weights()];
    let marginals = columns_a
        .iter()
        .filter_map(|ca| {
            let cb = columns_b.iter().find(|cb| cb.name == ca.name)?;
            // What follows from the same fixed parameters in both has no error to compare it by.
            if !ca.varies() && !cb.varies() && ca.values.first() == cb.values.first() {
                return None;
            }
            let ess = [(a, ca), (b, cb)].map(|(r, c)| r.draws.ess_of_mean(&c.values).max(1.0));
            Some(marginal(ca, cb, &weights, ess))
        })
        .collect();
    let mut modes = match (mode_weights(a), mode_weights(b)) {
        (Some(ma), Some(mb)) => ma
            .iter()
            .zip(&mb)
            .map(|(x, y)| mode_row(mode_name(x.mode), x.probability, y.probability))
            .collect(),
        _ => Vec::new(),
    };
    if let (Some(x), Some(y)) = (prolate_probability(a), prolate_probability(b)) {
        modes.push(mode_row("prolate".to_owned(), x, y));
    }
    let cost = [a, b].map(|r| CostRow {
        calls: r.cost.calls,
        gradients: r.cost.gradients,
        cpu_seconds: r.cost.cpu_seconds,
        ess: r.ess.quoted,
        q_ess_per_cpu_second: column(r, "q")
            .ok()
            .map(|q| r.draws.ess_of_mean(&q.values) / r.cost.cpu_seconds),
    });
    Ok(Comparison {
        names: [name_a.to_owned(), name_b.to_owned()],
        ln_z_sigma: (ln_z[0].value - ln_z[1].value) / ln_z[0].error.hypot(ln_z[1].error),
        ln_z,
        marginals,
        modes,
        cost,
        converged: [a.converged(), b.converged()],
        one_model: false,
        same_data: true,
    })
}

/// Compares runs of other data, in the parameters that both have.
///
/// # Errors
/// [`Error::NoDraws`] if one has no draws.
pub fn compare_other_data(name_a: &str, a: &Run, name_b: &str, b: &Run) -> Result<Comparison> {
    Ok(Comparison {
        same_data: false,
        ..compare_models(name_a, a, name_b, b)?
    })
}

fn mode_row(name: String, a: Probability, b: Probability) -> ModeRow {
    let error = a.error.hypot(b.error).max(MIN_MODE_ERROR);
    // One degree is as few as the law of a difference can have: a run of a single lineage states none.
    let parts = [a, b].map(|p| p.error.powi(4) / p.degrees_of_freedom.max(1.0));
    let degrees_of_freedom = error.powi(4) / parts.iter().sum::<f64>();
    ModeRow {
        name,
        weight: [a.weight, b.weight],
        error: [a.error, b.error],
        sigma: normal_deviate((a.weight - b.weight) / error, degrees_of_freedom),
    }
}

fn mode_name(mode: Mode) -> String {
    let symbol = |positive: bool| if positive { '+' } else { '-' };
    format!(
        "dir_x{} dir_y{} {}",
        symbol(mode.dir_x_positive),
        symbol(mode.dir_y_positive),
        if mode.prolate { "prolate" } else { "oblate" }
    )
}

fn marginal(a: &Column, b: &Column, weights: &[Vec<f64>; 2], ess: [f64; 2]) -> MarginalRow {
    let mean_and_variance = |values: &[f64], w: &[f64]| {
        let mean: f64 = values.iter().zip(w).map(|(v, w)| v * w).sum();
        let variance: f64 = values
            .iter()
            .zip(w)
            .map(|(v, w)| w * (v - mean) * (v - mean))
            .sum();
        (mean, variance)
    };
    let (ma, va) = mean_and_variance(&a.values, &weights[0]);
    let (mb, vb) = mean_and_variance(&b.values, &weights[1]);
    let quantile = |values: &[f64], w: &[f64], p: f64| weighted_quantile(values, w, p);
    let median = [
        quantile(&a.values, &weights[0], 0.5),
        quantile(&b.values, &weights[1], 0.5),
    ];
    let width =
        |values: &[f64], w: &[f64]| 0.5 * (quantile(values, w, 0.84) - quantile(values, w, 0.16));
    let half = 0.5 * (width(&a.values, &weights[0]) + width(&b.values, &weights[1]));
    let wasserstein = wasserstein(
        (&a.values, &weights[0], ess[0]),
        (&b.values, &weights[1], ess[1]),
    );
    MarginalRow {
        name: a.name.clone(),
        sigma: (ma - mb) / (va / ess[0] + vb / ess[1]).sqrt(),
        shift: (median[0] - median[1]) / half,
        wasserstein: wasserstein.distance / half,
        wasserstein_expected: wasserstein.expected / half,
        median,
    }
}
