//! A screen keeps a draw of a density with a probability that a surrogate of ln L gives (rejection sampling). A density fitted to draws of
//! a posterior has tails in which the posterior has none; most of the annealing path would only remove them.
//!
//! With `w = prior S / density`, where S is the surrogate's likelihood, the probability is `min(1, w / most)`, and at least `least`. So the
//! screened density is `density min(1, w / most) / mean`, and nowhere below `least` times the density: a surrogate that is too low in
//! some place cannot close it.

use crate::surrogate::Surrogate;
use crate::valid::{Valid, countable, ensure};
use serde::{Deserialize, Serialize};

/// Fraction of the draws that a screen keeps (docs/decisions.md, section 3).
const KEPT: f64 = 1.0 / 128.0;

/// Least probability to keep a draw, as a fraction of [`KEPT`]: the screened density is nowhere below this fraction of the density.
const LEAST: f64 = 0.25;

/// Halvings of the interval in which `most` is searched.
const HALVINGS: usize = 60;

/// What a screen made of the draws that it was shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Screened {
    draws: u64,
    /// Sums of the screened density over the density, and of its square.
    sum: f64,
    squares: f64,
}

impl Screened {
    /// Adds a draw, kept or not, from the logarithm of the screened density over the density there.
    pub fn note(&mut self, ln_over_density: f64) {
        let ratio = ln_over_density.exp();
        self.draws += 1;
        self.sum += ratio;
        self.squares += ratio * ratio;
    }

    /// Adds others.
    pub fn add(&mut self, other: &Self) {
        self.draws += other.draws;
        self.sum += other.sum;
        self.squares += other.squares;
    }

    /// ln of the integral of the screened density as it is normalised, and its variance; zeros without a screen.
    #[must_use]
    pub fn ln_integral(&self) -> (f64, f64) {
        if self.draws == 0 {
            return (0.0, 0.0);
        }
        let draws = self.draws as f64;
        let variance = self.squares / (self.sum * self.sum) - 1.0 / draws;
        ((self.sum / draws).ln(), variance.max(0.0))
    }

    /// Checks sums that were read from a file.
    pub(crate) fn check(&self) -> Valid {
        ensure(
            countable([self.draws])
                && self.sum.is_finite()
                && self.squares.is_finite()
                && (self.draws == 0 || self.sum > 0.0),
            "the sums of a screen are not finite",
        )
    }
}

/// The screen.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Screen {
    pub(super) surrogate: Surrogate,
    /// ln of `most`, the ratio w from which on all draws are kept.
    ln_most: f64,
    /// ln of the mean probability over draws of the density.
    ln_mean: f64,
}

impl Screen {
    /// The screen that keeps about one in 128 of the draws with these ln w. None if there are none.
    #[must_use]
    pub fn new(surrogate: &Surrogate, ln_ratios: &[f64]) -> Option<Self> {
        let finite = || ln_ratios.iter().copied().filter(|r| r.is_finite());
        let mut low = finite().fold(f64::INFINITY, f64::min);
        // There even the draw with the largest ratio is kept as rarely as wanted.
        let mut high = finite().fold(f64::NEG_INFINITY, f64::max) - KEPT.ln();
        if low > high {
            return None;
        }
        let mean = |ln_most: f64| {
            let kept = ln_ratios.iter().map(|r| ln_kept(*r, ln_most).exp());
            kept.sum::<f64>() / ln_ratios.len() as f64
        };
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if mean(middle) > KEPT {
                low = middle;
            } else {
                high = middle;
            }
        }
        Some(Self {
            surrogate: surrogate.clone(),
            ln_most: high,
            ln_mean: mean(high).ln(),
        })
    }

    /// ln of the probability to keep a draw with this ln w.
    #[must_use]
    pub fn ln_kept(&self, ln_ratio: f64) -> f64 {
        ln_kept(ln_ratio, self.ln_most)
    }

    /// ln of the screened density over the density.
    pub(super) fn ln_over_density(&self, ln_ratio: f64) -> f64 {
        self.ln_kept(ln_ratio) - self.ln_mean
    }

    /// Checks a screen that was read from a file, for a target with so many features.
    pub(super) fn check(&self, features: usize) -> Valid {
        self.surrogate.check(features)?;
        ensure(
            self.ln_most.is_finite() && self.ln_mean.is_finite() && self.ln_mean <= 0.0,
            "a screen is not finite",
        )
    }
}

fn ln_kept(ln_ratio: f64, ln_most: f64) -> f64 {
    let least = (LEAST * KEPT).ln();
    let ln = ln_ratio - ln_most;
    // Not a number where the surrogate overflows.
    if ln.is_nan() {
        least
    } else {
        ln.clamp(least, 0.0)
    }
}
