//! Settings of a nested run.

use crate::error::{Error, Result};
use serde::{Deserialize, Serialize};

/// How a new point above the contour is found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kernel {
    /// [`Uniform`](Self::Uniform) below ten parameters, [`Differential`](Self::Differential) from ten on.
    #[default]
    Auto,
    /// Independent draws from the bound.
    Uniform,
    /// Slices along random directions of the local ellipsoid (hit and run).
    RandomSlice,
    /// Slices, half of them along the difference of two live points, half along random directions of the local ellipsoid.
    Differential,
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

    /// Steps per new point if the user gives none: `(3 + d) / 2` slices, from 15 parameters on `d^2 / 22`; `(3 + d) / 3` trajectories; 25 walk
    /// steps, from 12 parameters on `2 + 2 d`. In 30 dimensions `(3 + d) / 2` slices give a ln Z too high by 1.2 errors where no check
    /// says so (`cargo test -p oblate-samplers --release --test campaign -- --ignored nested`).
    #[must_use]
    pub fn default_steps(self, dim: usize) -> usize {
        match self.resolve(dim) {
            Self::RandomWalk => (2 + 2 * dim).max(25),
            Self::RandomSlice | Self::Differential => (3 + dim).div_ceil(2).max(dim * dim / 22),
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
    /// Effective draws (Kish) that a dynamic run goes on for: it adds batches of live points where they reduce the error most, as
    /// long as there are fewer. None: no such target.
    pub target_ess: Option<f64>,
    /// Error of ln Z that a dynamic run goes on for. None: no such target.
    pub target_ln_z_error: Option<f64>,
    /// What added live points aim at: 1, the posterior; 0, the evidence; a mix between. Of two targets the one that is left
    /// alone counts once the other is met.
    pub posterior_fraction: f64,
    /// Fraction of the live points replaced in one iteration.
    pub replaced_fraction: f64,
    /// How new points are found.
    pub kernel: Kernel,
    /// Slice updates, trajectories or walk steps per new point. None: [`Kernel::default_steps`], raised during a run if new
    /// points resemble their seeds. Where modes are many and narrow, few steps and many live points find more of them for the same calls.
    pub steps: Option<usize>,
    /// Simulations of the unknown prior volumes, for the error of ln Z.
    pub simulations: usize,
    /// Bootstraps over recent lineages of points, for the error of ln Z.
    pub bootstraps: usize,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            n_live: 500,
            dlnz: 0.01,
            target_ess: None,
            target_ln_z_error: None,
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
    /// Checks the ranges for a run of `dim` parameters.
    ///
    /// # Errors
    /// [`Error::Setting`] names the first one that is out of its range.
    pub fn check(&self, dim: usize) -> Result<()> {
        let refuse = |name, value: String, remedy| {
            Err(Error::Setting {
                name,
                value,
                remedy,
            })
        };
        if self.n_live < 4 * dim + 4 || self.n_live > 10_000_000 {
            return refuse(
                "n_live",
                self.n_live.to_string(),
                "give at least four per parameter and four more, better 25 per parameter, and at most ten million",
            );
        }
        if !(self.dlnz > 0.0 && self.dlnz.is_finite()) {
            return refuse(
                "dlnz",
                self.dlnz.to_string(),
                "give a small number above 0, as 0.01",
            );
        }
        for (name, target) in [
            ("target_ess", self.target_ess),
            ("target_ln_z_error", self.target_ln_z_error),
        ] {
            if let Some(value) = target
                && !(value > 0.0 && value.is_finite())
            {
                return refuse(
                    name,
                    value.to_string(),
                    "give a number above 0, or leave it out",
                );
            }
        }
        if !(0.0..=1.0).contains(&self.posterior_fraction) {
            return refuse(
                "posterior_fraction",
                self.posterior_fraction.to_string(),
                "give a number from 0, the evidence, to 1, the posterior",
            );
        }
        // Points at the peak alone never bring the volumes above it nearer.
        if self.target_ln_z_error.is_some() && self.posterior_fraction >= 1.0 {
            return refuse(
                "posterior_fraction",
                self.posterior_fraction.to_string(),
                "give less than 1 with `target_ln_z_error`, better 0",
            );
        }
        if !(self.replaced_fraction > 0.0 && self.replaced_fraction <= 0.5) {
            return refuse(
                "replaced_fraction",
                self.replaced_fraction.to_string(),
                "give a fraction above 0 and up to 0.5",
            );
        }
        if self.steps == Some(0) {
            return refuse("steps", "0".to_owned(), "give at least 1, or leave it out");
        }
        for (name, value) in [
            ("simulations", self.simulations),
            ("bootstraps", self.bootstraps),
        ] {
            if value < 20 {
                return refuse(
                    name,
                    value.to_string(),
                    "give at least 20, better a few hundred",
                );
            }
        }
        Ok(())
    }

    /// Whether live points are added until a target is met.
    pub(super) fn dynamic(&self) -> bool {
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
    fn settings_out_of_range_are_refused_by_name() {
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
        assert_eq!(name(&|s| s.dlnz = f64::NAN), "dlnz");
        assert_eq!(name(&|s| s.replaced_fraction = 0.6), "replaced_fraction");
        assert_eq!(name(&|s| s.target_ess = Some(0.0)), "target_ess");
        let nan = Some(f64::NAN);
        assert_eq!(name(&|s| s.target_ln_z_error = nan), "target_ln_z_error");
        assert_eq!(name(&|s| s.posterior_fraction = 1.1), "posterior_fraction");
        let peak_alone = |s: &mut Settings| {
            s.target_ln_z_error = Some(0.1);
            s.posterior_fraction = 1.0;
        };
        assert_eq!(name(&peak_alone), "posterior_fraction");
        assert_eq!(name(&|s| s.steps = Some(0)), "steps");
        assert_eq!(name(&|s| s.bootstraps = 3), "bootstraps");
    }
}
