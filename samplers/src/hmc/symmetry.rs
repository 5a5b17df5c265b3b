//! Symmetry moves declared by the target: involutions with a Metropolis test, and exact redraws along orbits.

use super::point::ln_density;
use super::{Evaluator, Point};
use crate::error::Result;
use crate::rng::{RandomStream, below, unit_open};
use crate::target::{Involution, Orbit, Symmetry};

/// Proposes the image of `at` under a self-inverse map and accepts it with probability
/// `min(1, |det J| pi_beta(Jz) / pi_beta(z))`: exact whether or not the posterior is
/// symmetric. Costs one value; true if accepted (the gradient is then unknown).
///
/// # Errors
/// [`Error::Fatal`](crate::Error::Fatal) or [`Error::Infinite`](crate::Error::Infinite) from the target.
pub fn propose_involution(
    evaluator: &mut Evaluator<'_>,
    involution: &dyn Involution,
    beta: f64,
    at: &mut Point,
    rng: &mut RandomStream,
) -> Result<bool> {
    let uniform = unit_open(rng);
    let mut image = at.z.clone();
    let Some(ln_det) = involution.apply(&mut image) else {
        return Ok(false);
    };
    if image.iter().any(|z| !z.is_finite()) {
        return Ok(false);
    }
    let ln_likelihood = evaluator.value(&image)?;
    if ln_likelihood == f64::NEG_INFINITY {
        return Ok(false);
    }
    let ln_over_prior = evaluator.ln_over_prior(&image);
    let ln_ratio =
        ln_density(beta, &image, ln_likelihood, ln_over_prior) - at.ln_density(beta) + ln_det;
    let accepted = uniform.ln() < ln_ratio;
    if accepted {
        at.z = image;
        at.ln_likelihood = ln_likelihood;
        at.ln_over_prior = ln_over_prior;
        at.has_gradient = false;
    }
    Ok(accepted)
}

/// Tries each of the target's involutions with probability 1/2.
///
/// # Errors
/// As [`propose_involution`].
pub fn try_involutions(
    evaluator: &mut Evaluator<'_>,
    beta: f64,
    at: &mut Point,
    rng: &mut RandomStream,
) -> Result<()> {
    for involution in Symmetry::involutions(evaluator.target().symmetries()) {
        if unit_open(rng) < 0.5 {
            propose_involution(evaluator, involution, beta, at, rng)?;
        }
    }
    Ok(())
}

/// Tries one of the target's involutions or none, all with the same probability: a move that is its own reverse, as one of several in turn is not.
///
/// # Errors
/// As [`propose_involution`].
pub fn try_one_involution(
    evaluator: &mut Evaluator<'_>,
    beta: f64,
    at: &mut Point,
    rng: &mut RandomStream,
) -> Result<()> {
    let symmetries = evaluator.target().symmetries();
    let choices = Symmetry::involutions(symmetries).count() + 1;
    if let Some(involution) = Symmetry::involutions(symmetries).nth(below(rng, choices)) {
        propose_involution(evaluator, involution, beta, at, rng)?;
    }
    Ok(())
}

/// Redraws the position of `at` along an orbit from the prior. The likelihood is unchanged and not called; the gradient
/// at the new point is computed, and counted, by the next move that needs it. On a path from a mixture the draw is
/// accepted by its log ratio of reference to prior, and may be rejected.
pub fn refresh(
    evaluator: &mut Evaluator<'_>,
    orbit: &dyn Orbit,
    beta: f64,
    at: &mut Point,
    rng: &mut RandomStream,
) {
    let mut image = at.z.clone();
    orbit.refresh(&mut image, rng);
    if image.iter().any(|z| !z.is_finite()) {
        return;
    }
    let ln_over_prior = evaluator.ln_over_prior(&image);
    if evaluator.reference().is_prior()
        || unit_open(rng).ln() < (1.0 - beta) * (ln_over_prior - at.ln_over_prior)
    {
        at.z = image;
        at.ln_over_prior = ln_over_prior;
        at.has_gradient = false;
    }
}
