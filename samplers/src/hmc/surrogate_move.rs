//! A move along a surrogate of ln L, accepted by ln L itself (surrogate transitions: Liu 2001, section 9.4.3; delayed acceptance:
//! Christen & Fox 2005).
//!
//! HMC transitions that leave the posterior of the surrogate invariant are reversible, and so are several in succession. At the density with
//! the likelihood `S^(1 - f) L^f`, of surrogate and likelihood, their end is accepted with probability `min(1, (L(y) S(x) / (L(x) S(y)))^f)`:
//! one value of ln L for a whole sequence of trajectories, and exact whatever the surrogate.

use super::{Evaluator, LocalSampler, Plan, Point, Transition};
use crate::error::Result;
use crate::rng::{RandomStream, unit_open};

/// One move of `transitions` HMC transitions of `along`, which follows the surrogate, at the exponent `fraction` of the likelihood; `noted` is
/// called with each. [`Point::gap`] of `at` must be known.
///
/// # Errors
/// [`Error::Fatal`](crate::Error::Fatal) or [`Error::Infinite`](crate::Error::Infinite) from the target.
#[allow(
    clippy::too_many_arguments,
    reason = "those of an HMC transition, and both densities"
)]
pub fn surrogate_move(
    evaluator: &mut Evaluator<'_>,
    along: &mut LocalSampler<'_, '_>,
    fraction: f64,
    plan: &Plan,
    transitions: usize,
    at: &mut Point,
    rng: &mut RandomStream,
    mut noted: impl FnMut(&Transition),
) -> Result<()> {
    let mut end = at.clone();
    for _ in 0..transitions {
        noted(&along.transition(&mut end, plan, rng)?);
    }
    let uniform = unit_open(rng);
    if end.z != at.z {
        end.gap = evaluator.value(&end.z)? - end.ln_likelihood;
        if uniform < (fraction * (end.gap - at.gap)).exp() {
            *at = end;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hmc::Metric;
    use crate::rng::{Domain, standard_normal, stream};
    use crate::surrogate::{Examples, Surrogate};
    use crate::target::{Marginal, Outcome, Prior, Target};

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

    /// A surrogate that is wrong: its likelihood lies elsewhere and is wider.
    fn wrong() -> Surrogate {
        let mut rng = stream(1, Domain::Test, 0, 0);
        let mut examples = Examples::default();
        for _ in 0..4_000 {
            let z = [0; 2].map(|_| 1.5 * standard_normal(&mut rng));
            examples.push(
                &z,
                -0.3 * (z[0] - 0.6).powi(2) - 0.5 * (z[1] - 0.2).powi(2),
                &[],
            );
        }
        Surrogate::fit(&examples, None, &mut rng).unwrap()
    }

    #[test]
    fn moves_along_a_wrong_surrogate_sample_the_posterior() {
        let unit = Marginal::Normal { mean: 0.0, sd: 1.0 };
        let target = Bent(Prior::new(["x", "y"].map(|name| (name, "", unit))).unwrap());
        let (surrogate, metric) = (wrong(), Metric::identity(2));
        let plan = Plan {
            step: 0.5,
            length: 1.5,
            max_leapfrogs: 16,
            max_energy_range: 1000.0,
            slack: 0.0,
        };
        // Means of z0, z1 and z0^2 under the posterior, by summation over a grid.
        let grid: Vec<[f64; 2]> = (-160..=160)
            .flat_map(|i| (-160..=160).map(move |j| [f64::from(i), f64::from(j)].map(|x| x / 32.0)))
            .collect();
        let of = |z: &[f64]| [z[0], z[1], z[0] * z[0]];
        let (mut total, mut exact) = (0.0, [0.0; 3]);
        for z in &grid {
            let weight = (bent(z) - 0.5 * (z[0] * z[0] + z[1] * z[1])).exp();
            total += weight;
            for (sum, x) in exact.iter_mut().zip(of(z)) {
                *sum += weight * x;
            }
        }
        // Batches of 100 moves give the error of each mean.
        let mut batches = vec![[0.0; 3]; 200];
        let mut rng = stream(2, Domain::Test, 0, 0);
        let mut evaluator = Evaluator::new(&target);
        let mut at = Point::new(2);
        let mut own = Evaluator::new(&target).with_surrogate(Some(&surrogate));
        at.ln_likelihood = own.value(&at.z).unwrap();
        at.gap = evaluator.value(&at.z).unwrap() - at.ln_likelihood;
        let mut moved = 0;
        for batch in &mut batches {
            for _ in 0..100 {
                let own = Evaluator::new(&target).with_surrogate(Some(&surrogate));
                let mut along = LocalSampler::of(own, 1.0, &metric);
                let before = at.z.clone();
                surrogate_move(
                    &mut evaluator,
                    &mut along,
                    1.0,
                    &plan,
                    3,
                    &mut at,
                    &mut rng,
                    |_| (),
                )
                .unwrap();
                moved += usize::from(at.z != before);
                for (sum, x) in batch.iter_mut().zip(of(&at.z)) {
                    *sum += x / 100.0;
                }
            }
        }
        // A surrogate that is right would be accepted always; this one is wrong enough to matter.
        let acceptance = moved as f64 / 20_000.0;
        assert!((0.2..0.9).contains(&acceptance), "{acceptance}");
        for k in 0..3 {
            let mean = batches.iter().map(|b| b[k]).sum::<f64>() / 200.0;
            let variance = batches.iter().map(|b| (b[k] - mean).powi(2)).sum::<f64>() / 199.0;
            let (error, exact) = ((variance / 200.0).sqrt(), exact[k] / total);
            assert!(
                (mean - exact).abs() < 4.0 * error,
                "{k}: {mean} +- {error}, {exact}"
            );
            assert!(error < 0.03, "{k}: {error}");
        }
        assert_eq!(evaluator.calls.values, 20_001);
    }
}
