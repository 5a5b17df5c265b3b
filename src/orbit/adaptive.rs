//! Fourth-order steps that are as short as particles need (docs/physics.md, section 5).
//!
//! A step is a composition of six kicks and drifts (Blanes & Moan 2002, J. Comput. Appl. Math. 142, 313: a Runge-Kutta-Nyström method of
//! fourth order). All particles that are integrated together take the same steps. The size of each step is recorded: with this record the
//! integration is a fixed sequence of kicks and drifts, a [`StepSchedule`](super::StepSchedule), and its derivative is that of this
//! sequence.

use super::leapfrog::force;
use super::winding::{crossing, is_negative};
use super::{FinalParticle, State};
use crate::potential::{Plummer, Potential};
use crate::scalar::{Scalar, Vec3};
use crate::units::G;

/// Kicks, and so force evaluations, of a step; its first force is the last one of the step before.
pub const STAGES: usize = 6;

const A: [f64; 2] = [0.245_298_957_184_271, 0.604_872_665_711_080];
const A_3: f64 = 0.5 - (A[0] + A[1]);
const B: [f64; 3] = [
    0.082_984_406_417_405_2,
    0.396_309_801_498_368,
    -0.039_056_304_922_348_6,
];

/// Lengths of the drifts in steps.
pub const DRIFTS: [f64; STAGES] = [A[0], A[1], A_3, A_3, A[1], A[0]];

/// Lengths of the kicks in steps: before the first drift, and after each.
pub const KICKS: [f64; STAGES + 1] = [
    B[0],
    B[1],
    B[2],
    1.0 - 2.0 * (B[0] + B[1] + B[2]),
    B[2],
    B[1],
    B[0],
];

/// Times of the kicks in steps: the sums of the drifts before them.
pub const TIMES: [f64; STAGES + 1] = [0.0, A[0], A[0] + A[1], 0.5, 0.5 + A_3, 1.0 - A[0], 1.0];

/// Sizes between the size of a step and its half.
const PER_HALVING: u8 = 4;

/// The sizes of steps down to, and not with, the half: 2^(-number / 4).
const SIZES: [f64; PER_HALVING as usize] = [
    1.0,
    0.840_896_415_253_714_5,
    std::f64::consts::FRAC_1_SQRT_2,
    0.594_603_557_501_360_5,
];

/// The length of the next step, of a size with this number, where `left` is what is left until today; both in longest steps. The size is
/// 2^(-number / 4): so few sizes that a change of the parameters seldom changes the steps, which the derivative takes as fixed. The last
/// two steps are equal, and end today.
#[inline(always)]
#[must_use]
pub fn length(number: u8, left: f64) -> f64 {
    let size = SIZES[usize::from(number % PER_HALVING)] / (1_u64 << (number / PER_HALVING)) as f64;
    if left <= size {
        left
    } else if left < 2.0 * size {
        0.5 * left
    } else {
        size
    }
}

/// What an integration by adaptive steps is given, and where it records the sizes of the steps.
pub trait AdaptiveSteps<S> {
    /// Number of steps if all are as long as possible.
    fn steps(&self) -> usize;
    /// The shortest step is the longest one halved so often.
    fn max_halvings(&self) -> u8;
    /// Largest phase of a step in radians, see [`advance_adaptively`].
    fn max_phase(&self) -> f64;
    /// Length of the longest step, Gyr.
    fn step_gyr(&self) -> S;
    /// The progenitor's position at a time that is counted in longest steps before today.
    fn progenitor_at(&self, left: f64) -> Vec3<S>;
    /// Records the size of the next step, as [`length()`] numbers it.
    fn record(&mut self, number: u8);
}

/// Integrates particles, one in each lane, from their release to today; as [`advance`](super::advance()) along the schedule that
/// `steps` records.
///
/// The phase of a step of length h is the larger one of h (v^2 - x.a)^(1/2) / |x|, where -x.a is the square of the circular velocity,
/// and of h times the frequency of the progenitor's own gravity at the particle. At the start and at the end of a step, which is
/// predicted to second order, it must be at most [`max_phase`](AdaptiveSteps::max_phase) for every particle: looking at both ends makes
/// approach to the centre and departure alike, and energies hold several times better.
#[inline(always)]
pub fn advance_adaptively<S: Scalar>(
    host: &impl Potential<S>,
    progenitor: &Plummer<S>,
    steps: &mut impl AdaptiveSteps<S>,
    start: State<S>,
    turns: S,
) -> FinalParticle<S> {
    let shortest = steps.max_halvings() * PER_HALVING;
    let phase2 = steps.max_phase() * steps.max_phase();
    // Squared, over the square of the largest phase: no root, and no division for each particle.
    let pull = progenitor.mass * (G / phase2);
    let pull2 = pull * pull;
    let core2 = progenitor.r_s * progenitor.r_s;
    let step = steps.step_gyr();
    let (mut left, mut number) = (steps.steps() as f64, 0_u8);
    let (mut turns, mut ambiguous_windings) = (turns, S::zero());
    let mut x = start.x;
    // Velocities without the last kick of the step before, which is joined with the first of the next.
    let mut v = start.v;
    let mut kick_before = S::zero();
    let mut centre = steps.progenitor_at(left);
    let mut a = force(host, progenitor, x, centre);
    while left > 0.0 {
        let d2 = (x - centre).norm2() + core2;
        let now = Now::new(
            x,
            v.add_scaled(a, kick_before),
            a,
            phase2,
            d2 * d2 * d2,
            pull2,
        );
        // No closure here: it would not be compiled for the instruction set of its kernel.
        if number < shortest && now.is_too_long(step * length(number, left)) {
            number += 1;
            while number < shortest && now.is_too_long(step * length(number, left)) {
                number += 1;
            }
        } else {
            while number > 0 && !now.is_too_long(step * length(number - 1, left)) {
                number -= 1;
            }
        }
        let length = length(number, left);
        let h = step * length;
        v = v.add_scaled(a, kick_before + h * KICKS[0]);
        for stage in 0..STAGES {
            let before = x;
            x = x.add_scaled(v, h * DRIFTS[stage]);
            turns += crossing(before, x);
            ambiguous_windings += is_negative(before.x * x.x + before.y * x.y);
            centre = steps.progenitor_at(left - TIMES[stage + 1] * length);
            a = force(host, progenitor, x, centre);
            if stage + 1 < STAGES {
                v = v.add_scaled(a, h * KICKS[stage + 1]);
            }
        }
        kick_before = h * KICKS[STAGES];
        left -= length;
        steps.record(number);
    }
    FinalParticle {
        state: State {
            x,
            v: v.add_scaled(a, kick_before),
        },
        turns,
        ambiguous_windings,
    }
}

/// Particles at the start of a step.
struct Now<S> {
    x: Vec3<S>,
    v: Vec3<S>,
    a: Vec3<S>,
    phase2: f64,
    /// |x|^2 times the square of the largest phase, and v^2 - x.a.
    sides: (S, S),
    /// In the gravity of the progenitor, the phase is too large where `d6` is below `pull2` times h^4.
    d6: S,
    pull2: S,
}

impl<S: Scalar> Now<S> {
    #[inline(always)]
    fn new(x: Vec3<S>, v: Vec3<S>, a: Vec3<S>, phase2: f64, d6: S, pull2: S) -> Self {
        Self {
            x,
            v,
            a,
            phase2,
            d6,
            pull2,
            sides: (x.norm2() * phase2, v.norm2() - x.dot(a)),
        }
    }

    /// Whether a step of length `h` is too long for any particle: its phase at the start or at the end, or that in the progenitor's
    /// gravity.
    #[inline(always)]
    fn is_too_long(&self, h: S) -> bool {
        let h2 = h * h;
        let (r2, speed2) = self.sides;
        if S::any(r2.lt(speed2 * h2)) || S::any(self.d6.lt(self.pull2 * (h2 * h2))) {
            return true;
        }
        let v = self.v.add_scaled(self.a, h);
        let x = self.x.add_scaled(self.v.add_scaled(self.a, h * 0.5), h);
        S::any((x.norm2() * self.phase2).lt((v.norm2() - x.dot(self.a)) * h2))
    }
}
