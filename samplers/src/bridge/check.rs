//! Whether a state that was read from a checkpoint is one that this bridge can have come to.

use super::batch::Batch;
use super::particle::Particle;
use super::settings::{FITTED_STEPS, Settings};
use super::state::State;
use crate::hmc::StepSize;
use crate::output::Draws;
use crate::valid::{Valid, countable, ensure, moderate};

impl State {
    /// Checks all that the next MCMC step, the next step and the result rely on; `parent` are the draws that the SMC particles began as.
    pub(super) fn check(
        &self,
        settings: &Settings,
        parent: &Draws,
        dim: usize,
        features: usize,
    ) -> Valid {
        ensure(
            (0.0..=1.0).contains(&self.fraction) && self.ln_ratio.is_finite(),
            "it is not between its two likelihoods",
        )?;
        self.check_batches(settings)?;
        let all = self.particles.iter().chain(&self.waiting);
        all.clone()
            .try_for_each(|particle| particle.check(parent, dim))?;
        let fine = |particle: &Particle| particle.both.fine.is_finite();
        // The first step gives particles without a fine likelihood the weight 0.
        ensure(
            self.particles.iter().any(fine)
                && (self.fraction <= 0.0 || self.particles.iter().all(fine)),
            "an SMC particle has no likelihood",
        )?;
        let most = if self.fraction < 1.0 {
            settings.mcmc_steps
        } else {
            settings.mcmc_steps + settings.further_mcmc_steps
        };
        let moves = self.metrics.len() == 2
            && self.pools.len() == 2
            && self.gaps_before.len() == self.particles.len();
        let steps_next = self.fraction < 1.0 && self.mcmc_steps == settings.mcmc_steps;
        ensure(
            self.mcmc_steps <= most && (moves || steps_next),
            "it has no metric or pool to move by, or too many MCMC steps",
        )?;
        for metric in &self.metrics {
            metric.check(dim)?;
        }
        self.pools.iter().try_for_each(|pool| pool.check(dim))?;
        ensure(
            countable([self.levels.len() as u64]) && self.gaps_before.iter().all(|g| !g.is_nan()),
            "a difference of likelihoods is not a number",
        )?;
        let further = self.mcmc_steps.saturating_sub(settings.mcmc_steps);
        let visits = if self.fraction < 1.0 || self.surrogate.is_none() {
            0
        } else {
            further.min(FITTED_STEPS) * dim
        };
        let whole = [0, 1].iter().zip(&self.visited).all(|(half, rows)| {
            let own = self.particles.iter().filter(|p| p.lineage % 2 == *half);
            rows.len() == visits * own.count() && moderate(rows)
        }) && (self.visited_before.iter())
            .all(|rows| rows.len().is_multiple_of(dim) && moderate(rows));
        ensure(
            whole,
            "the places that its particles have been at are not complete",
        )?;
        self.surrogate.iter().try_for_each(|s| s.check(features))?;
        self.examples.check(features)?;
        self.step.iter().try_for_each(StepSize::check)?;
        self.cost.check()
    }

    /// Each batch has particles, as many as the settings allow at most; those before the present one wait until it is at the fine likelihood.
    fn check_batches(&self, settings: &Settings) -> Valid {
        let allowed = |particles: usize| (1..=settings.smc_particles).contains(&particles);
        let sum = |of: fn(&Batch) -> usize| {
            let mut of_batches = self.batches.iter().map(of);
            of_batches.try_fold(0_usize, |sum, number| sum.checked_add(number))
        };
        let joined = self.fraction >= 1.0 && self.mcmc_steps >= settings.mcmc_steps;
        let sound = |batch: &Batch| allowed(batch.particles) && batch.ln_ratio.is_finite();
        let present = sum(|batch| batch.particles).and_then(|earlier| {
            let waiting = if joined { 0 } else { earlier };
            let present = self.particles.len().checked_sub(earlier - waiting)?;
            (self.waiting.len() == waiting).then_some(present)
        });
        ensure(
            self.batches.iter().all(sound)
                && present.is_some_and(allowed)
                && sum(|batch| batch.levels).is_some_and(|levels| levels <= self.levels.len()),
            "another number of SMC particles than the settings allow",
        )
    }
}

impl Particle {
    fn check(&self, parent: &Draws, dim: usize) -> Valid {
        ensure(
            self.z.len() == dim && moderate(&self.z),
            "an SMC particle has another dimension, or is not finite",
        )?;
        ensure(
            self.both.coarse.is_finite() && self.both.fine < f64::INFINITY,
            "an SMC particle has no likelihood",
        )?;
        ensure(
            self.eve < parent.len(),
            "an SMC particle descends from no draw",
        )
    }
}

#[cfg(test)]
mod tests {
    use super::super::particle::Both;
    use super::super::state::Level;
    use super::*;

    /// A change to a state.
    type Damage<'a> = &'a dyn Fn(&mut State);
    use crate::difference_pool::DifferencePool;
    use crate::hmc::Metric;

    #[test]
    fn a_state_of_a_bridge_is_sound_and_a_forged_one_is_refused() {
        let settings = Settings {
            smc_particles: 30,
            mcmc_steps: 3,
            further_mcmc_steps: 2,
            max_batches: 2,
        };
        let parent = Draws {
            ln_likelihood: vec![-1.0; 50],
            ..Draws::default()
        };
        let particle = |row: usize| Particle {
            z: vec![0.1 * row as f64, 1.0],
            both: Both {
                coarse: -1.0,
                fine: -2.0,
            },
            eve: row,
            lineage: 0,
        };
        let sound = State {
            fraction: 0.5,
            particles: (0..30).map(particle).collect(),
            mcmc_steps: 1,
            gaps_before: vec![-1.0; 30],
            metrics: vec![Metric::identity(2); 2],
            pools: vec![DifferencePool::default(); 2],
            levels: Vec::<Level>::new(),
            ..State::default()
        };
        assert_eq!(sound.check(&settings, &parent, 2, 2), Ok(()));
        let batch = |particles: usize, levels: usize| Batch {
            particles,
            levels,
            ln_ratio: 0.0,
        };
        let damages: [(Damage<'_>, &str); 15] = [
            (&|s| s.fraction = f64::NAN, "between"),
            (&|s| s.particles.clear(), "number of SMC particles"),
            (&|s| s.particles[3].z = vec![0.0; 3], "another dimension"),
            (&|s| s.particles[3].z[0] = f64::INFINITY, "not finite"),
            (
                &|s| s.particles[3].both.fine = f64::NEG_INFINITY,
                "no likelihood",
            ),
            (&|s| s.particles[3].eve = 50, "no draw"),
            (&|s| s.metrics.clear(), "no metric"),
            (&|s| s.mcmc_steps = 4, "too many MCMC steps"),
            (&|s| s.examples.push(&[1.0; 3], 0.0, &[]), "examples"),
            (&|s| s.visited[1] = vec![0.0; 2], "not complete"),
            (&|s| s.cost.calls = u64::MAX, "too large"),
            (
                &|s| s.batches = vec![batch(30, 0)],
                "number of SMC particles",
            ),
            (
                &|s| s.waiting = vec![particle(0)],
                "number of SMC particles",
            ),
            (
                &|s| {
                    s.batches = vec![batch(1, 1)];
                    s.waiting = vec![particle(0)];
                },
                "number of SMC particles",
            ),
            (&|s| s.visited_before[0] = vec![0.0; 3], "not complete"),
        ];
        let second = State {
            batches: vec![batch(1, 0)],
            waiting: vec![particle(0)],
            ..sound.clone()
        };
        assert_eq!(second.check(&settings, &parent, 2, 2), Ok(()));
        let ended = State {
            fraction: 1.0,
            mcmc_steps: 4,
            ..sound.clone()
        };
        assert_eq!(ended.check(&settings, &parent, 2, 2), Ok(()));
        for (damage, expected) in damages {
            let mut state = sound.clone();
            damage(&mut state);
            let found = state.check(&settings, &parent, 2, 2).err();
            assert!(
                found.is_some_and(|f| f.contains(expected)),
                "{expected}: {found:?}"
            );
        }
    }
}
