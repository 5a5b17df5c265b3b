//! Points of parameter space from numpy, one or many, and numbers for each of them back to numpy.

use crate::errors::wrong;
use numpy::{PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyFloat;

/// What numpy can make into an array of aligned 64-bit floats in C order. One that is this already is not copied.
fn any_floats<'py>(given: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let numpy = given.py().import("numpy")?;
    let arguments = (given, numpy.getattr("float64")?, ["C", "A"]);
    Ok(numpy.call_method1("require", arguments)?.cast_into()?)
}

/// As numpy makes them, numbers of one shape.
///
/// # Errors
/// `TypeError` or `ValueError` by numpy; `OblateError` for another shape.
pub fn floats<'py>(
    given: &Bound<'py, PyAny>,
    name: &str,
    shape: &[usize],
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let array = any_floats(given)?;
    if array.shape() == shape {
        return Ok(array);
    }
    Err(wrong(
        name,
        format!("an array of shape {:?}", array.shape()),
        &format!("give the shape {shape:?}"),
    ))
}

/// One point of shape `(dim,)`, or many of shape `(n, dim)`.
pub struct Points<'py> {
    array: PyReadonlyArrayDyn<'py, f64>,
    dim: usize,
    is_one: bool,
}

impl<'py> Points<'py> {
    /// Reads what numpy can make into an array, as of [`any_floats`].
    ///
    /// # Errors
    /// `TypeError` or `ValueError` by numpy; `OblateError` for another shape.
    pub fn new(given: &Bound<'py, PyAny>, name: &str, dim: usize) -> PyResult<Self> {
        let array = any_floats(given)?.readonly();
        let is_one = match array.shape() {
            [width] if *width == dim => true,
            [_, width] if *width == dim => false,
            shape => {
                return Err(wrong(
                    name,
                    format!("an array of shape {shape:?}"),
                    &format!("give the shape [{dim}] for one point, or [n, {dim}] for many"),
                ));
            }
        };
        Ok(Self { array, dim, is_one })
    }

    /// Whether this is one point, not a batch.
    pub fn is_one(&self) -> bool {
        self.is_one
    }

    /// All numbers, point by point.
    ///
    /// # Errors
    /// None: the array is contiguous.
    pub fn numbers(&self) -> PyResult<&[f64]> {
        Ok(self.array.as_slice()?)
    }

    /// Numbers per point.
    pub fn dim(&self) -> usize {
        self.dim
    }

    /// One number for each point: a float for one, an array of shape `(n,)` for many.
    pub fn values(&self, values: Vec<f64>) -> Bound<'py, PyAny> {
        let py = self.array.py();
        match values.as_slice() {
            [value] if self.is_one => PyFloat::new(py, *value).into_any(),
            _ => PyArray1::from_vec(py, values).into_any(),
        }
    }

    /// `width` numbers for each point: an array of shape `(width,)` for one, of shape `(n, width)` for many.
    ///
    /// # Errors
    /// None, if there are `width` numbers for each point.
    pub fn rows(&self, numbers: Vec<f64>, width: usize) -> PyResult<Bound<'py, PyAny>> {
        let py = self.array.py();
        let flat = PyArray1::from_vec(py, numbers);
        if self.is_one {
            return Ok(flat.into_any());
        }
        let count = self.array.shape()[0];
        Ok(flat.reshape([count, width])?.into_any())
    }
}
