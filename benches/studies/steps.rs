//! Error of a track by number of steps and step rule.
//!
//! `cargo bench --bench steps` prints a table, in per cent: for mocks that meet the paper's criteria, the rms over bins of the
//! relative difference of the mean radius from that of the same particles with 3,200 equal steps. The data's errors are 2 per cent.
//! Not a timing. The recorded table is in benches/RESULTS.md.

mod tracks;

use oblate::spray::TableSettings;
use oblate::stream::{Model, ModelSettings, StepRule, StepsPer};
use oblate::track::Track;
use rayon::prelude::*;
use tracks::{distance, systems, track};

const MOCKS: usize = 60;
const PARTICLES: usize = 2_048;
const REFERENCE_STEPS: usize = 3_200;

fn model(steps: usize, step_rule: StepRule) -> Model {
    let releases = TableSettings {
        particles: PARTICLES,
        ..TableSettings::default()
    };
    Model::new(&ModelSettings {
        releases,
        steps,
        steps_per: StepsPer::Particle,
        step_rule,
        orbit_steps: 1_024,
        // Errors are to be seen, not rejected.
        min_steps_per_orbit: 0,
        ..ModelSettings::default()
    })
    .expect("a model")
}

fn main() {
    let systems = systems(MOCKS);
    let reference = model(REFERENCE_STEPS, StepRule::Uniform);
    let references: Vec<Option<Track>> = systems
        .par_iter()
        .map(|system| track(&reference, system))
        .collect();
    println!("| steps | rule | median | 90 % | 95 % | worst |\n|---|---|---|---|---|---|");
    for steps in [25, 50, 100, 200, 400] {
        for rule in [StepRule::Uniform, StepRule::Dynamical] {
            let model = model(steps, rule);
            let mut errors: Vec<f64> = systems
                .par_iter()
                .zip(&references)
                .filter_map(|(system, reference)| {
                    Some(distance(&track(&model, system)?, reference.as_ref()?))
                })
                .collect();
            errors.sort_by(f64::total_cmp);
            let at = |percent: usize| errors[(errors.len() - 1) * percent / 100];
            println!(
                "| {steps} | {rule:?} | {:.3} | {:.2} | {:.2} | {:.2} |",
                at(50),
                at(90),
                at(95),
                at(100)
            );
        }
    }
}
