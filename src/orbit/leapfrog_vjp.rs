//! The leapfrog of [`advance`](super::advance()) run backwards in reverse mode: exact derivatives of the same discrete
//! map, at about the cost of two values, and no path to remember.

use super::leapfrog::force;
use super::{Schedule, State};
use crate::potential::{Halo, HaloCotangent, Plummer, PlummerCotangent};
use crate::scalar::{Scalar, Vec3};

/// Derivatives with respect to one step of a course.
#[derive(Clone, Copy, Debug)]
pub struct StepCotangent<S> {
    /// With respect to the progenitor's position at its kick.
    pub progenitor: Vec3<S>,
    /// With respect to the length of its drift, times that length: no division per particle.
    pub drift: S,
    /// With respect to the length of its kick, per Gyr.
    pub kick: S,
}

impl<S: Scalar> StepCotangent<S> {
    /// Nothing yet.
    #[inline(always)]
    #[must_use]
    pub fn zero() -> Self {
        Self {
            progenitor: Vec3::zero(),
            drift: S::zero(),
            kick: S::zero(),
        }
    }
}

/// Pulls the derivative `by_position` of some scalar with respect to a particle's final position back along its path: the
/// derivative with respect to its start. Adds what falls on the host, the progenitor's sphere and the course.
///
/// The path is not remembered but run backwards from `end`, the state that [`advance`](super::advance()) arrived at: each
/// drift and kick is undone by itself, so it is the same path but for rounding. The derivative with respect to a state is set
/// to zero where the square of its position part exceeds `limit2`; with a limit of infinity it is exact.
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
    schedule_bar: &mut [StepCotangent<S>],
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
        let step_bar = &mut schedule_bar[j];
        step_bar.drift += by.x.dot(drift);
        // ReleaseOffset v += c a(x_j).
        let lambda = by.v * schedule.kick_gyr(j);
        let (a_host, x_host) = H::vjp(host, at.x, lambda, host_bar);
        let (a_sphere, x_sphere) =
            progenitor.vjp(at.x - schedule.progenitor_at(j), lambda, progenitor_bar);
        let a = a_host + a_sphere;
        at.v = at.v.add_scaled(a, -schedule.kick_gyr(j));
        step_bar.kick += by.v.dot(a);
        step_bar.progenitor = step_bar.progenitor - x_sphere;
        by.x = by.x + x_host + x_sphere;
        by = within(by, limit2);
    }
    by
}

/// Zero where the position part of `by` is longer than sqrt(`limit2`), `by` elsewhere: a NaN stays, for the caller to find.
#[inline(always)]
fn within<S: Scalar>(by: State<S>, limit2: S) -> State<S> {
    let beyond = limit2.lt(by.x.norm2());
    State {
        x: Vec3::select(beyond, Vec3::zero(), by.x),
        v: Vec3::select(beyond, Vec3::zero(), by.v),
    }
}
