//! The rate at which stars leave the progenitor, as weights of the release times (docs/physics.md, section 4).

use super::mass_loss::{MassLoss, MassOverTime};
use crate::error::Result;
use crate::params::StreamPrior;
use crate::scalar::Real;
use serde::{Deserialize, Serialize};

/// The rate at which stars leave the progenitor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ReleaseRate {
    /// Even in time, as in Chemaly et al. (2026).
    #[default]
    Even,
    /// In proportion to a power of the frequency of orbits at the tidal radius, which is highest at pericentres. The power is the parameter
    /// `release_peaking`.
    Tidal,
}

impl ReleaseRate {
    pub(super) fn is_even(&self) -> bool {
        *self == Self::Even
    }
}

/// Checks that a prior has the power of a rate that needs one, and otherwise not.
///
/// # Errors
/// [`Error::Setting`](crate::Error::Setting) if it lacks a value or a distribution, or has one in vain.
pub(super) fn check_prior(rate: ReleaseRate, prior: &StreamPrior) -> Result<()> {
    prior.check_belongs(
        "release_peaking",
        !rate.is_even(),
        "`model.release_rate`",
        Some("{ kind = \"uniform\", lo = 0, hi = 3 }"),
    )
}

/// How many stars leave in the interval of each release time.
#[derive(Clone, Copy, Debug)]
pub(super) struct ReleaseLaw<S> {
    pub rate: ReleaseRate,
    /// The power of the tidal rate.
    pub peaking: S,
    pub mass_loss: MassOverTime<S>,
}

impl<S: Real> ReleaseLaw<S> {
    /// Whether all release times have the same weight.
    pub fn is_even(&self) -> bool {
        self.rate.is_even() && self.mass_loss.law != Some(MassLoss::Complete)
    }

    /// Number `k` of `count` release times of equal intervals, without its common factor: `frequency2` is the square of the frequency of
    /// orbits at the tidal radius.
    #[inline(always)]
    pub fn weight(&self, k: usize, count: usize, frequency2: S) -> S {
        let mut weight = self.mass_loss.part_before_its_end(k, count);
        if self.rate == ReleaseRate::Tidal {
            weight *= (frequency2.ln() * self.peaking * 0.5).exp();
        }
        weight
    }
}

/// Divides weights by their mean. Returns the mean of their squares: how many times larger the variance of a mean over all particles is
/// than with even weights; 1 without weights, which are then all 1.
#[inline(always)]
pub(super) fn normalise<S: Real>(weights: &mut [S]) -> S {
    if weights.is_empty() {
        return S::one();
    }
    let count = weights.len() as f64;
    let mut sum = S::zero();
    for &weight in weights.iter() {
        sum += weight;
    }
    let scale = S::from_f64(count) / sum;
    let mut squares = S::zero();
    for weight in weights.iter_mut() {
        *weight *= scale;
        squares += *weight * *weight;
    }
    squares / count
}
