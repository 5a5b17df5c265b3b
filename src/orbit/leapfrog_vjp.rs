//! Reverse mode of [`advance`](super::advance()): exact derivatives of the same discrete map, at about the cost of two
//! values, without storing the path.

use super::leapfrog::force;
use super::{Schedule, State};
use crate::potential::{Halo, HaloCotangent, Plummer, PlummerCotangent};
use crate::scalar::{Scalar, Vec3};

/// The vector-Jacobian product of [`advance`](super::advance()): from `position_bar`, the derivative of a result with respect to
/// a particle's final position (per kpc), returns its derivative with respect to the particle's initial state. The derivatives
/// with respect to the host, the progenitor, the progenitor's position at each kick, and the logarithm of the length of all steps are
/// added to theirs.
///
/// The trajectory is not stored but integrated backwards from `end`, the final state of [`advance`](super::advance()): each drift
/// and kick is undone, so it is the same trajectory except for rounding. The derivative with respect to a state is set to zero
/// where the squared length of its position part exceeds `limit2`; with an infinite limit it is exact.
#[inline(always)]
#[allow(
    clippy::too_many_arguments,
    reason = "the mirror image of `advance`, plus its accumulators"
)]
pub fn reverse<S: Scalar, H: Halo>(
    host: &H::In<S>,
    progenitor: &Plummer<S>,
    schedule: &impl Schedule<S>,
    end: State<S>,
    position_bar: Vec3<S>,
    host_bar: &mut HaloCotangent<S>,
    progenitor_bar: &mut PlummerCotangent<S>,
    path_bar: &mut [Vec3<S>],
    ln_time_bar: &mut S,
    limit2: S,
) -> State<S> {
    let steps = schedule.steps();
    let mut at = end;
    let mut by = State {
        x: position_bar,
        v: Vec3::zero(),
    };
    // The last kick changes velocities only, so derivatives start at the last drift.
    let last = force(host, progenitor, at.x, schedule.progenitor_at(steps));
    at.v = at.v.add_scaled(last, -schedule.kick_gyr(steps));
    for j in (0..steps).rev() {
        // Drift x_{j+1} = x_j + h v.
        let drift = at.v * schedule.drift_gyr(j);
        at.x = at.x - drift;
        by.v = by.v.add_scaled(by.x, schedule.drift_gyr(j));
        *ln_time_bar += by.x.dot(drift);
        // Kick v += c a(x_j).
        let lambda = by.v * schedule.kick_gyr(j);
        let (a_host, x_host) = H::vjp(host, at.x, lambda, host_bar);
        let (a_progenitor, x_progenitor) =
            progenitor.vjp(at.x - schedule.progenitor_at(j), lambda, progenitor_bar);
        let a = a_host + a_progenitor;
        at.v = at.v.add_scaled(a, -schedule.kick_gyr(j));
        *ln_time_bar += lambda.dot(a);
        path_bar[j] = path_bar[j] - x_progenitor;
        by.x = by.x + x_host + x_progenitor;
        by = within(by, limit2);
    }
    by
}

/// Zero where the position part of `state_bar` is longer than sqrt(`limit2`), `state_bar` elsewhere; a NaN is kept, so that the
/// caller can detect it.
#[inline(always)]
fn within<S: Scalar>(by: State<S>, limit2: S) -> State<S> {
    let beyond = limit2.lt(by.x.norm2());
    State {
        x: Vec3::select(beyond, Vec3::zero(), by.x),
        v: Vec3::select(beyond, Vec3::zero(), by.v),
    }
}
