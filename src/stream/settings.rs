//! How a stream is made: releases, steps, orbit.

use crate::orbit::OrbitMethod;
use crate::spray::TableSettings;
use serde::{Deserialize, Serialize};

/// How a particle's steps are spread over its time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StepRule {
    /// Equal steps: the paper.
    #[default]
    Uniform,
    /// Shorter where the progenitor's orbit turns faster, see [`AdaptiveGrid`](crate::orbit::AdaptiveGrid).
    Dynamical,
}

/// Whose steps are counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StepsPer {
    /// Every particle takes the same number of steps, longer ones the older it is: the paper.
    Particle,
    /// A particle of the stream's age takes this number of steps, others in proportion to their time in flight: the same
    /// error for about half of the steps. Particles fill the lanes where an epoch has 16 of them or more.
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
    /// Whose steps these are.
    pub steps_per: StepsPer,
    /// How they are spread over its time.
    pub step_rule: StepRule,
    /// How the progenitor is carried.
    pub orbit: OrbitMethod,
    /// Steps of the progenitor's orbit.
    pub orbit_steps: usize,
    /// Fewest leapfrog steps per turn where the progenitor's orbit turns fastest (a circular orbit there, 2 pi / omega); a
    /// galaxy with fewer is rejected. With six the energy of a plunging orbit still holds to 1e-4; with two or three its
    /// particles are scattered by their steps alone, and a track is an accident of rounding. 0: none is rejected.
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
