//! The samplers on Python functions.

use crate::callable::{CallableTarget, Functions, cube};
use crate::errors::{to_python, wrong};
use crate::marginals::Marginal;
use crate::observer::PythonObserver;
use crate::pool::Threads;
use crate::run::Run;
use crate::settings::changed;
use crate::signals::interruptible;
use oblate::inference::{Sampler, SamplerSettings, sample as run_sampler};
use oblate::samplers::{Control, Prior};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::Arc;

/// The prior of an argument: a dictionary of marginals, or a function of the unit cube with the names of its results.
fn prior(
    given: &Bound<'_, PyAny>,
    names: Option<Vec<String>>,
) -> PyResult<(Prior, Option<Py<PyAny>>)> {
    if let Ok(marginals) = given.cast::<PyDict>() {
        if names.is_some() {
            let remedy = "leave them out, because the prior has names";
            return Err(wrong("names", "given", remedy));
        }
        let mut triples = Vec::new();
        for (name, marginal) in marginals {
            let marginal: Marginal = marginal.extract()?;
            triples.push((name.extract::<String>()?, "", marginal.into()));
        }
        let prior = Prior::new(triples).map_err(|e| to_python(e.into()))?;
        return Ok((prior, None));
    }
    if !given.is_callable() {
        let remedy = "give a dictionary of marginals, or a function of the unit cube with `names`";
        return Err(wrong("prior", given.repr()?, remedy));
    }
    let Some(names) = names else {
        let remedy = "give the names of the parameters that the function of the unit cube returns";
        return Err(wrong("names", "missing", remedy));
    };
    Ok((cube(names)?, Some(given.clone().unbind())))
}

/// Samples a posterior of Python functions by nested sampling or parallel tempering.
///
/// `ln_likelihood` takes a point, an array of shape `(dim,)`, and returns ln L, minus infinity where the likelihood is zero; if
/// `vectorized`, it takes points of shape `(n, dim)` and returns `n` values. `prior` is a dictionary of `Uniform`, `Normal` and
/// `HalfNormal` by the parameters' names, or a function from the unit cube to the parameters, whose `names` are then given.
/// `gradient` takes a point and returns ln L and its derivatives. The sampler is `nested` or `pt-hmc`; `settings` are those of
/// docs/samplers.md, section 6. On more than one thread, functions must be safe to call from several threads.
///
/// An exception of a function ends the run and is raised here; so is `KeyboardInterrupt`. The same seed gives the same draws.
#[pyfunction]
#[pyo3(signature = (
    ln_likelihood, prior, *, names=None, gradient=None, vectorized=false, sampler="nested", settings=None, seed=1,
    max_calls=None, threads=1, on_event=None
))]
#[expect(
    clippy::too_many_arguments,
    reason = "keyword arguments of a Python function"
)]
pub fn sample(
    py: Python<'_>,
    ln_likelihood: Py<PyAny>,
    prior: &Bound<'_, PyAny>,
    names: Option<Vec<String>>,
    gradient: Option<Py<PyAny>>,
    vectorized: bool,
    sampler: &str,
    settings: Option<&Bound<'_, PyDict>>,
    seed: u64,
    max_calls: Option<u64>,
    threads: usize,
    on_event: Option<Py<PyAny>>,
) -> PyResult<Run> {
    let (prior, prior_transform) = self::prior(prior, names)?;
    if gradient.is_some() && prior_transform.is_some() {
        let remedy = "give the prior as a dictionary of marginals, whose derivatives are known";
        return Err(wrong("gradient", "given", remedy));
    }
    let sampler: Sampler = sampler.parse().map_err(to_python)?;
    let table = match sampler {
        Sampler::Nested => "nested.",
        Sampler::PtHmc => "pt_hmc.",
    };
    let defaults = SamplerSettings {
        sampler,
        ..SamplerSettings::default()
    };
    let settings = changed(defaults, table, settings)?;
    settings.check(prior.dim()).map_err(to_python)?;
    let functions = Functions {
        ln_likelihood,
        gradient,
        prior_transform,
        vectorized,
    };
    let pool = Threads::new(Some(threads))?.pool()?;
    let run = interruptible(py, &pool, |stop| {
        let target = CallableTarget::new(functions, prior, stop);
        let mut observer = PythonObserver::new(on_event);
        let mut control = Control::new(&mut observer);
        control.interrupt = Arc::clone(stop);
        control.budget.max_calls = max_calls.unwrap_or(u64::MAX);
        let run = run_sampler(&target, &settings, seed, &mut control);
        let run = run.map(|run| target.in_physical_parameters(run));
        match target.into_raised() {
            Some(raised) => Err(raised),
            None => observer.finish(run)?.map_err(to_python),
        }
    })?;
    Ok(run?.into())
}
