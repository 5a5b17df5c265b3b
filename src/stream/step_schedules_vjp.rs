//! Reverse mode of the step schedules: from derivatives with respect to the progenitor's positions at the kicks to derivatives with respect
//! to the nodes of the orbit. The lengths of the steps are proportional to the age, whose derivative is in
//! [`SharedCotangent`](super::cotangents::SharedCotangent).

use super::cotangents::Cotangents;
use crate::orbit::{HermiteWeights, position_vjp};
use crate::scalar::Vec3;

impl Cotangents {
    /// Adds the derivatives with respect to interpolated positions of the progenitor to those with respect to the nodes.
    pub(super) fn progenitor_positions_vjp(
        &mut self,
        weights: &[HermiteWeights],
        positions_bar: &[Vec3<f64>],
    ) {
        for (weights, position_bar) in weights.iter().zip(positions_bar) {
            position_vjp(&mut self.nodes, weights, *position_bar);
        }
    }
}
