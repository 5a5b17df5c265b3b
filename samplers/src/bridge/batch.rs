//! Batches of particles, each moved from the coarse run to the fine likelihood by itself, and how they count together.
//!
//! Each batch begins with other draws of the coarse run, and has its own estimate of the ratio of the two evidences. These estimates are
//! unbiased, so that their mean is the common one, and the particles of a batch count in proportion to its own (as the island particle
//! model of Vergé, Dubarry, Del Moral & Moulines 2015 without exchange between islands).

use crate::diagnostics::ln_sum_exp;
use serde::{Deserialize, Serialize};

/// A batch at the fine likelihood, or on its way there.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Batch {
    /// Number of its particles.
    pub(super) particles: usize,
    /// Steps of the exponent that it took.
    pub(super) levels: usize,
    /// ln Z at its exponent minus that of the coarse run.
    pub(super) ln_ratio: f64,
}

/// ln Z at the fine likelihood minus that of the coarse run, by all batches.
pub(super) fn ln_ratio(batches: &[Batch]) -> f64 {
    let ln_ratios: Vec<f64> = batches.iter().map(|batch| batch.ln_ratio).collect();
    ln_sum_exp(&ln_ratios) - (batches.len() as f64).ln()
}

/// The fraction of the weight of all particles that each batch has.
pub(super) fn shares(batches: &[Batch]) -> Vec<f64> {
    let ln_sum = ln_ratio(batches) + (batches.len() as f64).ln();
    let share = |batch: &Batch| (batch.ln_ratio - ln_sum).exp();
    batches.iter().map(share).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn batches_count_by_their_ratios() {
        let batch = |ratio: f64| Batch {
            particles: 100,
            levels: 2,
            ln_ratio: ratio.ln(),
        };
        let batches = [batch(1.0), batch(3.0)];
        assert!((ln_ratio(&batches).exp() - 2.0).abs() < 1e-12);
        let shares = shares(&batches);
        assert!((shares[0] - 0.25).abs() < 1e-12 && (shares[1] - 0.75).abs() < 1e-12);
        let one = ln_ratio(&[batch(5.0)]);
        assert_eq!(one.to_bits(), 5.0_f64.ln().to_bits());
    }
}
