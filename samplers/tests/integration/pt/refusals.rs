//! Runs that cannot start or cannot end are refused with a message.

use crate::targets::smooth;
use oblate_samplers::control::Silent;
use oblate_samplers::pt::{self, Settings};
use oblate_samplers::{Control, Error, Event, Marginal, Observer, Outcome, Prior, Target};
use std::ops::ControlFlow;

/// Rejects everything, with or without a gradient.
struct Nothing {
    prior: Prior,
    gradient: bool,
}

impl Nothing {
    fn new(gradient: bool) -> Self {
        let prior = Prior::new([("x", "", Marginal::Uniform { lo: 0.0, hi: 1.0 })]).unwrap();
        Self { prior, gradient }
    }
}

impl Target for Nothing {
    fn prior(&self) -> &Prior {
        &self.prior
    }
    fn ln_likelihood(&self, _: &[f64]) -> Outcome {
        Outcome::Reject("bound to nothing")
    }
    fn gradient_cost(&self) -> Option<f64> {
        self.gradient.then_some(1.0)
    }
}

fn refused(target: &dyn Target, settings: &Settings) -> Error {
    let mut silent = Silent;
    pt::run(target, settings, 1, &mut Control::new(&mut silent)).unwrap_err()
}

#[test]
fn a_target_that_rejects_everything_is_refused_with_its_cause() {
    let error = refused(&Nothing::new(true), &Settings::default());
    assert!(
        matches!(
            error,
            Error::NoStart {
                tries: 100_000..,
                ..
            }
        ),
        "{error}"
    );
    assert!(error.to_string().contains("bound to nothing"), "{error}");
}

#[test]
fn a_target_without_a_gradient_is_sent_to_the_nested_sampler() {
    let error = refused(&Nothing::new(false), &Settings::default());
    assert!(matches!(error, Error::TemperingWithoutGradient), "{error}");
}

#[test]
fn settings_out_of_range_are_refused_by_name() {
    let good = Settings::default();
    let bad = [
        (
            "chain_sets",
            Settings {
                chain_sets: 1,
                ..good.clone()
            },
        ),
        (
            "surrogate",
            Settings {
                surrogate: true,
                hmc_transitions: 0,
                slice_updates: 1,
                ..good.clone()
            },
        ),
        (
            "rounds",
            Settings {
                rounds: 1,
                ..good.clone()
            },
        ),
        (
            "first_scans",
            Settings {
                first_scans: 1,
                ..good.clone()
            },
        ),
        (
            "temperatures",
            Settings {
                temperatures: 100,
                ..good.clone()
            },
        ),
        (
            "max_leapfrogs",
            Settings {
                max_leapfrogs: 0,
                ..good.clone()
            },
        ),
        (
            "hmc_transitions",
            Settings {
                hmc_transitions: 0,
                ..good.clone()
            },
        ),
        (
            "target_acceptance",
            Settings {
                target_acceptance: f64::NAN,
                ..good.clone()
            },
        ),
        (
            "trajectory",
            Settings {
                trajectory: -1.0,
                ..good
            },
        ),
    ];
    for (name, settings) in bad {
        let message = refused(&smooth::iso(2), &settings).to_string();
        let range = format!("{name} = ");
        let rule = format!("`{name}`");
        assert!(
            message.starts_with(&range) || message.contains(&rule),
            "{message}"
        );
    }
}

/// Records the events.
#[derive(Default)]
struct Diary(Vec<Event>);

impl Observer for Diary {
    fn event(&mut self, event: &Event) -> ControlFlow<()> {
        self.0.push(event.clone());
        ControlFlow::Continue(())
    }
}

#[test]
fn an_observer_is_told_of_the_start_every_scan_and_the_end() {
    let mut diary = Diary::default();
    let run = pt::run(
        &smooth::iso(2),
        &super::rounds(4),
        1,
        &mut Control::new(&mut diary),
    )
    .unwrap();
    let events = diary.0;
    assert_eq!(events.first(), Some(&Event::Started { dim: 2 }));
    assert_eq!(events.last(), Some(&Event::Finished));
    let scans: Vec<(usize, usize, u64)> = events
        .iter()
        .filter_map(|event| match event {
            Event::Tempered {
                round,
                scan,
                gradients,
                ..
            } => Some((*round, *scan, *gradients)),
            _ => None,
        })
        .collect();
    assert_eq!(scans.len(), 4 + 8 + 16 + 32);
    assert_eq!((scans[0].0, scans[0].1), (0, 0));
    assert_eq!((scans[59].0, scans[59].1), (3, 31));
    assert_eq!(scans[59].2, run.cost.gradients);
    assert!(scans.windows(2).all(|w| w[1].2 > w[0].2));
}
