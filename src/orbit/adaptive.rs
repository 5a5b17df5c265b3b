//! Adaptive steps of fourth order (docs/physics.md, section 5).
//!
//! All particles that are integrated together take the same steps. The size of each step is recorded: with this record the
//! integration is a fixed sequence of kicks and drifts, a [`StepSchedule`](super::StepSchedule), and its derivative is that of this
//! sequence.

use super::blanes_moan::{DRIFTS, KICKS, STAGES, TIMES};
use super::leapfrog::force;
use super::winding::Crossings;
use super::{FinalParticle, State};
use crate::potential::{Plummer, Potential};
use crate::scalar::{Scalar, Vec3};
use crate::units::G;

/// Number of sizes from one size to its half.
const PER_HALVING: u8 = 4;

/// The sizes above 1/2, by their number: 2^(-number / 4).
const SIZES: [f64; PER_HALVING as usize] = [
    1.0,
    0.840_896_415_253_714_5,
    std::f64::consts::FRAC_1_SQRT_2,
    0.594_603_557_501_360_5,
];

/// The length of the next step at the time `left` before today, both in longest steps; the step has the size 2^(-number / 4). The last two
/// steps are equal and end today. There are few sizes, so that a change of the parameters seldom changes the steps, which the derivative
/// takes as constants.
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

/// The settings of an integration by adaptive steps, and the record of the sizes of its steps.
pub trait AdaptiveSteps<S: Scalar> {
    /// Number of steps if all are as long as possible.
    fn steps(&self) -> usize;
    /// How often the longest step is halved to make the shortest.
    fn max_halvings(&self) -> u8;
    /// Largest phase of a step in radians, see [`advance_adaptively`].
    fn max_phase(&self) -> f64;
    /// Length of the longest step, Gyr.
    fn step_gyr(&self) -> S;
    /// The progenitor's position at a time that is counted in longest steps before today.
    fn progenitor_at(&self, left: f64) -> Vec3<S>;
    /// The progenitor's position at the end of each drift of a step of this length that begins at `left`.
    /// It may be implemented to compute all together.
    #[inline(always)]
    fn progenitor_during(&self, left: f64, length: f64) -> [Vec3<S>; STAGES] {
        let mut centres = [Vec3::zero(); STAGES];
        for stage in 0..STAGES {
            centres[stage] = self.progenitor_at(left - TIMES[stage + 1] * length);
        }
        centres
    }
    /// The fraction of its mass that the progenitor has at a time that is counted in longest steps before today.
    fn mass_fraction(&self, left: f64) -> S;
    /// Records the size of the next step, as [`length()`] numbers it.
    fn record(&mut self, number: u8);
}

/// Integrates particles, one per lane, from their release to today: as [`advance`](super::advance()) by the schedule that `steps`
/// records. `winding_number` is the one at release.
///
/// A step is the longest whose phase is at most [`max_phase`](AdaptiveSteps::max_phase) at its start and at its predicted end, for every
/// particle (docs/physics.md, section 5). Looking at both ends makes the choice nearly the same towards the centre and away from it;
/// without it, energies drift.
#[inline(always)]
pub fn advance_adaptively<S: Scalar>(
    host: &impl Potential<S>,
    progenitor: &Plummer<S>,
    steps: &mut impl AdaptiveSteps<S>,
    start: State<S>,
    winding_number: S,
) -> FinalParticle<S> {
    let shortest = steps.max_halvings() * PER_HALVING;
    let phase2 = steps.max_phase() * steps.max_phase();
    // By the whole mass of the progenitor, also where it has lost some. The comparison of phases is squared: no root, and no division for each
    // particle.
    let gm_over_phase2 = progenitor.mass * (G / phase2);
    let gm2_over_phase4 = gm_over_phase2 * gm_over_phase2;
    let core2 = progenitor.r_s * progenitor.r_s;
    let step = steps.step_gyr();
    let (mut left, mut number) = (steps.steps() as f64, 0_u8);
    let (mut winding_number, mut ambiguous_windings) = (winding_number, S::zero());
    let State { mut x, mut v } = start;
    // `v` lacks the last kick of the step before, which is joined with the first of the next.
    let mut v_synchronised = v;
    let mut kick_before = S::zero();
    let mut centre = steps.progenitor_at(left);
    let mut a = force(host, progenitor, x, centre, steps.mass_fraction(left));
    while left > 0.0 {
        let from = State {
            x,
            v: v_synchronised,
        };
        let d2 = (x - centre).norm2() + core2;
        let step_start = StepStart::new(from, a, phase2, d2 * d2 * d2, gm2_over_phase4);
        // No closure, because it would be compiled without the instructions of the kernel.
        if number < shortest && step_start.is_too_long(step * length(number, left)) {
            number += 1;
            while number < shortest && step_start.is_too_long(step * length(number, left)) {
                number += 1;
            }
        } else {
            while number > 0 && !step_start.is_too_long(step * length(number - 1, left)) {
                number -= 1;
            }
        }
        let length = length(number, left);
        let h = step * length;
        let centres = steps.progenitor_during(left, length);
        v = v.add_scaled(a, kick_before + h * KICKS[0]);
        for stage in 0..STAGES {
            x = x.add_scaled(v, h * DRIFTS[stage]);
            centre = centres[stage];
            let fraction = steps.mass_fraction(left - TIMES[stage + 1] * length);
            a = force(host, progenitor, x, centre, fraction);
            if stage + 1 < STAGES {
                v = v.add_scaled(a, h * KICKS[stage + 1]);
            }
        }
        kick_before = h * KICKS[STAGES];
        v_synchronised = v.add_scaled(a, kick_before);
        // Positions between the drifts are not on the path.
        let to = State {
            x,
            v: v_synchronised,
        };
        let crossings = Crossings::between(from, to, h);
        winding_number += crossings.number;
        ambiguous_windings += crossings.ambiguous;
        left -= length;
        steps.record(number);
    }
    FinalParticle {
        state: State {
            x,
            v: v_synchronised,
        },
        winding_number,
        ambiguous_windings,
    }
}

/// Particles at the start of a step.
struct StepStart<S> {
    state: State<S>,
    a: Vec3<S>,
    phase2: f64,
    /// The phase is too large where |x|^2 times the square of the largest phase is below v^2 - x.a times h^2.
    phase_sides: (S, S),
    /// In the gravity of the progenitor, the phase is too large where `d6` is below `gm2_over_phase4` times h^4.
    d6: S,
    gm2_over_phase4: S,
}

impl<S: Scalar> StepStart<S> {
    #[inline(always)]
    fn new(state: State<S>, a: Vec3<S>, phase2: f64, d6: S, gm2_over_phase4: S) -> Self {
        let State { x, v } = state;
        Self {
            state,
            a,
            phase2,
            d6,
            gm2_over_phase4,
            phase_sides: (x.norm2() * phase2, v.norm2() - x.dot(a)),
        }
    }

    /// Whether a step of length `h` is too long for any particle: by its phase at the start or at the predicted end, or by that in the
    /// progenitor's gravity.
    #[inline(always)]
    fn is_too_long(&self, h: S) -> bool {
        let h2 = h * h;
        let (largest, actual) = self.phase_sides;
        if S::any(largest.lt(actual * h2)) || S::any(self.d6.lt(self.gm2_over_phase4 * (h2 * h2))) {
            return true;
        }
        let State { x, v } = self.state;
        let x = x.add_scaled(v.add_scaled(self.a, h * 0.5), h);
        let v = v.add_scaled(self.a, h);
        S::any((x.norm2() * self.phase2).lt((v.norm2() - x.dot(self.a)) * h2))
    }
}
