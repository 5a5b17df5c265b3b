//! A move along a surrogate of ln L, accepted by ln L itself (surrogate transitions: Liu 2001, section 9.4.3; delayed acceptance:
//! Christen & Fox 2005).
//!
//! HMC transitions that leave a density `s` invariant are reversible. Their end y is accepted from the beginning x with the probability
//! `min(1, pi(y) s(x) / (pi(x) s(y)))`, and leaves `pi` invariant: one value of ln L for a whole trajectory, and exact whatever the
//! surrogate. `s` is the posterior of the surrogate at all temperatures: a reference that resembles the posterior makes the densities
//! between them resemble it too, and costs more than the surrogate.
//!
//! Moves between the modes that the target's involutions connect are made in the same way: an involution that leaves `s` invariant before the
//! transition and one after it, which need no value of ln L of their own.

use super::point::ln_density;
use super::{LocalSampler, MAX_ENERGY_RANGE, Plan, Point, Transition};
use crate::error::Result;
use crate::rng::{RandomStream, unit_open};

/// How long a move goes.
#[derive(Clone, Copy, Debug)]
pub struct MoveLength {
    /// Mean number of leapfrog steps.
    leapfrogs: usize,
    /// Whether there is an involution before and after it. The errors of the surrogate at the two ends have nothing to do with each other then, as after a long
    /// trajectory anyhow; a short move would be accepted less.
    involutions: bool,
}

impl MoveLength {
    /// So many leapfrog steps on average.
    #[must_use]
    pub const fn of(leapfrogs: usize) -> Self {
        Self {
            leapfrogs,
            involutions: false,
        }
    }

    /// The same with involutions.
    #[must_use]
    pub const fn with_involutions(leapfrogs: usize) -> Self {
        Self {
            leapfrogs,
            involutions: true,
        }
    }
}

/// The moves of a state. Long ones go far where the surrogate is right, short ones are accepted where it is wrong (docs/decisions.md, section 3).
pub const MOVE_LENGTHS: [MoveLength; 3] = [
    MoveLength::of(8),
    MoveLength::of(32),
    MoveLength::with_involutions(128),
];

impl Plan {
    /// A transition of so many leapfrog steps on average, of a chain in equilibrium.
    #[must_use]
    pub fn of_leapfrogs(step: f64, leapfrogs: usize) -> Self {
        Self {
            step,
            length: leapfrogs as f64 * step,
            max_leapfrogs: 2 * leapfrogs,
            max_energy_range: MAX_ENERGY_RANGE,
            slack: 0.0,
        }
    }
}

/// One move of `at`, at the inverse temperature `beta` of an annealing path: an HMC transition of `along`, which follows a surrogate, of steps of so many metric units, with the
/// involutions of its length, and the probability with which ln L accepted its end, 0 if that is the beginning. `values` computes ln L at a place, and the logarithm of the
/// reference of the path over the prior there.
///
/// # Errors
/// [`Error::Fatal`](crate::Error::Fatal) or [`Error::Infinite`](crate::Error::Infinite) from the target; those of `values`.
pub fn surrogate_move(
    values: impl FnOnce(&[f64]) -> Result<(f64, f64)>,
    along: &mut LocalSampler<'_, '_>,
    beta: f64,
    step: f64,
    length: MoveLength,
    at: &mut Point,
    rng: &mut RandomStream,
) -> Result<(Transition, f64)> {
    let mut end = at.clone();
    along.evaluator.fill(&mut end)?;
    let before = along.ln_density(&end);
    if length.involutions {
        along.try_one_involution(&mut end, rng)?;
    }
    let plan = Plan::of_leapfrogs(step, length.leapfrogs);
    let transition = along.transition(&mut end, &plan, rng)?;
    if length.involutions {
        along.try_one_involution(&mut end, rng)?;
    }
    let uniform = unit_open(rng);
    if end.z == at.z {
        return Ok((transition, 0.0));
    }
    let after = along.ln_density(&end);
    let (ln_likelihood, ln_over_prior) = values(&end.z)?;
    let rise = ln_density(beta, &end.z, ln_likelihood, ln_over_prior) - at.ln_density(beta);
    // From one state without a likelihood to another the ratio is no number.
    let acceptance = if ln_likelihood > f64::NEG_INFINITY {
        (rise - (after - before)).exp().min(1.0)
    } else {
        0.0
    };
    if uniform < acceptance {
        at.z = end.z;
        at.ln_likelihood = ln_likelihood;
        at.ln_over_prior = ln_over_prior;
        at.has_gradient = false;
    }
    Ok((transition, acceptance))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bent::{Batches, Bent, wrong_surrogate};
    use crate::hmc::{Evaluator, Metric};
    use crate::rng::{Domain, stream};

    #[test]
    fn moves_along_a_wrong_surrogate_sample_the_density_at_each_temperature() {
        for beta in [1.0, 0.5] {
            assert_sampled(beta, MoveLength::of(8));
        }
    }

    #[test]
    fn so_do_moves_with_an_involution_that_is_no_symmetry() {
        for beta in [1.0, 0.5] {
            assert_sampled(beta, MoveLength::with_involutions(8));
        }
    }

    /// Samples `N(z; 0, I) L^beta` by moves along the posterior of the wrong surrogate.
    fn assert_sampled(beta: f64, length: MoveLength) {
        let target = Bent::new();
        let (surrogate, metric) = (wrong_surrogate(), Metric::identity(2));
        let mut batches = Batches::new(100);
        let mut rng = stream(2, Domain::Test, 0, 0);
        let mut evaluator = Evaluator::new(&target);
        let along = Evaluator::new(&target).with_surrogate(&surrogate);
        let mut along = LocalSampler::of(along, 1.0, &metric);
        let mut at = Point::new(2);
        at.ln_likelihood = evaluator.value(&at.z).unwrap();
        let mut sum_of_acceptance = 0.0;
        for _ in 0..40_000 {
            let values = |z: &[f64]| Ok((evaluator.value(z)?, 0.0));
            let (_, acceptance) =
                surrogate_move(values, &mut along, beta, 0.5, length, &mut at, &mut rng).unwrap();
            sum_of_acceptance += acceptance;
            batches.push(&at.z);
        }
        // A surrogate that is right would be accepted always; this one is wrong enough to matter.
        let acceptance = sum_of_acceptance / 40_000.0;
        assert!((0.2..0.9).contains(&acceptance), "{acceptance}");
        batches.assert_exact(beta, 0.03);
        // One value for each move that has left its beginning.
        assert!(evaluator.calls.values <= 40_001);
    }
}
