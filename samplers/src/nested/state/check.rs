//! Whether a state that was read from a checkpoint is one that this run can have come to.

use super::super::dynamic::LikelihoodRange;
use super::super::live::{REJECTED, narrow};
use super::super::settings::Kernel;
use super::{Context, State};
use crate::valid::{Valid, countable, ensure};

impl State {
    /// Checks all that the next iteration, the next batch and the result rely on.
    pub fn check(&self, context: &Context<'_>) -> Valid {
        let dim = context.target.dim();
        self.live.check(dim, self.begun, self.begun_recent)?;
        self.dead.check(dim, self.begun, self.begun_recent)?;
        self.check_births()?;
        // An iteration or a batch makes at least one point dead, and begins recent lineages at most once.
        ensure(
            self.iteration <= self.dead.len() as u64,
            "more iterations than points that have died",
        )?;
        let most = |each: usize| (self.iteration + 1).saturating_mul(each as u64);
        ensure(
            u64::from(self.begun_recent) <= most(context.recent_lineages())
                && self.begun_recent < u32::MAX / 2,
            "more recent lineages than iterations can have begun",
        )?;
        let batches = narrow(self.batches).saturating_mul(narrow(context.lineages()));
        ensure(
            self.begun >= narrow(context.lineages()) && self.begun <= batches,
            "more lineages than batches can have begun",
        )?;
        ensure(
            self.ln_x.is_finite() && self.ln_x <= 0.0 && self.ln_x_at_fit <= 0.0,
            "a prior volume is above 1 or none",
        )?;
        ensure(
            self.ln_z < f64::INFINITY,
            "the evidence is infinite or not a number",
        )?;
        self.check_batches(context)?;
        self.check_bounds(context)?;
        self.tuning.check(
            self.ranks.len(),
            context.first_steps(),
            context.most_steps(),
        )?;
        self.ranks.check()?;
        self.learner.check(dim, context.target.feature_count())?;
        self.cost.check()?;
        let counts = [self.next_point, self.bounded_points, self.bounded_calls];
        ensure(countable(counts), "a count is too large")
    }

    /// Every point is a draw of the prior, or was born when another one died.
    fn check_births(&self) -> Valid {
        let mut deaths = self.dead.ln_l.clone();
        deaths.sort_by(f64::total_cmp);
        let known = |birth: &f64| {
            *birth == f64::NEG_INFINITY
                || deaths
                    .binary_search_by(|death| death.total_cmp(birth))
                    .is_ok()
        };
        ensure(
            self.live.birth.iter().chain(&self.dead.birth).all(known),
            "a point was born at a contour where none has died",
        )
    }

    fn check_batches(&self, context: &Context<'_>) -> Valid {
        ensure(
            (self.batches > 1) == self.range.is_some()
                && self.range.is_some() == self.left.is_some(),
            "the number of batches and their likelihood bounds do not belong together",
        )?;
        // A bound that no point can pass would never end the batch.
        let possible = |range: &LikelihoodRange| {
            range.floor < f64::INFINITY
                && range.ceiling < f64::INFINITY
                && range.ln_x.is_finite()
                && range.ln_x <= 0.0
        };
        ensure(
            self.range.iter().all(possible),
            "the likelihood bounds of a batch are infinite or not numbers",
        )?;
        ensure(
            self.batches >= 1 && countable([self.batches as u64]),
            "the number of batches is zero or too large",
        )?;
        if !self.started {
            return ensure(
                self.dead.len() == 0 && self.batches == 1,
                "points have died before the first were drawn",
            );
        }
        // So the lowest points can die and others remain, as long as the batch is not at its end.
        ensure(
            self.live.len() >= context.settings.n_live
                && (self.range.is_some() || self.live.best() > REJECTED),
            "too few live points",
        )
    }

    fn check_bounds(&self, context: &Context<'_>) -> Valid {
        let count = if context.kernel() == Kernel::Uniform {
            1
        } else {
            2
        };
        ensure(
            self.bounds.is_empty() || self.bounds.len() == count,
            "another number of bounds than the kernel has",
        )?;
        self.bounds
            .iter()
            .try_for_each(|bound| bound.check(context.target.dim()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A change to a state.
    type Damage<'a> = &'a dyn Fn(&mut State);
    use crate::nested::live::Genealogy;
    use crate::nested::settings::Settings;
    use crate::target::{Marginal, Outcome, Prior, Target};

    struct Bell(Prior);

    impl Target for Bell {
        fn prior(&self) -> &Prior {
            &self.0
        }
        fn ln_likelihood(&self, theta: &[f64]) -> Outcome {
            Outcome::Value(-20.0 * theta.iter().map(|x| (x - 0.4).powi(2)).sum::<f64>())
        }
    }

    /// What is wrong with a state of 25 iterations that something was done to.
    fn fault(kernel: Kernel, damage: impl Fn(&mut State)) -> Option<&'static str> {
        let unit = Marginal::Uniform { lo: 0.0, hi: 1.0 };
        let target = Bell(Prior::new(["x", "y"].map(|name| (name, "", unit))).unwrap());
        let settings = Settings {
            n_live: 40,
            kernel,
            ..Settings::default()
        };
        let context = Context {
            target: &target,
            settings: &settings,
            seed: 1,
        };
        let mut state = State::new(&context);
        for replacement in 0..25 {
            assert_eq!(state.check(&context), Ok(()), "{replacement}");
            state.advance(&context).unwrap();
        }
        damage(&mut state);
        state.check(&context).err()
    }

    #[test]
    fn a_state_of_a_run_is_sound_and_a_forged_one_is_refused() {
        for kernel in [Kernel::Uniform, Kernel::Differential] {
            assert_eq!(fault(kernel, |_| ()), None);
        }
        let range = |ceiling: f64| LikelihoodRange {
            floor: f64::NEG_INFINITY,
            ceiling,
            ln_x: 0.0,
        };
        let with_range = |s: &mut State, ceiling: f64| {
            (s.batches, s.range, s.left) = (2, Some(range(ceiling)), Some(0.0));
        };
        let damages: [(Damage<'_>, &str); 19] = [
            (&|s| with_range(s, f64::INFINITY), "bounds of a batch"),
            (&|s| with_range(s, f64::NAN), "bounds of a batch"),
            (&|s| s.live.ln_l.truncate(3), "other numbers"),
            (&|s| s.live = s.live.select(&[]), "too few live points"),
            (&|s| s.live.ln_l[3] = f64::NAN, "not finite"),
            (&|s| s.dead.ln_l[0] = f64::INFINITY, "not finite"),
            (
                &|s| s.live.birth[3] = s.live.ln_l[3],
                "not above the likelihood bound",
            ),
            (&|s| s.live.birth[3] -= 1e-3, "none has died"),
            (
                &|s| s.live.genealogy[0] = Genealogy::from(u32::MAX),
                "does not exist",
            ),
            (&|s| s.begun_recent = u32::MAX, "more recent lineages"),
            (&|s| s.begun = u32::MAX, "more lineages"),
            (&|s| s.iteration = u64::MAX, "more iterations"),
            (&|s| s.ln_x = f64::NAN, "prior volume"),
            (&|s| s.ln_z = f64::INFINITY, "evidence"),
            (&|s| s.left = Some(1.0), "batches"),
            (&|s| s.started = false, "before the first"),
            (&|s| drop(s.bounds.pop()), "bounds"),
            (&|s| s.tuning.steps = usize::MAX, "number of steps"),
            (&|s| s.cost.calls = u64::MAX, "count is too large"),
        ];
        for (damage, expected) in damages {
            let found = fault(Kernel::Differential, damage);
            assert!(
                found.is_some_and(|f| f.contains(expected)),
                "{expected}: {found:?}"
            );
        }
    }
}
