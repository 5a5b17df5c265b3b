//! Kick-drift-kick leapfrog in the potential of the host and the moving progenitor, on any number type.

use super::winding::{crossing, is_negative};
use super::{Schedule, State};
use crate::potential::{Plummer, Potential};
use crate::scalar::{Scalar, Vec3};

/// A particle today.
#[derive(Clone, Copy, Debug)]
pub struct FinalParticle<S> {
    /// Its state at t = 0.
    pub state: State<S>,
    /// Times its projection went round counter-clockwise, counted at the negative x axis; a whole number.
    pub turns: S,
    /// Steps that turned it by more than 90 degrees around the projected centre, where the count is ambiguous.
    pub ambiguous_windings: S,
}

/// The acceleration at `x` in the host and a progenitor at `centre`. A function and not a closure, so that it is inlined
/// into code compiled for any instruction set.
#[inline(always)]
pub(super) fn force<S: Scalar>(
    host: &impl Potential<S>,
    progenitor: &Plummer<S>,
    x: Vec3<S>,
    centre: Vec3<S>,
) -> Vec3<S> {
    progenitor.add_acceleration(x - centre, host.acceleration(x))
}

/// Integrates one particle, or one lane each of several, along a step schedule in the potential of `host` and `progenitor`.
///
/// The last kick of a step is fused with the first of the next: one force per step. `turns` is the winding count at release.
#[inline(always)]
pub fn advance<S: Scalar>(
    host: &impl Potential<S>,
    progenitor: &Plummer<S>,
    schedule: &impl Schedule<S>,
    start: State<S>,
    turns: S,
) -> FinalParticle<S> {
    let steps = schedule.steps();
    let mut x = start.x;
    let first = force(host, progenitor, x, schedule.progenitor_at(0));
    let mut v = start.v.add_scaled(first, schedule.kick_gyr(0));
    let mut turns = turns;
    let mut ambiguous_windings = S::zero();
    for j in 1..=steps {
        let before = x;
        x = x.add_scaled(v, schedule.drift_gyr(j - 1));
        turns += crossing(before, x);
        let cosine = before.x * x.x + before.y * x.y;
        ambiguous_windings += is_negative(cosine);
        let a = force(host, progenitor, x, schedule.progenitor_at(j));
        v = v.add_scaled(a, schedule.kick_gyr(j));
    }
    FinalParticle {
        state: State { x, v },
        turns,
        ambiguous_windings,
    }
}
