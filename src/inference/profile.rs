//! Named settings of the model and its likelihood.

use crate::likelihood::{Coverage, LikelihoodSettings};
use crate::orbit::OrbitMethod;
use crate::spray::{SamplingScheme, TableSettings};
use crate::stream::{ModelSettings, Precision, StepRule, StepsPer};
use crate::track::BinEdges;
use serde::{Deserialize, Serialize};

/// A named choice of the settings of model and likelihood.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Profile {
    /// For fits, the default: 2,560 smeared Sobol particles in single precision, adaptive steps, soft bin edges, a smooth penalty for uncovered bins, and the
    /// model's own noise added to that of the data. docs/validation.md, section 2, compares its accuracy and time with
    /// [`Paper`](Self::Paper).
    #[default]
    Fast,
    /// The choices of Chemaly et al. 2026: 10,000 random particles in double precision, 100 uniform steps, a leapfrog orbit, hard bin edges, and zero
    /// likelihood where a bin is not covered.
    Paper,
}

impl Profile {
    /// Its model.
    #[must_use]
    pub fn model(self) -> ModelSettings {
        match self {
            Self::Fast => ModelSettings::default(),
            Self::Paper => ModelSettings {
                releases: TableSettings {
                    particles: 10_000,
                    release_times: 100,
                    sampling_scheme: SamplingScheme::Random,
                    ..TableSettings::default()
                },
                steps: 100,
                steps_per: StepsPer::Particle,
                step_rule: StepRule::Uniform,
                orbit: OrbitMethod::Leapfrog,
                orbit_steps: 100,
                precision: Precision::Double,
                ..ModelSettings::default()
            },
        }
    }

    /// Its likelihood.
    #[must_use]
    pub fn likelihood(self) -> LikelihoodSettings {
        match self {
            Self::Fast => LikelihoodSettings::default(),
            Self::Paper => LikelihoodSettings {
                edges: BinEdges::Hard,
                coverage: Coverage::Reject,
                model_noise: false,
                ..LikelihoodSettings::default()
            },
        }
    }
}
