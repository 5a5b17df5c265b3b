//! Kicks and drifts by a schedule in the potential of the host and the moving progenitor, on any number type (docs/physics.md, section 5).

use super::winding::Crossings;
use super::{Schedule, State};
use crate::potential::{Plummer, Potential};
use crate::scalar::{Scalar, Vec3};

/// A particle today.
#[derive(Clone, Copy, Debug)]
pub struct FinalParticle<S> {
    /// Its state at t = 0.
    pub state: State<S>,
    /// Winding number of its projection: counter-clockwise crossings of the negative x axis less clockwise ones.
    pub winding_number: S,
    /// Number of chords of its path that turn by more than 90 degrees around the projected centre, so that the winding number may be wrong.
    pub ambiguous_windings: S,
}

/// The acceleration at `x` in the host and a progenitor at `centre` with this fraction of its mass. A function and not a closure, because a
/// closure cannot be marked `#[inline(always)]` and would be compiled without the instructions of the kernel.
#[inline(always)]
pub(super) fn force<S: Scalar>(
    host: &impl Potential<S>,
    progenitor: &Plummer<S>,
    x: Vec3<S>,
    centre: Vec3<S>,
    fraction: S,
) -> Vec3<S> {
    progenitor.add_acceleration(fraction, x - centre, host.acceleration(x))
}

/// Integrates one particle, or one per lane, by a step schedule in the potential of `host` and `progenitor`, from the state `start` and the
/// winding number at its release.
///
/// The last kick of a step is joined with the first of the next: one force per drift.
#[inline(always)]
pub fn advance<S: Scalar>(
    host: &impl Potential<S>,
    progenitor: &Plummer<S>,
    schedule: &impl Schedule<S>,
    start: State<S>,
    winding_number: S,
) -> FinalParticle<S> {
    let (drifts, drifts_of_step) = (schedule.drifts(), schedule.drifts_of_step());
    let mut x = start.x;
    let fraction = schedule.mass_fraction(0).value;
    let mut a = force(host, progenitor, x, schedule.progenitor_at(0), fraction);
    let mut v = start.v.add_scaled(a, schedule.kick_gyr(0));
    let mut winding_number = winding_number;
    let mut ambiguous_windings = S::zero();
    for first in (0..drifts).step_by(drifts_of_step) {
        // Between kicks: the velocities at both ends of the step follow from its first and its last kick.
        let (from, v_from, a_from) = (x, v, a);
        let mut v_to = v;
        let mut h = S::zero();
        for j in first..first + drifts_of_step {
            let drift = schedule.drift_gyr(j);
            h += drift;
            x = x.add_scaled(v, drift);
            let fraction = schedule.mass_fraction(j + 1).value;
            a = force(host, progenitor, x, schedule.progenitor_at(j + 1), fraction);
            v_to = v;
            v = v.add_scaled(a, schedule.kick_gyr(j + 1));
        }
        let kick = h * schedule.kick_of_step();
        let from = State {
            x: from,
            v: v_from.add_scaled(a_from, -kick),
        };
        let to = State {
            x,
            v: v_to.add_scaled(a, kick),
        };
        let crossings = Crossings::between(from, to, h);
        winding_number += crossings.number;
        ambiguous_windings += crossings.ambiguous;
    }
    FinalParticle {
        state: State { x, v },
        winding_number,
        ambiguous_windings,
    }
}
