//! How a stream is made: releases, steps, orbit.

use crate::error::Result;
use crate::orbit::OrbitMethod;
use crate::spray::TableSettings;
use oblate_samplers::limits::in_range;
use serde::{Deserialize, Serialize};

/// How a particle's steps are spread over its time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StepRule {
    /// Equal steps: the paper.
    #[default]
    Uniform,
    /// Shorter where the progenitor's orbital frequency is higher, see [`AdaptiveGrid`](crate::orbit::AdaptiveGrid).
    Dynamical,
}

/// What the number of steps refers to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StepsPer {
    /// Every particle takes the same number of steps, longer ones the older it is: the paper.
    Particle,
    /// A particle of the stream's age takes this number of steps, others in proportion to their time since release: the
    /// same error for about half of the steps. Lanes are full where a release time has 16 particles or more.
    #[default]
    Age,
}

impl StepsPer {
    /// The number of steps of a particle released at the time `tau` in [-1, 0).
    pub(super) fn of(self, steps: usize, tau: f64) -> usize {
        match self {
            Self::Particle => steps,
            #[allow(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "at most `steps`, at least 0"
            )]
            Self::Age => ((-tau * steps as f64).ceil() as usize).clamp(1, steps),
        }
    }
}

/// How a stream is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ModelSettings {
    /// The releases.
    pub releases: TableSettings,
    /// Leapfrog steps.
    pub steps: usize,
    /// What this number refers to.
    pub steps_per: StepsPer,
    /// How they are spread over its time.
    pub step_rule: StepRule,
    /// How the progenitor is integrated.
    pub orbit: OrbitMethod,
    /// Steps of the progenitor's orbit.
    pub orbit_steps: usize,
    /// Minimum number of leapfrog steps per orbital period where the progenitor's period is shortest (that of a circular orbit there,
    /// 2 pi / omega); a system with fewer is rejected. With six the energy of a plunging orbit still holds to 1e-4; with two or three its
    /// particles are scattered by the integration error, and the track is random. 0: none is rejected.
    pub min_steps_per_orbit: usize,
}

impl Default for ModelSettings {
    fn default() -> Self {
        Self {
            releases: TableSettings::default(),
            steps: 120,
            steps_per: StepsPer::default(),
            step_rule: StepRule::default(),
            orbit: OrbitMethod::default(),
            orbit_steps: 192,
            min_steps_per_orbit: 6,
        }
    }
}

impl ModelSettings {
    /// Checks every number by itself, those of the releases too: the ranges of docs/limits.md.
    ///
    /// # Errors
    /// [`Error::OutOfRange`](crate::Error::OutOfRange) with the first one that is out of its range.
    pub fn check(&self) -> Result<()> {
        self.releases.check()?;
        in_range("model.steps", self.steps, 1..=100_000)?;
        in_range("model.orbit_steps", self.orbit_steps, 1..=100_000)?;
        let least = self.min_steps_per_orbit;
        in_range("model.min_steps_per_orbit", least, 0..=10_000)?;
        Ok(())
    }
}
