//! The MCMC moves of one particle of a bridge.

use super::between::Between;
use super::independent::propose;
use super::particle::Particle;
use crate::difference_pool::DifferencePool;
use crate::error::Result;
use crate::hmc::{
    Evaluator, LocalSampler, MOVE_LENGTHS, Metric, Point, Reference, slice_updates, surrogate_move,
    try_involutions,
};
use crate::output::Calls;
use crate::rng::RandomStream;
use crate::surrogate::{Examples, Surrogate};
use crate::target::Target;

/// The moves of an MCMC step of the particles of one half of the lineages.
pub(super) struct Moves<'a> {
    pub(super) target: &'a dyn Target,
    pub(super) coarse: &'a dyn Target,
    /// Exponent of the fine likelihood.
    pub(super) fraction: f64,
    /// A surrogate of the fine likelihood, if there is one.
    pub(super) surrogate: Option<&'a Surrogate>,
    /// Density of independent proposals, in further MCMC steps.
    pub(super) density: Option<&'a Reference>,
    /// Of the particles of the other half.
    pub(super) metric: &'a Metric,
    pub(super) pool: &'a DifferencePool,
    /// Leapfrog step along the surrogate.
    pub(super) step: f64,
    /// Whether this is the first MCMC step at this exponent.
    pub(super) first: bool,
    /// Whether this is a further MCMC step: it is made at the fine likelihood, and needs no other.
    pub(super) further: bool,
}

/// A particle after an MCMC step.
pub(super) struct Moved {
    pub(super) particle: Particle,
    pub(super) calls: Calls,
    /// Values of the fine likelihood at the ends of moves along the surrogate.
    pub(super) examples: Examples,
    /// Mean acceptance of these moves by the surrogate.
    pub(super) acceptance: f64,
}

impl Moves<'_> {
    /// Moves a particle by a slice update, in the first MCMC step at an exponent after the target's involutions. Where there is a
    /// surrogate, moves along it follow, and the slice update is made in that first MCMC step only. In further MCMC steps an independent
    /// proposal comes before them.
    pub(super) fn explore(&self, particle: &Particle, rng: &mut RandomStream) -> Result<Moved> {
        let mut moved = Moved {
            particle: particle.clone(),
            calls: Calls::default(),
            examples: Examples::default(),
            acceptance: 0.0,
        };
        if self.first || self.surrogate.is_none() {
            self.by_slice_update(&mut moved, rng)?;
        }
        if let Some(density) = self.density {
            let (calls, examples) = propose(&mut moved.particle, density, self.target, rng)?;
            moved.calls.add(&calls);
            moved.examples = examples;
        }
        if let Some(surrogate) = self.surrogate {
            self.along(surrogate, &mut moved, rng)?;
        }
        Ok(moved)
    }

    fn by_slice_update(&self, moved: &mut Moved, rng: &mut RandomStream) -> Result<()> {
        let Particle { z, both, .. } = &mut moved.particle;
        let mut point = Point::new(z.len());
        point.z.clone_from(z);
        if self.further {
            let mut fine = Evaluator::new(self.target);
            point.ln_likelihood = both.fine;
            slice_updates(
                &mut fine,
                1.0,
                self.metric,
                self.pool,
                1,
                &mut point,
                rng,
                |_| (),
            )?;
            moved.calls.add(&fine.calls);
            both.fine = point.ln_likelihood;
            *z = point.z;
            return Ok(());
        }
        let between = Between::new(self.coarse, self.target, self.fraction);
        let (metric, pool) = (self.metric, self.pool);
        let calls = between.explore(&mut point, both, |evaluator, point| {
            if self.first {
                try_involutions(evaluator, 1.0, point, rng)?;
            }
            slice_updates(evaluator, 1.0, metric, pool, 1, point, rng, |_| ())
        })?;
        moved.calls.add(&calls);
        *z = point.z;
        Ok(())
    }

    /// Moves along the surrogate, accepted by the intermediate likelihood.
    fn along(
        &self,
        surrogate: &Surrogate,
        moved: &mut Moved,
        rng: &mut RandomStream,
    ) -> Result<()> {
        let Particle { z, both, .. } = &mut moved.particle;
        let mut coarse = Evaluator::new(self.coarse);
        let mut fine = Evaluator::new(self.target).keeping_examples(true);
        let along = Evaluator::new(self.target).with_surrogate(surrogate);
        let mut along = LocalSampler::of(along, 1.0, self.metric);
        let mut at = Point::new(z.len());
        at.z.clone_from(z);
        for length in MOVE_LENGTHS {
            at.ln_likelihood = both.at(self.fraction);
            let mut new = *both;
            let values = |z: &[f64]| {
                if !self.further {
                    new.coarse = coarse.value(z)?;
                    if new.coarse == f64::NEG_INFINITY {
                        return Ok((f64::NEG_INFINITY, 0.0));
                    }
                }
                new.fine = fine.value(z)?;
                Ok((new.at(self.fraction), 0.0))
            };
            let (transition, _) =
                surrogate_move(values, &mut along, 1.0, self.step, length, &mut at, rng)?;
            if at.z != *z {
                z.clone_from(&at.z);
                *both = new;
            }
            moved.acceptance += transition.acceptance / MOVE_LENGTHS.len() as f64;
        }
        moved.calls.add(&coarse.calls);
        let (calls, examples) = fine.into_calls_and_examples();
        moved.calls.add(&calls);
        moved.examples.append(examples);
        Ok(())
    }
}
