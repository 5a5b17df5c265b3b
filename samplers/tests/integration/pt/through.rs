//! Populations that go through a coarse likelihood: the result is the fine one's, whatever the coarse one is.

use super::failed;
use crate::stops::{StopAt, plan};
use crate::targets::smooth::{self, Smooth};
use oblate_samplers::control::Silent;
use oblate_samplers::output::Status;
use oblate_samplers::pt::{self, Settings};
use oblate_samplers::{Control, Error, Event, Observer, Outcome, Prior, Run, Target};
use std::ops::ControlFlow;
use std::path::Path;

/// Four fifths of another's ln L, with ripples, and no gradient.
struct Coarse<'a>(&'a Smooth);

impl Target for Coarse<'_> {
    fn prior(&self) -> &Prior {
        self.0.prior()
    }
    fn ln_likelihood(&self, theta: &[f64]) -> Outcome {
        match self.0.ln_likelihood(theta) {
            Outcome::Value(l) => Outcome::Value(0.8 * l + 0.5 * (20.0 * theta[0]).sin()),
            other => other,
        }
    }
}

fn settings() -> Settings {
    Settings {
        annealing: 100,
        slices: 2,
        rounds: 4,
        first_scans: 32,
        mixture_rounds: 4,
        extensions: 15,
        ..Settings::default()
    }
}

fn run(target: &Smooth, seed: u64) -> Run {
    let mut silent = Silent;
    let mut control = Control::new(&mut silent);
    pt::run_through(&Coarse(target), target, &settings(), seed, &mut control).unwrap()
}

#[test]
fn evidence_and_weights_are_those_of_the_fine_likelihood() {
    for (target, plus) in [(smooth::twins13(0.9), Some(0.9)), (smooth::mvn13(), None)] {
        let run = run(&target, 1);
        assert!(run.converged(), "{}: {:?}", target.name, failed(&run));
        let z = (run.evidence.ln_z - target.ln_z) / run.evidence.error;
        assert!(z.abs() < 4.0, "{}: z {z}", target.name);
        if let Some(plus) = plus {
            let sides = run.draws.column(0);
            let weight = sides.iter().filter(|x| **x > 0.0).count() as f64 / sides.len() as f64;
            // 100 independent draws, of which a run that passes has at least so many.
            assert!(
                (weight - plus).abs() < 4.0 * (plus * (1.0 - plus) / 100.0).sqrt(),
                "{weight}"
            );
        }
    }
}

/// Keeps what the populations said last, and stops the run when they have crossed.
#[derive(Default)]
struct Crossed {
    share: f64,
    ln_z: f64,
}

impl Observer for Crossed {
    fn event(&mut self, event: &Event) -> ControlFlow<()> {
        match event {
            Event::Refining { share, ln_z, .. } => (self.share, self.ln_z) = (*share, *ln_z),
            Event::Tempered { .. } => return ControlFlow::Break(()),
            _ => {}
        }
        ControlFlow::Continue(())
    }
}

#[test]
fn populations_arrive_with_the_evidence_of_the_fine_likelihood() {
    let target = smooth::mvn13();
    let off: Vec<f64> = (1..=10)
        .map(|seed| {
            let mut last = Crossed::default();
            let mut control = Control::new(&mut last);
            pt::run_through(&Coarse(&target), &target, &settings(), seed, &mut control).unwrap();
            assert!(last.share >= 1.0);
            last.ln_z - target.ln_z
        })
        .collect();
    let mean = off.iter().sum::<f64>() / 10.0;
    let variance = off.iter().map(|o| (o - mean).powi(2)).sum::<f64>() / 9.0;
    let error = (variance / 10.0).sqrt();
    // Student's t with nine degrees of freedom: one in a thousand.
    assert!(mean.abs() < 4.8 * error, "{mean:+.3} +- {error:.3}");
}

fn resumed(target: &Smooth, path: &Path, events: u64) -> Result<Run, Error> {
    let mut observer = StopAt(events);
    let mut control = Control::new(&mut observer);
    control.checkpoint = Some(plan(path));
    pt::run_through(&Coarse(target), target, &settings(), 7, &mut control)
}

#[test]
fn a_run_stopped_on_the_way_across_resumes_to_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("pt.ckpt");
    let target = smooth::twins13(0.9);
    let expected = run(&target, 7);
    let mut stopped_across = 0;
    let whole = loop {
        match resumed(&target, &path, 60) {
            Err(Error::Interrupted) => stopped_across += 1,
            Ok(run) if run.status == Status::Complete => break run,
            Ok(_) => {}
            Err(other) => panic!("{other}"),
        }
    };
    assert!(stopped_across > 2, "{stopped_across} stops");
    assert_eq!(whole.bits(), expected.bits());
}

/// The same prior, and a likelihood nowhere.
struct Nowhere<'a>(&'a Smooth);

impl Target for Nowhere<'_> {
    fn prior(&self) -> &Prior {
        self.0.prior()
    }
    fn ln_likelihood(&self, _: &[f64]) -> Outcome {
        Outcome::Reject("nowhere")
    }
    fn ln_likelihood_and_gradient(&self, theta: &[f64], _: &mut [f64]) -> Outcome {
        self.ln_likelihood(theta)
    }
    fn gradient_cost(&self) -> Option<f64> {
        Some(1.0)
    }
}

#[test]
fn what_cannot_go_through_is_refused_with_a_remedy() {
    let (target, other) = (smooth::twins13(0.9), smooth::gauss3());
    let through = |coarse: &dyn Target, fine: &dyn Target, settings: &Settings| {
        let mut silent = Silent;
        pt::run_through(coarse, fine, settings, 1, &mut Control::new(&mut silent)).unwrap_err()
    };
    let none = Settings {
        annealing: 0,
        ..settings()
    };
    for (error, said) in [
        (through(&target, &target, &none), "annealing"),
        (through(&other, &target, &settings()), "other parameters"),
        (
            through(&target, &Nowhere(&target), &settings()),
            "let the two differ less",
        ),
    ] {
        assert!(error.to_string().contains(said), "{error}");
    }
}
