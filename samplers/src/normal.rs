//! The standard normal distribution, with full relative precision in both tails.

use std::f64::consts::{FRAC_1_SQRT_2, SQRT_2};

/// `ln sqrt(2 pi)`.
pub const LN_SQRT_2PI: f64 = 0.918_938_533_204_672_8;

/// `ln phi(z)`, the log density.
#[must_use]
pub fn ln_pdf(z: f64) -> f64 {
    -0.5 * z * z - LN_SQRT_2PI
}

/// `Phi(z)`, accurate relative to itself in the lower tail.
#[must_use]
pub fn cdf(z: f64) -> f64 {
    0.5 * libm::erfc(-z * FRAC_1_SQRT_2)
}

/// `1 - Phi(z)`, accurate relative to itself in the upper tail.
#[must_use]
pub fn sf(z: f64) -> f64 {
    cdf(-z)
}

/// `Phi^-1(p)` for p in (0, 1), accurate for p down to the smallest normal double; give the smaller of p and 1 - p
/// and use the sign to keep digits in the upper tail. p = 0 and p = 1 give infinities.
#[must_use]
pub fn quantile(p: f64) -> f64 {
    if p <= 0.0 {
        return f64::NEG_INFINITY;
    }
    if p >= 1.0 {
        return f64::INFINITY;
    }
    -SQRT_2 * statrs::function::erf::erfc_inv(2.0 * p)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantile_inverts_the_distribution_in_both_tails() {
        for i in -370..=370 {
            let z = f64::from(i) * 0.1;
            let back = if z < 0.0 {
                quantile(cdf(z))
            } else {
                -quantile(sf(z))
            };
            assert!((back - z).abs() <= 4e-15 * z.abs().max(1.0), "{z} {back}");
        }
    }
}
