//! The result of a sampler.

use crate::errors::to_python;
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use oblate::posterior::{Column, Summary, columns, zarr::equal_weight_rows};
use oblate::run::RunFolder;
use oblate::{Fit, samplers};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;

/// The result of a sampler: draws, evidence and convergence checks.
#[pyclass(frozen, module = "oblate")]
pub struct Run {
    run: samplers::Run,
    summary: Option<Summary>,
}

impl From<samplers::Run> for Run {
    fn from(run: samplers::Run) -> Self {
        Self { run, summary: None }
    }
}

impl From<Fit> for Run {
    fn from(fit: Fit) -> Self {
        Self {
            run: fit.run,
            summary: Some(fit.summary),
        }
    }
}

impl Run {
    /// All columns: parameters, derived quantities, ln L.
    fn columns(&self) -> Vec<Column> {
        let mut all = columns(&self.run);
        all.push(Column {
            name: "ln_likelihood".to_owned(),
            unit: String::new(),
            values: self.run.draws.ln_likelihood.clone(),
        });
        all
    }
}

#[pymethods]
impl Run {
    /// Reads a finished run from its folder.
    #[staticmethod]
    fn read(folder: PathBuf) -> PyResult<Self> {
        let folder = RunFolder::open(&folder).map_err(to_python)?;
        let stored = folder.read().map_err(to_python)?;
        Ok(Self {
            run: stored.run,
            summary: Some(stored.summary),
        })
    }

    /// The sampler: `nested`, `pt-hmc` or `bridge`.
    #[getter]
    fn method(&self) -> &'static str {
        self.run.method.name()
    }

    /// Master seed.
    #[getter]
    fn seed(&self) -> u64 {
        self.run.seed
    }

    /// Names of the parameters.
    #[getter]
    fn names(&self) -> Vec<String> {
        self.run.names.clone()
    }

    /// Units of the parameters.
    #[getter]
    fn units(&self) -> Vec<String> {
        self.run.units.clone()
    }

    /// The sampler's own draws, of shape `(n, dim)`.
    #[getter]
    fn theta<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let draws = &self.run.draws;
        PyArray1::from_slice(py, &draws.theta).reshape([draws.len(), draws.dim])
    }

    /// ln L of each draw.
    #[getter]
    fn ln_likelihood<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.run.draws.ln_likelihood)
    }

    /// Logarithm of the weight of each draw; the weights add up to 1.
    #[getter]
    fn ln_weight<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.run.draws.ln_weight)
    }

    /// Derived quantities of each draw.
    #[getter]
    fn derived<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let derived = PyDict::new(py);
        for (i, (name, _)) in self.run.derived_names.iter().enumerate() {
            let column = self.run.draws.derived_column(i);
            derived.set_item(name, PyArray1::from_vec(py, column))?;
        }
        Ok(derived)
    }

    /// ln Z.
    #[getter]
    fn ln_z(&self) -> f64 {
        self.run.evidence.ln_z
    }

    /// Standard error of ln Z.
    #[getter]
    fn ln_z_error(&self) -> f64 {
        self.run.evidence.error
    }

    /// Effective sample size: the smallest of all parameters.
    #[getter]
    fn ess(&self) -> f64 {
        self.run.ess.quoted
    }

    /// Likelihood values, those with a gradient among them.
    #[getter]
    fn calls(&self) -> u64 {
        self.run.cost.all_calls()
    }

    /// Rejected points by cause.
    #[getter]
    fn rejected<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let rejected = PyDict::new(py);
        for (cause, count) in &self.run.cost.rejected {
            rejected.set_item(cause, count)?;
        }
        Ok(rejected)
    }

    /// Whether the run ended by its stopping rule and passed every check.
    #[getter]
    fn converged(&self) -> bool {
        self.run.converged()
    }

    /// Convergence checks.
    #[getter]
    fn checks<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyDict>>> {
        let to_dict = |check: &samplers::output::Check| {
            let dict = PyDict::new(py);
            dict.set_item("name", &check.name)?;
            dict.set_item("value", check.value)?;
            dict.set_item("limit", check.limit)?;
            dict.set_item("passed", check.pass)?;
            dict.set_item("message", &check.message)?;
            Ok(dict)
        };
        self.run.checks.iter().map(to_dict).collect()
    }

    /// Warnings, each with its remedy.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        let of_model = self.summary.iter().flat_map(|s| &s.model_warnings);
        self.run.warnings.iter().chain(of_model).cloned().collect()
    }

    /// Draws as a pandas table: of equal weight, or the sampler's own with a column `weight`.
    #[pyo3(signature = (*, weighted=false))]
    fn to_pandas<'py>(&self, weighted: bool, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let (table, units) = (PyDict::new(py), PyDict::new(py));
        let rows: Vec<usize> = if weighted {
            (0..self.run.draws.len()).collect()
        } else {
            equal_weight_rows(&self.run).concat()
        };
        for column in self.columns() {
            let values = rows.iter().map(|row| column.values[*row]);
            table.set_item(&column.name, PyArray1::from_iter(py, values))?;
            units.set_item(column.name, column.unit)?;
        }
        if weighted {
            let weights = self.run.draws.weights();
            table.set_item("weight", PyArray1::from_vec(py, weights))?;
        }
        let frame = py.import("pandas")?.call_method1("DataFrame", (table,))?;
        frame.getattr("attrs")?.set_item("units", units)?;
        Ok(frame)
    }

    fn __len__(&self) -> usize {
        self.run.draws.len()
    }

    fn __str__(&self) -> String {
        match &self.summary {
            Some(summary) => summary.to_string(),
            None => self.__repr__(),
        }
    }

    fn __repr__(&self) -> String {
        let converged = if self.run.converged() {
            "converged"
        } else {
            "not converged"
        };
        format!(
            "Run({}, {converged}, {} draws, ESS {:.0}, ln Z = {:.3} +- {:.3})",
            self.run.method.name(),
            self.run.draws.len(),
            self.run.ess.quoted,
            self.run.evidence.ln_z,
            self.run.evidence.error
        )
    }
}
