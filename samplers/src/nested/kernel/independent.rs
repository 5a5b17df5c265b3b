//! Proposals that do not depend on where a chain is: draws of a density fitted to the surviving points of the other half of the lineages,
//! screened by their surrogate. By them chains pass from mode to mode.
//!
//! # Why the prior above the likelihood bound stays invariant
//!
//! A draw of the density g is kept with the probability s, a function of its place alone, and what is kept has the density g s but for a
//! constant. It is accepted if ln L there is above the bound, with the Metropolis probability of an independent proposal, the ratio of
//! prior / (g s) there and here. Whether any of a fixed number of draws is kept does not depend on where the chain is.

use super::along::{OtherHalf, Proposals};
use super::chain::{Chain, cube_from_normal, wall};
use crate::error::Result;
use crate::rng::{RandomStream, unit_open};
use crate::surrogate::Scratch;

/// Draws that are screened for one proposal.
const DRAWS: usize = 256;

/// Least probability to keep a draw: a surrogate that is too low in some place cannot close it.
const LEAST: f64 = 1e-4;

/// What a draw is judged by.
struct Judge<'a> {
    proposals: &'a Proposals<'a>,
    other: &'a OtherHalf<'a>,
    theta: Vec<f64>,
    features: Vec<f64>,
    scratch: Scratch,
}

impl Judge<'_> {
    /// ln of prior / g at a place, and of the probability to keep a draw there.
    fn at(&mut self, chain: &Chain<'_>, z: &[f64]) -> (f64, f64) {
        let target = chain.context.target;
        target.prior().theta_from_z(z, &mut self.theta);
        target.features(z, &self.theta, &mut self.features);
        let ln_l = (self.other.surrogate).ln_likelihood(&self.features, &mut self.scratch);
        let ln_ratio = Proposals::ln_ratio(self.proposals.mixture, z);
        let below = (chain.context.contour - ln_l) / self.other.width;
        let ln_kept = ln_ratio - self.proposals.ln_most - wall(below);
        // Not a number where the surrogate overflows.
        let ln_kept = if ln_kept.is_nan() {
            LEAST.ln()
        } else {
            ln_kept.clamp(LEAST.ln(), 0.0)
        };
        (ln_ratio, ln_kept)
    }
}

/// One proposal, if a draw is kept.
pub(super) fn step(
    chain: &mut Chain<'_>,
    other: &OtherHalf<'_>,
    rng: &mut RandomStream,
) -> Result<()> {
    let Some(proposals) = other.proposals else {
        return Ok(());
    };
    let mut judge = Judge {
        proposals,
        other,
        theta: vec![0.0; chain.x.len()],
        features: vec![0.0; chain.context.target.feature_count()],
        scratch: Scratch::default(),
    };
    let mut kept = None;
    for _ in 0..DRAWS {
        let z = proposals.mixture.draw(rng);
        let (ln_ratio, ln_kept) = judge.at(chain, &z);
        if unit_open(rng).ln() < ln_kept {
            kept = Some((z, ln_ratio - ln_kept));
            break;
        }
    }
    let Some((z, there)) = kept else {
        chain.motion.proposals.note(false, false);
        return Ok(());
    };
    let here = judge.at(chain, &chain.normals());
    let mut accepted = unit_open(rng).ln() < there - (here.0 - here.1);
    if accepted {
        cube_from_normal(&z, &mut chain.trial);
        let ln_l = chain.likelihood.at(&chain.trial)?;
        accepted = ln_l > chain.context.contour;
        if accepted {
            chain.accept(ln_l);
            chain.label = chain.bound.label(&chain.x);
        }
    }
    chain.motion.proposals.note(true, accepted);
    Ok(())
}
