//! The conditional density of one coordinate: a mixture of normals, described by outputs of a network.

use crate::normal::LN_SQRT_2PI;
use crate::rng::{RandomStream, standard_normal, unit_open};
use crate::single::single;
use std::ops::Range;

/// Normals of each conditional density.
const NORMALS: usize = 4;

/// Numbers that describe a conditional density: log weights up to a constant, means, logarithms of widths.
pub(super) const OUTPUTS: usize = 3 * NORMALS;

/// Range of the logarithm of a width, in units of the draws' standard deviation.
const LN_WIDTH: Range<f64> = -5.0..3.0;

/// Outputs that describe a few normals side by side.
pub(super) fn side_by_side() -> [f32; OUTPUTS] {
    std::array::from_fn(|output| match output / NORMALS {
        0 => 0.0,
        1 => 2.0 * (output % NORMALS) as f32 / (NORMALS - 1) as f32 - 1.0,
        _ => -0.3,
    })
}

/// One conditional density.
pub(super) struct Conditional([f64; OUTPUTS]);

impl Conditional {
    /// That of coordinate `i`, from the outputs of all coordinates.
    pub fn of(outputs: &[f32], i: usize) -> Self {
        let outputs = &outputs[i * OUTPUTS..(i + 1) * OUTPUTS];
        Self(std::array::from_fn(|k| f64::from(outputs[k])))
    }

    fn ln_weights(&self) -> [f64; NORMALS] {
        std::array::from_fn(|k| self.0[k])
    }

    fn mean(&self, k: usize) -> f64 {
        self.0[NORMALS + k]
    }

    fn ln_width(&self, k: usize) -> f64 {
        self.0[2 * NORMALS + k].clamp(LN_WIDTH.start, LN_WIDTH.end)
    }

    /// Log density at `x`.
    pub fn ln_density(&self, x: f64) -> f64 {
        let terms = std::array::from_fn(|k| {
            let u = (x - self.mean(k)) * (-self.ln_width(k)).exp();
            self.0[k] - 0.5 * u * u - self.ln_width(k)
        });
        fractions(terms).1 - fractions(self.ln_weights()).1 - LN_SQRT_2PI
    }

    /// Log density at `x` and its derivative by `x`; those by the outputs are written into `by_outputs`.
    pub fn ln_density_and_slope(&self, x: f64, by_outputs: &mut [f32]) -> (f64, f64) {
        let per_width: [f64; NORMALS] = std::array::from_fn(|k| (-self.ln_width(k)).exp());
        let u: [f64; NORMALS] = std::array::from_fn(|k| (x - self.mean(k)) * per_width[k]);
        let terms = std::array::from_fn(|k| self.0[k] - 0.5 * u[k] * u[k] - self.ln_width(k));
        let (belongs, ln_sum) = fractions(terms);
        let (weights, ln_weights) = fractions(self.ln_weights());
        let mut slope = 0.0;
        for k in 0..NORMALS {
            let pull = belongs[k] * u[k] * per_width[k];
            by_outputs[k] = single(belongs[k] - weights[k]);
            by_outputs[NORMALS + k] = single(pull);
            let free = LN_WIDTH.contains(&self.0[2 * NORMALS + k]);
            let by_ln_width = belongs[k] * (u[k] * u[k] - 1.0);
            by_outputs[2 * NORMALS + k] = if free { single(by_ln_width) } else { 0.0 };
            slope -= pull;
        }
        (ln_sum - ln_weights - LN_SQRT_2PI, slope)
    }

    /// A draw.
    pub fn draw(&self, rng: &mut RandomStream) -> f64 {
        let (weights, _) = fractions(self.ln_weights());
        let mut place = unit_open(rng);
        let chosen = (0..NORMALS).find(|k| {
            place -= weights[*k];
            place < 0.0
        });
        // Rounding can leave the sum of the weights just below 1.
        let k = chosen.unwrap_or(NORMALS - 1);
        self.mean(k) + self.ln_width(k).exp() * standard_normal(rng)
    }
}

/// The exponentials of these numbers, divided by their sum, and the logarithm of that sum.
fn fractions(ln: [f64; NORMALS]) -> ([f64; NORMALS], f64) {
    let top = ln.into_iter().fold(f64::NEG_INFINITY, f64::max);
    let parts = ln.map(|ln| (ln - top).exp());
    let sum: f64 = parts.iter().sum();
    (parts.map(|part| part / sum), top + sum.ln())
}
