//! Draws of the prior beside those of the posterior.

use oblate_samplers::Prior;
use oblate_samplers::output::Draws;
use oblate_samplers::rng::{Domain, stream, unit_open};

/// `count` equal-weight draws of a prior, with derived quantities from `derived` (physical parameters in, a fixed
/// number of quantities out). Log-likelihoods are NaN. One keyed stream per draw: the same for any order of work.
pub fn prior_draws(
    prior: &Prior,
    count: usize,
    seed: u64,
    mut derived: impl FnMut(&[f64]) -> Vec<f64>,
) -> Draws {
    let dim = prior.dim();
    let mut draws = Draws {
        dim,
        ln_likelihood: vec![f64::NAN; count],
        ln_weight: vec![-(count as f64).ln(); count],
        chain: vec![0; count],
        group: vec![0; count],
        ..Draws::default()
    };
    let (mut u, mut theta) = (vec![0.0; dim], vec![0.0; dim]);
    for row in 0..count {
        let mut rng = stream(seed, Domain::Prior, 0, row as u64);
        u.fill_with(|| unit_open(&mut rng));
        prior.theta_from_u(&u, &mut theta);
        draws.theta.extend_from_slice(&theta);
        let quantities = derived(&theta);
        draws.derived_dim = quantities.len();
        draws.derived.extend(quantities);
    }
    draws
}
