//! Settings of the model of a stream: releases, steps, orbit.

use super::baryons::BaryonSettings;
use super::friction;
use super::mass_loss::{self, MassLoss, MassOverTime};
use super::release_rate::{self, ReleaseRate};
use super::second_axis;
use crate::error::Result;
use crate::orbit::OrbitMethod;
use crate::params::StreamPrior;
use crate::potential::{HaloKind, Host};
use crate::spray::TableSettings;
use oblate_samplers::limits::in_range;
use serde::{Deserialize, Serialize};

/// How the lengths of a particle's steps are chosen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StepRule {
    /// Equal leapfrog steps, and the orbit of the progenitor in `orbit_steps` steps, as in Chemaly et al. (2026).
    Uniform,
    /// Fourth-order steps whose phase is bounded, see [`advance_adaptively`](crate::orbit::advance_adaptively), and the orbit in as many
    /// steps as its phase needs.
    #[default]
    Adaptive,
}

/// The time that the number of steps refers to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StepsPer {
    /// The time since the particle's release: all particles take the same number of steps, as in Chemaly et al. (2026).
    Particle,
    /// The age of the stream: particles released later take fewer steps, in proportion to the time since their release. The error is the
    /// same for about half of the steps.
    #[default]
    Age,
}

impl StepsPer {
    /// The number of steps of a particle released at the time `tau` in [-1, 0), where a particle of the stream's age takes `steps`.
    pub(super) fn number_of_steps(self, steps: usize, tau: f64) -> usize {
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

/// The precision of the numbers in which particles are integrated. Everything else is computed in doubles.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Precision {
    /// Doubles: 16 particles together, 32 with equal steps.
    Double,
    /// Singles, 32 particles together: half the time, and rounding far below the error of the model (docs/decisions.md, section 1).
    Single,
}

/// Settings of the model of a stream.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ModelSettings {
    /// The kind of the host's halo.
    #[serde(skip_serializing_if = "HaloKind::is_default")]
    pub halo: HaloKind,
    /// Disc and bulge of the host.
    #[serde(skip_serializing_if = "BaryonSettings::is_none")]
    pub baryons: BaryonSettings,
    /// How the progenitor loses mass; none: it keeps its mass.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mass_loss: Option<MassLoss>,
    /// The rate at which stars leave the progenitor.
    #[serde(skip_serializing_if = "ReleaseRate::is_even")]
    pub release_rate: ReleaseRate,
    /// Whether the halo slows the progenitor by dynamical friction.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub dynamical_friction: bool,
    /// The releases.
    pub releases: TableSettings,
    /// Number of steps of a particle; of adaptive steps, if all are as long as possible.
    pub steps: usize,
    /// The time that this number refers to.
    pub steps_per: StepsPer,
    /// How the lengths of the steps are chosen.
    pub step_rule: StepRule,
    /// How the progenitor is integrated.
    pub orbit: OrbitMethod,
    /// Number of steps of the progenitor's orbit; with adaptive steps, four times the number of blocks of the age that are divided until
    /// the phase of each step is at most three quarters of `step_phase`.
    pub orbit_steps: usize,
    /// Largest phase of an adaptive step, radians (docs/physics.md, section 3). The error grows with its fourth power.
    pub step_phase: f64,
    /// How often the longest adaptive step is halved to make the shortest. A system whose progenitor would need shorter steps is rejected,
    /// because the time to compute it would have no bound.
    pub max_halvings: u8,
    /// The precision of the particles' integration.
    pub precision: Precision,
}

impl Default for ModelSettings {
    fn default() -> Self {
        Self {
            halo: HaloKind::default(),
            baryons: BaryonSettings::default(),
            mass_loss: None,
            release_rate: ReleaseRate::default(),
            dynamical_friction: false,
            releases: TableSettings::default(),
            steps: 8,
            steps_per: StepsPer::default(),
            step_rule: StepRule::default(),
            orbit: OrbitMethod::default(),
            orbit_steps: 64,
            step_phase: 0.85,
            max_halvings: 7,
            precision: Precision::Single,
        }
    }
}

impl ModelSettings {
    /// The host in words: the kind of halo, and with it a disc and a bulge, and how the progenitor loses mass and stars.
    #[must_use]
    pub fn host_in_words(&self) -> String {
        let with = match (self.baryons.disc.is_some(), self.baryons.bulge.is_some()) {
            (false, false) => "",
            (true, false) => " with a disc",
            (false, true) => " with a bulge",
            (true, true) => " with a disc and a bulge",
        };
        let mut words = format!("{}{with}", self.halo);
        if let Some(law) = self.mass_loss {
            words.push_str(", ");
            words.push_str(law.in_words());
        }
        if !self.release_rate.is_even() {
            words.push_str(", stars leaving at the tidal rate");
        }
        if self.dynamical_friction {
            words.push_str(", dynamical friction");
        }
        words
    }

    /// Whether halo, disc and bulge, mass loss, release rate and friction are those of other settings.
    #[must_use]
    pub fn has_host_of(&self, other: &Self) -> bool {
        self.with_host_of(other) == *self
    }

    /// These settings with halo, disc and bulge, mass loss, release rate and friction of others.
    #[must_use]
    pub fn with_host_of(self, other: &Self) -> Self {
        Self {
            halo: other.halo,
            baryons: other.baryons,
            mass_loss: other.mass_loss,
            release_rate: other.release_rate,
            dynamical_friction: other.dynamical_friction,
            ..self
        }
    }

    /// The mass of the progenitor over time in hosts of this kind, by the parameter of the law: constant in one that is no galaxy, whose kernels
    /// have it so.
    pub(super) fn mass_over_time<S, H: Host>(&self, parameter: S) -> MassOverTime<S> {
        MassOverTime {
            law: self.mass_loss.filter(|_| H::IS_GALAXY),
            parameter,
        }
    }

    /// Checks that a prior has the parameters of the host, and no others of hosts.
    ///
    /// # Errors
    /// [`Error::Setting`](crate::Error::Setting) with the first parameter that lacks a value or a distribution, or that has one in vain.
    pub fn check_prior(&self, prior: &StreamPrior) -> Result<()> {
        self.baryons.check_prior(prior)?;
        second_axis::check_prior(self.halo, prior)?;
        mass_loss::check_prior(self.mass_loss, prior)?;
        release_rate::check_prior(self.release_rate, prior)?;
        friction::check_prior(self.dynamical_friction, prior)
    }

    /// Checks a prior that parameters are drawn from: as [`check_prior`](Self::check_prior), and its distributions suit the halo.
    ///
    /// # Errors
    /// Those of `check_prior`; [`Error::Setting`](crate::Error::Setting) if the mass of a logarithmic halo has the default distribution, which is
    /// that of NFW haloes.
    pub fn check_distributions(&self, prior: &StreamPrior) -> Result<()> {
        self.check_prior(prior)?;
        if self.halo == HaloKind::Logarithmic {
            prior.check_not_default(
                "log10_m_halo",
                "the default, which is that of NFW haloes",
                "a logarithmic halo has the circular velocity v0, v0^2 = G M / R_s, and most masses of this default would make it faster than \
                 500 km/s: give a distribution, such as { kind = \"uniform\", lo = 10, hi = 12.5 }",
            )?;
        }
        Ok(())
    }

    /// Checks that every number, those of the releases too, is in its range of docs/limits.md.
    ///
    /// # Errors
    /// [`Error::OutOfRange`](crate::Error::OutOfRange) with the first one that is out of its range.
    pub fn check(&self) -> Result<()> {
        self.baryons.check()?;
        self.releases.check()?;
        in_range("model.steps", self.steps, 1..=100_000)?;
        in_range("model.orbit_steps", self.orbit_steps, 1..=100_000)?;
        in_range("model.step_phase", self.step_phase, 0.01..=10.0)?;
        in_range("model.max_halvings", self.max_halvings, 0..=16)?;
        Ok(())
    }
}
