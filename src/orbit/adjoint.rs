//! The leapfrog of [`advance`](super::advance()) run backwards in reverse mode: exact derivatives of the same discrete
//! map, at about the cost of two values.

use super::State;
use super::leapfrog::force;
use crate::potential::{FlattenedNfw, NfwCotangent, Plummer, PlummerCotangent};
use crate::scalar::{Scalar, Vec3};
use std::hint::black_box;

/// As [`advance`](super::advance()), and writes the positions of the force evaluations into `positions`, of length
/// steps + 1, for [`reverse`].
#[inline(always)]
pub fn advance_recorded<S: Scalar>(
    host: &FlattenedNfw<S>,
    progenitor: &Plummer<S>,
    progenitor_at: impl Fn(usize) -> Vec3<S>,
    step_gyr: S,
    start: State<S>,
    positions: &mut [Vec3<S>],
) {
    let steps = positions.len() - 1;
    let mut x = start.x;
    let mut v = start
        .v
        .add_scaled(force(host, progenitor, x, progenitor_at(0)), step_gyr * 0.5);
    positions[0] = x;
    for (j, slot) in positions.iter_mut().enumerate().skip(1) {
        x = x.add_scaled(v, step_gyr);
        *slot = x;
        if j < steps {
            v = v.add_scaled(force(host, progenitor, x, progenitor_at(j)), step_gyr);
        }
    }
}

/// Derivatives of a scalar with respect to the start of a particle and the step length.
#[derive(Clone, Copy, Debug)]
pub struct Reversed<S> {
    /// With respect to the starting position and velocity.
    pub start: State<S>,
    /// With respect to the step length in Gyr.
    pub step_gyr: S,
}

/// Pulls the derivative `by_position` of some scalar with respect to a particle's final position back through its
/// recorded path. Adds what falls on the host, the progenitor's sphere and its path (through `by_path(j, derivative)`).
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
    progenitor_at: impl Fn(usize) -> Vec3<S>,
    step_gyr: S,
    positions: &[Vec3<S>],
    by_position: Vec3<S>,
    by_host: &mut NfwCotangent<S>,
    by_sphere: &mut PlummerCotangent<S>,
    mut by_path: impl FnMut(usize, Vec3<S>),
    tame: impl Fn(State<S>) -> State<S>,
) -> Reversed<S> {
    let steps = positions.len() - 1;
    let (mut by_drift, mut by_kick) = (S::zero(), S::zero());
    // The last kick changes velocities only, so the sweep starts at the last drift.
    let mut by = State {
        x: by_position,
        v: Vec3::zero(),
    };
    for j in (0..steps).rev() {
        // Drift x_{j+1} = x_j + h v.
        by.v = by.v.add_scaled(by.x, step_gyr);
        by_drift += by.x.dot(positions[j + 1] - positions[j]);
        // Kick v += c a(x_j), c = h, or h/2 for the first.
        let share = if j == 0 { 0.5 } else { 1.0 };
        let kick = by.v * S::from_f64(share);
        let lambda = kick * step_gyr;
        let (a_host, x_host) = host.pull_back(positions[j], lambda, by_host);
        let (a_sphere, x_sphere) =
            progenitor.pull_back(positions[j] - progenitor_at(j), lambda, by_sphere);
        by_kick += kick.dot(a_host + a_sphere);
        by_path(j, -x_sphere);
        by.x = by.x + x_host + x_sphere;
        by = tame(by);
        // Between steps the sweep's state rests in memory. In lanes it is too much for the registers, and a compiler that
        // may keep it there takes the lanes apart: twice the time.
        black_box((
            &mut by,
            &mut *by_host,
            &mut *by_sphere,
            &mut by_drift,
            &mut by_kick,
        ));
    }
    Reversed {
        start: by,
        step_gyr: by_drift / step_gyr + by_kick,
    }
}
