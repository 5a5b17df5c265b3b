//! The step size of one temperature, adapted towards a target acceptance while a round adapts, and fixed otherwise.

use crate::normal::quantile;
use crate::valid::{Valid, ensure};
use serde::{Deserialize, Serialize};

/// Largest step in metric units: a leapfrog on a Gaussian is unstable beyond 2, and inefficient well below.
pub const MAX_STEP: f64 = 1.2;

/// Smallest step: a thousandth of the metric's own width. Where a target is rough below any step, acceptance stops
/// rising as steps shrink, and without a lower limit they would shrink until no state moves.
const MIN_STEP: f64 = 1e-3;

/// Largest correction of the logarithm of a step at once: a factor of four.
const MAX_CORRECTION: f64 = 1.386;

/// Robbins-Monro on the logarithm of the step, with the average over the second half of a round as its result.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StepSize {
    ln_step: f64,
    sum: f64,
    count: u32,
}

impl StepSize {
    /// A controller at this step.
    #[must_use]
    pub fn new(step: f64) -> Self {
        Self {
            ln_step: step.clamp(MIN_STEP, MAX_STEP).ln(),
            sum: 0.0,
            count: 0,
        }
    }

    /// Checks a controller that was read from a file.
    pub(crate) fn check(&self) -> Valid {
        let allowed = MIN_STEP.ln()..=MAX_STEP.ln();
        ensure(
            allowed.contains(&self.ln_step) && self.sum.is_finite() && self.count < u32::MAX / 2,
            "a step size is out of its range",
        )
    }

    /// The step to use now.
    #[must_use]
    pub fn step(&self) -> f64 {
        self.ln_step.exp()
    }

    /// Updates the step by the mean acceptance of scan number `scan` of a round of `scans` (Robbins-Monro). The gain starts at
    /// 1.5, so that a few scans without any acceptance shorten the step by orders of magnitude, and falls as `scan^-0.6`. In the
    /// first half of a round, which does not enter the result, an acceptance near 1 lengthens the step as fast.
    pub fn learn(&mut self, acceptance: f64, target: f64, scan: usize, scans: usize) {
        let gain = 1.5 / ((scan + 1) as f64).powf(0.6);
        let counts = 2 * (scan + 1) > scans;
        let push = if !counts && acceptance > 0.95 {
            target
        } else {
            acceptance - target
        };
        self.ln_step = (self.ln_step + gain * push).clamp(MIN_STEP.ln(), MAX_STEP.ln());
        if counts {
            self.sum += self.ln_step;
            self.count += 1;
        }
    }

    /// The logarithm of the step with acceptance `target`, after scans at this fixed step with mean acceptance `acceptance`: that of a
    /// trajectory is `erfc(c step^2)` (Beskos et al. 2013). Changed by a factor of four at most.
    #[must_use]
    pub fn ln_corrected(&self, acceptance: f64, target: f64) -> f64 {
        let depth = |acceptance: f64| -quantile(0.5 * acceptance.clamp(1e-3, 0.999));
        let change = 0.5 * (depth(target) / depth(acceptance)).ln();
        self.ln_step + change.clamp(-MAX_CORRECTION, MAX_CORRECTION)
    }

    /// The logarithm of this round's step: the average over its second half.
    #[must_use]
    pub fn ln_found(&self) -> f64 {
        if self.count > 0 {
            self.sum / f64::from(self.count)
        } else {
            self.ln_step
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_is_corrected_to_the_wanted_acceptance() {
        let step = StepSize::new(0.2);
        let acceptance = |ln_step: f64| libm::erfc(4.0 * (2.0 * ln_step).exp());
        let corrected = step.ln_corrected(acceptance(0.2_f64.ln()), 0.6);
        assert!((acceptance(corrected) - 0.6).abs() < 1e-10);
        assert!((step.ln_corrected(0.6, 0.6) - 0.2_f64.ln()).abs() < 1e-12);
        assert!((step.ln_corrected(1.0, 0.6) - 0.8_f64.ln()).abs() < 1e-3);
    }

    #[test]
    fn a_step_far_too_short_grows_back_within_one_round() {
        let mut step = StepSize::new(1e-4);
        for scan in 0..64 {
            let acceptance = (-(step.step() / 0.8).powi(4)).exp();
            step.learn(acceptance, 0.8, scan, 64);
        }
        let ideal = 0.8 * (-(0.8_f64.ln())).powf(0.25);
        let found = step.ln_found().exp();
        assert!((found / ideal).ln().abs() < 0.3, "{found} {ideal}");
    }

    #[test]
    fn a_step_wrong_by_four_orders_is_mended_within_three_short_rounds() {
        // Acceptance of a Gaussian whose stiffest direction is 1e-3 wide: the energy error grows as step^4.
        let acceptance = |step: f64| (-(step / 1e-3).powi(4)).exp();
        let mut found = 1.0_f64;
        for scans in [4, 8, 16] {
            let mut step = StepSize::new(found);
            for scan in 0..scans {
                step.learn(acceptance(step.step()), 0.8, scan, scans);
            }
            found = step.ln_found().exp();
        }
        let ideal = 1e-3 * (-(0.8_f64.ln())).powf(0.25);
        assert!((found / ideal).ln().abs() < 0.7, "{found} {ideal}");
    }
}
