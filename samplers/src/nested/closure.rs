//! The shortest way in: a closure over the unit cube, or over a prior of one's own.

use super::{Settings, run};
use crate::control::{Control, Silent};
use crate::error::Result;
use crate::output::Run;
use crate::target::{Marginal, Outcome, Prior, Target};

/// A nested run of the log-likelihood `ln_likelihood` of `dim` parameters, each uniform between 0 and 1: to be [`run`](Sample::run)
/// as it is, or changed before. NaN and minus infinity are rejected points.
///
/// ```
/// use oblate_samplers::nested;
///
/// // 1 - x^2 between 0 and 1: its integral is 2/3.
/// let run = nested::sample(|u| (1.0 - u[0] * u[0]).ln(), 1).seed(7).run()?;
/// assert!((run.evidence.ln_z - (2.0_f64 / 3.0).ln()).abs() < 4.0 * run.evidence.error);
/// # Ok::<(), oblate_samplers::Error>(())
/// ```
pub fn sample<F>(ln_likelihood: F, dim: usize) -> Sample<F>
where
    F: Fn(&[f64]) -> f64 + Sync,
{
    Sample {
        ln_likelihood,
        dim,
        prior: None,
        settings: Settings::default(),
        seed: 1,
    }
}

/// A nested run that has not begun; see [`sample`].
#[derive(Clone, Debug)]
pub struct Sample<F> {
    ln_likelihood: F,
    dim: usize,
    prior: Option<Prior>,
    settings: Settings,
    seed: u64,
}

impl<F> Sample<F>
where
    F: Fn(&[f64]) -> f64 + Sync,
{
    /// Another prior, whose parameters the closure is then given; it brings their number and names.
    #[must_use]
    pub fn prior(mut self, prior: Prior) -> Self {
        self.prior = Some(prior);
        self
    }

    /// Other settings.
    #[must_use]
    pub fn settings(mut self, settings: Settings) -> Self {
        self.settings = settings;
        self
    }

    /// Another number of live points.
    #[must_use]
    pub fn live(mut self, n_live: usize) -> Self {
        self.settings.n_live = n_live;
        self
    }

    /// Live points are added until there are so many effective draws.
    #[must_use]
    pub fn until_ess(mut self, target: f64) -> Self {
        self.settings.target_ess = Some(target);
        self
    }

    /// Another seed.
    #[must_use]
    pub fn seed(mut self, seed: u64) -> Self {
        self.seed = seed;
        self
    }

    /// Runs it.
    ///
    /// # Errors
    /// Those of [`nested::run`](run()).
    pub fn run(self) -> Result<Run> {
        self.run_under(&mut Control::new(&mut Silent))
    }

    /// Runs it under a caller's hold: observer, budget, interrupt, checkpoints.
    ///
    /// # Errors
    /// Those of [`nested::run`](run()).
    pub fn run_under(self, control: &mut Control<'_>) -> Result<Run> {
        let prior = match self.prior {
            Some(prior) => prior,
            None => Prior::new((1..=self.dim).map(|i| {
                let unit = Marginal::Uniform { lo: 0.0, hi: 1.0 };
                (format!("x{i}"), "", unit)
            }))?,
        };
        let closure = Closure {
            prior,
            ln_likelihood: self.ln_likelihood,
        };
        run(&closure, &self.settings, self.seed, control)
    }
}

struct Closure<F> {
    prior: Prior,
    ln_likelihood: F,
}

impl<F> Target for Closure<F>
where
    F: Fn(&[f64]) -> f64 + Sync,
{
    fn prior(&self) -> &Prior {
        &self.prior
    }

    fn ln_likelihood(&self, theta: &[f64]) -> Outcome {
        Outcome::from_ln_likelihood((self.ln_likelihood)(theta))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::normal;

    #[test]
    fn a_closure_over_a_prior_of_ones_own_is_sampled() {
        let normal = Marginal::Normal { mean: 0.0, sd: 2.0 };
        let prior = Prior::new([("a", "kpc", normal), ("b", "kpc", normal)]).unwrap();
        let ln_l = |x: &[f64]| normal::ln_pdf(x[0]) + normal::ln_pdf(x[1]);
        let run = sample(ln_l, 2)
            .prior(prior)
            .live(200)
            .seed(3)
            .run()
            .unwrap();
        // A normal of variance 1 against one of variance 4: that of their difference at 0.
        let truth = -(5.0_f64).ln() - 2.0 * normal::LN_SQRT_2PI;
        assert!((run.evidence.ln_z - truth).abs() < 4.0 * run.evidence.error);
        assert_eq!(run.names, ["a", "b"]);
    }

    #[test]
    fn effective_draws_are_added_and_a_cube_without_sides_is_refused() {
        let run = sample(|u| -50.0 * (u[0] - 0.5).powi(2), 1)
            .live(50)
            .until_ess(500.0);
        assert!(run.run().unwrap().ess.kish >= 500.0);
        assert!(sample(|_| 0.0, 0).run().is_err());
    }
}
