//! More draws for a density to be fitted to: copies of draws, moved along a surrogate of ln L.
//!
//! A flexible density that is fitted to a few hundred draws is high at each of them and low between them. HMC transitions that leave the
//! posterior of a surrogate invariant fill these places and cost no value of ln L. Where the surrogate is wrong the copies are too, and the
//! fitted density resembles the posterior less; a sampler that has it as its reference stays exact.

use super::{Evaluator, LocalSampler, Metric, Plan, Point};
use crate::error::Result;
use crate::rng::RandomStream;
use crate::surrogate::Surrogate;
use crate::target::Target;
use rayon::prelude::*;

/// Mean number of leapfrog steps from one copy to the next (docs/decisions.md, section 2).
const LEAPFROGS: usize = 64;

/// Mean acceptance that a step must have, on trial from about so many draws, and the factor by which it is shortened until then.
const ACCEPTANCE: f64 = 0.7;
const TRIALS: usize = 100;
const SHORTER: f64 = 0.7;

/// Largest number of times that a step is shortened.
const MAX_SHORTENED: usize = 12;

/// Rows of coordinates, each followed by its copies, so that copies of neighbouring rows are neighbours: at most `most` rows in all, or the
/// given ones alone if there are more than half as many. `step` is that of a transition in this metric; it is shortened if too
/// few would be accepted; `rng` gives the stream of each row, twice as many as there are rows.
///
/// # Errors
/// Those of the target.
pub fn with_moved_copies(
    rows: &[f64],
    most: usize,
    target: &dyn Target,
    surrogate: &Surrogate,
    metric: &Metric,
    mut step: f64,
    rng: impl Fn(usize) -> RandomStream + Sync,
) -> Result<Vec<f64>> {
    let dim = target.dim();
    let count = rows.len() / dim;
    let copies = (most / count.max(1)).saturating_sub(1);
    if copies == 0 {
        return Ok(rows.to_vec());
    }
    let sampler_at = |z: &[f64]| {
        let evaluator = Evaluator::new(target).with_surrogate(surrogate);
        let mut point = Point::new(dim);
        point.z.copy_from_slice(z);
        (LocalSampler::of(evaluator, 1.0, metric), point)
    };
    let every = count.div_ceil(TRIALS);
    for _ in 0..MAX_SHORTENED {
        let trials: Vec<f64> = (rows.par_chunks_exact(dim * every).enumerate())
            .map(|(i, z)| {
                let (mut along, mut point) = sampler_at(&z[..dim]);
                let plan = Plan::of_leapfrogs(step, LEAPFROGS);
                Ok(along.transition(&mut point, &plan, &mut rng(i))?.acceptance)
            })
            .collect::<Result<_>>()?;
        if trials.iter().sum::<f64>() >= ACCEPTANCE * trials.len() as f64 {
            break;
        }
        step *= SHORTER;
    }
    let plan = Plan::of_leapfrogs(step, LEAPFROGS);
    let moved: Vec<Vec<f64>> = (rows.par_chunks_exact(dim).enumerate())
        .map(|(i, z)| {
            let (mut along, mut point) = sampler_at(z);
            let mut rng = rng(count + i);
            let mut all = z.to_vec();
            for _ in 0..copies {
                along.transition(&mut point, &plan, &mut rng)?;
                all.extend_from_slice(&point.z);
            }
            Ok(all)
        })
        .collect::<Result<_>>()?;
    Ok(moved.concat())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bent::{Bent, wrong_surrogate};
    use crate::rng::{Domain, stream};

    const ROWS: usize = 400;

    /// A row and so many copies that the last has forgotten the row.
    const ALL: usize = 16;

    fn moved(most: usize, step: f64) -> Vec<f64> {
        // All rows are at one place, some three standard deviations from the surrogate's mean.
        let rows = [2.5; 2 * ROWS];
        let (metric, rng) = (Metric::identity(2), |i: usize| {
            stream(3, Domain::Test, 0, i as u64)
        });
        with_moved_copies(
            &rows,
            most,
            &Bent::new(),
            &wrong_surrogate(),
            &metric,
            step,
            rng,
        )
        .unwrap()
    }

    #[test]
    fn copies_follow_the_posterior_of_the_surrogate_even_from_a_step_that_is_too_long() {
        for step in [0.1, 5.0] {
            let all = moved(ALL * ROWS, step);
            assert_eq!(all.len(), 2 * ALL * ROWS);
            let lasts: Vec<&[f64]> = all
                .chunks_exact(2 * ALL)
                .map(|chunk| {
                    assert_eq!(chunk[..2], [2.5, 2.5], "a row comes before its copies");
                    &chunk[2 * ALL - 2..]
                })
                .collect();
            // The surrogate's posterior is normal: of coordinate z with ln S = -a (z - c)^2, precision 1 + 2a and mean 2 a c over it.
            for (k, (a, c)) in [(0.3, 0.6), (0.5, 0.2)].into_iter().enumerate() {
                let precision = 1.0 + 2.0 * a;
                let mean = lasts.iter().map(|z| z[k]).sum::<f64>() / ROWS as f64;
                let squares = lasts.iter().map(|z| (z[k] - mean).powi(2)).sum::<f64>();
                let variance = squares / (ROWS - 1) as f64;
                // Four standard errors of independent draws, and 0.05 for the fit of the surrogate.
                let error = (1.0 / precision / ROWS as f64).sqrt();
                let off = (mean - 2.0 * a * c / precision).abs();
                assert!(off < 4.0 * error + 0.05, "{step}, {k}: {mean}");
                let spread = variance * precision - 1.0;
                let error = (2.0 / ROWS as f64).sqrt();
                assert!(spread.abs() < 4.0 * error + 0.05, "{step}, {k}: {variance}");
            }
        }
    }

    #[test]
    fn rows_that_are_many_have_no_copies() {
        assert_eq!(moved(2 * ROWS - 1, 0.1), [2.5; 2 * ROWS]);
    }
}
