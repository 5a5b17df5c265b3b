//! What a track may have beside its radii: mean line-of-sight velocities, widths of the stream, and densities of stars.

use crate::track::BinQuantity;
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;

/// How a quantity is named and bounded.
#[derive(Clone, Debug)]
pub struct QuantityColumn {
    /// The column of its values.
    pub value: &'static str,
    /// The column of their standard errors.
    pub error: &'static str,
    /// The unit of both as astropy reads it.
    pub unit: &'static str,
    /// Values that it may have.
    pub values: RangeInclusive<f64>,
    /// Standard errors that it may have.
    pub errors: RangeInclusive<f64>,
}

impl BinQuantity {
    /// Its columns and ranges (docs/limits.md).
    #[must_use]
    pub fn column(self) -> QuantityColumn {
        match self {
            Self::Velocity => QuantityColumn {
                value: "v",
                error: "v_err",
                unit: "km / s",
                values: -10_000.0..=10_000.0,
                errors: 1e-3..=10_000.0,
            },
            Self::Width => QuantityColumn {
                value: "width",
                error: "width_err",
                unit: "kpc",
                values: 1e-3..=1e4,
                errors: 1e-3..=1e4,
            },
            Self::Density => QuantityColumn {
                value: "density",
                error: "density_err",
                unit: "1 / deg",
                values: -1e12..=1e12,
                errors: 1e-6..=1e12,
            },
        }
    }
}

/// A measured value with its standard error.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// The value.
    pub value: f64,
    /// Its standard error.
    pub error: f64,
}
