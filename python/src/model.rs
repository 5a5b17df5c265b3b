//! Streams of given parameters, without data.

use crate::errors::{no_track, to_python, wrong};
use crate::pool::Threads;
use crate::settings::{changed, from_file};
use crate::tables::{particle_columns, track_columns};
use oblate::Rejection;
use oblate::inference::FitSettings;
use oblate::params::{DIM, NAMES, StreamParams, StreamPrior, index_of};
use oblate::stream::{self, Particles, StreamInput, Workspace};
use oblate::track::Track;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;

/// A model of streams with its settings.
#[pyclass(frozen, module = "oblate")]
pub struct Model {
    model: stream::Model,
    settings: FitSettings,
    prior: StreamPrior,
    threads: Threads,
}

/// All parameters by name; fixed and absent ones may be left out.
fn params(given: &Bound<'_, PyDict>, prior: &StreamPrior) -> PyResult<StreamParams<f64>> {
    let mut values = [None; DIM];
    for (name, value) in given {
        let name: String = name.extract()?;
        let Some(index) = index_of(&name) else {
            let remedy = format!(
                "there is no such parameter; the names are {}",
                NAMES.join(", ")
            );
            return Err(wrong(&name, value.repr()?, &remedy));
        };
        values[index] = Some(value.extract()?);
    }
    let given = StreamParams::from_array(values);
    prior.complete(&given).map_err(to_python)
}

impl Model {
    fn particles(&self, given: &Bound<'_, PyDict>) -> PyResult<(StreamParams<f64>, Particles)> {
        let params = params(given, &self.prior)?;
        self.prior.check_inside(&params).map_err(to_python)?;
        let input = StreamInput {
            params: &params,
            q_range: self.prior.q_range(),
            threads: stream::Threads::All,
        };
        let pool = self.threads.pool()?;
        let work = || -> Result<Particles, Rejection> {
            let mut work = Workspace::default();
            self.model.particles(&input, &mut work)?;
            Ok(work.particles)
        };
        let particles = given.py().detach(|| pool.install(work)).map_err(no_track)?;
        Ok((params, particles))
    }
}

#[pymethods]
impl Model {
    #[new]
    #[pyo3(signature = (*, config=None, settings=None, threads=None))]
    fn new(
        config: Option<PathBuf>,
        settings: Option<&Bound<'_, PyDict>>,
        threads: Option<usize>,
    ) -> PyResult<Self> {
        let settings: FitSettings = changed(from_file(config)?, "", settings)?;
        let prior = settings.prior.with_required_free();
        let prior = StreamPrior::new(&prior).map_err(to_python)?;
        (settings.model.check_prior(&prior)).map_err(to_python)?;
        Ok(Self {
            model: stream::Model::new(&settings.model).map_err(to_python)?,
            prior,
            settings,
            threads: Threads::new(threads)?,
        })
    }

    /// The particles of a stream, by columns, from all parameters by name.
    fn stream<'py>(&self, parameters: &Bound<'py, PyDict>) -> PyResult<Bound<'py, PyDict>> {
        let (_, particles) = self.particles(parameters)?;
        particle_columns(parameters.py(), self.model.particle_table(&particles))
    }

    /// The track of a stream, by columns, from all parameters by name: at the angles and the distance of data with `phi0_deg` and
    /// `distance_factor`.
    #[pyo3(signature = (parameters, *, bin_width_deg=10.0))]
    fn track<'py>(
        &self,
        parameters: &Bound<'py, PyDict>,
        bin_width_deg: f64,
    ) -> PyResult<Bound<'py, PyDict>> {
        let (params, particles) = self.particles(parameters)?;
        let likelihood = &self.settings.likelihood;
        let min_n = likelihood.min_fraction * particles.len() as f64;
        let track = Track::new(&particles, bin_width_deg, likelihood.edges, min_n);
        // As data have it whose progenitor is at another phi, or whose distance is another.
        let track = track.map_err(to_python)?;
        let track = track.measured_with(&params);
        track_columns(parameters.py(), &track)
    }

    fn __repr__(&self) -> String {
        format!(
            "Model({} particles)",
            self.settings.model.releases.particles
        )
    }
}
