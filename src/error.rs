//! [`Error`]: the run cannot start or continue; [`Rejection`]: a point of parameter space has no track or no
//! likelihood; [`Tally`]: approximations made in the computation of a track, counted.

mod array;
mod output;
mod population;
mod track;

pub use array::ArrayFault;
pub use output::{NameFault, OutputFault};
pub use population::PosteriorFault;
pub use track::TrackFault;

use oblate_samplers::limits::{OutOfRange, TooMuchMemory};
use oblate_samplers::output::RunFault;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// The crate's result.
pub type Result<T> = std::result::Result<T, Error>;

/// A run that cannot start or cannot continue; every message has the fault, its place and the remedy.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file is not written in its format.
    #[error("{}: {message}; {remedy}", place(path, *line))]
    Syntax {
        /// The file.
        path: PathBuf,
        /// The line, from 1, where it is known.
        line: Option<usize>,
        /// The parser's message.
        message: String,
        /// What to do.
        remedy: &'static str,
    },
    /// A track file cannot be used.
    #[error("{}: {fault}", place(path, *line))]
    TrackFile {
        /// The file.
        path: PathBuf,
        /// The line, from 1, where it is known.
        line: Option<usize>,
        /// What is wrong.
        fault: TrackFault,
    },
    /// The columns of a track made in memory cannot be used.
    #[error("track {name}{}: {fault}", bin.map_or(String::new(), |bin| format!(", bin {bin}")))]
    Track {
        /// The track.
        name: String,
        /// The bin, from 1, if one bin is at fault.
        bin: Option<usize>,
        /// What is wrong.
        fault: TrackFault,
    },
    /// A value that was read from a file cannot be used.
    #[error("{}: {source}", place(path, *line))]
    InFile {
        /// The file.
        path: PathBuf,
        /// The line, from 1, where it is known.
        line: Option<usize>,
        /// What is wrong with it.
        source: Box<Error>,
    },
    /// A table of a settings file cannot be used.
    #[error("[{table}] {source}")]
    InTable {
        /// The table as the user writes it.
        table: &'static str,
        /// What is wrong with it.
        source: Box<Error>,
    },
    /// A setting, flag or argument is out of its range (docs/limits.md).
    #[error(transparent)]
    OutOfRange(#[from] OutOfRange),
    /// The settings need more memory than one task may take.
    #[error(transparent)]
    TooMuchMemory(#[from] TooMuchMemory),
    /// A setting, flag or argument cannot be used, or not together with others.
    #[error("{key} = {value}: {remedy}")]
    Setting {
        /// The key as the user writes it.
        key: String,
        /// What was given.
        value: String,
        /// What is allowed.
        remedy: String,
    },
    /// A parameter lies outside its prior.
    #[error(
        "{name} = {value} lies outside its prior [{lo}, {hi}]; give a value inside, or widen the prior"
    )]
    OutsidePrior {
        /// The parameter.
        name: String,
        /// What was given.
        value: f64,
        /// Lower bound.
        lo: f64,
        /// Upper bound.
        hi: f64,
    },
    /// The output exists already.
    #[error("{}: exists already", path.display())]
    Exists {
        /// The file or folder.
        path: PathBuf,
    },
    /// Nothing can be written to a path, or nothing at it may be removed.
    #[error("{} {fault}", path.display())]
    OutputPath {
        /// The file or folder.
        path: PathBuf,
        /// Why.
        fault: OutputFault,
    },
    /// A run has ended, and its result could not be written.
    #[error("{source}; no work is lost, the run can be continued where it ended")]
    Unwritten {
        /// Why not.
        source: Box<Error>,
    },
    /// A file could not be read or written.
    #[error("{}: {source}; {remedy}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The operating system's error.
        source: std::io::Error,
        /// What to do.
        remedy: &'static str,
    },
    /// Standard output could not be written.
    #[error("standard output: {source}; free space where it goes, or send it elsewhere")]
    Output {
        /// The operating system's error.
        source: std::io::Error,
    },
    /// Another program that is needed cannot be started, or fails.
    #[error("{program}: {message}; {remedy}")]
    Command {
        /// The program.
        program: String,
        /// What it or the operating system says.
        message: String,
        /// What to do.
        remedy: &'static str,
    },
    /// Another process works in the run folder.
    #[error("{}: another run works in this folder; wait for its end, or use another folder", path.display())]
    FolderInUse {
        /// The locked file.
        path: PathBuf,
    },
    /// The folder holds a run of another track, other settings or another version.
    #[error("{}: made from another track, other settings or another version", path.display())]
    OtherInputs {
        /// The folder.
        path: PathBuf,
    },
    /// A run folder has no track.
    #[error("{} has no track: it is not a fit", path.display())]
    NotAFit {
        /// The folder.
        path: PathBuf,
    },
    /// An array of a posterior file cannot be used.
    #[error("{}: {array}: {fault}; restore the run folder from a whole copy, or fit again", path.display())]
    Array {
        /// The Zarr folder.
        path: PathBuf,
        /// The array within it.
        array: String,
        /// What is wrong.
        fault: ArrayFault,
    },
    /// Arrays and numbers of a run do not belong together.
    #[error("{0}; restore the run folder from a whole copy, or fit again")]
    UnsoundRun(#[from] RunFault),
    /// A run folder has the files of two runs.
    #[error(
        "posterior.zarr and summary.json belong to different runs; restore the run folder from one copy, or fit again"
    )]
    MixedFolder,
    /// The draws of a run are not those that its summary was written with.
    #[error(
        "{} does not have the checksum in summary.json: the two are of different runs, or a file is damaged; restore the run folder from \
         one copy, or run again",
        path.display()
    )]
    Checksum {
        /// The Zarr folder.
        path: PathBuf,
    },
    /// A parameter or derived quantity has a name that no array can have.
    #[error(
        "`{}` cannot be the name of an array: another parameter has it, or it is empty, `.`, `..`, `chain` or `draw`, or it has a slash; \
         choose another name",
        name.escape_debug()
    )]
    ArrayName {
        /// The name.
        name: String,
    },
    /// Two tracks of a study have the same name.
    #[error(
        "the track `{}` would have the run folder of `{}`; give each track of a study a `name` of its own in its header",
        name.escape_debug(),
        other.escape_debug()
    )]
    SameName {
        /// Name of the later track.
        name: String,
        /// Name of the earlier one.
        other: String,
    },
    /// A name cannot be made into that of a file.
    #[error("the name `{}` is {fault}", name.escape_debug())]
    Name {
        /// The name.
        name: String,
        /// Why.
        fault: NameFault,
    },
    /// No draw of the prior gives the data's track, or the greater part of it.
    #[error(
        "none of {tries} prior draws covers {unreached} of the track's {bins} bins within a factor of five of their radii, such as \
         r = {r_kpc:.4} kpc at phi = {phi_deg} deg; check the track's units and its progenitor's position, or widen the prior"
    )]
    UnreachableTrack {
        /// Number of draws.
        tries: u64,
        /// Number of the track's bins.
        bins: usize,
        /// Number of those that no draw covers.
        unreached: usize,
        /// Centre of the first of these.
        phi_deg: f64,
        /// Its radius.
        r_kpc: f64,
    },
    /// Too few draws of the prior make mocks.
    #[error(
        "only {found} of {tries} prior draws meet the criteria of a mock; loosen the criteria on angle, length and radius, or change \
         the prior"
    )]
    TooFewMocks {
        /// Number of draws.
        tries: u64,
        /// Number of mocks among them.
        found: usize,
    },
    /// No stream of some q is kept, so that the fraction that is kept is not known there.
    #[error(
        "none of {tries} draws at q = {q} meets the criteria of a mock, so that the fraction that is kept is not known there; make more \
         draws at each q"
    )]
    NoneKept {
        /// The value of q.
        q: f64,
        /// Number of draws.
        tries: u64,
    },
    /// Fewer runs than are needed.
    #[error("{given} runs where at least {min} are needed")]
    TooFewRuns {
        /// Number of runs.
        given: usize,
        /// The minimum.
        min: usize,
    },
    /// A fit that is to be used further has not converged.
    #[error(
        "the fit {name} has not converged; fit it longer (its summary names the checks that failed), or leave it out"
    )]
    NotConverged {
        /// Its name.
        name: String,
    },
    /// Fits that were to be merged are of different posteriors.
    #[error(
        "{first} and {second} differ in their {part}; merge fits of one track whose settings differ in the seed and the sampler's only"
    )]
    OtherPosterior {
        /// Name of one fit.
        first: String,
        /// Name of the other.
        second: String,
        /// What differs: the track, or a table of the settings.
        part: &'static str,
    },
    /// A fit that was to be merged ends with a bridge.
    #[error(
        "{} is the result of a bridge, not a nested run; merge the coarse runs, {} and those like it, and continue from the result by a \
         bridge", path.display(), coarse.display()
    )]
    NotNested {
        /// Its folder.
        path: PathBuf,
        /// The folder of its coarse run.
        coarse: PathBuf,
    },
    /// A bridge would lead to the model that it starts from.
    #[error("the model is that of the fit itself; choose a finer one")]
    SameModel,
    /// The output is one of the inputs, is in one or holds one.
    #[error("{} is, is in or holds one of the runs that are to be read; choose another folder", path.display())]
    OutputIsInput {
        /// The folder.
        path: PathBuf,
    },
    /// Runs that were to be compared have different parameters.
    #[error(
        "{first} has the parameters {first_names:?}, {second} has {second_names:?}; compare runs of one target: the same free parameters"
    )]
    OtherParameters {
        /// Name of one run.
        first: String,
        /// Its parameters.
        first_names: Vec<String>,
        /// Name of the other.
        second: String,
        /// Its parameters.
        second_names: Vec<String>,
    },
    /// A run that was to be compared has no draws.
    #[error(
        "{name} has no draws: it was stopped before the first one; continue it, or leave it out"
    )]
    NoDraws {
        /// Its name.
        name: String,
    },
    /// A run has no column of this name.
    #[error("the run has no column `{column}`; choose among {}", found.join(", "))]
    NoColumn {
        /// The name.
        column: String,
        /// The names of its columns.
        found: Vec<String>,
    },
    /// Draws have another number of columns than is needed.
    #[error(
        "draws of {found} columns where {needed} are needed; give draws of the same run or family"
    )]
    DrawColumns {
        /// Number of columns.
        found: usize,
        /// Number needed.
        needed: usize,
    },
    /// A posterior of q cannot be part of a population, or of a calibration.
    #[error("{name}: {fault}")]
    Posterior {
        /// Name of the fit.
        name: String,
        /// What is wrong.
        fault: PosteriorFault,
    },
    /// A point that had to have a track has none.
    #[error(
        "no track at these parameters: {0}; {remedy}", remedy = .0.remedy()
    )]
    NoTrack(Rejection),
    /// The sampler stopped.
    #[error(transparent)]
    Sampler(#[from] oblate_samplers::Error),
}

impl Error {
    /// Makes an error of the operating system at a path into [`Error::Io`] with a remedy.
    pub(crate) fn io(path: &Path, remedy: &'static str) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_path_buf();
        move |source| Self::Io {
            path,
            source,
            remedy,
        }
    }

    /// The same, in a table of a settings file.
    #[must_use]
    pub fn within(self, table: &'static str) -> Self {
        Self::InTable {
            table,
            source: Box::new(self),
        }
    }
}

/// A file with a line, for messages.
fn place(path: &Path, line: Option<usize>) -> String {
    line.map_or_else(
        || path.display().to_string(),
        |line| format!("{}, line {line}", path.display()),
    )
}

/// Why a point of parameter space has no track or no likelihood. Counted by cause, never an error of the run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Rejection {
    /// A parameter is NaN, infinite or outside the model's domain (a negative mass).
    BadParameter,
    /// The progenitor's orbit is infinite or NaN.
    BadOrbit,
    /// The progenitor's orbit turns faster somewhere than its particles' shortest steps can follow
    /// ([`ModelSettings::max_halvings`](crate::stream::ModelSettings::max_halvings)); more `model.max_halvings` resolve it.
    UnresolvedOrbit,
    /// A particle's state is NaN or infinite.
    BadParticle,
    /// A data bin has too few model particles (`coverage = "reject"`).
    Uncovered,
    /// The likelihood is NaN or infinite.
    BadLikelihood,
    /// A parameter lies outside its prior: only of points that a user gives, since samplers stay inside.
    OutsidePrior,
}

impl Rejection {
    /// The cause as it appears in files and reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::BadParameter => "bad_parameter",
            Self::BadOrbit => "bad_orbit",
            Self::UnresolvedOrbit => "unresolved_orbit",
            Self::BadParticle => "bad_particle",
            Self::Uncovered => "uncovered",
            Self::BadLikelihood => "bad_likelihood",
            Self::OutsidePrior => "outside_prior",
        }
    }

    /// The remedy, for a user who asked for this one point.
    #[must_use]
    pub fn remedy(self) -> &'static str {
        match self {
            Self::BadParameter => {
                "give finite parameters, masses, radii and an age above zero, fractions of at most one, and x0_kpc not below zero"
            }
            Self::UnresolvedOrbit => {
                "its progenitor comes too close to the centre for the shortest steps allowed: increase `model.max_halvings`"
            }
            Self::Uncovered => {
                "change the parameters, or take a `likelihood.coverage` with a penalty"
            }
            Self::OutsidePrior => "give parameters inside the prior, or widen the prior",
            Self::BadOrbit | Self::BadParticle | Self::BadLikelihood => "change the parameters",
        }
    }
}

impl std::fmt::Display for Rejection {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

/// Numbers of approximations and ambiguities on the way to one track, for the report.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Tally {
    /// Releases whose tidal radius had to be bounded (see [`spray`](crate::spray)).
    pub bounded_tidal_radius: u64,
    /// Eighths of particle steps that change the angle around the projected centre by more than 90 degrees, so that the winding number is
    /// ambiguous.
    pub ambiguous_windings: u64,
}

impl std::ops::AddAssign for Tally {
    fn add_assign(&mut self, other: Self) {
        self.bounded_tidal_radius += other.bounded_tidal_radius;
        self.ambiguous_windings += other.ambiguous_windings;
    }
}
