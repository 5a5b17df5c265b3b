//! One Hamiltonian trajectory and its Metropolis test.

use super::{Evaluator, Metric, Point, try_one_involution};
use crate::error::Result;
use crate::rng::{RandomStream, standard_normal, unit_open};
use crate::target::Target;

/// Maximum length of the whitened force, in units of sqrt(d); that of a Gaussian with the width of the metric is far
/// smaller.
///
/// The leapfrog is reversible and volume-preserving for any field that depends on the position alone, so that
/// transitions with a bounded force are exact. Gradients of a chaotic target can be ten orders of magnitude larger than
/// the change of the density over any finite step; without the bound every trajectory through such a point would
/// diverge.
const MAX_FORCE: f64 = 100.0;

/// Maximum range of the energies along a trajectory of a chain in equilibrium.
pub const MAX_ENERGY_RANGE: f64 = 1000.0;

/// Step size and length of a transition, fixed before it and independent of the state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plan {
    /// Step in metric units.
    pub step: f64,
    /// Mean length of a trajectory in metric units; pi/2 is a quarter period of a Gaussian.
    pub length: f64,
    /// Maximum number of leapfrog steps.
    pub max_leapfrogs: usize,
    /// Maximum range of the energies along a trajectory; a trajectory beyond it is stopped as divergent.
    pub max_energy_range: f64,
    /// 0 for the exact Metropolis test. Above 0, a rise in energy is divided by this fraction of the depth that the
    /// trajectory descended: while a chain still descends from the prior by thousands of units, its energy errors are
    /// large but small relative to the descent, and the exact test would shorten steps without limit. Such transitions
    /// do not leave the density invariant.
    pub slack: f64,
}

/// How a trajectory ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum End {
    /// At a new point, where the energy is higher by this.
    Arrived {
        /// Energy at the end minus energy at the start.
        rise: f64,
        /// Potential energy at the start minus the lowest one on the trajectory.
        fall: f64,
    },
    /// At a point without a likelihood.
    Rejected,
    /// The energies differ by more than the limit, or are not finite: the step is too long for the curvature.
    Diverged,
}

/// The outcome of a transition.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transition {
    /// Probability of acceptance.
    pub acceptance: f64,
    /// Whether it was accepted.
    pub accepted: bool,
    /// Leapfrog steps planned (a transition that ended early took fewer).
    pub leapfrogs: usize,
    /// Whether the length was cut by the largest number of steps.
    pub capped: bool,
    /// How the trajectory ended.
    pub end: End,
}

impl Transition {
    /// A point without a gradient is not moved.
    const UNMOVED: Self = Self {
        acceptance: 0.0,
        accepted: false,
        leapfrogs: 0,
        capped: false,
        end: End::Rejected,
    };
}

/// Makes HMC transitions at one temperature; its buffers are allocated once.
pub struct LocalSampler<'t, 'm> {
    /// Evaluates and counts.
    pub evaluator: Evaluator<'t>,
    /// Whitened momentum, of length `dim`: set before a trajectory; after it, the momentum at its end.
    pub momentum: Vec<f64>,
    /// End of the last trajectory.
    pub end: Point,
    beta: f64,
    metric: &'m Metric,
    force: Vec<f64>,
    whitened_force: Vec<f64>,
    velocity: Vec<f64>,
}

/// The outcome of one leapfrog step.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Step {
    /// A point with a likelihood and a gradient.
    Made,
    /// One without.
    Rejected,
    /// Coordinates that are not finite.
    Lost,
}

impl<'t, 'm> LocalSampler<'t, 'm> {
    /// A local sampler of `N(z; 0, I) L(z)^beta`.
    #[must_use]
    pub fn new(target: &'t dyn Target, beta: f64, metric: &'m Metric) -> Self {
        Self::of(Evaluator::new(target), beta, metric)
    }

    /// A local sampler of the density at `beta` on the annealing path of an evaluator.
    #[must_use]
    pub fn of(evaluator: Evaluator<'t>, beta: f64, metric: &'m Metric) -> Self {
        let dim = evaluator.target().dim();
        Self {
            evaluator,
            momentum: vec![0.0; dim],
            end: Point::new(dim),
            beta,
            metric,
            force: vec![0.0; dim],
            whitened_force: vec![0.0; dim],
            velocity: vec![0.0; dim],
        }
    }

    /// Follows the leapfrog trajectory from `from` with the present momentum; it ends in [`end`](Self::end) and
    /// [`momentum`](Self::momentum).
    ///
    /// The trajectory is stopped at the first point without a likelihood and as soon as the energies on it, ends included, span
    /// more than `max_energy_range`. The reversed trajectory has the same points, so both rules treat the two directions alike
    /// and a Metropolis test at the end is exact.
    ///
    /// # Errors
    /// [`Error::Fatal`](crate::Error::Fatal) or [`Error::Infinite`](crate::Error::Infinite) from the target.
    pub fn trajectory(
        &mut self,
        from: &Point,
        step: f64,
        leapfrogs: usize,
        max_energy_range: f64,
    ) -> Result<End> {
        self.set_state(from);
        let start = self.energy();
        let (mut low, mut high, mut now) = (start, start, start);
        let top = self.potential();
        let mut bottom = top;
        for _ in 0..leapfrogs {
            match self.step(step)? {
                Step::Made => {}
                Step::Rejected => return Ok(End::Rejected),
                Step::Lost => return Ok(End::Diverged),
            }
            now = self.energy();
            low = low.min(now);
            high = high.max(now);
            bottom = bottom.min(self.potential());
            if !now.is_finite() || high - low > max_energy_range {
                return Ok(End::Diverged);
            }
        }
        Ok(End::Arrived {
            rise: now - start,
            fall: top - bottom,
        })
    }

    /// Takes over a point that has a gradient.
    fn set_state(&mut self, point: &Point) {
        self.end.copy_from(point);
        self.update_force();
    }

    /// One leapfrog step; [`end`](Self::end) and [`momentum`](Self::momentum) have a meaning only if it was made.
    fn step(&mut self, step: f64) -> Result<Step> {
        self.kick(0.5 * step);
        self.metric.velocity(&self.momentum, &mut self.velocity);
        for (z, v) in self.end.z.iter_mut().zip(&self.velocity) {
            *z += step * v;
        }
        if self.end.z.iter().any(|z| !z.is_finite()) {
            return Ok(Step::Lost);
        }
        self.evaluator.fill(&mut self.end)?;
        if !self.end.has_gradient {
            return Ok(Step::Rejected);
        }
        self.update_force();
        self.kick(0.5 * step);
        Ok(Step::Made)
    }

    /// Computes a missing gradient; false if there is none, and then the point is unchanged.
    fn has_gradient(&mut self, at: &mut Point) -> Result<bool> {
        if !at.has_gradient {
            let before = at.ln_likelihood;
            self.evaluator.fill(at)?;
            if !at.has_gradient {
                at.ln_likelihood = before;
            }
        }
        Ok(at.has_gradient)
    }

    /// One HMC transition: a new momentum, a trajectory of random length and step, a Metropolis test.
    ///
    /// # Errors
    /// [`Error::Fatal`](crate::Error::Fatal) or [`Error::Infinite`](crate::Error::Infinite) from the target.
    pub fn transition(
        &mut self,
        at: &mut Point,
        plan: &Plan,
        rng: &mut RandomStream,
    ) -> Result<Transition> {
        if !self.has_gradient(at)? {
            return Ok(Transition::UNMOVED);
        }
        for r in &mut self.momentum {
            *r = standard_normal(rng);
        }
        let length = plan.length * (0.5 + unit_open(rng));
        let step = plan.step * (0.9 + 0.2 * unit_open(rng));
        let wanted = (length / step).ceil().max(1.0);
        let capped = wanted > plan.max_leapfrogs as f64;
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a whole number between 1 and the cap"
        )]
        let leapfrogs = wanted.min(plan.max_leapfrogs as f64) as usize;
        let end = self.trajectory(at, step, leapfrogs, plan.max_energy_range)?;
        let acceptance = match end {
            End::Arrived { rise, fall } => (-rise / (plan.slack * fall).max(1.0)).exp().min(1.0),
            End::Rejected | End::Diverged => 0.0,
        };
        // Always drawn: the use of the random stream must not depend on the outcome.
        let accepted = unit_open(rng) < acceptance;
        if accepted {
            at.copy_from(&self.end);
        }
        Ok(Transition {
            acceptance,
            accepted,
            leapfrogs,
            capped,
            end,
        })
    }

    /// [`try_one_involution`] at this sampler's temperature.
    ///
    /// # Errors
    /// [`Error::Fatal`](crate::Error::Fatal) or [`Error::Infinite`](crate::Error::Infinite) from the target.
    pub fn try_one_involution(&mut self, at: &mut Point, rng: &mut RandomStream) -> Result<()> {
        try_one_involution(&mut self.evaluator, self.beta, at, rng)
    }

    /// Log density that the transitions leave invariant, up to a constant, at a point that this sampler's evaluator has filled.
    #[must_use]
    pub fn ln_density(&self, point: &Point) -> f64 {
        point.ln_density(self.beta)
    }

    /// The gradient of [`ln_density`](Self::ln_density) at a point; none where a trajectory cannot begin.
    ///
    /// # Errors
    /// [`Error::Fatal`](crate::Error::Fatal) or [`Error::Infinite`](crate::Error::Infinite) from the target.
    pub fn score(&mut self, at: &Point) -> Result<Option<Vec<f64>>> {
        self.end.copy_from(at);
        if self.evaluator.follows_surrogate() || !self.end.has_gradient {
            self.evaluator.fill(&mut self.end)?;
        }
        if !self.end.has_gradient {
            return Ok(None);
        }
        self.update_force();
        Ok(Some(self.force.clone()))
    }

    /// Minus the log density at the present end.
    fn potential(&self) -> f64 {
        -self.ln_density(&self.end)
    }

    /// The potential and `|r|^2 / 2`.
    fn energy(&self) -> f64 {
        self.potential() + 0.5 * dot(&self.momentum, &self.momentum)
    }

    fn update_force(&mut self) {
        for ((f, g), z) in self
            .force
            .iter_mut()
            .zip(&self.end.gradient)
            .zip(&self.end.z)
        {
            *f = self.beta * g - z;
        }
        for (f, ln_over_prior) in self.force.iter_mut().zip(&self.end.ln_over_prior_gradient) {
            *f += (1.0 - self.beta) * ln_over_prior;
        }
        self.metric
            .whiten_force(&self.force, &mut self.whitened_force);
        shorten(&mut self.whitened_force, MAX_FORCE);
    }

    fn kick(&mut self, time: f64) {
        for (r, f) in self.momentum.iter_mut().zip(&self.whitened_force) {
            *r += time * f;
        }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Scales a vector of d numbers down to a length of at most `longest` sqrt(d).
pub fn shorten(vector: &mut [f64], longest: f64) {
    let limit = longest * (vector.len() as f64).sqrt();
    let length = dot(vector, vector).sqrt();
    if length > limit {
        for v in vector {
            *v *= limit / length;
        }
    }
}
