//! How far off is a track for want of steps, by rule?
//!
//! `cargo bench --bench steps` prints a table, in per cent: for mocks that meet the paper's criteria, the rms over bins of the
//! mean radius against that of the same particles at 3,200 equal steps. The data's errors are 2 per cent. Not a timing.

use oblate::data::{MockSettings, mocks};
use oblate::params::{PriorSettings, StreamPrior};
use oblate::spray::TableSettings;
use oblate::stream::{Arrivals, Flights, Galaxy, Model, ModelSettings, StepRule, StepsPer};
use oblate::track::{BinEdges, Track};
use rayon::prelude::*;

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
        ..ModelSettings::default()
    })
    .expect("a model")
}

fn track(model: &Model, galaxy: &Galaxy<f64>) -> Option<Track> {
    let setup = model.setup(galaxy).ok()?;
    let (mut flights, mut stars) = (Flights::default(), Arrivals::default());
    model.carry(&setup, &mut flights, &mut stars).ok()?;
    let least = 0.01 * PARTICLES as f64;
    Some(Track::of(&stars, 10.0, BinEdges::default(), least))
}

/// Rms over the bins that both have, in per cent.
fn distance(track: &Track, reference: &Track) -> f64 {
    let squares: Vec<f64> = reference
        .bins
        .iter()
        .filter_map(|b| {
            let a = track.bins.iter().find(|a| a.bin == b.bin)?;
            Some((a.r_kpc / b.r_kpc - 1.0).powi(2))
        })
        .collect();
    100.0 * (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt()
}

fn main() {
    let prior = StreamPrior::new(&PriorSettings::default()).expect("a prior");
    let drawn = mocks(&prior, &MockSettings::default(), MOCKS, 1).expect("mocks");
    let galaxies: Vec<Galaxy<f64>> = drawn
        .mocks
        .iter()
        .map(|mock| Galaxy::from_params(&mock.params, prior.q_range()))
        .collect();
    let reference = model(REFERENCE_STEPS, StepRule::Uniform);
    let references: Vec<Option<Track>> = galaxies
        .par_iter()
        .map(|galaxy| track(&reference, galaxy))
        .collect();
    println!("| steps | rule | median | 90 % | 95 % | worst |\n|---|---|---|---|---|---|");
    for steps in [25, 50, 100, 200, 400] {
        for rule in [StepRule::Uniform, StepRule::Dynamical] {
            let model = model(steps, rule);
            let mut errors: Vec<f64> = galaxies
                .par_iter()
                .zip(&references)
                .filter_map(|(galaxy, reference)| {
                    Some(distance(&track(&model, galaxy)?, reference.as_ref()?))
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
