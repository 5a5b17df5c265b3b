//! The leapfrog of [`advance`](super::advance()) run backwards in reverse mode: exact derivatives of the same discrete
//! map, at about the cost of two values.

use super::leapfrog::force;
use super::{Course, State};
use crate::potential::{FlattenedNfw, NfwCotangent, Plummer, PlummerCotangent};
use crate::scalar::{Scalar, Vec3};
use std::hint::black_box;

/// As [`advance`](super::advance()), and writes the positions of the force evaluations into `positions`, of length
/// steps + 1, for [`reverse`].
#[inline(always)]
pub fn advance_recorded<S: Scalar>(
    host: &FlattenedNfw<S>,
    progenitor: &Plummer<S>,
    course: &impl Course<S>,
    start: State<S>,
    positions: &mut [Vec3<S>],
) {
    let steps = positions.len() - 1;
    let mut x = start.x;
    let first = force(host, progenitor, x, course.progenitor_at(0));
    let mut v = start.v.add_scaled(first, course.kick_gyr(0));
    positions[0] = x;
    for (j, slot) in positions.iter_mut().enumerate().skip(1) {
        x = x.add_scaled(v, course.drift_gyr(j - 1));
        *slot = x;
        if j < steps {
            let a = force(host, progenitor, x, course.progenitor_at(j));
            v = v.add_scaled(a, course.kick_gyr(j));
        }
    }
}

/// Derivatives with respect to one step of a course.
#[derive(Clone, Copy, Debug)]
pub struct ByStep<S> {
    /// With respect to the progenitor's position at its kick.
    pub progenitor: Vec3<S>,
    /// With respect to the length of its drift, times that length: no division per particle.
    pub drift: S,
    /// With respect to the length of its kick, per Gyr.
    pub kick: S,
}

impl<S: Scalar> ByStep<S> {
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

/// Pulls the derivative `by_position` of some scalar with respect to a particle's final position back through its
/// recorded path: the derivative with respect to its start. Adds what falls on the host, the progenitor's sphere and the
/// course.
/// After each step back the derivative with respect to the state then is what `tame` makes of it: the identity for the
/// exact derivative.
#[inline(always)]
#[allow(
    clippy::too_many_arguments,
    reason = "the mirror image of `advance`, plus its accumulators"
)]
pub fn reverse<S: Scalar>(
    host: &FlattenedNfw<S>,
    progenitor: &Plummer<S>,
    course: &impl Course<S>,
    positions: &[Vec3<S>],
    by_position: Vec3<S>,
    by_host: &mut NfwCotangent<S>,
    by_sphere: &mut PlummerCotangent<S>,
    by_course: &mut [ByStep<S>],
    tame: impl Fn(State<S>) -> State<S>,
) -> State<S> {
    let steps = positions.len() - 1;
    // The last kick changes velocities only, so the sweep starts at the last drift.
    let mut by = State {
        x: by_position,
        v: Vec3::zero(),
    };
    for j in (0..steps).rev() {
        // Drift x_{j+1} = x_j + h v.
        by.v = by.v.add_scaled(by.x, course.drift_gyr(j));
        let by_step = &mut by_course[j];
        by_step.drift += by.x.dot(positions[j + 1] - positions[j]);
        // Kick v += c a(x_j).
        let lambda = by.v * course.kick_gyr(j);
        let (a_host, x_host) = host.pull_back(positions[j], lambda, by_host);
        let (a_sphere, x_sphere) =
            progenitor.pull_back(positions[j] - course.progenitor_at(j), lambda, by_sphere);
        by_step.kick += by.v.dot(a_host + a_sphere);
        by_step.progenitor = by_step.progenitor - x_sphere;
        by.x = by.x + x_host + x_sphere;
        by = tame(by);
        // Between steps the sweep's state rests in memory. In lanes it is too much for the registers, and a compiler that
        // may keep it there takes the lanes apart: twice the time.
        black_box((&mut by, &mut *by_host, &mut *by_sphere));
    }
    by
}
