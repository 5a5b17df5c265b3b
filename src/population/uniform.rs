//! The uniform distribution between two free edges.

use super::cells::widest;
use super::family::Family;
use super::hyperprior::{self, ANY, POSITIVE};
use super::truncated_gaussian::{DEVIATIONS, MEANS};
use crate::error::Result;
use crate::scalar::Real;
use oblate_samplers::Marginal;
use serde::{Deserialize, Serialize};

/// Width of each edge's ramp over the width of the distribution. A step would leave ln L without a derivative in the edge: a
/// stream's draws enter one by one.
const RAMP: f64 = 0.05;

/// Smallest width under the default hyperprior: a narrower population could hold a single draw of a stream.
const MIN_WIDTH: f64 = 0.05;

/// Hyperpriors of the family.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct UniformPriors {
    /// Prior of the centre; uniform on [0.5, 1.5].
    pub centre_pop: Marginal,
    /// Prior of the width between the edges; uniform on [0.05, 2].
    pub width_pop: Marginal,
}

impl Default for UniformPriors {
    fn default() -> Self {
        Self {
            centre_pop: Marginal::Uniform { lo: 0.5, hi: 1.5 },
            width_pop: Marginal::Uniform {
                lo: MIN_WIDTH,
                hi: 2.0,
            },
        }
    }
}

impl UniformPriors {
    /// Checks every number by itself, and that the width is positive.
    ///
    /// # Errors
    /// [`Error::OutOfRange`](crate::Error::OutOfRange) or [`Error::Setting`](crate::Error::Setting) with the first key that is at fault.
    pub fn check(&self) -> Result<()> {
        hyperprior::check("uniform.centre_pop", &self.centre_pop, &MEANS, &ANY)?;
        hyperprior::check("uniform.width_pop", &self.width_pop, &DEVIATIONS, &POSITIVE)
    }
}

/// The density that is constant between `centre - width / 2` and `centre + width / 2`, cut at the ends of the support: an edge beyond an
/// end is no edge. The density falls from its full value to zero linearly over a twentieth of the width around each edge.
/// Hyperparameters `centre_pop` and `width_pop`; the edges inside the support are the derived `lower_pop` and `upper_pop`.
#[derive(Clone, Debug)]
pub struct Uniform {
    support: (f64, f64),
    priors: UniformPriors,
}

impl Uniform {
    /// The family on a support `(q_min, q_max)`.
    ///
    /// # Errors
    /// Those of [`UniformPriors::check`].
    pub fn new(support: (f64, f64), priors: UniformPriors) -> Result<Self> {
        priors.check()?;
        Ok(Self { support, priors })
    }
}

/// 0 below 0, `t` from 0 to 1, 1 above.
fn ramp<S: Real>(t: S) -> S {
    t.max(S::zero()).min(S::one())
}

/// Its integral from minus infinity to `t`.
fn ramp_integral<S: Real>(t: S) -> S {
    let inside = ramp(t);
    inside * inside * 0.5 + (t - S::one()).max(S::zero())
}

impl Family<2> for Uniform {
    fn support(&self) -> (f64, f64) {
        self.support
    }

    fn hyperparameters(&self) -> [(&'static str, Marginal); 2] {
        [
            ("centre_pop", self.priors.centre_pop),
            ("width_pop", self.priors.width_pop),
        ]
    }

    /// The difference of two ramps, one at each edge, over its integral in the support. Integrals over a population are sums over cells of the support, and a member
    /// narrower than the widest of them counts as one of that width.
    fn ln_pdf<S: Real>(&self, [centre, width]: [S; 2]) -> impl Fn(f64) -> S {
        let (lo, hi) = self.support;
        let width = width.max(S::from_f64(widest(self.support)));
        let length = width * RAMP;
        let edge = |sign: f64| {
            let middle = centre + width * (0.5 * sign);
            move |q: f64| (-middle + q) / length + 0.5
        };
        let (up, down) = (edge(-1.0), edge(1.0));
        let mass = length
            * ((ramp_integral(up(hi)) - ramp_integral(up(lo)))
                - (ramp_integral(down(hi)) - ramp_integral(down(lo))));
        let ln_mass = mass.ln();
        move |q| (ramp(up(q)) - ramp(down(q))).ln() - ln_mass
    }

    fn derived_names(&self) -> &'static [&'static str] {
        &["lower_pop", "upper_pop"]
    }

    fn derived(&self, [centre, width]: [f64; 2]) -> Vec<f64> {
        let (lo, hi) = self.support;
        vec![
            (centre - 0.5 * width).max(lo),
            (centre + 0.5 * width).min(hi),
        ]
    }
}
