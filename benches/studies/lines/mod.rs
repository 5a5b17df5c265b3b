//! Roughness of ln L along a short line through a point of parameter space.

use nalgebra::{DMatrix, DVector};
use oblate::likelihood::StreamLikelihood;
use oblate::params::{DIM, REQUIRED, StreamPrior};
use oblate_samplers::rng::{Domain, standard_normal, stream};

const POINTS: usize = 41;

/// Half of the length of a line in z, in which the prior is a unit normal.
const REACH: f64 = 0.05;

/// Root mean square of ln L about its best cubic on line number `line` through a point, in a random direction of z; `None` if a point of
/// the line is rejected.
pub fn roughness(
    likelihood: &StreamLikelihood,
    prior: &StreamPrior,
    theta: &[f64; DIM],
    line: u64,
) -> Option<f64> {
    let mut rng = stream(1, Domain::Prior, 0, line);
    let direction: [f64; REQUIRED] = std::array::from_fn(|_| standard_normal(&mut rng));
    let length = direction.iter().map(|d| d * d).sum::<f64>().sqrt();
    let mut middle = [0.0; REQUIRED];
    prior.prior().z_from_theta(theta, &mut middle);
    let places: Vec<f64> = (0..POINTS)
        .map(|k| 2.0 * k as f64 / (POINTS - 1) as f64 - 1.0)
        .collect();
    let values: Option<Vec<f64>> = places
        .iter()
        .map(|place| {
            let z: [f64; REQUIRED] =
                std::array::from_fn(|i| middle[i] + REACH * place * direction[i] / length);
            let mut theta = *theta;
            prior.prior().theta_from_z(&z, &mut theta);
            Some(likelihood.ln_likelihood(&theta).ok()?.ln_likelihood)
        })
        .collect();
    let values = DVector::from_vec(values?);
    let powers = DMatrix::from_fn(POINTS, 4, |k, power| places[k].powf(power as f64));
    let cubic = powers.clone().svd(true, true).solve(&values, 1e-12).ok()?;
    Some((&values - powers * cubic).norm() / (POINTS as f64).sqrt())
}
