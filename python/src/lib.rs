//! The extension module `oblate._oblate`: the library's functions for numpy arrays. `_oblate.pyi` has the types that Python sees.

mod callable;
mod errors;
mod fit;
mod marginals;
mod model;
mod observer;
mod points;
mod pool;
mod run;
mod sample;
mod settings;
mod signals;
mod tables;
mod track;

/// The extension module.
#[pyo3::pymodule]
mod _oblate {
    #[pymodule_export]
    use crate::errors::OblateError;
    #[pymodule_export]
    use crate::fit::{_restore_fit, Fit};
    #[pymodule_export]
    use crate::marginals::Marginal;
    #[pymodule_export]
    use crate::model::Model;
    #[pymodule_export]
    use crate::run::Run;
    #[pymodule_export]
    use crate::sample::sample;
    #[pymodule_export]
    use crate::track::Track;

    /// Version of the library.
    #[pymodule_export]
    #[expect(
        non_upper_case_globals,
        reason = "the name that Python packages have for it"
    )]
    const __version__: &str = env!("CARGO_PKG_VERSION");
}
