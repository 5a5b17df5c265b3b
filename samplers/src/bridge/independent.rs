//! Proposals for the further MCMC steps that do not depend on where a particle is: draws of a density that resembles the posterior, screened by
//! the surrogate of the fine likelihood. By them particles pass from mode to mode, and forget from which draw they descend.
//!
//! A proposal is accepted with the Metropolis probability of an independent one. The density for particles of one half of the lineages is
//! fitted to the other half: to its coarse draws, and the more, the more there are, to where its particles have been at the fine likelihood. What few
//! coarse draws have brought to the fine posterior, others can come to.

use super::particle::Particle;
use super::settings::FITTED_STEPS;
use crate::error::Result;
use crate::hmc::{Evaluator, Reference, screen, thinned};
use crate::output::{Calls, Draws};
use crate::rng::{Domain, RandomStream, stream, unit_open};
use crate::surrogate::{Examples, Surrogate};
use crate::target::Target;

/// Most points that the densities of both halves are fitted to.
pub(super) const MAX_TRAINING: usize = 8_000;

/// Tasks whose draws set a screen.
const SCREEN_TASKS: usize = 8;

/// Task of the random streams of the first fits, from where those of later fits descend, and the first index, within an MCMC step, of those of
/// the screens.
const FITS: u64 = u64::MAX;
const SCREENS: u64 = u64::MAX - 1_000;

/// Densities for the particles of even and of odd lineages.
pub(super) struct Proposals([Reference; 2]);

impl Proposals {
    /// Fitted to where the particles of even and of odd lineages have been in further MCMC steps, `visited`, and, as far as that is
    /// little, to the `draws` of a coarse run; none if all are too few. `lineage` gives that of a draw, and `fitted` the numbers of earlier batches
    /// and of steps of the present one whose places these are.
    pub fn new(
        draws: &Draws,
        visited: [Vec<f64>; 2],
        [batches, steps]: [usize; 2],
        target: &dyn Target,
        seed: u64,
        lineage: impl Fn(usize) -> u32,
    ) -> Option<Self> {
        let dim = target.dim();
        let known = visited.map(|rows| thinned(&rows, dim, MAX_TRAINING / 2));
        let wanted = MAX_TRAINING - (known[0].len() + known[1].len()) / dim;
        let mut halves = known;
        let mut z = vec![0.0; dim];
        for row in draws.resample(wanted.min(draws.len()), 0.5) {
            target.prior().z_from_theta(draws.theta_row(row), &mut z);
            if z.iter().all(|z| z.is_finite()) {
                halves[(lineage(row) % 2) as usize].extend_from_slice(&z);
            }
        }
        let task = FITS - (batches * (FITTED_STEPS + 1) + steps) as u64;
        let fit = |half: usize| {
            let rng = |part: usize| stream(seed, Domain::Bridge, task, (2 * part + half) as u64);
            Reference::resembling(&halves[1 - half], dim, rng)
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
/// [`Error::Fatal`](crate::Error::Fatal) or [`Error::Infinite`](crate::Error::Infinite) from the target.
pub(super) fn propose(
    particle: &mut Particle,
    density: &Reference,
    fine: &dyn Target,
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
    if uniform.ln() < rise {
        particle.z = z;
        particle.both.fine = value;
    }
    Ok(evaluator.into_calls_and_examples())
}

#[cfg(test)]
mod tests {
    use super::super::particle::Both;
    use super::*;
    use crate::bent::{Batches, Bent, ln_likelihood, wrong_surrogate};
    use crate::output::Origin;
    use crate::rng::standard_normal;

    /// Draws of a coarse run around the origin, of two lineages.
    fn coarse_draws(target: &Bent, rng: &mut RandomStream) -> Draws {
        let mut draws = Draws::of(target);
        for row in 0..4_000 {
            let theta = [(); 2].map(|()| 0.3 * standard_normal(rng));
            let origin = Origin {
                chain: 0,
                cluster: row % 2,
            };
            draws
                .push(target, &theta, 0.0, -4_000_f64.ln(), origin)
                .unwrap();
        }
        draws
    }

    /// What particles of even lineages have found beside the coarse draws is proposed to those of odd lineages, and only to these.
    #[test]
    fn densities_know_where_the_particles_of_the_other_half_have_been() {
        let target = Bent::new();
        let mut rng = stream(1, Domain::Test, 2, 0);
        let draws = coarse_draws(&target, &mut rng);
        let found: Vec<f64> = (0..4_000)
            .map(|_| 2.5 + 0.1 * standard_normal(&mut rng))
            .collect();
        let ln_over_prior = |steps: usize| {
            let visited = [found[..1_000 * steps].to_vec(), Vec::new()];
            let lineage = |row: usize| draws.cluster[row];
            let Proposals(densities) =
                Proposals::new(&draws, visited, [0, steps], &target, 1, lineage).unwrap();
            densities.map(|density| {
                Evaluator::from_reference(&target, &density).ln_over_prior(&[2.5; 2])
            })
        };
        let [even_before, odd_before] = ln_over_prior(0);
        let [even, odd] = ln_over_prior(4);
        // Without them there is a twentieth of the prior, or less where wide.
        assert!(odd > odd_before + 3.0, "{odd_before} {odd}");
        assert!((even - even_before).abs() < 1.0, "{even_before} {even}");
    }

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
            let (calls, examples) = propose(&mut particle, &density, &target, &mut rng).unwrap();
            moved += usize::from(particle.z != before);
            assert!(calls.values == 1 && examples.len() == 1);
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
