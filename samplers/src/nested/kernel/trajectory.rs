//! Trajectories along a surrogate of ln L, inside a soft wall at the likelihood bound.
//!
//! # Why the prior above the likelihood bound stays invariant
//!
//! In standard-normal coordinates z the prior is a standard normal distribution. A trajectory begins with a momentum r from a standard normal
//! distribution, and follows the leapfrog of the energy `|z|^2 / 2 + |r|^2 / 2 + wall`, where the wall is a function of the surrogate alone:
//! `ln(1 + exp((bound - surrogate) / width))`, nearly 0 above the bound and steep below it. The leapfrog is reversible and preserves
//! volume for any force that depends on the position alone. Its end is accepted if ln L there is above the bound, with the Metropolis
//! probability of the change of `|z|^2 / 2 + |r|^2 / 2`, the energy without the wall: one value of ln L for a whole trajectory, and exact
//! whatever the surrogate. Where the surrogate is right, the wall is as high at the end as at the beginning, and nearly all ends are
//! accepted.

use super::along::OtherHalf;
use super::chain::{Chain, cube_from_normal, wall};
use crate::error::Result;
use crate::rng::{RandomStream, standard_normal, unit_open};
use crate::surrogate::{Scratch, Surrogate};
use crate::target::Target;
use nalgebra::DMatrix;

/// Mean numbers of leapfrog steps of the trajectories of a set: long ones go far where the surrogate is right, short ones are
/// accepted where it is wrong.
const LEAPFROGS: [usize; 3] = [8, 32, 128];

/// Widths of the walls of sets of trajectories in turn, over the narrowest. A point where the surrogate is too low by many widths hardly ever leaves its place
/// through a narrow wall: with narrow walls alone such points become too few, and ln Z too high (docs/decisions.md, section 5).
pub(super) const WIDTHS: [f64; 3] = [1.0, 4.0, 16.0];

/// Maximum length of the whitened force, in units of the root of the number of dimensions.
const MAX_FORCE: f64 = 100.0;

/// Largest change of the energy of a trajectory; beyond, it is given up.
const MAX_ENERGY_RANGE: f64 = 1000.0;

/// A place on a trajectory, with the energies there.
struct Place {
    z: Vec<f64>,
    force: Vec<f64>,
    /// `|z|^2 / 2`.
    prior: f64,
    wall: f64,
}

/// Space for one trajectory.
struct Leapfrog<'a> {
    target: &'a dyn Target,
    surrogate: &'a Surrogate,
    metric: &'a DMatrix<f64>,
    bound: f64,
    width: f64,
    theta: Vec<f64>,
    features: Vec<f64>,
    features_bar: Vec<f64>,
    scratch: Scratch,
    gradient: Vec<f64>,
}

/// Makes a set of trajectories.
pub(super) fn steps(
    chain: &mut Chain<'_>,
    other: &OtherHalf<'_>,
    rng: &mut RandomStream,
) -> Result<()> {
    let target = chain.context.target;
    let (dim, count) = (chain.x.len(), target.feature_count());
    let mut leapfrog = Leapfrog {
        target,
        surrogate: other.surrogate,
        metric: other.metric,
        bound: chain.context.contour,
        width: other.width,
        theta: vec![0.0; dim],
        features: vec![0.0; count],
        features_bar: vec![0.0; count],
        scratch: Scratch::default(),
        gradient: vec![0.0; dim],
    };
    let mut place = leapfrog.at(chain.normals());
    for leapfrogs in LEAPFROGS {
        let length = (leapfrogs, other.step);
        one(chain, &mut leapfrog, &mut place, length, rng)?;
    }
    chain.label = chain.bound.label(&chain.x);
    Ok(())
}

/// One trajectory of so many leapfrog steps on average, of so long steps on average.
fn one(
    chain: &mut Chain<'_>,
    leapfrog: &mut Leapfrog<'_>,
    place: &mut Place,
    (leapfrogs, step): (usize, f64),
    rng: &mut RandomStream,
) -> Result<()> {
    // The number and the length of steps do not depend on the state.
    let count = (leapfrogs as f64 * (0.5 + unit_open(rng))).ceil();
    let step = step * (0.9 + 0.2 * unit_open(rng));
    let mut momentum: Vec<f64> = (0..chain.x.len()).map(|_| standard_normal(rng)).collect();
    let kinetic = half_square(&momentum);
    let uniform = unit_open(rng);
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a small number above zero"
    )]
    let end = leapfrog.trajectory(place, &mut momentum, step, count as usize);
    let Some(end) = end else {
        chain.motion.trajectories.note(0.0, false);
        return Ok(());
    };
    let rise = end.prior + half_square(&momentum) - place.prior - kinetic;
    let energy = (-(rise + end.wall - place.wall)).exp().min(1.0);
    let mut accepted = uniform.ln() < -rise;
    if accepted {
        cube_from_normal(&end.z, &mut chain.trial);
        let ln_l = chain.likelihood.at(&chain.trial)?;
        accepted = ln_l > chain.context.contour;
        if accepted {
            chain.accept(ln_l);
            *place = end;
        }
    }
    chain.motion.trajectories.note(energy, accepted);
    Ok(())
}

impl Leapfrog<'_> {
    /// The place at `z`.
    fn at(&mut self, z: Vec<f64>) -> Place {
        self.target.prior().theta_from_z(&z, &mut self.theta);
        self.target.features(&z, &self.theta, &mut self.features);
        let ln_l = self.surrogate.ln_likelihood_and_gradient(
            &self.features,
            &mut self.features_bar,
            &mut self.scratch,
        );
        self.target
            .features_vjp(&z, &self.theta, &self.features_bar, &mut self.gradient);
        let below = (self.bound - ln_l) / self.width;
        let wall = wall(below);
        let slope = 1.0 / (1.0 + (-below).exp()) / self.width;
        let force: Vec<f64> = z
            .iter()
            .zip(&self.gradient)
            .map(|(z, g)| slope * g - z)
            .collect();
        Place {
            prior: half_square(&z),
            force: self.whitened(&force),
            wall,
            z,
        }
    }

    /// `L' f`, no longer than [`MAX_FORCE`].
    fn whitened(&self, force: &[f64]) -> Vec<f64> {
        let dim = force.len();
        let mut out: Vec<f64> = (0..dim)
            .map(|j| (j..dim).map(|i| self.metric[(i, j)] * force[i]).sum())
            .collect();
        let (length, limit) = (
            (2.0 * half_square(&out)).sqrt(),
            MAX_FORCE * (dim as f64).sqrt(),
        );
        if length > limit {
            out.iter_mut().for_each(|f| *f *= limit / length);
        }
        out
    }

    /// The end of a trajectory, with the momentum there; none if the energy is lost.
    fn trajectory(
        &mut self,
        from: &Place,
        momentum: &mut [f64],
        step: f64,
        count: usize,
    ) -> Option<Place> {
        let energy =
            |place: &Place, momentum: &[f64]| place.prior + place.wall + half_square(momentum);
        let first = energy(from, momentum);
        let (mut low, mut high) = (first, first);
        let mut force = from.force.clone();
        let mut z = from.z.clone();
        let mut place = None;
        for _ in 0..count {
            kick(momentum, &force, 0.5 * step);
            for (i, z) in z.iter_mut().enumerate() {
                *z += step
                    * (0..=i)
                        .map(|j| self.metric[(i, j)] * momentum[j])
                        .sum::<f64>();
            }
            let here = self.at(z.clone());
            kick(momentum, &here.force, 0.5 * step);
            let now = energy(&here, momentum);
            (low, high) = (low.min(now), high.max(now));
            if !now.is_finite() || high - low > MAX_ENERGY_RANGE {
                return None;
            }
            force.clone_from(&here.force);
            place = Some(here);
        }
        place
    }
}

fn kick(momentum: &mut [f64], force: &[f64], time: f64) {
    for (r, f) in momentum.iter_mut().zip(force) {
        *r += time * f;
    }
}

fn half_square(x: &[f64]) -> f64 {
    0.5 * x.iter().map(|x| x * x).sum::<f64>()
}
