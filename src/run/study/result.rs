//! What a study has found.

use crate::config::StreamsOf;
use crate::inference::Sampler;
use crate::posterior::{ScalingRow, Summary, scaling};
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

/// A finished population of a subset of the streams.
#[derive(Clone, Debug)]
pub struct StudySubset {
    /// Number of its streams.
    pub streams: usize,
    /// The run.
    pub run: StudyRun,
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
    /// Populations of subsets of the streams.
    pub subsets: Vec<StudySubset>,
    /// Fits and populations that could not be done.
    pub failed: Vec<FailedRun>,
    /// Fraction of prior draws that met the criteria of a mock.
    pub acceptance: Option<f64>,
    /// Whether the study was interrupted; the same command continues it.
    pub interrupted: bool,
}

impl StudyResult {
    /// Whether all runs have converged, populations of subsets too.
    #[must_use]
    pub fn converged(&self) -> bool {
        let subsets = self.subsets.iter().map(|subset| &subset.run);
        self.runs().chain(subsets).all(|run| run.summary.converged)
    }

    /// All runs but those of subsets: tracks, mocks, populations.
    pub fn runs(&self) -> impl Iterator<Item = &StudyRun> {
        self.tracks
            .iter()
            .chain(&self.mocks)
            .chain(&self.populations)
    }
}

impl StudyResult {
    /// How the widths of the hyperparameters fall with the number of streams, from the subsets to the first population of all streams; empty
    /// without subsets.
    #[must_use]
    pub fn scaling(&self) -> Vec<ScalingRow> {
        let all = self
            .populations
            .first()
            .filter(|_| !self.subsets.is_empty());
        let all = all.and_then(|run| {
            let population = run.summary.population.as_ref()?;
            Some((population.streams.len(), &run.summary))
        });
        let subsets = self.subsets.iter();
        let subsets = subsets.map(|subset| (subset.streams, &subset.run.summary));
        scaling(&subsets.chain(all).collect::<Vec<_>>())
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
