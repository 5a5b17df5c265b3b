//! Errors that end a run: every message has the fault, its place and the remedy.

use crate::limits::{OutOfRange, TooMuchMemory};
use std::path::PathBuf;

/// The crate's result.
pub type Result<T> = std::result::Result<T, Error>;

/// A run that cannot start or cannot continue. A point without a likelihood is not an error but a
/// [`Reject`](crate::Outcome::Reject).
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A number is out of its range.
    #[error(transparent)]
    OutOfRange(#[from] OutOfRange),
    /// The settings need more memory than one run may take.
    #[error(transparent)]
    TooMuchMemory(#[from] TooMuchMemory),
    /// Settings do not go together, or not with the target.
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
    /// The interval of a slice update became empty although it contains a point above the likelihood bound.
    #[error(
        "the interval of a slice update became empty in {tries} steps; check that the likelihood gives the same number each time at the same point"
    )]
    EmptySlice {
        /// Number of steps inward.
        tries: u64,
    },
    /// Independent draws from the ellipsoids never exceed the likelihood bound.
    #[error(
        "none of {calls} independent draws from the ellipsoids is above the likelihood bound; use `kernel = \"differential\"`, which does not need tight ellipsoids"
    )]
    LooseBound {
        /// Number of likelihood calls.
        calls: u64,
    },
    /// The SMC samplers do not reach the end of their annealing path.
    #[error(
        "SMC does not reach the end of its annealing path, after {steps} steps: ln L differs too much between the particles; use more SMC particles, or check the errors of the data"
    )]
    EndlessPath {
        /// Number of steps.
        steps: usize,
    },
    /// Parallel tempering of a target without gradients.
    #[error(
        "parallel tempering needs gradients, and this target offers none; use nested sampling instead"
    )]
    TemperingWithoutGradient,
    /// The nested sampler's kernel `galilean` with a target without gradients.
    #[error(
        "the kernel `galilean` needs gradients, and this target offers none; use `differential` or `random-slice`, which need values only"
    )]
    GalileanWithoutGradient,
    /// The target failed in a way that does not depend on the point.
    #[error("the target failed: {0}; remove the cause and resume from the checkpoint")]
    Fatal(String),
    /// The target returned plus infinity.
    #[error(
        "the log-likelihood is +inf at theta = {theta:?}; a likelihood must be finite or rejected, check its normalisation"
    )]
    Infinite {
        /// Where, in physical parameters.
        theta: Vec<f64>,
    },
    /// A run was stopped before its first result.
    #[error("stopped before the first result; resume it from its checkpoint")]
    Interrupted,
    /// A file could not be read or written.
    #[error("{path}: {source}; check that the folder exists, is writable and has space left")]
    Io {
        /// The file.
        path: PathBuf,
        /// The operating system's error.
        source: std::io::Error,
    },
    /// A checkpoint cannot be written or used.
    #[error("{path}: {fault}")]
    Checkpoint {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        fault: CheckpointFault,
    },
    /// A target gives another number of derived quantities than it names.
    #[error(
        "the target names {named} derived quantities and gives {given}; its `derived` and `derived_names` must agree"
    )]
    DerivedCount {
        /// Number of names.
        named: usize,
        /// Number of values.
        given: usize,
    },
    /// A run has other parameters than the target, or two targets have different ones.
    #[error("{run} has other parameters than the target; give the settings with which it was made")]
    OtherParameters {
        /// Which run: of a bridge or a merge.
        run: &'static str,
    },
    /// The arrays and numbers of a run do not belong together.
    #[error("{run}: {message}; give the run as the sampler returned it")]
    Inconsistent {
        /// Which run: of a bridge or a merge.
        run: &'static str,
        /// What does not belong together.
        message: String,
    },
    /// A run has no draws.
    #[error("{run} has no draws; resume it until it has")]
    NoDraws {
        /// Which run: of a bridge or a merge.
        run: &'static str,
    },
    /// ln L of several draws of a run is not what the target gives there.
    #[error(
        "ln L of {run} is another for this target, of one of several draws {here} instead of {there}; give the data and settings with which it was made"
    )]
    OtherLikelihood {
        /// Which run: of a bridge or a merge.
        run: &'static str,
        /// ln L by the target.
        here: f64,
        /// ln L in the run.
        there: f64,
    },
    /// The fine target of a bridge rejects all draws of the coarse run.
    #[error(
        "the fine target rejects all draws of the coarse run; use a coarse likelihood closer to the fine one"
    )]
    NoCommonSupport,
    /// Fewer than two runs to merge.
    #[error("a merge needs two runs or more, and {given} was given")]
    TooFewRuns {
        /// Number of runs.
        given: usize,
    },
    /// Two runs to merge have the same seed, and with it the same draws.
    #[error(
        "two of the runs to merge have the same seed, {seed}, and so the same draws; give each run its own seed"
    )]
    SameSeed {
        /// The seed.
        seed: u64,
    },
    /// Two runs to merge have common draws, though their seeds differ.
    #[error(
        "two of the runs to merge have draws in common: one, with the seed {seed}, is a part of another, which is a merger itself; give each run once"
    )]
    SharedDraws {
        /// The seed of the later one.
        seed: u64,
    },
    /// Runs to merge have more lineages than labels.
    #[error("the runs to merge have too many lineages to be told apart; merge fewer runs")]
    TooManyLineages,
    /// A run to merge has no effective sample sizes of its parameters.
    #[error(
        "one of the runs to merge has no effective sample sizes of its parameters; fit it again"
    )]
    NoEss,
    /// A run to merge is not a nested one.
    #[error(
        "the run with seed {seed} is not a nested run, and only those can be merged; leave it out"
    )]
    NotNested {
        /// Its seed.
        seed: u64,
    },
}

/// What is wrong with a checkpoint.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CheckpointFault {
    /// Another file, or one that ends too early.
    #[error("not a checkpoint, or cut short; remove it and start again, or restore a good copy")]
    NotACheckpoint,
    /// Of another version of the program.
    #[error(
        "checkpoint format {found}, and this program writes {written}; resume with the version that wrote it, or start again"
    )]
    Format {
        /// Version of the file.
        found: u32,
        /// Version of this program.
        written: u32,
    },
    /// The content is damaged.
    #[error(
        "the checksum does not match, so the file is damaged; remove it and start again, or restore a good copy"
    )]
    Checksum,
    /// Of a run with other settings or another seed.
    #[error("written by a run with other settings or another seed; resume with those of the run")]
    OtherSettings,
    /// Of a run on another target.
    #[error(
        "written for another target (data, model or library version); resume with the same inputs"
    )]
    OtherTarget,
    /// The content has another layout.
    #[error("cannot be decoded ({message}); remove it and start again, or restore a good copy")]
    Undecodable {
        /// The decoder's message.
        message: String,
    },
    /// The state can be decoded, but is none of this run.
    #[error("its state is of no run: {message}; remove it and start again, or restore a good copy")]
    Inconsistent {
        /// What is wrong with it.
        message: String,
    },
    /// The state is larger than what can be read back.
    #[error(
        "the state has {gib} GiB, and at most {max_gib} can be read back; use fewer live points, chain sets or scans"
    )]
    TooLarge {
        /// Its size.
        gib: usize,
        /// The largest size.
        max_gib: u64,
    },
    /// The state has no encoding.
    #[error("the state cannot be encoded ({message}); report this as a bug")]
    Unencodable {
        /// The encoder's message.
        message: String,
    },
}
