//! Settings of a nested run.

use crate::error::{Error, Result};
use crate::limits::{Memory, in_range};
use crate::output::MIN_ESS;
use serde::{Deserialize, Serialize};

/// Dead points per live point of a whole run: the natural logarithm by which the prior volume shrinks. A posterior of 13 parameters
/// needs about 40.
const NATS: f64 = 64.0;

/// Memory per point when the result is put together: its coordinates in the run, in the copy that is weighed, as physical parameters,
/// and as draws.
const BYTES_PER_COORDINATE: f64 = 5.0 * 8.0;

/// The same of everything else: likelihoods, births, orders, genealogy, ranks, weights, derived quantities and history.
const BYTES_PER_POINT: f64 = 50.0 * 8.0;

/// Largest number of values that a surrogate learns from. Some of every age stay: with the last ones alone the surrogate forgets how deep ln L
/// is elsewhere, and trajectories are lost there (docs/decisions.md, section 5).
pub(super) const EXAMPLES_KEPT: usize = 120_000;

/// How a new point above the likelihood bound is found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kernel {
    /// [`Uniform`](Self::Uniform) below ten parameters, [`Differential`](Self::Differential) from ten on.
    #[default]
    Auto,
    /// Independent draws from the ellipsoids.
    Uniform,
    /// Slice updates along random directions of the local ellipsoid (hit and run).
    RandomSlice,
    /// Slice updates, half of them along the difference of two live points (differential evolution), half along random directions
    /// of the local ellipsoid.
    Differential,
    /// As [`Differential`](Self::Differential) at first; trajectories along a surrogate of ln L, which learns from the values of the run, and
    /// draws of a mixture fitted to the live points and screened by the surrogate, beside few slice updates as soon as they are accepted.
    Surrogate,
    /// Metropolis steps in the metric of the local ellipsoid.
    RandomWalk,
    /// Galilean Monte Carlo: straight trajectories in the metric of the local ellipsoid, reflected at the likelihood bound
    /// by the gradient of ln L; for targets that have one.
    Galilean,
}

impl Kernel {
    /// The kernel that `Auto` stands for with `dim` parameters; any other one is itself.
    #[must_use]
    pub fn resolve(self, dim: usize) -> Self {
        match self {
            Self::Auto if dim < 10 => Self::Uniform,
            Self::Auto => Self::Differential,
            other => other,
        }
    }

    /// Steps per new point if the settings have none: `(3 + d) / 2` slice updates, from 15 parameters on `d^2 / 22`;
    /// `(3 + d) / 3` Galilean Monte Carlo trajectories; 25 walk steps, from 12 parameters on `2 + 2 d`.
    /// docs/targets.md, section 1, has the bias with fewer steps.
    #[must_use]
    pub fn default_steps(self, dim: usize) -> usize {
        match self.resolve(dim) {
            Self::RandomWalk => (2 + 2 * dim).max(25),
            Self::RandomSlice | Self::Differential | Self::Surrogate => {
                (3 + dim).div_ceil(2).max(dim * dim / 22)
            }
            Self::Galilean => (3 + dim).div_ceil(3),
            Self::Auto | Self::Uniform => 1,
        }
    }
}

/// Settings of a nested run: static, or dynamic if it has a target.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// Number of live points; the error of ln Z falls as its square root.
    pub n_live: usize,
    /// The run ends when the live points could raise ln Z by less than this.
    pub dlnz: f64,
    /// Effective sample size, the smallest of bulk and tails, that a dynamic run aims at: while it is smaller, or the draws have too few
    /// ancestors for it to be reliable, batches of live points are added where they reduce the errors most. None: no such target.
    pub target_ess: Option<f64>,
    /// Error of ln Z that a dynamic run aims at. None: no such target.
    pub target_ln_z_error: Option<f64>,
    /// Largest number of batches of a dynamic run, the first one included. A run that has ended with fewer goes on if it is resumed with more.
    pub max_batches: usize,
    /// What added live points improve: 1, the posterior; 0, the evidence; between, both with these weights. Where only the error of ln Z is not yet as
    /// small as its target it counts as 0, and where of two targets only the effective sample size is not met as 1.
    pub posterior_fraction: f64,
    /// Fraction of the live points replaced in one iteration.
    pub replaced_fraction: f64,
    /// How new points are found.
    pub kernel: Kernel,
    /// Slice updates, trajectories or walk steps per new point. None: [`Kernel::default_steps`], raised during a run if
    /// new points depend on their seeds. Where modes are many and narrow, few steps and many live points find more of
    /// them for the same calls.
    pub steps: Option<usize>,
    /// Simulations of the unknown prior volumes, for the error of ln Z.
    pub simulations: usize,
    /// Bootstraps over recent lineages, for the error of ln Z.
    pub bootstraps: usize,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            n_live: 500,
            dlnz: 0.01,
            target_ess: None,
            target_ln_z_error: None,
            max_batches: 20,
            posterior_fraction: 0.8,
            replaced_fraction: 0.1,
            kernel: Kernel::Auto,
            steps: None,
            simulations: 400,
            bootstraps: 200,
        }
    }
}

impl Settings {
    /// Maximum number of batches: with a hundred lineages each, labels of lineages have 16 bits.
    pub const MAX_BATCHES: usize = 640;

    /// Effective sample size that the checks want: 400, or the target where that is smaller.
    #[must_use]
    pub(super) fn min_ess(&self) -> f64 {
        self.target_ess.unwrap_or(MIN_ESS).min(MIN_ESS)
    }

    /// Checks every number by itself: the ranges of docs/limits.md.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] names the first one that is out of its range.
    pub fn check_ranges(&self) -> Result<()> {
        in_range("n_live", self.n_live, 8..=1_000_000)?;
        in_range("dlnz", self.dlnz, 1e-6..=100.0)?;
        if let Some(target) = self.target_ess {
            in_range("target_ess", target, 1.0..=1e7)?;
        }
        if let Some(target) = self.target_ln_z_error {
            in_range("target_ln_z_error", target, 1e-4..=100.0)?;
        }
        in_range("max_batches", self.max_batches, 1..=Self::MAX_BATCHES)?;
        in_range("posterior_fraction", self.posterior_fraction, 0.0..=1.0)?;
        in_range("replaced_fraction", self.replaced_fraction, 1e-6..=0.5)?;
        if let Some(steps) = self.steps {
            in_range("steps", steps, 1..=10_000)?;
        }
        in_range("simulations", self.simulations, 20..=100_000)?;
        in_range("bootstraps", self.bootstraps, 20..=100_000)?;
        Ok(())
    }

    /// Checks whether a run of `dim` parameters can work with these numbers.
    ///
    /// # Errors
    /// As of [`check_ranges`](Self::check_ranges); [`Error::Setting`] for numbers that do not go together;
    /// [`Error::TooMuchMemory`] by the estimate of [`memory`](Self::memory).
    pub fn check(&self, dim: usize) -> Result<()> {
        self.check_ranges()?;
        let least = 4 * dim + 4;
        if self.n_live < least {
            return Err(Error::Setting {
                name: "n_live",
                value: self.n_live.to_string(),
                remedy: "give at least four per parameter and four more, better 25 per parameter",
            });
        }
        self.memory(dim).check()?;
        Ok(())
    }

    /// An estimate of the memory of a run of `dim` parameters: its points at the end, and what is computed of them, `NATS` points per live
    /// point of every batch. Batches that do not begin with the prior have fewer.
    #[must_use]
    pub fn memory(&self, dim: usize) -> Memory {
        let point = BYTES_PER_POINT + BYTES_PER_COORDINATE * dim as f64;
        let mut memory = Memory::default().with("n_live", point * NATS * self.n_live as f64);
        if self.kernel == Kernel::Surrogate {
            // Examples in single precision as kept, twice while they are chosen, and in the network's units; as many residuals as
            // coordinates twice.
            memory = memory.with("kernel", 20.0 * EXAMPLES_KEPT as f64 * 3.0 * dim as f64);
        }
        if self.dynamic() {
            let further = point * NATS * self.n_live as f64 * (self.max_batches - 1) as f64;
            memory = memory.with("max_batches", further);
        }
        memory
    }

    /// Whether live points are added until a target is met.
    #[must_use]
    pub fn dynamic(&self) -> bool {
        self.target_ess.is_some() || self.target_ln_z_error.is_some()
    }

    /// Points replaced in one iteration.
    pub(super) fn replaced_count(&self) -> usize {
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a fraction of a checked count"
        )]
        let size = (self.replaced_fraction * self.n_live as f64) as usize;
        size.max(1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_that_do_not_go_together_are_refused_by_name() {
        let name = |change: &dyn Fn(&mut Settings)| {
            let mut settings = Settings::default();
            change(&mut settings);
            match settings.check(3) {
                Err(Error::Setting { name, .. }) => name,
                other => panic!("{other:?}"),
            }
        };
        assert!(Settings::default().check(3).is_ok());
        assert_eq!(name(&|s| s.n_live = 15), "n_live");
    }

    #[test]
    fn too_many_points_are_refused_by_name() {
        let key = |change: &dyn Fn(&mut Settings)| {
            let mut settings = Settings::default();
            change(&mut settings);
            match settings.check(13) {
                Err(Error::TooMuchMemory(much)) => much.key,
                other => panic!("{other:?}"),
            }
        };
        assert_eq!(key(&|s| s.n_live = 1_000_000), "n_live");
        let batches = |s: &mut Settings| {
            s.target_ess = Some(1e7);
            (s.n_live, s.max_batches) = (20_000, Settings::MAX_BATCHES);
        };
        assert_eq!(key(&batches), "max_batches");
    }
}
