//! Parallel tempering against exact evidences and posteriors.

mod evidence;

use crate::targets::smooth::Smooth;
use oblate_samplers::control::Silent;
use oblate_samplers::pt::{self, Settings};
use oblate_samplers::{Control, Run};

/// A run without limits.
fn run(target: &Smooth, settings: &Settings, seed: u64) -> Run {
    let mut silent = Silent;
    pt::run(target, settings, seed, &mut Control::new(&mut silent)).unwrap()
}
