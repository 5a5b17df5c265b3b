//! Interrupts outside of the samplers: in the stages of a fit before and after them, while mocks are made, and in a pilot.

use super::study::TRACKS;
use crate::cli::{SMALL, example};
use crate::folders::files;
use oblate::config::StudyConfig;
use oblate::data::ObservedTrack;
use oblate::run::{Destination, FitsSoFar, IfExists, Monitor, Study, Watcher, fit};
use oblate::samplers::control::Silent;
use oblate::samplers::{Error as SamplerError, Event, Observer};
use oblate::{Error, Fit, FitSettings, Result};
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Sets the interrupt as soon as a part of a stage is done.
struct StopsIn<'a> {
    stage: &'a str,
    reached: bool,
    interrupt: Arc<AtomicBool>,
}

impl Observer for StopsIn<'_> {
    fn event(&mut self, event: &Event) -> ControlFlow<()> {
        match event {
            Event::Stage { name, .. } => self.reached = name == self.stage,
            Event::Advanced { done, of } if self.reached && done < of => {
                self.interrupt.store(true, Ordering::Relaxed);
            }
            _ => (),
        }
        ControlFlow::Continue(())
    }
}

fn is_interrupt<T>(result: &Result<T>) -> bool {
    matches!(result, Err(Error::Sampler(SamplerError::Interrupted)))
}

#[test]
fn a_fit_stopped_in_any_stage_goes_on_to_the_same_bytes() {
    let temporary = tempfile::tempdir().unwrap();
    let mut settings: FitSettings = toml::from_str(SMALL).unwrap();
    settings.model.releases.particles = 64;
    settings.model.step_phase = 3.0;
    settings.coarse_particles = 32;
    settings.sampling.nested.n_live = 20;
    let track = ObservedTrack::read(&example("tracks/s2_spherical.ecsv")).unwrap();
    let fitted = |folder: &Path, stage: &str| -> Result<Fit> {
        let destination = Destination {
            folder,
            if_exists: IfExists::Resume,
            command: "",
        };
        let interrupt = Arc::default();
        let mut observer = StopsIn {
            stage,
            reached: false,
            interrupt: Arc::clone(&interrupt),
        };
        let mut monitor = Monitor {
            observer: &mut observer,
            interrupt,
            checkpoint_every: Duration::MAX,
            max_wall: Duration::MAX,
        };
        fit(&track, &settings, destination, &mut monitor)
    };
    let whole = temporary.path().join("whole");
    let expected = fitted(&whole, "").unwrap();
    for stage in [
        "check of the prior",
        "error of the coarse model",
        "error of the model",
    ] {
        let folder = temporary.path().join(stage);
        let stopped = fitted(&folder, stage);
        assert!(is_interrupt(&stopped), "{stage}: {:?}", stopped.err());
        if stage == "check of the prior" {
            assert!(!folder.exists());
            continue;
        }
        for result in ["summary.json", "posterior.zarr"] {
            assert!(!folder.join(result).exists(), "{stage}: {result}");
        }
        let resumed = fitted(&folder, "").unwrap();
        assert_eq!(resumed.run.bits(), expected.run.bits(), "{stage}");
        assert!(files(&folder) == files(&whole), "{stage}");
    }
}

/// A user who has interrupted the study at its beginning.
struct Stopped;

impl Watcher for Stopped {
    fn monitored(
        &self,
        _: &str,
        work: &mut dyn FnMut(&mut Monitor<'_>) -> Result<()>,
    ) -> Result<()> {
        work(&mut Monitor {
            observer: &mut Silent,
            interrupt: Arc::new(AtomicBool::new(true)),
            checkpoint_every: Duration::MAX,
            max_wall: Duration::MAX,
        })
    }

    fn advanced(&self, _: &FitsSoFar) {}

    fn interrupted(&self) -> bool {
        true
    }
}

#[test]
fn a_study_is_stopped_while_mocks_are_made_and_in_its_pilot() {
    let temporary = tempfile::tempdir().unwrap();
    let mocks = "title = \"mocks\"\nout = \"out\"\n[mocks]\ncount = 1\nseed = 7\nsamplers = [\"nested\"]\n\
                 mock.model.releases.particles = 400\n";
    for (text, stops_in_pilot) in [(mocks, false), (TRACKS, true)] {
        let mut config: StudyConfig = toml::from_str(text).unwrap();
        config.out = temporary.path().join("out");
        if let Some(tracks) = &mut config.tracks {
            tracks.files = vec![example("tracks/s2_spherical.ecsv")];
        }
        let study = Study::new(&config, Path::new("."), &Stopped);
        assert_eq!(is_interrupt(&study), !stops_in_pilot);
        assert_eq!(config.out.exists(), stops_in_pilot);
        if let Ok(study) = study {
            assert!(is_interrupt(&study.cost(&Stopped)));
        }
    }
}
