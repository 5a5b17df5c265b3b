//! Parallel tempering against exact evidences and posteriors.

mod evidence;
mod look;
mod posterior;
mod refusals;
mod resume;
mod schedule;
mod smc;

use crate::targets::smooth::Smooth;
use oblate_samplers::control::Silent;
use oblate_samplers::output::Check;
use oblate_samplers::pt::{self, Settings};
use oblate_samplers::{Control, Run};

/// A run without limits.
fn run(target: &Smooth, settings: &Settings, seed: u64) -> Run {
    let mut silent = Silent;
    pt::run(target, settings, seed, &mut Control::new(&mut silent)).unwrap()
}

/// Default settings with this many rounds.
fn rounds(rounds: usize) -> Settings {
    Settings {
        rounds,
        ..Settings::default()
    }
}

fn check<'a>(run: &'a Run, name: &str) -> &'a Check {
    run.checks.iter().find(|g| g.name == name).unwrap()
}

fn failed(run: &Run) -> Vec<&str> {
    run.checks
        .iter()
        .filter(|g| !g.pass)
        .map(|g| g.name.as_str())
        .collect()
}
