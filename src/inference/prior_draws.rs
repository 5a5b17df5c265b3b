//! Draws of the prior, kept with those of the posterior.

use oblate_samplers::Target;
use oblate_samplers::output::Draws;
use oblate_samplers::rng::{Domain, stream, unit_open};

/// `count` draws of the target's prior, equally weighted, with the target's derived quantities. Log-likelihoods are NaN. Every draw has
/// its own random substream, so that the result does not depend on the order of work.
#[must_use]
pub fn prior_draws(target: &dyn Target, count: usize, seed: u64) -> Draws {
    let dim = target.dim();
    let mut draws = Draws {
        dim,
        derived_dim: target.derived_names().len(),
        ln_likelihood: vec![f64::NAN; count],
        ln_weight: vec![-(count as f64).ln(); count],
        chain: vec![0; count],
        cluster: vec![0; count],
        ..Draws::default()
    };
    let (mut u, mut theta) = (vec![0.0; dim], vec![0.0; dim]);
    for row in 0..count {
        let mut rng = stream(seed, Domain::Prior, 0, row as u64);
        u.fill_with(|| unit_open(&mut rng));
        target.prior().theta_from_u(&u, &mut theta);
        draws.theta.extend_from_slice(&theta);
        target.derived(&theta, &mut draws.derived);
    }
    draws
}
