//! Observed tracks.

use crate::errors::to_python;
use numpy::PyArray1;
use oblate::data::{Measured, ObservedTrack, ReadOptions};
use oblate::track::BinQuantity;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::path::PathBuf;

/// An observed track: one projected radius per bin of angle from the progenitor.
#[pyclass(frozen, module = "oblate")]
#[derive(Clone)]
pub struct Track {
    /// The track of the library.
    pub observed: ObservedTrack,
}

impl Track {
    /// Reads a track file.
    ///
    /// # Errors
    /// Those of [`ObservedTrack::read_with`].
    pub fn from_file(
        path: &std::path::Path,
        assume_error: Option<&str>,
        handedness: Option<&str>,
    ) -> PyResult<Self> {
        let options = ReadOptions {
            assumed_error: assume_error
                .map(str::parse)
                .transpose()
                .map_err(to_python)?,
            handedness: handedness.map(str::parse).transpose().map_err(to_python)?,
        };
        let observed = ObservedTrack::read_with(path, &options).map_err(to_python)?;
        Ok(Self { observed })
    }

    fn column<'py>(py: Python<'py>, values: &[f64]) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, values)
    }

    /// Numbers of a quantity, NaN where it is not measured; `None` of a track without it.
    fn measured<'py>(
        &self,
        py: Python<'py>,
        quantity: BinQuantity,
        of: fn(&Measured) -> f64,
    ) -> Option<Bound<'py, PyArray1<f64>>> {
        let rows = self.observed.measured.get(&quantity)?;
        let number = |measured: &Option<Measured>| measured.as_ref().map_or(f64::NAN, of);
        Some(Self::column(
            py,
            &rows.iter().map(number).collect::<Vec<_>>(),
        ))
    }
}

/// What is measured from values and errors, which are NaN where nothing is; `None` without both.
fn measured(
    [value_name, error_name]: [&str; 2],
    values: Option<Vec<f64>>,
    errors: Option<Vec<f64>>,
) -> PyResult<Option<Vec<Option<Measured>>>> {
    match (values, errors) {
        (None, None) => Ok(None),
        (Some(values), Some(errors)) if values.len() == errors.len() => {
            let of_bin = |(value, error): (f64, f64)| {
                (!value.is_nan() || !error.is_nan()).then_some(Measured { value, error })
            };
            Ok(Some(values.into_iter().zip(errors).map(of_bin).collect()))
        }
        _ => Err(PyValueError::new_err(format!(
            "{value_name} and {error_name} must be given together, with one number for each bin; NaN in both where nothing is measured"
        ))),
    }
}

#[pymethods]
impl Track {
    #[new]
    #[pyo3(signature = (phi_deg, r_kpc, r_err_kpc, *, bin_width_deg, name="track", v_km_s=None, v_err_km_s=None, width_kpc=None, width_err_kpc=None, density_per_deg=None, density_err_per_deg=None))]
    #[allow(
        clippy::too_many_arguments,
        reason = "keyword arguments, one for each column"
    )]
    fn new(
        phi_deg: Vec<f64>,
        r_kpc: Vec<f64>,
        r_err_kpc: Vec<f64>,
        bin_width_deg: f64,
        name: &str,
        v_km_s: Option<Vec<f64>>,
        v_err_km_s: Option<Vec<f64>>,
        width_kpc: Option<Vec<f64>>,
        width_err_kpc: Option<Vec<f64>>,
        density_per_deg: Option<Vec<f64>>,
        density_err_per_deg: Option<Vec<f64>>,
    ) -> PyResult<Self> {
        let mut observed = ObservedTrack::new(name, &phi_deg, bin_width_deg, &r_kpc, &r_err_kpc)
            .map_err(to_python)?;
        let velocities = measured(["v_km_s", "v_err_km_s"], v_km_s, v_err_km_s)?;
        let widths = measured(["width_kpc", "width_err_kpc"], width_kpc, width_err_kpc)?;
        let densities = measured(
            ["density_per_deg", "density_err_per_deg"],
            density_per_deg,
            density_err_per_deg,
        )?;
        for (quantity, rows) in [
            (BinQuantity::Velocity, velocities),
            (BinQuantity::Width, widths),
            (BinQuantity::Density, densities),
        ] {
            if let Some(rows) = rows {
                observed = observed.with_measured(quantity, rows).map_err(to_python)?;
            }
        }
        Ok(Self { observed })
    }

    /// Reads a track file: ECSV or CSV (docs/tracks.md). `assume_error` is a text such as `2%`, `handedness` is `as-given` or `mirrored`.
    #[staticmethod]
    #[pyo3(signature = (path, *, assume_error=None, handedness=None))]
    fn read(path: PathBuf, assume_error: Option<&str>, handedness: Option<&str>) -> PyResult<Self> {
        Self::from_file(&path, assume_error, handedness)
    }

    #[getter]
    fn name(&self) -> &str {
        &self.observed.name
    }

    #[getter]
    fn bin_width_deg(&self) -> f64 {
        self.observed.bin_width_deg
    }

    #[getter]
    fn phi_deg<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        Self::column(py, &self.observed.phi_deg)
    }

    #[getter]
    fn r_kpc<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        Self::column(py, &self.observed.r_kpc)
    }

    #[getter]
    fn r_err_lo_kpc<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        Self::column(py, &self.observed.r_err_lo_kpc)
    }

    #[getter]
    fn r_err_hi_kpc<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        Self::column(py, &self.observed.r_err_hi_kpc)
    }

    /// Mean line-of-sight velocities, km/s, NaN where none is measured; `None` of a track without velocities.
    #[getter]
    fn v_km_s<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        self.measured(py, BinQuantity::Velocity, |m| m.value)
    }

    /// Their standard errors.
    #[getter]
    fn v_err_km_s<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        self.measured(py, BinQuantity::Velocity, |m| m.error)
    }

    /// Widths of the stream, kpc, NaN where none is measured; `None` of a track without widths.
    #[getter]
    fn width_kpc<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        self.measured(py, BinQuantity::Width, |m| m.value)
    }

    /// Their standard errors.
    #[getter]
    fn width_err_kpc<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        self.measured(py, BinQuantity::Width, |m| m.error)
    }

    /// Numbers of stars per degree, NaN where none is measured; `None` of a track without densities.
    #[getter]
    fn density_per_deg<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        self.measured(py, BinQuantity::Density, |m| m.value)
    }

    /// Their standard errors.
    #[getter]
    fn density_err_per_deg<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        self.measured(py, BinQuantity::Density, |m| m.error)
    }

    /// What was assumed because the file does not say it.
    #[getter]
    fn assumptions(&self) -> Vec<String> {
        self.observed.assumptions()
    }

    fn __len__(&self) -> usize {
        self.observed.len()
    }

    fn __repr__(&self) -> String {
        format!(
            "Track({:?}, {} bins)",
            self.observed.name,
            self.observed.len()
        )
    }
}
