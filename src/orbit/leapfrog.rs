//! Leapfrog (kick, drift, kick) in the potential of the host and the moving progenitor, on any number type (docs/physics.md, section 5).

use super::winding::{crossing, is_negative};
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
    /// Number of steps that turned it by more than 90 degrees around the projected centre, so that the winding number may be wrong.
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
/// The last kick of a step is joined with the first of the next: one force per step.
#[inline(always)]
pub fn advance<S: Scalar>(
    host: &impl Potential<S>,
    progenitor: &Plummer<S>,
    schedule: &impl Schedule<S>,
    start: State<S>,
    winding_number: S,
) -> FinalParticle<S> {
    let steps = schedule.steps();
    let mut x = start.x;
    let fraction = schedule.mass_fraction(0).value;
    let first = force(host, progenitor, x, schedule.progenitor_at(0), fraction);
    let mut v = start.v.add_scaled(first, schedule.kick_gyr(0));
    let mut winding_number = winding_number;
    let mut ambiguous_windings = S::zero();
    for j in 1..=steps {
        let before = x;
        x = x.add_scaled(v, schedule.drift_gyr(j - 1));
        winding_number += crossing(before, x);
        let cosine = before.x * x.x + before.y * x.y;
        ambiguous_windings += is_negative(cosine);
        let fraction = schedule.mass_fraction(j).value;
        let a = force(host, progenitor, x, schedule.progenitor_at(j), fraction);
        v = v.add_scaled(a, schedule.kick_gyr(j));
    }
    FinalParticle {
        state: State { x, v },
        winding_number,
        ambiguous_windings,
    }
}
