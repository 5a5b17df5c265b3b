//! What can end a run: every variant says what, where, and what to do next.

use std::path::PathBuf;

/// The crate's result.
pub type Result<T> = std::result::Result<T, Error>;

/// A run that cannot start or cannot go on. A point without a likelihood is not an error but a
/// [`Reject`](crate::Outcome::Reject).
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A setting is out of its range.
    #[error("setting `{name}` is {value}; {remedy}")]
    Setting {
        /// The setting's name as the user writes it.
        name: &'static str,
        /// What was given.
        value: String,
        /// What to give instead.
        remedy: &'static str,
    },
    /// No draw of the prior has a finite likelihood.
    #[error(
        "none of {tries} prior draws has a finite likelihood (most frequent cause: {cause}); check that the prior can produce the data, or use a likelihood that is finite everywhere"
    )]
    NoStart {
        /// Number of prior draws tried.
        tries: usize,
        /// The most frequent cause of rejection.
        cause: String,
    },
    /// A step of a sampler did not end.
    #[error("{what}, after {tries} tries; {remedy}")]
    Stuck {
        /// What did not end.
        what: &'static str,
        /// Number of tries.
        tries: u64,
        /// What to do.
        remedy: &'static str,
    },
    /// The sampler needs gradients and the target has none.
    #[error("{sampler} needs gradients, and this target offers none; {remedy}")]
    NoGradient {
        /// Which sampler asked.
        sampler: &'static str,
        /// What to use instead.
        remedy: &'static str,
    },
    /// The target failed in a way that no other point can mend.
    #[error("the target failed: {0}; mend the cause and resume from the checkpoint")]
    Fatal(String),
    /// The target returned plus infinity.
    #[error(
        "the log-likelihood is +inf at theta = {theta:?}; a likelihood must be finite or rejected, check its normalisation"
    )]
    Infinite {
        /// Where, in physical parameters.
        theta: Vec<f64>,
    },
    /// A run was stopped before it had anything to show.
    #[error("stopped before there was a result; resume it, from its checkpoint where it has one")]
    Interrupted,
    /// A file could not be read or written.
    #[error("{path}: {source}; check that the folder exists, is writable and has space left")]
    Io {
        /// The file.
        path: PathBuf,
        /// The operating system's word.
        source: std::io::Error,
    },
    /// A checkpoint cannot be used.
    #[error("{path}: {why}; {remedy}")]
    Checkpoint {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        why: String,
        /// What to do.
        remedy: &'static str,
    },
    /// Two things that belong together do not.
    #[error("{what}: {why}")]
    Mismatch {
        /// What was compared.
        what: &'static str,
        /// How they differ, and the remedy.
        why: String,
    },
}
