//! Errors of the library as Python exceptions, with the library's message.

use oblate::{Error, Rejection};
use pyo3::create_exception;
use pyo3::exceptions::{PyFileNotFoundError, PyOSError, PyPermissionError, PyValueError};
use pyo3::prelude::*;
use std::io::ErrorKind;

create_exception!(
    oblate,
    OblateError,
    PyValueError,
    "Input that cannot be used, or work that cannot go on; the message says why and what to do."
);

/// The exception of an error of the library.
pub fn to_python(error: Error) -> PyErr {
    let message = error.to_string();
    let kind = match &error {
        Error::Io { source, .. } => source.kind(),
        Error::Sampler(oblate::samplers::Error::Io { source, .. }) => source.kind(),
        _ => return OblateError::new_err(message),
    };
    match kind {
        ErrorKind::NotFound => PyFileNotFoundError::new_err(message),
        ErrorKind::PermissionDenied => PyPermissionError::new_err(message),
        _ => PyOSError::new_err(message),
    }
}

/// The exception of a point that had to have a stream and has none.
pub fn no_track(cause: Rejection) -> PyErr {
    to_python(Error::NoTrack(cause))
}

/// The exception of an argument that cannot be used, in the words of the library.
pub fn wrong(key: &str, value: impl ToString, remedy: &str) -> PyErr {
    to_python(Error::Setting {
        key: key.to_owned(),
        value: value.to_string(),
        remedy: remedy.to_owned(),
    })
}
