//! Python functions as a target of the samplers.

use crate::errors::wrong;
use crate::points::floats;
use numpy::{PyArray1, PyArrayMethods};
use oblate::samplers::{Outcome, Prior, Run, Target};
use pyo3::prelude::*;
use rayon::prelude::*;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// Cost of a value with gradient in units of a value, as of reverse mode.
const GRADIENT_COST: f64 = 3.0;

/// The functions of a user.
pub struct Functions {
    /// ln L of one point, or of each of many if `vectorized`.
    pub ln_likelihood: Py<PyAny>,
    /// ln L of one point and its derivatives.
    pub gradient: Option<Py<PyAny>>,
    /// Physical parameters from coordinates of the unit cube.
    pub prior_transform: Option<Py<PyAny>>,
    /// Whether `ln_likelihood` takes many points.
    pub vectorized: bool,
}

/// The posterior of a user's functions.
pub struct CallableTarget {
    functions: Functions,
    /// With a `prior_transform` that of the cube: the samplers then work on the cube, and physical parameters are derived.
    prior: Prior,
    /// True as soon as the run is to end.
    stop: Arc<AtomicBool>,
    /// The first exception that a function raised.
    raised: Mutex<Option<PyErr>>,
}

impl CallableTarget {
    /// Of functions over a prior. `stop` ends the run early when it is set, and is set when a function raises an exception.
    pub fn new(functions: Functions, prior: Prior, stop: &Arc<AtomicBool>) -> Self {
        Self {
            functions,
            prior,
            stop: Arc::clone(stop),
            raised: Mutex::new(None),
        }
    }

    /// The exception that a function raised.
    pub fn into_raised(self) -> Option<PyErr> {
        self.raised
            .into_inner()
            .unwrap_or_else(PoisonError::into_inner)
    }

    /// A run on the cube as one in physical parameters.
    pub fn in_physical_parameters(&self, mut run: Run) -> Run {
        if self.functions.prior_transform.is_some() {
            let draws = &mut run.draws;
            draws.theta = std::mem::take(&mut draws.derived);
            draws.derived_dim = 0;
            run.derived_names.clear();
        }
        run
    }

    /// Ends the run with an exception.
    fn fail(&self, error: PyErr) -> Outcome {
        self.stop.store(true, Ordering::Relaxed);
        let mut raised = self.raised.lock().unwrap_or_else(PoisonError::into_inner);
        raised.get_or_insert(error);
        Outcome::Fatal("a Python function raised an exception".to_owned())
    }

    /// Calls Python, unless the run is to end.
    fn call<T>(&self, work: impl FnOnce(Python<'_>) -> PyResult<T>) -> Result<T, Outcome> {
        if self.stop.load(Ordering::Relaxed) {
            return Err(Outcome::Fatal("stopped".to_owned()));
        }
        Python::attach(work).map_err(|error| self.fail(error))
    }

    /// A point as the user's functions take it.
    fn argument<'py>(&self, py: Python<'py>, point: &[f64]) -> PyResult<Bound<'py, PyAny>> {
        let point = PyArray1::from_slice(py, point);
        match &self.functions.prior_transform {
            None => Ok(point.into_any()),
            Some(transform) => {
                let theta = transform.bind(py).call1((point,))?;
                let shape = [self.prior.dim()];
                Ok(floats(&theta, "prior_transform(u)", &shape)?.into_any())
            }
        }
    }

    /// ln L of many points, by one call.
    fn values_at_once(&self, py: Python<'_>, points: &[Vec<f64>]) -> PyResult<Vec<f64>> {
        let mut numbers = Vec::with_capacity(points.len() * self.dim());
        for point in points {
            let theta = self.argument(py, point)?;
            numbers.extend_from_slice(
                floats(&theta, "theta", &[self.dim()])?
                    .readonly()
                    .as_slice()?,
            );
        }
        let theta = PyArray1::from_vec(py, numbers).reshape([points.len(), self.dim()])?;
        let values = self.functions.ln_likelihood.bind(py).call1((theta,))?;
        let values = floats(&values, "ln_likelihood(theta)", &[points.len()])?;
        Ok(values.readonly().as_slice()?.to_vec())
    }

    /// ln L and its gradient, which is written into `gradient`.
    fn value_and_gradient(
        &self,
        py: Python<'_>,
        function: &Py<PyAny>,
        theta: &[f64],
        gradient: &mut [f64],
    ) -> PyResult<f64> {
        let answer = function
            .bind(py)
            .call1((PyArray1::from_slice(py, theta),))?;
        let (value, derivatives): (f64, Bound<'_, PyAny>) = answer.extract()?;
        let derivatives = floats(&derivatives, "gradient(theta)[1]", &[theta.len()])?;
        gradient.copy_from_slice(derivatives.readonly().as_slice()?);
        Ok(value)
    }
}

impl Target for CallableTarget {
    fn prior(&self) -> &Prior {
        &self.prior
    }

    fn ln_likelihood(&self, theta: &[f64]) -> Outcome {
        let value = self.call(|py| {
            if self.functions.vectorized {
                let values = self.values_at_once(py, &[theta.to_vec()])?;
                return Ok(values.first().copied().unwrap_or(f64::NAN));
            }
            let theta = self.argument(py, theta)?;
            self.functions
                .ln_likelihood
                .bind(py)
                .call1((theta,))?
                .extract()
        });
        value.map_or_else(|failed| failed, Outcome::from_ln_likelihood)
    }

    fn ln_likelihoods(&self, thetas: &[Vec<f64>]) -> Vec<Outcome> {
        if !self.functions.vectorized {
            return thetas.par_iter().map(|t| self.ln_likelihood(t)).collect();
        }
        match self.call(|py| self.values_at_once(py, thetas)) {
            Ok(values) => values
                .into_iter()
                .map(Outcome::from_ln_likelihood)
                .collect(),
            Err(failed) => vec![failed; thetas.len()],
        }
    }

    fn ln_likelihood_and_gradient(&self, theta: &[f64], gradient: &mut [f64]) -> Outcome {
        let Some(function) = &self.functions.gradient else {
            return Outcome::Fatal("there is no gradient".to_owned());
        };
        self.call(|py| self.value_and_gradient(py, function, theta, gradient))
            .map_or_else(|failed| failed, Outcome::from_ln_likelihood)
    }

    fn gradient_cost(&self) -> Option<f64> {
        self.functions.gradient.as_ref().map(|_| GRADIENT_COST)
    }

    fn derived_names(&self) -> Vec<(String, String)> {
        if self.functions.prior_transform.is_none() {
            return Vec::new();
        }
        let names = self.prior.names().iter();
        names.map(|name| (name.clone(), String::new())).collect()
    }

    fn derived(&self, theta: &[f64], out: &mut Vec<f64>) {
        if self.functions.prior_transform.is_none() {
            return;
        }
        // After an exception these numbers are not used.
        let nothing = vec![f64::NAN; theta.len()];
        let theta = self.call(|py| {
            let theta = self.argument(py, theta)?;
            let theta = floats(&theta, "theta", &[self.dim()])?;
            Ok(theta.readonly().as_slice()?.to_vec())
        });
        out.extend(theta.unwrap_or(nothing));
    }
}

/// The prior of the unit cube with these names.
///
/// # Errors
/// `OblateError` if there is no name.
pub fn cube(names: Vec<String>) -> PyResult<Prior> {
    let unit = oblate::samplers::Marginal::Uniform { lo: 0.0, hi: 1.0 };
    if names.is_empty() {
        return Err(wrong("names", "[]", "give the name of each parameter"));
    }
    Prior::new(names.into_iter().map(|name| (name, "", unit)))
        .map_err(|e| crate::errors::to_python(e.into()))
}
