//! Reverse mode of the step schedules: from derivatives with respect to the progenitor's positions at the kicks to derivatives with respect to
//! the orbit's nodes. All lengths of steps are proportional to the age, whose derivative is summed with those of the potentials.

use super::cotangents::Cotangents;
use crate::orbit::{HermiteWeights, add_weighted};
use crate::scalar::Vec3;

impl Cotangents {
    /// Adds the derivatives with respect to positions at `places` on the orbit to those with respect to its nodes. The kick today moves no
    /// position: there is none for the last place.
    pub(super) fn add_path(&mut self, places: &[HermiteWeights], path_bar: &[Vec3<f64>]) {
        for (place, by) in places.iter().zip(path_bar) {
            add_weighted(&mut self.nodes, place, *by);
        }
    }
}
