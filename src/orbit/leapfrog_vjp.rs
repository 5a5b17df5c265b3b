//! Reverse mode of [`advance`](super::advance()): exact derivatives of the same discrete map (docs/physics.md, section 8).

use super::{Schedule, State};
use crate::potential::{Host, HostCotangent, Plummer, PlummerCotangent};
use crate::scalar::{Scalar, Vec3};

/// The vector-Jacobian product of [`advance`](super::advance()): from `end_bar`, the derivative of a result with respect to
/// a particle's final state (per kpc and per kpc/Gyr), returns its derivative with respect to the particle's initial state. The derivatives
/// with respect to the host, the progenitor, the progenitor's position at each kick, and the logarithm of the length of all
/// steps are added to `host_bar`, `progenitor_bar`, `progenitor_positions_bar` and `ln_time_bar`.
///
/// The trajectory is not stored but integrated backwards from `end`, the final state of [`advance`](super::advance()): each drift
/// and kick is undone, so it is the same trajectory except for rounding. The derivative with respect to a state is set to zero
/// once the squared length of the derivative with respect to its position exceeds `limit2`; with an infinite limit it is exact.
#[inline(always)]
#[allow(
    clippy::too_many_arguments,
    reason = "the arguments of `advance`, and the sums of derivatives"
)]
pub fn advance_vjp<S: Scalar, H: Host>(
    host: &H::In<S>,
    progenitor: &Plummer<S>,
    schedule: &impl Schedule<S>,
    end: State<S>,
    end_bar: State<S>,
    host_bar: &mut HostCotangent<S>,
    progenitor_bar: &mut PlummerCotangent<S>,
    progenitor_positions_bar: &mut [Vec3<S>],
    ln_time_bar: &mut S,
    limit2: S,
) -> State<S> {
    let drifts = schedule.drifts();
    let mut state = end;
    let mut state_bar = end_bar;
    for j in (0..=drifts).rev() {
        // Kick v += c a(x_j).
        let lambda = state_bar.v * schedule.kick_gyr(j);
        let (a_host, x_bar_host) = H::vjp(host, state.x, lambda, host_bar);
        let (a_progenitor, x_bar_progenitor) = progenitor.vjp_of(
            schedule.mass_fraction(j),
            state.x - schedule.progenitor_at(j),
            lambda,
            progenitor_bar,
        );
        let a = a_host + a_progenitor;
        state.v = state.v.add_scaled(a, -schedule.kick_gyr(j));
        *ln_time_bar += lambda.dot(a);
        progenitor_positions_bar[j] = progenitor_positions_bar[j] - x_bar_progenitor;
        state_bar.x = state_bar.x + x_bar_host + x_bar_progenitor;
        state_bar = truncated(state_bar, limit2);
        if j == 0 {
            break;
        }
        // Drift x_j = x_{j-1} + h v.
        let drift = state.v * schedule.drift_gyr(j - 1);
        state.x = state.x - drift;
        state_bar.v = state_bar
            .v
            .add_scaled(state_bar.x, schedule.drift_gyr(j - 1));
        *ln_time_bar += state_bar.x.dot(drift);
    }
    state_bar
}

/// Zero where the squared length of `state_bar.x` exceeds `limit2`, `state_bar` elsewhere. A NaN is kept, so that the caller can
/// detect it.
#[inline(always)]
fn truncated<S: Scalar>(state_bar: State<S>, limit2: S) -> State<S> {
    let beyond = limit2.lt(state_bar.x.norm2());
    State {
        x: Vec3::select(beyond, Vec3::zero(), state_bar.x),
        v: Vec3::select(beyond, Vec3::zero(), state_bar.v),
    }
}
