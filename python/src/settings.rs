//! Settings: the library's own, from a settings file and from Python values.

use crate::errors::{to_python, wrong};
use oblate::config::{read, to_toml, with_value};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyList, PyString, PyTuple};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::path::PathBuf;

/// The settings of a file, or the defaults.
///
/// # Errors
/// Those of [`read`].
pub fn from_file<T: DeserializeOwned + Default>(path: Option<PathBuf>) -> PyResult<T> {
    path.map_or_else(|| Ok(T::default()), |path| read(&path))
        .map_err(to_python)
}

/// Settings with those of a dictionary changed, as by `--set KEY=VALUE`; `table` stands before each key.
///
/// # Errors
/// `OblateError` for an unknown key or a value of another type; `TypeError` for a value that no setting has.
pub fn changed<T: Serialize + DeserializeOwned>(
    mut settings: T,
    table: &str,
    changes: Option<&Bound<'_, PyDict>>,
) -> PyResult<T> {
    for (key, value) in changes.into_iter().flatten() {
        let key: String = key.extract()?;
        let value = toml_value(&value)?.to_string();
        settings = with_value(&settings, &format!("{table}{key}"), &value).map_err(to_python)?;
    }
    Ok(settings)
}

/// All settings as a dictionary of tables.
///
/// # Errors
/// Those of [`to_toml`].
pub fn to_dict<'py>(py: Python<'py>, settings: &impl Serialize) -> PyResult<Bound<'py, PyAny>> {
    let text = to_toml(settings).map_err(to_python)?;
    py.import("tomllib")?.call_method1("loads", (text,))
}

/// A Python value as TOML.
fn toml_value(value: &Bound<'_, PyAny>) -> PyResult<toml::Value> {
    // Before the integers: for Python, bool is one of them.
    if value.is_instance_of::<PyBool>() {
        return Ok(toml::Value::Boolean(value.extract()?));
    }
    if let Ok(text) = value.cast::<PyString>() {
        return Ok(toml::Value::String(text.extract()?));
    }
    if let Ok(table) = value.cast::<PyDict>() {
        let pairs = table
            .iter()
            .map(|(key, value)| Ok((key.extract::<String>()?, toml_value(&value)?)));
        return Ok(toml::Value::Table(pairs.collect::<PyResult<_>>()?));
    }
    if value.is_instance_of::<PyList>() || value.is_instance_of::<PyTuple>() {
        let items = value.try_iter()?.map(|item| toml_value(&item?));
        return Ok(toml::Value::Array(items.collect::<PyResult<_>>()?));
    }
    if let Ok(integer) = value.extract::<i64>() {
        return Ok(toml::Value::Integer(integer));
    }
    if let Ok(number) = value.extract::<f64>() {
        return Ok(toml::Value::Float(number));
    }
    Err(PyTypeError::new_err(format!(
        "{} cannot be a setting; give a number, a text, a bool, a list or a dict",
        value.repr()?
    )))
}

/// A text of a few choices.
///
/// # Errors
/// `OblateError` for any other text.
pub fn one_of<T: Copy>(key: &str, given: &str, choices: &[(&str, T)]) -> PyResult<T> {
    let names = || choices.iter().map(|(name, _)| *name).collect::<Vec<_>>();
    choices
        .iter()
        .find(|(name, _)| *name == given)
        .map(|(_, choice)| *choice)
        .ok_or_else(|| wrong(key, given, &format!("give one of {}", names().join(", "))))
}
