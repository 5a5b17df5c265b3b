//! The posterior of the hyperparameters, as a target of the samplers.

use super::exponential::add_exponential;
use super::family::Family;
use super::kept_cells::KeptCells;
use super::q_posterior::QPosterior;
use crate::data::Selection;
use crate::error::{Error, PosteriorFault, Result};
use crate::posterior::Interval;
use crate::scalar::{Dual, Real, gradient_of, lift};
use oblate_samplers::diagnostics::effective_number;
use oblate_samplers::limits::{Memory, in_range};
use oblate_samplers::output::Draws;
use oblate_samplers::{Cause, Outcome, Prior, Target};
use serde::{Deserialize, Serialize};

/// Cost of a value with its gradient in units of a value; docs/validation.md, section 6, has the measured range.
const GRADIENT_COST: f64 = 2.0;

/// No draw of some stream has any weight under the population.
const NO_OVERLAP: Cause = "no overlap with a stream";

/// Settings of the reweighting of streams.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PopulationSettings {
    /// Draws per stream that are kept, by systematic resampling; 5000. More cost time in proportion; fewer make the
    /// sum over draws coarse where a population is narrow (see [`PopulationTarget::effective_draws`]).
    pub max_draws: usize,
}

impl Default for PopulationSettings {
    fn default() -> Self {
        Self { max_draws: 5_000 }
    }
}

impl PopulationSettings {
    /// Checks every number by itself: the ranges of docs/limits.md.
    ///
    /// # Errors
    /// [`Error::OutOfRange`].
    pub fn check(&self) -> Result<()> {
        in_range("reweighting.max_draws", self.max_draws, 1..=1_000_000)?;
        Ok(())
    }

    /// An estimate of the memory of the draws of `streams` streams: q and a factor of each.
    #[must_use]
    pub fn memory(&self, streams: usize) -> Memory {
        let draws = (streams * self.max_draws) as f64;
        Memory::default().with(
            "reweighting.max_draws",
            2.0 * size_of::<f64>() as f64 * draws,
        )
    }
}

/// One stream, ready for evaluation.
#[derive(Clone, Debug)]
pub(super) struct WeightedStream {
    /// The fit's name.
    pub name: String,
    /// Draws of q.
    pub q: Vec<f64>,
    /// `ln (w_i / pi(q_i))`.
    pub ln_factor: Vec<f64>,
    /// `ln pi(q)`, the same for all draws.
    pub ln_prior: f64,
    /// Number of independent draws that they are worth.
    pub effective_size: f64,
    /// q by all draws of the fit, those outside the family's support too.
    pub in_its_fit: Interval,
}

/// `prior of the hyperparameters x product over streams of sum_i w_i pi(q_i | alpha) / pi(q_i)`.
///
/// The logarithm of that product is relative to the streams' evidences under their own priors: differences of ln Z
/// between families are Bayes factors of the whole data.
#[derive(Clone, Debug)]
pub struct PopulationTarget<F, const N: usize> {
    family: F,
    prior: Prior,
    streams: Vec<WeightedStream>,
    kept: Option<KeptCells>,
}

impl<F: Family<N>, const N: usize> PopulationTarget<F, N> {
    /// Checks the streams against the family and prepares them: draws outside the family's support stay out (their
    /// density is zero, their weight remains lost), the others are thinned.
    ///
    /// # Errors
    /// As of [`PopulationSettings::check`]; [`Error::TooMuchMemory`] by the estimate of [`PopulationSettings::memory`];
    /// [`Error::TooFewRuns`] for no streams; [`Error::Posterior`] for a stream that [`QPosterior::check`] refuses or that has no draw
    /// inside the support; [`Error::Sampler`] for hyperpriors that are not distributions.
    pub fn new(family: F, streams: &[QPosterior], settings: PopulationSettings) -> Result<Self> {
        settings.check()?;
        settings.memory(streams.len()).check()?;
        if streams.is_empty() {
            return Err(Error::TooFewRuns { given: 0, min: 1 });
        }
        let (lo, hi) = family.support();
        let mut prepared = Vec::with_capacity(streams.len());
        for posterior in streams {
            let ln_prior = posterior.check((lo, hi))?;
            let weights: Vec<f64> = posterior.ln_weight.iter().map(|w| w.exp()).collect();
            let in_its_fit = Interval::new(&posterior.q, &weights, "");
            let posterior = posterior.thinned(settings.max_draws);
            let (q, ln_factor): (Vec<f64>, Vec<f64>) = posterior
                .q
                .iter()
                .zip(&posterior.ln_weight)
                .filter(|(q, w)| (lo..=hi).contains(*q) && **w > f64::NEG_INFINITY)
                .map(|(q, w)| (*q, w - ln_prior))
                .unzip();
            if q.is_empty() {
                return Err(Error::Posterior {
                    name: posterior.name,
                    fault: PosteriorFault::OutsideSupport { lo, hi },
                });
            }
            prepared.push(WeightedStream {
                name: posterior.name,
                q,
                ln_factor,
                ln_prior,
                effective_size: posterior.effective_size,
                in_its_fit,
            });
        }
        let prior = Prior::new(
            family
                .hyperparameters()
                .map(|(name, marginal)| (name, "", marginal)),
        )?;
        Ok(Self {
            family,
            prior,
            streams: prepared,
            kept: None,
        })
    }

    /// The same for streams of which only a fraction was kept, by criteria that depend on q: the likelihood of each is divided by the fraction
    /// of the population that is kept (Mandel, Farr & Gair 2019).
    ///
    /// # Errors
    /// Those of [`Selection::check`].
    pub fn with_selection(mut self, selection: &Selection) -> Result<Self> {
        selection.check()?;
        self.kept = Some(KeptCells::new(selection, self.family.support()));
        Ok(self)
    }

    /// The selection on the family's support.
    pub(super) fn kept_cells(&self) -> Option<&KeptCells> {
        self.kept.as_ref()
    }

    /// Number of streams.
    #[must_use]
    pub fn streams(&self) -> usize {
        self.streams.len()
    }

    /// The streams, as they are evaluated.
    pub(super) fn weighted_streams(&self) -> &[WeightedStream] {
        &self.streams
    }

    /// The family.
    #[must_use]
    pub fn family(&self) -> &F {
        &self.family
    }

    /// `ln` of the product over streams at hyperparameters `alpha`, on any number type; minus infinity or NaN where it
    /// has no value.
    pub fn ln_product<S: Real>(&self, alpha: [S; N]) -> S {
        let ln_pdf = self.family.ln_pdf(alpha);
        // The largest term needs no derivatives.
        let plain = self.family.ln_pdf(alpha.map(Real::re));
        let mut sum = S::zero();
        for stream in &self.streams {
            sum += ln_sum_exp(stream, &plain, &ln_pdf);
        }
        match &self.kept {
            Some(kept) if sum.re().is_finite() => {
                sum - kept.ln_kept(&plain, &ln_pdf) * self.streams.len() as f64
            }
            _ => sum,
        }
    }

    /// `ln` of each factor of the product, in the streams' order.
    pub(super) fn ln_likelihoods(&self, alpha: [f64; N]) -> Vec<f64> {
        let ln_pdf = self.family.ln_pdf(alpha);
        let kept = self.kept.as_ref();
        let ln_kept = kept.map_or(0.0, |kept| kept.ln_kept(&ln_pdf, &ln_pdf));
        self.streams
            .iter()
            .map(|stream| ln_sum_exp(stream, &ln_pdf, &ln_pdf) - ln_kept)
            .collect()
    }

    /// Effective number of draws that carry each stream's sum at `alpha`: `(sum x)^2 / sum x^2` over its terms. With
    /// few draws the sum is dominated by noise, and a narrow population gets too large a likelihood; then fits with
    /// more draws are needed, or narrow populations cannot be trusted.
    #[must_use]
    pub fn effective_draws(&self, alpha: [f64; N]) -> Vec<f64> {
        let ln_pdf = self.family.ln_pdf(alpha);
        self.streams
            .iter()
            .map(|stream| {
                let terms = || {
                    stream
                        .q
                        .iter()
                        .zip(&stream.ln_factor)
                        .map(|(q, w)| w + ln_pdf(*q))
                };
                let top = terms().fold(f64::NEG_INFINITY, f64::max);
                effective_number(terms().map(|term| (term - top).exp()))
            })
            .collect()
    }
}

/// `ln sum_i exp(ln_factor_i + ln_pdf(q_i))`, with the largest term taken out.
fn ln_sum_exp<S: Real>(
    stream: &WeightedStream,
    plain: &impl Fn(f64) -> f64,
    ln_pdf: &impl Fn(f64) -> S,
) -> S {
    let draws = || stream.q.iter().zip(&stream.ln_factor);
    let top = draws().fold(f64::NEG_INFINITY, |top, (q, w)| top.max(w + plain(*q)));
    if !top.is_finite() {
        return S::from_f64(top);
    }
    let mut sum = S::zero();
    for (q, w) in draws() {
        add_exponential(&mut sum, ln_pdf(*q) + (w - top));
    }
    sum.ln() + top
}

/// The hyperparameters of `count` equal-weight draws.
pub(super) fn equal_weight_members<const N: usize>(draws: &Draws, count: usize) -> Vec<[f64; N]> {
    draws
        .resample(count, 0.5)
        .into_iter()
        .filter_map(|row| <[f64; N]>::try_from(draws.theta_row(row)).ok())
        .collect()
}

fn outcome(ln_product: f64) -> Outcome {
    if ln_product == f64::NEG_INFINITY {
        Outcome::Reject(NO_OVERLAP)
    } else {
        Outcome::from_ln_likelihood(ln_product)
    }
}

impl<F: Family<N>, const N: usize> Target for PopulationTarget<F, N> {
    fn prior(&self) -> &Prior {
        &self.prior
    }

    fn ln_likelihood(&self, theta: &[f64]) -> Outcome {
        match <[f64; N]>::try_from(theta) {
            Ok(alpha) => outcome(self.ln_product(alpha)),
            Err(_) => wrong_length(theta.len(), N),
        }
    }

    fn ln_likelihood_and_gradient(&self, theta: &[f64], gradient: &mut [f64]) -> Outcome {
        let Ok(alpha) = <[f64; N]>::try_from(theta) else {
            return wrong_length(theta.len(), N);
        };
        let value: Dual<N> = self.ln_product(lift(&alpha));
        gradient.copy_from_slice(&gradient_of(&value));
        if gradient.iter().all(|g| g.is_finite()) {
            outcome(value.re)
        } else {
            Outcome::Reject("gradient not finite")
        }
    }

    fn gradient_cost(&self) -> Option<f64> {
        Some(GRADIENT_COST)
    }

    fn derived_names(&self) -> Vec<(String, String)> {
        let own = self.family.derived_names();
        let all = ["min_effective_draws"].iter().chain(own);
        all.map(|name| ((*name).to_owned(), String::new()))
            .collect()
    }

    fn derived(&self, theta: &[f64], out: &mut Vec<f64>) {
        let smallest = <[f64; N]>::try_from(theta).map_or(f64::NAN, |alpha| {
            self.effective_draws(alpha)
                .into_iter()
                .fold(f64::INFINITY, f64::min)
        });
        out.push(smallest);
        match <[f64; N]>::try_from(theta) {
            Ok(alpha) => out.extend(self.family.derived(alpha)),
            Err(_) => out.extend(self.family.derived_names().iter().map(|_| f64::NAN)),
        }
    }
}

fn wrong_length(given: usize, wanted: usize) -> Outcome {
    Outcome::Fatal(format!(
        "{given} hyperparameters were given, {wanted} are needed"
    ))
}
