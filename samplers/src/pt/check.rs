//! Whether a state that was read from a checkpoint is one that this run can have come to.

use super::Settings;
use super::state::{Chain, State, Temperature};
use crate::hmc::Reference;
use crate::valid::{Valid, countable, ensure, moderate};

impl State {
    /// Checks all that the next scan, the next adaptation and the result rely on. `settings` are those of the run, which may allow
    /// other extensions than the state's own.
    pub(in crate::pt) fn check(
        &self,
        settings: &Settings,
        seed: u64,
        dim: usize,
        features: usize,
    ) -> Valid {
        let own = Settings {
            extensions: settings.extensions,
            ..self.settings.clone()
        };
        ensure(
            own == *settings && self.seed == seed,
            "it has other settings or another seed",
        )?;
        ensure(self.round < settings.rounds, "a round after the last")?;
        let extensions = if self.is_last_round() {
            Settings::MAX_EXTENSIONS
        } else {
            0
        };
        ensure(
            self.extensions <= extensions && self.scan <= self.scans(),
            "more scans than the round has",
        )?;
        ensure(countable([self.clock]), "a count is too large")?;
        self.cost.check()?;
        self.references
            .iter()
            .try_for_each(|r| r.check(dim, features))?;
        self.surrogate.iter().try_for_each(|s| s.check(features))?;
        self.examples.check(features)?;
        let [first, second] = self.references.each_ref().map(Reference::is_prior);
        ensure(
            first == second,
            "annealing paths from the prior and from another reference",
        )?;
        let whole = |rows: &Vec<f64>| rows.len().is_multiple_of(dim) && moderate(rows);
        ensure(
            whole(&self.training),
            "the draws that the references were fitted to have another dimension, or are not finite",
        )?;
        self.check_temperatures(dim)?;
        match &self.smc_samplers {
            Some(smc_samplers) => {
                ensure(
                    self.round == 0 && self.scan == 0 && self.chains.is_empty(),
                    "it has begun before its SMC samplers reached the posterior",
                )?;
                smc_samplers.check(settings, dim)
            }
            None => {
                self.check_chains(dim)?;
                let planned: Vec<(usize, usize)> = if self.is_last_round() {
                    let parts = |extension| {
                        let parts = settings.parts_of_extension(extension);
                        parts.map(move |scans| (extension, scans))
                    };
                    (0..=self.extensions).flat_map(parts).collect()
                } else {
                    vec![(0, settings.scans(self.round))]
                };
                self.record
                    .check(dim, settings, &self.beta(), &planned, self.scan)
            }
        }
    }

    fn check_temperatures(&self, dim: usize) -> Valid {
        let count = self.temperatures.len();
        ensure(
            (self.settings.min_temperatures..=self.settings.max_temperatures).contains(&count),
            "another number of temperatures than the settings allow",
        )?;
        let beta = self.beta();
        ensure(
            beta[0] >= 0.0
                && beta.windows(2).all(|b| b[0] <= b[1])
                && beta[count - 1].to_bits() == 1.0_f64.to_bits(),
            "inverse temperatures that do not rise from 0 to 1",
        )?;
        self.temperatures
            .iter()
            .try_for_each(|temperature: &Temperature| {
                temperature.metric.check(dim)?;
                temperature.step.check()?;
                temperature
                    .pools
                    .iter()
                    .try_for_each(|pool| pool.check(dim))
            })
    }

    /// Every chain set has one state and one replica at each temperature.
    fn check_chains(&self, dim: usize) -> Valid {
        let count = self.temperatures.len();
        ensure(
            self.chains.len() == self.settings.chain_sets * count,
            "another number of states than chain sets and temperatures",
        )?;
        for (number, chain_set) in self.chains.chunks_exact(count).enumerate() {
            let reference = self.reference(number * count);
            let mut seen = vec![false; count];
            for (k, Chain { point, replica }) in chain_set.iter().enumerate() {
                // A state without a likelihood comes from the reference, and is never swapped to a larger beta.
                point.check(dim, reference, k + 1 < count)?;
                let place = seen.get_mut(*replica);
                ensure(
                    place.is_some_and(|seen| !std::mem::replace(seen, true)),
                    "a replica is at two temperatures, or does not exist",
                )?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A change to a state.
    type Damage<'a> = &'a dyn Fn(&mut State);
    use crate::target::{Marginal, Outcome, Prior, Target};

    struct Bell(Prior);

    impl Target for Bell {
        fn prior(&self) -> &Prior {
            &self.0
        }
        fn ln_likelihood(&self, theta: &[f64]) -> Outcome {
            Outcome::Value(-20.0 * theta.iter().map(|x| (x - 0.4).powi(2)).sum::<f64>())
        }
        fn ln_likelihood_and_gradient(&self, theta: &[f64], gradient: &mut [f64]) -> Outcome {
            for (g, x) in gradient.iter_mut().zip(theta) {
                *g = -40.0 * (x - 0.4);
            }
            self.ln_likelihood(theta)
        }
    }

    fn settings() -> Settings {
        Settings {
            chain_sets: 2,
            rounds: 3,
            temperatures: 4,
            min_temperatures: 3,
            max_temperatures: 6,
            smc_particles: 100,
            smc_samplers: 2,
            mcmc_steps: 2,
            slice_updates: 1,
            extensions: 2,
            mixture_rounds: 3,
            surrogate: true,
            hmc_transitions: 0,
            ..Settings::default()
        }
    }

    /// The state after so many scans and MCMC steps, sound at each.
    fn state_after(steps: usize) -> State {
        let unit = Marginal::Uniform { lo: 0.0, hi: 1.0 };
        let target = Bell(Prior::new(["x", "y"].map(|name| (name, "", unit))).unwrap());
        let settings = settings();
        let mut state = State::start(&target, &settings, 1).unwrap();
        for step in 0..steps {
            assert_eq!(state.check(&settings, 1, 2, 2), Ok(()), "{step}");
            if state.finished() {
                let ln_z = state.evidence().ln_z;
                state.go_on(&target, false, ln_z).unwrap();
            }
            state.advance(&target).unwrap();
        }
        state
    }

    /// What is wrong with a state that something was done to.
    fn fault(state: &State, damage: impl Fn(&mut State)) -> Option<&'static str> {
        let mut state = state.clone();
        damage(&mut state);
        state.check(&settings(), 1, 2, 2).err()
    }

    #[test]
    fn a_state_of_a_run_is_sound_and_a_forged_one_is_refused() {
        // Two rounds of 4 and 8 scans after the SMC samplers, the last of 16, and one extension of it.
        let (early, late) = (&state_after(2), &state_after(50));
        assert!(late.extensions > 0);
        assert_eq!(fault(late, |_| ()), None);
        let damages: [(&State, Damage<'_>, &str); 15] = [
            (
                early,
                &|s| s.settings.hmc_transitions += 1,
                "other settings",
            ),
            (early, &|s| s.round = 1, "before its SMC samplers"),
            (
                early,
                &|s| s.smc_samplers = None,
                "another number of states",
            ),
            (late, &|s| s.seed += 1, "another seed"),
            (late, &|s| s.round = 3, "after the last"),
            (late, &|s| s.scan = usize::MAX, "more scans"),
            (late, &|s| s.scan -= 1, "other scans than the round"),
            (late, &|s| s.clock = u64::MAX, "too large"),
            (
                late,
                &|s| s.temperatures.truncate(1),
                "number of temperatures",
            ),
            (late, &|s| s.temperatures[1].beta = f64::NAN, "do not rise"),
            (
                late,
                &|s| s.temperatures[1].metric = crate::hmc::Metric::identity(1),
                "a metric",
            ),
            (late, &|s| drop(s.chains.pop()), "another number of states"),
            (
                late,
                &|s| s.chains[1].replica = s.chains[0].replica,
                "a replica",
            ),
            (
                late,
                &|s| s.chains[1].point.z = Vec::new(),
                "a point has another dimension",
            ),
            (late, &|s| s.training.push(0.0), "fitted to"),
        ];
        for (state, damage, expected) in damages {
            let found = fault(state, damage);
            assert!(
                found.is_some_and(|f| f.contains(expected)),
                "{expected}: {found:?}"
            );
        }
    }
}
