//! Proposals for the further MCMC steps that do not depend on where a particle is: draws of a density that resembles the posterior of the coarse
//! likelihood, screened by the surrogate of the fine one. By them particles pass from mode to mode, and forget from which draw they descend.
//!
//! A proposal is accepted with the Metropolis probability of an independent one. The density for particles of one half of the lineages is
//! fitted to the coarse draws of the other half.

use super::particle::{Both, Particle};
use crate::error::Result;
use crate::hmc::{Evaluator, Reference, screen};
use crate::output::{Calls, Run};
use crate::rng::{Domain, RandomStream, stream, unit_open};
use crate::surrogate::{Examples, Surrogate};
use crate::target::Target;

/// Most draws of the coarse run that the densities of both halves are fitted to.
const MAX_TRAINING: usize = 8_000;

/// Tasks whose draws set a screen.
const SCREEN_TASKS: usize = 8;

/// Task of the random streams of the fits, and the first index, within an MCMC step, of those of the screens.
const FITS: u64 = u64::MAX;
const SCREENS: u64 = u64::MAX - 1_000;

/// Densities for the particles of even and of odd lineages.
pub(super) struct Proposals([Reference; 2]);

impl Proposals {
    /// Fitted to the draws of a coarse run; none if they are too few. `lineage` gives that of a row.
    pub fn new(
        parent: &Run,
        target: &dyn Target,
        seed: u64,
        lineage: impl Fn(usize) -> u32,
    ) -> Option<Self> {
        let (draws, dim) = (&parent.draws, target.dim());
        let mut halves = [Vec::new(), Vec::new()];
        let mut z = vec![0.0; dim];
        for row in draws.resample(MAX_TRAINING.min(draws.len()), 0.5) {
            target.prior().z_from_theta(draws.theta_row(row), &mut z);
            if z.iter().all(|z| z.is_finite()) {
                halves[1 - (lineage(row) % 2) as usize].extend_from_slice(&z);
            }
        }
        let fit = |half: usize| {
            let rng = |part: usize| stream(seed, Domain::Bridge, FITS, (2 * part + half) as u64);
            Reference::resembling(&halves[half], dim, rng)
        };
        let (even, odd) = rayon::join(|| fit(0), || fit(1));
        Some(Self([even?, odd?]))
    }

    /// The densities screened by a surrogate; none if no draw has a finite value of it. `task` is that of the streams of the MCMC step.
    pub fn screened(
        &self,
        surrogate: &Surrogate,
        target: &dyn Target,
        seed: u64,
        task: u64,
    ) -> Option<[Reference; 2]> {
        let screened = |half: usize| {
            let density = &self.0[half];
            let screen = screen(density, surrogate, target, SCREEN_TASKS, |part| {
                let index = SCREENS + (2 * part + half) as u64;
                stream(seed, Domain::Bridge, task, index)
            })?;
            Some(density.clone().screened(Some(screen)))
        };
        Some([screened(0)?, screened(1)?])
    }
}

/// Proposes a draw of `density` for a particle at the fine likelihood. Returns the calls, and the value of the fine likelihood as an example.
///
/// # Errors
/// [`Error::Fatal`](crate::Error::Fatal) or [`Error::Infinite`](crate::Error::Infinite) from the targets.
pub(super) fn propose(
    particle: &mut Particle,
    density: &Reference,
    [coarse, fine]: [&dyn Target; 2],
    rng: &mut RandomStream,
) -> Result<(Calls, Examples)> {
    let mut evaluator = Evaluator::from_reference(fine, density).keeping_examples(true);
    let mut z = vec![0.0; particle.z.len()];
    evaluator.draw_reference(&mut z, rng);
    let there = evaluator.ln_over_prior(&z);
    let here = evaluator.ln_over_prior(&particle.z);
    let uniform = unit_open(rng);
    let value = evaluator.value(&z)?;
    let rise = (value - there) - (particle.both.fine - here);
    let (mut calls, examples) = evaluator.into_calls_and_examples();
    if uniform.ln() < rise {
        let mut evaluator = Evaluator::new(coarse);
        let both = Both {
            coarse: evaluator.value(&z)?,
            fine: value,
        };
        calls.add(&evaluator.calls);
        // Where the coarse likelihood is zero the intermediate ones have no density.
        if both.coarse > f64::NEG_INFINITY {
            particle.z = z;
            particle.both = both;
        }
    }
    Ok((calls, examples))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bent::{Batches, Bent, ln_likelihood, wrong_surrogate};
    use crate::rng::standard_normal;

    #[test]
    fn proposals_of_a_wrong_density_screened_by_a_wrong_surrogate_sample_the_posterior() {
        let target = Bent::new();
        let mut rng = stream(1, Domain::Test, 0, 0);
        // Elsewhere than the posterior, and wider.
        let draw = |_| [0.3, 0.1].map(|mean| mean + 0.9 * standard_normal(&mut rng));
        let rows: Vec<f64> = (0..4_000).flat_map(draw).collect();
        let fit = |part: usize| stream(1, Domain::Test, 1, part as u64);
        let density = Reference::resembling(&rows, 2, fit).unwrap();
        let proposals = Proposals([density.clone(), density]);
        let screened = proposals.screened(&wrong_surrogate(), &target, 1, 7);
        let [density, _] = screened.unwrap();
        let mut particle = Particle {
            z: vec![0.0; 2],
            both: Both {
                coarse: 0.0,
                fine: ln_likelihood(&[0.0; 2]),
            },
            eve: 0,
            lineage: 0,
        };
        let (mut batches, mut moved) = (Batches::new(50), 0);
        for _ in 0..10_000 {
            let before = particle.z.clone();
            let (calls, examples) =
                propose(&mut particle, &density, [&target, &target], &mut rng).unwrap();
            moved += usize::from(particle.z != before);
            assert!(calls.values <= 2 && examples.len() == 1);
            batches.push(&particle.z);
        }
        // Proposals of the posterior itself would be accepted always; these are wrong enough to matter.
        assert!(
            (2_000..9_500).contains(&moved),
            "{moved} of 10,000 accepted"
        );
        batches.assert_exact(1.0, 0.05);
    }
}
