//! Proposals for the further MCMC steps that do not depend on where a particle is: draws of a density that resembles the posterior of the coarse
//! likelihood, screened by the surrogate of the fine one. By them particles pass from mode to mode, and forget from which draw they descend.
//!
//! A proposal is accepted with the Metropolis probability of an independent one. The density for particles of one half of the lineages is
//! fitted to the coarse draws of the other half.

use super::particle::{Both, Particle};
use crate::error::Result;
use crate::hmc::{Evaluator, Reference, Screen};
use crate::output::{Calls, Run};
use crate::rng::{Domain, RandomStream, stream, unit_open};
use crate::surrogate::{Examples, Surrogate};
use crate::target::Target;
use rayon::prelude::*;

/// Most draws of the coarse run that the densities of both halves are fitted to.
const MAX_TRAINING: usize = 8_000;

/// Draws by which a screen is set, and how many of them are made by one task.
const SCREENED: usize = 4_000;
const SCREENED_TASK: usize = 500;

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
            let ln_ratios: Vec<f64> = (0..SCREENED / SCREENED_TASK)
                .into_par_iter()
                .flat_map_iter(|part| {
                    let index = SCREENS + (2 * part + half) as u64;
                    let mut rng = stream(seed, Domain::Bridge, task, index);
                    let mut evaluator = Evaluator::from_reference(target, &self.0[half]);
                    evaluator.ln_ratios_of_draws(surrogate, SCREENED_TASK, &mut rng)
                })
                .collect();
            let screen = Screen::new(surrogate, &ln_ratios)?;
            Some(self.0[half].clone().screened(Some(screen)))
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
    use crate::rng::standard_normal;
    use crate::target::{Marginal, Outcome, Prior};

    /// `ln L = -(z0 - 1)^2 / 2 - 2 (z1 - z0^2 / 4)^2` over standard normals.
    struct Bent(Prior);

    impl Target for Bent {
        fn prior(&self) -> &Prior {
            &self.0
        }
        fn ln_likelihood(&self, theta: &[f64]) -> Outcome {
            Outcome::Value(bent(theta))
        }
    }

    fn bent(z: &[f64]) -> f64 {
        -0.5 * (z[0] - 1.0).powi(2) - 2.0 * (z[1] - 0.25 * z[0] * z[0]).powi(2)
    }

    #[test]
    fn proposals_of_a_wrong_density_screened_by_a_wrong_surrogate_sample_the_posterior() {
        let unit = Marginal::Normal { mean: 0.0, sd: 1.0 };
        let target = Bent(Prior::new(["x", "y"].map(|name| (name, "", unit))).unwrap());
        let mut rng = stream(1, Domain::Test, 0, 0);
        // Both lie elsewhere than the posterior, and are wider.
        let mut examples = Examples::default();
        let mut rows = Vec::new();
        for _ in 0..4_000 {
            let z = [0; 2].map(|_| 1.5 * standard_normal(&mut rng));
            examples.push(
                &z,
                -0.3 * (z[0] - 0.6).powi(2) - 0.5 * (z[1] - 0.2).powi(2),
                &[],
            );
            rows.extend([0.3 + 0.6 * z[0], 0.1 + 0.5 * z[1]]);
        }
        let surrogate = Surrogate::fit(&examples, None, &mut rng).unwrap();
        let fit = |part: usize| stream(1, Domain::Test, 1, part as u64);
        let density = Reference::resembling(&rows, 2, fit).unwrap();
        let proposals = Proposals([density.clone(), density]);
        let [density, _] = proposals.screened(&surrogate, &target, 1, 7).unwrap();
        // Means of z0, z1 and z0^2 by summation over a grid.
        let of = |z: &[f64]| [z[0], z[1], z[0] * z[0]];
        let (mut total, mut exact) = (0.0, [0.0; 3]);
        for i in -160..=160 {
            for j in -160..=160 {
                let z = [i, j].map(|place| f64::from(place) / 32.0);
                let weight = (bent(&z) - 0.5 * (z[0] * z[0] + z[1] * z[1])).exp();
                total += weight;
                for (sum, x) in exact.iter_mut().zip(of(&z)) {
                    *sum += weight * x;
                }
            }
        }
        // Batches of 50 proposals give the error of each mean.
        let mut batches = vec![[0.0; 3]; 200];
        let mut particle = Particle {
            z: vec![0.0; 2],
            both: Both {
                coarse: 0.0,
                fine: bent(&[0.0; 2]),
            },
            eve: 0,
            lineage: 0,
        };
        let mut moved = 0;
        for batch in &mut batches {
            for _ in 0..50 {
                let before = particle.z.clone();
                let (calls, examples) =
                    propose(&mut particle, &density, [&target, &target], &mut rng).unwrap();
                moved += usize::from(particle.z != before);
                assert!(calls.values <= 2 && examples.len() == 1);
                for (sum, x) in batch.iter_mut().zip(of(&particle.z)) {
                    *sum += x / 50.0;
                }
            }
        }
        // Proposals of the posterior itself would be accepted always; these are wrong enough to matter.
        assert!(
            (2_000..9_500).contains(&moved),
            "{moved} of 10,000 accepted"
        );
        for k in 0..3 {
            let mean = batches.iter().map(|b| b[k]).sum::<f64>() / 200.0;
            let variance = batches.iter().map(|b| (b[k] - mean).powi(2)).sum::<f64>() / 199.0;
            let (error, exact) = ((variance / 200.0).sqrt(), exact[k] / total);
            assert!(
                (mean - exact).abs() < 4.0 * error,
                "{k}: {mean} +- {error}, {exact}"
            );
            assert!(error < 0.05, "{k}: {error}");
        }
    }
}
