//! Events of a run for a Python function.

use oblate::{Event, Observer};
use pyo3::prelude::*;
use std::ops::ControlFlow;

/// Sends each event to a Python function, as a dictionary like a line of `log.jsonl`. An exception stops the run.
pub struct PythonObserver {
    function: Option<Py<PyAny>>,
    raised: Option<PyErr>,
}

impl PythonObserver {
    /// For a function, if there is one.
    pub fn new(function: Option<Py<PyAny>>) -> Self {
        Self {
            function,
            raised: None,
        }
    }

    /// The result of a run, or the exception that the function raised.
    ///
    /// # Errors
    /// That exception.
    pub fn finish<T>(self, result: T) -> PyResult<T> {
        self.raised.map_or(Ok(result), Err)
    }
}

impl Observer for PythonObserver {
    fn event(&mut self, event: &Event) -> ControlFlow<()> {
        let Some(function) = self.function.as_ref().filter(|_| self.raised.is_none()) else {
            return match self.raised {
                None => ControlFlow::Continue(()),
                Some(_) => ControlFlow::Break(()),
            };
        };
        // An event has numbers and texts only, which always have a JSON text.
        let text = serde_json::to_string(event).unwrap_or_default();
        let told = Python::attach(|py| -> PyResult<()> {
            let event = py.import("json")?.call_method1("loads", (text,))?;
            function.bind(py).call1((event,))?;
            Ok(())
        });
        match told {
            Ok(()) => ControlFlow::Continue(()),
            Err(error) => {
                self.raised = Some(error);
                ControlFlow::Break(())
            }
        }
    }
}
