//! Studies as the program that watches them sees them.

use super::study::TRACKS;
use oblate::config::StudyConfig;
use oblate::posterior::compare;
use oblate::report::FigureFormat;
use oblate::run::{
    Executor, FitsSoFar, Monitor, RunFolder, Study, StudyResult, Watcher, render_report,
};
use oblate::samplers::Error as SamplerError;
use oblate::samplers::control::Silent;
use oblate::samplers::output::Status;
use oblate::{Error, Result};
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// Keeps what it is told.
struct Seen {
    max_wall: Duration,
    /// A part of the label of runs that end at once, and their error.
    ends: Option<(&'static str, fn() -> Error)>,
    told: Mutex<Vec<FitsSoFar>>,
}

impl Default for Seen {
    fn default() -> Self {
        Self {
            max_wall: Duration::from_secs(3_600),
            ends: None,
            told: Mutex::default(),
        }
    }
}

impl Watcher for Seen {
    fn monitored(
        &self,
        label: &str,
        work: &mut dyn FnMut(&mut Monitor<'_>) -> Result<()>,
    ) -> Result<()> {
        if let Some((_, error)) = self.ends.filter(|(part, _)| label.contains(part)) {
            return Err(error());
        }
        work(&mut Monitor {
            observer: &mut Silent,
            interrupt: Arc::default(),
            checkpoint_every: Duration::from_secs(600),
            max_wall: self.max_wall,
        })
    }

    fn advanced(&self, fits: &FitsSoFar) {
        self.told.lock().unwrap().push(fits.clone());
    }

    fn interrupted(&self) -> bool {
        false
    }
}

/// A study of one track, with its population.
fn study(folder: &Path) -> StudyConfig {
    let mut config: StudyConfig = toml::from_str(TRACKS).unwrap();
    config.out = folder.join("out");
    let tracks = config.tracks.as_mut().unwrap();
    tracks.files = vec![crate::cli::example("tracks/s2_spherical.ecsv")];
    config
}

/// Does the study, and returns what it has found and what the watcher was told.
fn done(config: &StudyConfig, seen: Seen) -> (StudyResult, Vec<FitsSoFar>) {
    let study = Study::new(config, Path::new("."), &seen).unwrap();
    let result = study.run(Executor::Local, "", &seen).unwrap();
    (result, seen.told.into_inner().unwrap())
}

#[test]
fn a_finished_fit_that_fails_is_no_longer_counted_as_done() {
    let temporary = tempfile::tempdir().unwrap();
    let config = StudyConfig {
        population: None,
        ..study(temporary.path())
    };
    let (_, told) = done(&config, Seen::default());
    assert_eq!(
        told.last().map(|fits| (fits.done, fits.failed)),
        Some((1, 0))
    );
    let ends = Seen {
        ends: Some(("fit 1", || {
            Error::Sampler(SamplerError::EndlessPath { steps: 1 })
        })),
        ..Seen::default()
    };
    let (result, told) = done(&config, ends);
    assert_eq!(result.failed.len(), 1);
    let last = told.last().unwrap();
    assert_eq!((last.done, last.failed, last.running), (0, 1, 0));
}

#[test]
fn a_population_that_is_interrupted_before_its_first_draws_interrupts_the_study() {
    let temporary = tempfile::tempdir().unwrap();
    let ends = Seen {
        ends: Some(("population", || Error::Sampler(SamplerError::Interrupted))),
        ..Seen::default()
    };
    let (result, _) = done(&study(temporary.path()), ends);
    assert!(result.interrupted);
    assert_eq!((result.tracks.len(), result.populations.len()), (1, 0));
}

#[test]
fn a_population_or_a_fit_that_is_stopped_before_its_first_draw_does_not_end_the_study() {
    let temporary = tempfile::tempdir().unwrap();
    let config = study(temporary.path());
    let in_no_time = || Seen {
        max_wall: Duration::ZERO,
        ..Seen::default()
    };
    let report = |result: &StudyResult| {
        let folders: Vec<_> = result.runs().map(|run| run.folder.clone()).collect();
        render_report("stopped", &folders, &[FigureFormat::Svg], &[])
            .unwrap()
            .page
    };
    // The fit has no draws, and so the population no stream.
    let (result, _) = done(&config, in_no_time());
    assert_eq!((result.tracks.len(), result.populations.len()), (1, 0));
    let reason = &result.failed[0].reason;
    assert!(reason.contains("no draws of q"), "{reason}");
    report(&result);
    // With a fit, the population has no draws itself.
    let ends = Seen {
        ends: Some(("population", || Error::Sampler(SamplerError::Interrupted))),
        ..Seen::default()
    };
    done(&config, ends);
    let (result, _) = done(&config, in_no_time());
    assert!(result.failed.is_empty(), "{:?}", result.failed);
    let population = &result.populations[0];
    assert_eq!(population.summary.status, Status::BudgetSpent);
    let table = population.folder.join("density.csv");
    assert!(!table.exists());
    let page = report(&result);
    assert!(page.contains("given the population") && !page.contains("Density of q"));
    let stopped = RunFolder::open(&population.folder).unwrap().read().unwrap();
    let error = compare("a", &stopped.run, "b", &stopped.run).unwrap_err();
    assert!(matches!(error, Error::NoDraws { ref name } if name == "a"));
    assert!(error.to_string().contains("; continue it"), "{error}");
    // It goes on where it was.
    let (result, _) = done(&config, Seen::default());
    let population = &result.populations[0];
    assert_eq!(population.summary.status, Status::Complete);
    assert!(table.exists() && report(&result).contains("Density of q"));
}

#[test]
fn a_fit_that_may_go_on_is_not_done() {
    let temporary = tempfile::tempdir().unwrap();
    let mut config = StudyConfig {
        population: None,
        ..study(temporary.path())
    };
    let fits_to_do = |config: &StudyConfig| {
        let study = Study::new(config, Path::new("."), &Seen::default()).unwrap();
        study.cost(&Seen::default()).unwrap().map(|cost| cost.fits)
    };
    let at_first = |told: &[FitsSoFar]| told.first().map(|fits| (fits.done, fits.running));
    let in_no_time = || Seen {
        max_wall: Duration::ZERO,
        ..Seen::default()
    };
    let (result, _) = done(&config, in_no_time());
    assert_eq!(result.tracks[0].summary.status, Status::BudgetSpent);
    assert_eq!(fits_to_do(&config), Some(1));
    let (result, told) = done(&config, Seen::default());
    assert_eq!(at_first(&told), Some((0, 1)));
    let summary = &result.tracks[0].summary;
    assert!(summary.status == Status::Complete && !summary.converged);
    assert_eq!(fits_to_do(&config), None);
    // More batches are allowed than before.
    let tracks = config.tracks.as_mut().unwrap();
    tracks.fit.sampling.nested.max_batches = 2;
    assert_eq!(fits_to_do(&config), Some(1));
    let before = summary.cost.calls;
    let (result, told) = done(&config, Seen::default());
    assert_eq!(at_first(&told), Some((0, 1)));
    assert!(result.tracks[0].summary.cost.calls > before);
    assert_eq!(fits_to_do(&config), None);
    assert_eq!(at_first(&done(&config, Seen::default()).1), Some((1, 0)));
}
