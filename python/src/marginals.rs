//! Distributions of single parameters, of which a prior is the product.

use oblate::samplers;
use pyo3::prelude::*;

/// The distribution of one parameter.
#[pyclass(frozen, eq, from_py_object, module = "oblate")]
#[derive(Clone, PartialEq)]
pub enum Marginal {
    /// Uniform between two bounds.
    Uniform {
        /// Lower bound.
        lo: f64,
        /// Upper bound.
        hi: f64,
    },
    /// Normal.
    Normal {
        /// Mean.
        mean: f64,
        /// Standard deviation.
        sd: f64,
    },
    /// The positive half of a normal of mean zero.
    HalfNormal {
        /// Standard deviation of the whole normal.
        sd: f64,
    },
}

#[pymethods]
impl Marginal {
    fn __repr__(&self) -> String {
        match self {
            Self::Uniform { lo, hi } => format!("Uniform(lo={lo:?}, hi={hi:?})"),
            Self::Normal { mean, sd } => format!("Normal(mean={mean:?}, sd={sd:?})"),
            Self::HalfNormal { sd } => format!("HalfNormal(sd={sd:?})"),
        }
    }
}

impl From<samplers::Marginal> for Marginal {
    fn from(marginal: samplers::Marginal) -> Self {
        match marginal {
            samplers::Marginal::Uniform { lo, hi } => Self::Uniform { lo, hi },
            samplers::Marginal::Normal { mean, sd } => Self::Normal { mean, sd },
            samplers::Marginal::HalfNormal { sd } => Self::HalfNormal { sd },
        }
    }
}

impl From<Marginal> for samplers::Marginal {
    fn from(marginal: Marginal) -> Self {
        match marginal {
            Marginal::Uniform { lo, hi } => Self::Uniform { lo, hi },
            Marginal::Normal { mean, sd } => Self::Normal { mean, sd },
            Marginal::HalfNormal { sd } => Self::HalfNormal { sd },
        }
    }
}
