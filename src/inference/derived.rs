//! Quantities that follow from the parameters of a stream and are kept with its draws.

use crate::params::{StreamParams, StreamPrior};
use crate::potential::HaloKind;
use crate::stream::AnyHost;

/// Names and units of the derived quantities.
pub const DERIVED: [(&str, &str); 5] = [
    ("q", ""),
    ("axis_x", ""),
    ("axis_y", ""),
    ("axis_z", ""),
    ("log10_m200_halo", "dex(solMass)"),
];

/// The derived quantities, in the order of [`DERIVED`], in a host with this kind of halo.
#[must_use]
pub fn derived(
    prior: &StreamPrior,
    (host, kind): (&dyn AnyHost, HaloKind),
    params: &StreamParams<f64>,
) -> [f64; DERIVED.len()] {
    let shape = prior.shape(params);
    [
        shape.q,
        shape.axis.x,
        shape.axis.y,
        shape.axis.z,
        host.log10_m200(kind, params.log10_m_halo, params.r_s_halo_kpc),
    ]
}
