//! Observed tracks.

use crate::errors::to_python;
use numpy::PyArray1;
use oblate::data::{ObservedTrack, ReadOptions};
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
}

#[pymethods]
impl Track {
    #[new]
    #[pyo3(signature = (phi_deg, r_kpc, r_err_kpc, *, bin_width_deg, name="track"))]
    fn new(
        phi_deg: Vec<f64>,
        r_kpc: Vec<f64>,
        r_err_kpc: Vec<f64>,
        bin_width_deg: f64,
        name: &str,
    ) -> PyResult<Self> {
        let observed = ObservedTrack::new(name, &phi_deg, bin_width_deg, &r_kpc, &r_err_kpc)
            .map_err(to_python)?;
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
