//! The three kinds of bad news: [`Error`] (this run cannot go on), [`Rejection`] (this point has no track) and
//! [`Tally`] (it went on, but count it).

use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// The crate's result.
pub type Result<T> = std::result::Result<T, Error>;

/// A run that cannot start or cannot go on; every message says what, where, and what to do next.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file says something that cannot be used.
    #[error("{}{}: {what}; {remedy}", path.display(), line.map_or(String::new(), |l| format!(", line {l}")))]
    Input {
        /// The file.
        path: PathBuf,
        /// The line, from 1, where it is known.
        line: Option<usize>,
        /// What is wrong, with the column's or key's name.
        what: String,
        /// What to do.
        remedy: String,
    },
    /// A setting, flag or argument is out of its range.
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
    #[error("{}: exists already; choose another --out, continue it with --resume, or replace it with --force", path.display())]
    Exists {
        /// The file or folder.
        path: PathBuf,
    },
    /// A file could not be read or written.
    #[error("{}: {source}; {remedy}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The operating system's word.
        source: std::io::Error,
        /// What to do.
        remedy: &'static str,
    },
    /// No draw of the prior meets what is asked of it.
    #[error("none of {tries} prior draws {what}; {remedy}")]
    NoneFits {
        /// Number of draws tried.
        tries: usize,
        /// What they should have done.
        what: String,
        /// What to do.
        remedy: String,
    },
    /// Runs that were to be combined do not belong together.
    #[error("{what}; {remedy}")]
    Mismatch {
        /// How they differ.
        what: String,
        /// What to do.
        remedy: String,
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

/// Why a point of parameter space has no track or no likelihood. Adjoint by cause, never an error of the run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Rejection {
    /// A parameter is NaN, infinite or outside the model's domain (a negative mass).
    BadParameter,
    /// The progenitor's orbit left the finite numbers.
    BadOrbit,
    /// The progenitor's orbit turns faster somewhere than its particles' steps can follow
    /// ([`ModelSettings::min_steps_per_orbit`](crate::stream::ModelSettings::min_steps_per_orbit)); more `model.steps` resolve it.
    UnresolvedOrbit,
    /// A particle's state is NaN or infinite.
    BadParticle,
    /// A data bin has too few model particles (`coverage = "reject"`).
    Uncovered,
    /// The likelihood is NaN or infinite.
    BadLikelihood,
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
        }
    }

    /// What to do about it, where a person asked for this one point.
    #[must_use]
    pub fn remedy(self) -> &'static str {
        match self {
            Self::BadParameter => "give finite parameters, masses, radii and an age above zero",
            Self::UnresolvedOrbit => {
                "its progenitor comes too close to the centre for the leapfrog's steps: give more of them (--steps, model.steps), \
                 or model.min_steps_per_orbit = 0 to have it all the same"
            }
            Self::Uncovered => "change the parameters, or take coverage = \"penalty\"",
            Self::BadOrbit | Self::BadParticle | Self::BadLikelihood => "change the parameters",
        }
    }
}

impl std::fmt::Display for Rejection {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

/// What was bounded, smoothed or made unsafe on the way to one track, counted for the report.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Tally {
    /// Releases whose tidal radius had to be bounded (see the spray room).
    pub bounded_tidal_radius: u64,
    /// Particle-steps that turned a particle by more than 90 degrees around the projected centre: its winding count
    /// is not safe.
    pub ambiguous_windings: u64,
}

impl std::ops::AddAssign for Tally {
    fn add_assign(&mut self, other: Self) {
        self.bounded_tidal_radius += other.bounded_tidal_radius;
        self.ambiguous_windings += other.ambiguous_windings;
    }
}
