//! The error of the model at the posterior: how far ln L, and with it q, moves with shorter steps and with other, more particles.

use super::best_fit::Diagnostics;
use super::prior_predictive::Advanced;
use super::target::StreamTarget;
use crate::error::Result;
use crate::likelihood::StreamLikelihood;
use crate::spray::TableSettings;
use crate::stream::{Model, ModelSettings};
use oblate_samplers::diagnostics::weighted_quantile;
use oblate_samplers::output::Check;
use oblate_samplers::{Error as SamplerError, Run};
use std::ops::ControlFlow;

/// Number of posterior draws of equal weight that are evaluated again.
const DRAWS: usize = 256;

/// Number of values between two reports of progress, at which the work can be stopped.
const CHUNK: usize = 32;

/// Number of threads for which the memory of a model with more particles must suffice: not the present one, because the result must not
/// depend on it.
const THREADS: usize = 16;

/// Differences of ln L are cut off here, from their median: beyond, the first order in them says nothing.
const MAX_DIFFERENCE: f64 = 5.0;

/// Largest spread of ln L by the steps.
const STEPS_LIMIT: f64 = 0.5;

/// Largest spread of ln L by the particles.
const PARTICLES_LIMIT: f64 = 3.0;

/// Largest move of an end of q's 68 % interval, in its half-width.
const Q_LIMIT: f64 = 0.5;

/// How the names of the checks of the steps begin.
pub(crate) const STEPS_CHECKS: &str = "steps";

/// How the names of the checks of the particles begin.
pub(crate) const PARTICLES_CHECKS: &str = "particles";

/// Evaluates draws of the posterior again: with steps of half the length, and with other, more particles.
///
/// The difference Δ of ln L gives the posterior of the finer model by weights exp(Δ). To first order the mean of q moves by Cov(q, Δ)
/// and its variance by Cov((q - mean)², Δ), which needs far fewer draws than the weights themselves, and is exact for a normal posterior whose
/// ln L changes by a linear function of q.
///
/// Returns the checks; the numbers behind them are added to `found`. `advanced` is told how many of how many values are done.
///
/// # Errors
/// [`SamplerError::Interrupted`] if `advanced` stops it.
pub(super) fn model_error(
    target: &StreamTarget,
    run: &Run,
    found: &mut Diagnostics,
    advanced: &mut Advanced<'_>,
) -> Result<Vec<Check>> {
    let draws = Sample::new(target, run);
    if draws.points.is_empty() {
        return Ok(Vec::new());
    }
    let likelihood = target.likelihood();
    let shorter = likelihood.model().with_twice_the_steps();
    let count = draws.points.len() as u64;
    let difference = draws.difference(&likelihood.with_model(shorter), &mut |done| {
        advanced(done, 2 * count)
    })?;
    let mut checks = difference.checks(
        STEPS_CHECKS,
        STEPS_LIMIT,
        "steps of half the length",
        "decrease `model.step_phase`, or with equal steps increase `model.steps`",
        found,
    );
    let settings = likelihood.model().settings();
    let other = other_particles(settings);
    let factor = other.releases.particles / settings.releases.particles;
    match Model::new(&other) {
        Ok(model) => {
            let finer = likelihood.with_model(model);
            let difference =
                draws.difference(&finer, &mut |done| advanced(count + done, 2 * count))?;
            checks.extend(difference.checks(
                PARTICLES_CHECKS,
                PARTICLES_LIMIT,
                &format!("{factor} times as many, other particles"),
                "increase `model.releases.particles`",
                found,
            ));
        }
        Err(error) => found.warnings.push(format!(
            "the error of the model by its particles is not known: {error}"
        )),
    }
    Ok(checks)
}

/// Settings of a model with other particles: four times as many where the sampling scheme and the memory of [`THREADS`] values at once allow
/// it, else twice as many or the same number.
pub(super) fn other_particles(settings: &ModelSettings) -> ModelSettings {
    let with = |factor: usize| ModelSettings {
        releases: TableSettings {
            particles: factor * settings.releases.particles,
            release_times: factor * settings.releases.release_times,
            // Any other seed, in the range of seeds.
            seed: settings.releases.seed ^ 1,
            ..settings.releases
        },
        ..*settings
    };
    let most = settings.releases.sampling_scheme.max_particles();
    let allowed = |other: &ModelSettings| {
        other.releases.particles <= most && other.memory(THREADS).check().is_ok()
    };
    [4, 2]
        .map(with)
        .into_iter()
        .find(allowed)
        .unwrap_or(with(1))
}

/// Draws of equal weight, repeated ones once.
struct Sample {
    points: Vec<[f64; crate::params::DIM]>,
    ln_likelihood: Vec<f64>,
    q: Vec<f64>,
    weight: Vec<f64>,
}

/// How one ln L differs from another over the posterior.
struct Difference {
    /// Median of the difference.
    shift: f64,
    /// Half of its central 68 % range; infinite if more than 16 % of the draws are rejected.
    spread: f64,
    /// Move of the mean of q over the half-width of its 68 % interval, and the standard error of this number.
    q_shift: f64,
    q_shift_error: f64,
    /// Relative change of the standard deviation of q.
    q_width: f64,
    /// Fraction of the draws that the other likelihood rejects.
    rejected: f64,
}

impl Sample {
    fn new(target: &StreamTarget, run: &Run) -> Self {
        let mut sample = Self {
            points: Vec::new(),
            ln_likelihood: Vec::new(),
            q: Vec::new(),
            weight: Vec::new(),
        };
        let mut last = None;
        for row in run.draws.resample(DRAWS, 0.5) {
            match sample.weight.last_mut() {
                Some(weight) if last == Some(row) => *weight += 1.0,
                _ => sample.push(target, run, row),
            }
            last = Some(row);
        }
        let sum: f64 = sample.weight.iter().sum();
        sample.weight.iter_mut().for_each(|w| *w /= sum);
        sample
    }

    fn push(&mut self, target: &StreamTarget, run: &Run, row: usize) {
        let params = target.params(run.draws.theta_row(row));
        self.points.push(params.to_array());
        self.ln_likelihood.push(run.draws.ln_likelihood[row]);
        self.q.push(target.stream_prior().shape(&params).q);
        self.weight.push(1.0);
    }

    /// The mean of a number of each draw.
    fn mean(&self, number: impl Fn(usize) -> f64) -> f64 {
        let weights = self.weight.iter().enumerate();
        weights.map(|(i, weight)| weight * number(i)).sum()
    }

    /// How `other` differs from the likelihood of the draws.
    ///
    /// # Errors
    /// [`SamplerError::Interrupted`] if `done`, which is told how many values are, stops it.
    fn difference(
        &self,
        other: &StreamLikelihood,
        done: &mut dyn FnMut(u64) -> ControlFlow<()>,
    ) -> Result<Difference> {
        let mut values = Vec::new();
        for points in self.points.chunks(CHUNK) {
            values.extend(other.ln_likelihoods(points));
            if done(values.len() as u64).is_break() {
                return Err(SamplerError::Interrupted.into());
            }
        }
        let differences: Vec<f64> = values
            .iter()
            .zip(&self.ln_likelihood)
            .map(|(value, before)| match value {
                Ok(evaluation) => evaluation.ln_likelihood - before,
                Err(_) => f64::NEG_INFINITY,
            })
            .collect();
        let at = |p| weighted_quantile(&differences, &self.weight, p);
        let q_at = |p| weighted_quantile(&self.q, &self.weight, p);
        let (shift, half_width) = (at(0.5), 0.5 * (q_at(0.84) - q_at(0.16)));
        let cut = |i: usize| (differences[i] - shift).clamp(-MAX_DIFFERENCE, MAX_DIFFERENCE);
        let (q_mean, cut_mean) = (self.mean(|i| self.q[i]), self.mean(cut));
        let off = |i: usize| self.q[i] - q_mean;
        let product = |i: usize| off(i) * (cut(i) - cut_mean);
        let covariance = self.mean(product);
        let scatter = self.mean(|i| (product(i) - covariance).powi(2));
        let kish = 1.0 / self.weight.iter().map(|w| w * w).sum::<f64>();
        Ok(Difference {
            shift,
            spread: 0.5 * (at(0.84) - at(0.16)),
            q_shift: covariance / half_width,
            q_shift_error: (scatter / kish).sqrt() / half_width,
            q_width: 0.5 * self.mean(|i| off(i) * product(i)) / self.mean(|i| off(i).powi(2)),
            rejected: self.mean(|i| f64::from(u8::from(differences[i].is_infinite()))),
        })
    }
}

impl Difference {
    /// Its checks; the numbers are added to `found`.
    fn checks(
        &self,
        name: &str,
        limit: f64,
        change: &str,
        remedy: &str,
        found: &mut Diagnostics,
    ) -> Vec<Check> {
        let numbers = [
            ("ln_likelihood_shift", self.shift),
            ("ln_likelihood_spread", self.spread),
            ("q_shift", self.q_shift),
            ("q_shift_error", self.q_shift_error),
            ("q_width_change", self.q_width),
            ("rejected", self.rejected),
        ];
        // Where most draws are rejected, or the shape is fixed, some numbers do not exist.
        for (number, value) in numbers.into_iter().filter(|(_, value)| value.is_finite()) {
            found.insert(&format!("{name}_{number}"), value);
        }
        let mut checks = vec![Check::at_most(
            &format!("{name}-ln-likelihood"),
            if self.spread.is_finite() {
                self.spread
            } else {
                f64::INFINITY
            },
            limit,
            format!(
                "half of the central 68 % range of the change of ln L by {change}, over the posterior: {remedy}"
            ),
        )];
        if self.q_shift.is_finite() {
            checks.push(Check::at_most(
                &format!("{name}-q"),
                self.q_shift.abs() + self.q_width.abs(),
                Q_LIMIT,
                format!("how far an end of q's 68 % interval moves by {change}, in its half-width: {remedy}"),
            ));
        }
        checks
    }
}
