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
    /// Equal leapfrog steps, and an orbit of the progenitor in equal steps: the paper.
    Uniform,
    /// Fourth-order steps that are halved where the particles need it, see
    /// [`advance_adaptively`](crate::orbit::advance_adaptively), and an orbit in as many steps as it needs.
    #[default]
    Adaptive,
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
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ModelSettings {
    /// The releases.
    pub releases: TableSettings,
    /// Number of steps; of adaptive ones, if all are as long as possible.
    pub steps: usize,
    /// What this number refers to.
    pub steps_per: StepsPer,
    /// How they are spread over its time.
    pub step_rule: StepRule,
    /// How the progenitor is integrated.
    pub orbit: OrbitMethod,
    /// Steps of the progenitor's orbit; with adaptive steps, their number is doubled until their phase is at most half of `step_phase`.
    pub orbit_steps: usize,
    /// Largest phase of an adaptive step, radians: on a circular orbit 1.4 times the angle. The error grows with its fourth power.
    pub step_phase: f64,
    /// How often the longest adaptive step is halved to make the shortest. A system whose progenitor would need shorter steps is rejected, because its price
    /// would have no bound.
    pub max_halvings: u8,
}

impl Default for ModelSettings {
    fn default() -> Self {
        Self {
            releases: TableSettings::default(),
            steps: 8,
            steps_per: StepsPer::default(),
            step_rule: StepRule::default(),
            orbit: OrbitMethod::default(),
            orbit_steps: 64,
            step_phase: 0.85,
            max_halvings: 7,
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
        in_range("model.step_phase", self.step_phase, 0.01..=10.0)?;
        in_range("model.max_halvings", self.max_halvings, 0..=16)?;
        Ok(())
    }
}
