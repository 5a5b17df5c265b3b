//! Tracks and particles as dictionaries of numpy arrays.

use numpy::PyArray1;
use oblate::stream::ParticleTable;
use oblate::track::{Track, TrackBin};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// The bins of a track.
pub fn track_columns<'py>(py: Python<'py>, track: &Track) -> PyResult<Bound<'py, PyDict>> {
    let column =
        |of_bin: fn(&TrackBin) -> f64| PyArray1::from_iter(py, track.bins.iter().map(of_bin));
    let columns = PyDict::new(py);
    columns.set_item("phi_deg", column(|bin| bin.phi_deg))?;
    columns.set_item("r_kpc", column(|bin| bin.r_kpc))?;
    columns.set_item("r_err_kpc", column(|bin| bin.r_err_kpc))?;
    columns.set_item("n", column(|bin| bin.n))?;
    columns.set_item("v_km_s", column(|bin| bin.v_km_s))?;
    columns.set_item("v_err_km_s", column(|bin| bin.v_err_km_s))?;
    columns.set_item("width_kpc", column(|bin| bin.width_kpc))?;
    columns.set_item("density_per_deg", column(|bin| bin.density_per_deg))?;
    Ok(columns)
}

/// The particles of a stream.
pub fn particle_columns(py: Python<'_>, table: ParticleTable) -> PyResult<Bound<'_, PyDict>> {
    let columns = PyDict::new(py);
    let names: Vec<&str> = table.tails.iter().map(|tail| tail.name()).collect();
    columns.set_item("tail", py.import("numpy")?.call_method1("array", (names,))?)?;
    for (name, values) in table.columns {
        columns.set_item(name, PyArray1::from_vec(py, values))?;
    }
    Ok(columns)
}
