//! The particles of a bridge and how they are moved.

use super::Settings;
use super::between::{Between, Both};
use crate::diagnostics::effective_kinds;
use crate::difference_pool::DifferencePool;
use crate::error::{Error, Result};
use crate::hmc::{Evaluator, Metric, Point, slice_updates, try_involutions};
use crate::output::{Calls, Cost, Run};
use crate::rng::{Domain, stream, unit_open};
use crate::smc_weights::{SmcWeights, after_step};
use crate::target::{Symmetry, Target};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Index, within a step, of the random stream of the resampling.
const RESAMPLING: u64 = u64::MAX;

/// One SMC particle.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Particle {
    pub(super) z: Vec<f64>,
    pub(super) both: Both,
    /// Eve index: the row of the parent's draws from which it descends.
    pub(super) eve: usize,
    /// Cluster of dependent draws to which that row belongs.
    pub(super) lineage: u32,
}

/// One step of the bridge.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Level {
    pub(super) fraction: f64,
    /// ln Z here minus that of the coarse run.
    pub(super) ln_ratio: f64,
    /// Effective number of ancestors.
    pub(super) ancestors: f64,
    /// Correlation of `ln L_fine - ln L_coarse` before and after the slice updates.
    pub(super) correlation: f64,
}

/// The particles and the exponent reached: what a checkpoint holds.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct State {
    pub(super) fraction: f64,
    pub(super) ln_ratio: f64,
    pub(super) particles: Vec<Particle>,
    /// MCMC steps done at this exponent; none are due at 0.
    pub(super) mcmc_steps: usize,
    /// `ln L_fine - ln L_coarse` of every SMC particle before these MCMC steps.
    pub(super) gaps_before: Vec<f64>,
    /// Metrics for particles of even and of odd lineages; `pools` likewise.
    pub(super) metrics: Vec<Metric>,
    pub(super) pools: Vec<DifferencePool>,
    pub(super) levels: Vec<Level>,
    pub(super) cost: Cost,
}

impl State {
    /// `ln L_fine - ln L_coarse` of every SMC particle.
    fn gaps(&self) -> Vec<f64> {
        self.particles.iter().map(|m| m.both.gap()).collect()
    }

    /// Coordinates of the SMC particles of even (0) or odd (1) lineages; of all SMC particles where there are no such
    /// lineages.
    fn rows(&self, parity: u32) -> Vec<f64> {
        let of = |own: &dyn Fn(&Particle) -> bool| -> Vec<f64> {
            let particles = self.particles.iter().filter(|m| own(m));
            particles.flat_map(|m| m.z.iter().copied()).collect()
        };
        let half = of(&|m| m.lineage % 2 == parity);
        if half.is_empty() { of(&|_| true) } else { half }
    }
}

/// A bridge in progress.
pub(super) struct Bridge<'a> {
    pub(super) target: &'a dyn Target,
    pub(super) coarse: &'a dyn Target,
    pub(super) settings: &'a Settings,
    pub(super) seed: u64,
    pub(super) state: State,
}

impl Bridge<'_> {
    /// Whether the last MCMC step at the fine likelihood is done.
    pub(super) fn finished(&self) -> bool {
        self.state.fraction >= 1.0 && self.state.mcmc_steps == self.settings.mcmc_steps
    }

    /// Resamples draws of the parent to equal weights and computes their fine likelihood.
    pub(super) fn begin(&mut self, parent: &Run) -> Result<()> {
        let draws = &parent.draws;
        let grouped = draws.cluster.iter().any(|g| *g != draws.cluster[0]);
        let offset = unit_open(&mut stream(self.seed, Domain::Bridge, 0, RESAMPLING));
        let mut particles = Vec::new();
        for row in draws.resample(self.settings.smc_particles, offset) {
            let mut z = vec![0.0; draws.dim];
            let prior = self.target.prior();
            prior.z_from_theta(draws.theta_row(row), &mut z);
            // Rounding can put a draw on the bound of its prior, where it has no coordinates.
            if z.iter().all(|z| z.is_finite()) {
                particles.push(Particle {
                    z,
                    both: Both {
                        coarse: draws.ln_likelihood[row],
                        fine: f64::NEG_INFINITY,
                    },
                    eve: row,
                    lineage: if grouped {
                        draws.cluster[row]
                    } else {
                        u32::try_from(row).unwrap_or(u32::MAX)
                    },
                });
            }
        }
        let mut evaluator = Evaluator::new(self.target);
        let places: Vec<&[f64]> = particles.iter().map(|m| m.z.as_slice()).collect();
        let fine = evaluator.values(&places)?;
        if fine.iter().all(|l| *l == f64::NEG_INFINITY) {
            return Err(Error::NoCommonSupport);
        }
        for (particle, fine) in particles.iter_mut().zip(fine) {
            particle.both.fine = fine;
        }
        self.state.cost.count(&evaluator.calls);
        self.state.particles = particles;
        self.state.mcmc_steps = self.settings.mcmc_steps;
        Ok(())
    }

    /// One MCMC step of every particle, after a step of the exponent where one is due. On an error no particle has
    /// moved, and the same MCMC step can be repeated.
    pub(super) fn advance(&mut self) -> Result<()> {
        if self.state.mcmc_steps == self.settings.mcmc_steps {
            self.step()?;
        }
        self.mcmc_step()?;
        let state = &mut self.state;
        state.mcmc_steps += 1;
        if state.mcmc_steps == self.settings.mcmc_steps {
            let level = Level {
                fraction: state.fraction,
                ln_ratio: state.ln_ratio,
                ancestors: effective_kinds(state.particles.iter().map(|m| m.eve)),
                correlation: correlation(&state.gaps_before, &state.gaps()),
            };
            state.levels.push(level);
        }
        Ok(())
    }

    /// Number of the present step, from 1 on.
    fn level(&self) -> u64 {
        self.state.levels.len() as u64 + 1
    }

    /// Reweights and resamples.
    ///
    /// # Errors
    /// As of [`after_step`], before anything has changed.
    fn step(&mut self) -> Result<()> {
        let level = self.level();
        let state = &mut self.state;
        let smc_weights = SmcWeights::new(state.gaps());
        let left = 1.0 - state.fraction;
        let step = smc_weights.longest_step(left);
        state.fraction = after_step(state.fraction, step, state.levels.len() + 1)?;
        state.ln_ratio += smc_weights.ln_mean_weight(step);
        let uniform = unit_open(&mut stream(self.seed, Domain::Bridge, level, RESAMPLING));
        let drawn = smc_weights.resample(step, uniform).into_iter();
        state.particles = drawn.map(|i| state.particles[i].clone()).collect();
        state.mcmc_steps = 0;
        state.gaps_before = state.gaps();
        let dim = self.target.dim();
        let orbit = Symmetry::first_orbit(self.target.symmetries());
        let others = [1, 0].map(|parity| state.rows(parity));
        state.metrics = others
            .iter()
            .map(|rows| Metric::of_rows(rows, dim))
            .collect();
        state.pools = others
            .iter()
            .map(|rows| DifferencePool::new(rows, dim, orbit))
            .collect();
        Ok(())
    }

    /// One slice update of every particle at the present exponent; in the first MCMC step there also the target's
    /// involutions.
    fn mcmc_step(&mut self) -> Result<()> {
        let state = &self.state;
        let fraction = state.fraction;
        let (level, mcmc_step) = (self.level(), state.mcmc_steps as u64);
        let moved: Vec<Result<(Particle, Calls)>> = (0..state.particles.len())
            .into_par_iter()
            .map(|i| {
                let mut particle = state.particles[i].clone();
                let task = level << 32 | mcmc_step;
                let mut rng = stream(self.seed, Domain::Bridge, task, i as u64);
                let half = (particle.lineage % 2) as usize;
                let mut point = Point::new(self.target.dim());
                point.z.clone_from(&particle.z);
                let between = Between::new(self.coarse, self.target, fraction);
                let (metric, pool) = (&state.metrics[half], &state.pools[half]);
                let calls =
                    between.explore(&mut point, &mut particle.both, |evaluator, point| {
                        if mcmc_step == 0 {
                            try_involutions(evaluator, 1.0, point, &mut rng)?;
                        }
                        slice_updates(evaluator, 1.0, metric, pool, 1, point, &mut rng, |_| ())
                    })?;
                particle.z = point.z;
                Ok((particle, calls))
            })
            .collect();
        let moved: Vec<(Particle, Calls)> = moved.into_iter().collect::<Result<_>>()?;
        let (particles, calls): (Vec<Particle>, Vec<Calls>) = moved.into_iter().unzip();
        self.state.particles = particles;
        calls.iter().for_each(|calls| self.state.cost.count(calls));
        Ok(())
    }
}

/// Pearson's; 0 where one of the two does not vary.
fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let mean = |x: &[f64]| x.iter().sum::<f64>() / x.len() as f64;
    let (ma, mb) = (mean(a), mean(b));
    let sum = |f: &dyn Fn(f64, f64) -> f64| -> f64 {
        a.iter().zip(b).map(|(x, y)| f(x - ma, y - mb)).sum()
    };
    let scale = (sum(&|x, _| x * x) * sum(&|_, y| y * y)).sqrt();
    if scale > 0.0 {
        sum(&|x, y| x * y) / scale
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_that_rise_together_are_correlated() {
        assert!((correlation(&[1.0, 2.0, 3.0], &[2.0, 4.0, 6.0]) - 1.0).abs() < 1e-12);
        assert!(correlation(&[1.0, 1.0], &[2.0, 4.0]).abs() < 1e-12);
    }
}
