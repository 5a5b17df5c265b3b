//! What a study has found.

use crate::config::StreamsOf;
use crate::inference::Sampler;
use crate::posterior::Summary;
use std::path::PathBuf;

/// A finished run of a study.
#[derive(Clone, Debug)]
pub struct StudyRun {
    /// Its run folder.
    pub folder: PathBuf,
    /// The name of the track, `population`, or `population_FAMILY`.
    pub name: String,
    /// The sampler.
    pub sampler: Sampler,
    /// Its summary.
    pub summary: Summary,
}

/// The finished runs of a study.
#[derive(Clone, Debug, Default)]
pub struct StudyResult {
    /// Fits of tracks.
    pub tracks: Vec<StudyRun>,
    /// Fits of mocks.
    pub mocks: Vec<StudyRun>,
    /// Populations.
    pub populations: Vec<StudyRun>,
    /// Fits and populations that could not be done.
    pub failed: Vec<FailedRun>,
    /// Fraction of prior draws that met the criteria of a mock.
    pub acceptance: Option<f64>,
    /// Whether the study was interrupted; the same command continues it.
    pub interrupted: bool,
}

impl StudyResult {
    /// All runs: tracks, mocks, populations.
    pub fn runs(&self) -> impl Iterator<Item = &StudyRun> {
        self.tracks
            .iter()
            .chain(&self.mocks)
            .chain(&self.populations)
    }
}

/// A fit or a population that could not be done.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FailedRun {
    /// What it is a fit of; none: a population.
    pub of: Option<StreamsOf>,
    /// The name of the track or of the population.
    pub name: String,
    /// The sampler.
    pub sampler: Sampler,
    /// Why.
    pub reason: String,
}

impl std::fmt::Display for FailedRun {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} {}: {}", self.name, self.sampler.name(), self.reason)
    }
}
