//! How much a posterior says about each parameter: its information beyond the prior, and which posteriors are only their priors.

use oblate_samplers::{Prior, Run};

/// A posterior with less information than this about a parameter, in nats, is called equal to its prior: a normal distribution that is shifted by
/// less than half of its width, or that is not narrower than 0.7 times its width.
pub const EQUAL_TO_PRIOR: f64 = 0.1;

/// Cells of equal prior probability over which the information is summed.
const CELLS: usize = 20;

/// Smallest effective size at which the information of a draw of the prior is expected to be less than [`EQUAL_TO_PRIOR`]; with fewer draws
/// a posterior cannot be told from its prior.
pub const MIN_ESS_FOR_INFORMATION: f64 = (CELLS - 1) as f64 / (2.0 * EQUAL_TO_PRIOR);

/// Kullback-Leibler divergence of a marginal posterior from its prior, in nats: the sum over twenty cells of equal prior probability, less its
/// expectation for `ess` draws of the prior, and at least 0. At most ln 20.
///
/// `probability` is the prior's cumulative distribution.
#[must_use]
pub fn information(
    values: &[f64],
    weights: &[f64],
    ess: f64,
    probability: impl Fn(f64) -> f64,
) -> f64 {
    let mut cells = [0.0; CELLS];
    for (value, weight) in values.iter().zip(weights) {
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a probability times the number of cells"
        )]
        let cell = (probability(*value) * CELLS as f64) as usize;
        cells[cell.min(CELLS - 1)] += weight;
    }
    let filled = cells.iter().filter(|p| **p > 0.0);
    let sum: f64 = filled.map(|p| p * (p * CELLS as f64).ln()).sum();
    let expected = (CELLS - 1) as f64 / (2.0 * ess.max(1.0));
    (sum - expected).max(0.0)
}

/// [`information`] about each parameter of a run, in its order; none where the draws are too few to say ([`MIN_ESS_FOR_INFORMATION`]).
#[must_use]
pub fn marginal_information(run: &Run, prior: &Prior) -> Vec<(String, f64)> {
    if run.ess.quoted < MIN_ESS_FOR_INFORMATION {
        return Vec::new();
    }
    let weights = run.draws.weights();
    let names = prior.names().iter().zip(prior.marginals()).enumerate();
    names
        .map(|(k, (name, marginal))| {
            let probability = |value| marginal.u_from_theta(value);
            let values = run.draws.column(k);
            let about = information(&values, &weights, run.ess.quoted, probability);
            (name.clone(), about)
        })
        .collect()
}

/// Names of the parameters whose posterior equals the prior, by [`EQUAL_TO_PRIOR`].
#[must_use]
pub fn equal_to_prior(information: &[(String, f64)]) -> Vec<&str> {
    let equal = information
        .iter()
        .filter(|(_, nats)| *nats < EQUAL_TO_PRIOR);
    equal.map(|(name, _)| name.as_str()).collect()
}

/// Says which posteriors are only their priors, and the remedy; none if there are none.
#[must_use]
pub fn not_measured(information: &[(String, f64)], remedy: &str) -> Option<String> {
    let equal = equal_to_prior(information);
    let (posterior, prior, s) = match equal.len() {
        0 => return None,
        1 => ("the posterior", "its prior", "s"),
        _ => ("the posteriors", "their priors", ""),
    };
    Some(format!(
        "NOT MEASURED: {posterior} of {} equal{s} {prior} (less than {EQUAL_TO_PRIOR} nat of information); {remedy}.",
        equal.join(", "),
    ))
}
