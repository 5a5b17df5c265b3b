//! The minor axis of a halo, and its angle with a direction (docs/physics.md, section 10).

use super::second_axis::second_axis;
use crate::params::{QRange, StreamParams};
use crate::potential::HaloKind;
use crate::scalar::Vec3;
use std::f64::consts::FRAC_PI_2;

/// The direction of the minor axis of a halo.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MinorAxis {
    /// This unit vector.
    Along(Vec3<f64>),
    /// Any direction perpendicular to this unit vector, the symmetry axis of a prolate halo, all of whose other axes are equally long.
    PerpendicularTo(Vec3<f64>),
}

/// Angles around the axis of a prolate halo, in equal steps over a quarter of a turn.
const STEPS: usize = 32;

impl MinorAxis {
    /// That of a halo of this kind.
    #[must_use]
    pub fn new(kind: HaloKind, params: &StreamParams<f64>, q_range: QRange) -> Self {
        let shape = q_range.shape(params.dir());
        if kind != HaloKind::NfwTriaxial {
            return if shape.q <= 1.0 {
                Self::Along(shape.axis)
            } else {
                Self::PerpendicularTo(shape.axis)
            };
        }
        let second = second_axis(kind, params, shape.axis).axis;
        Self::Along(if shape.q <= params.p_halo.min(1.0) {
            shape.axis
        } else if params.p_halo <= 1.0 {
            second
        } else {
            shape.axis.cross(second)
        })
    }

    /// The cosines, from 0 to 1, of its angle with a direction, a unit vector: one, or many that are equally probable.
    #[must_use]
    pub fn cosines(self, direction: Vec3<f64>) -> Vec<f64> {
        match self {
            Self::Along(axis) => vec![axis.dot(direction).abs().min(1.0)],
            Self::PerpendicularTo(axis) => {
                let largest = (1.0 - axis.dot(direction).powi(2)).max(0.0).sqrt();
                let angle = |step| FRAC_PI_2 * (step as f64 + 0.5) / STEPS as f64;
                (0..STEPS).map(|step| largest * angle(step).cos()).collect()
            }
        }
    }
}
