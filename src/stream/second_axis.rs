//! The second axis of a triaxial halo: its parameters (docs/physics.md, section 2).

use super::angle::sin_cos_deg;
use crate::error::Result;
use crate::params::{StreamParams, StreamPrior};
use crate::potential::{HaloKind, SecondAxis};
use crate::scalar::{Real, Vec3};

/// The parameters of the second axis.
const OF_SECOND_AXIS: [&str; 2] = ["p_halo", "psi_halo_deg"];

/// Checks that a prior has the parameters of a second axis, if the halo has one, and otherwise not.
///
/// # Errors
/// [`Error::Setting`](crate::Error::Setting) with the first parameter that lacks a value or a distribution, or that has one in vain.
pub(super) fn check_prior(kind: HaloKind, prior: &StreamPrior) -> Result<()> {
    let is_triaxial = kind == HaloKind::NfwTriaxial;
    OF_SECOND_AXIS.into_iter().try_for_each(|name| {
        prior.check_belongs(name, is_triaxial, "`model.halo = \"nfw_triaxial\"`", None)
    })
}

/// The smallest `1 + n_z` that is divided by.
const LEAST_SUM: f64 = 1e-9;

/// The second axis of a halo of this kind with the axis `n`.
///
/// The shortest turn from the line of sight to `n` takes the sky's x axis to a direction perpendicular to `n`; the second axis is this direction
/// turned by `psi_halo_deg` around `n`. Where `n` points away from the observer, in one direction of all, there is no shortest turn, and the direction
/// changes fast around it.
pub(super) fn second_axis<S: Real>(
    kind: HaloKind,
    params: &StreamParams<S>,
    n: Vec3<S>,
) -> SecondAxis<S> {
    if kind != HaloKind::NfwTriaxial {
        return SecondAxis::none();
    }
    let (sin, cos) = sin_cos_deg(params.psi_halo_deg);
    let over = n.x / (n.z + 1.0).max(S::from_f64(LEAST_SUM));
    let first = Vec3::new(-(over * n.x) + 1.0, -(over * n.y), -n.x);
    let p = params.p_halo;
    SecondAxis {
        flattening: S::one() / (p * p) - 1.0,
        axis: first * cos + n.cross(first) * sin,
    }
}
