//! Accuracy and price of the three models of a fit, by class of galaxy.
//!
//! `cargo bench --bench accuracy` prints a table for mocks that meet the paper's criteria, drawn with converged steps. A galaxy is
//! - unresolved if the default model rejects it, because its progenitor needs shorter steps than the model has;
//! - edge-on if particles pass so near the projected centre that eighths of their steps turn them by more than 90 degrees on the sky;
//! - plain otherwise.
//!
//! The error is the rms over bins of the relative difference of the mean radius, in per cent, from that of 131,072 particles with steps of
//! half the default's phase; four tables of releases for each galaxy. The errors of the data are 2 per cent. The roughness is the rms
//! of ln L about the best cubic along four lines of 0.05 prior widths to both sides of the truth; lines with a rejected point have none, and
//! their fraction is printed. The time is that of one ln L at the truth on one thread. The recorded table is in docs/validation.md.

mod lines;
mod tracks;

use lines::roughness;
use oblate::Rejection;
use oblate::data::{Mock, MockSettings, mocks};
use oblate::inference::{FitSettings, Profile, StreamTarget};
use oblate::params::{DIM, PriorSettings, StreamPrior};
use oblate::spray::{SamplingScheme, TableSettings};
use oblate::stream::{Model, ModelSettings, System};
use oblate::track::{BinEdges, Track};
use rayon::prelude::*;
use std::time::Instant;
use tracks::{binned, distance, median_and_95, particles};

const MOCKS: usize = 160;
const SEEDS: u64 = 4;
const LINES: u64 = 4;

/// A galaxy, its converged track, and its class.
struct Galaxy {
    mock: Mock,
    system: System<f64>,
    track: Track,
    class: &'static str,
}

const CLASSES: [&str; 3] = ["plain", "edge-on", "unresolved"];

/// More halvings than any galaxy needs.
const MAX_HALVINGS: u8 = 14;

/// Settings with converged steps.
fn converged(releases: TableSettings) -> ModelSettings {
    let default = ModelSettings::default();
    ModelSettings {
        releases,
        step_phase: 0.5 * default.step_phase,
        max_halvings: MAX_HALVINGS,
        ..default
    }
}

fn galaxies(prior: &StreamPrior) -> Vec<Galaxy> {
    let settings = MockSettings {
        model: converged(MockSettings::default().model.releases),
        ..MockSettings::default()
    };
    let reference = Model::new(&converged(TableSettings {
        particles: 131_072,
        sampling_scheme: SamplingScheme::Sobol,
        seed: 77,
        ..TableSettings::default()
    }))
    .expect("a model");
    let fast = Model::new(&ModelSettings::default()).expect("a model");
    let drawn = mocks(prior, &settings, MOCKS, 1).expect("mocks");
    drawn
        .mocks
        .into_par_iter()
        .filter_map(|mock| {
            let system = System::from_params(&mock.params, prior.q_range());
            let exact = particles(&reference, &system)?;
            let class = match fast.progenitor_solution(&system) {
                Err(Rejection::UnresolvedOrbit) => CLASSES[2],
                _ if exact.tally.ambiguous_windings > 0 => CLASSES[1],
                _ => CLASSES[0],
            };
            Some(Galaxy {
                mock,
                system,
                track: binned(&exact, BinEdges::default()),
                class,
            })
        })
        .collect()
}

fn main() {
    let prior = StreamPrior::new(&PriorSettings::default()).expect("a prior");
    let galaxies = galaxies(&prior);
    let fast = FitSettings::default();
    let profiles = [
        (
            "paper",
            FitSettings {
                model: Profile::Paper.model(),
                likelihood: Profile::Paper.likelihood(),
                ..FitSettings::default()
            },
        ),
        ("coarse", fast.coarse(10.0).expect("a coarse model")),
        ("fast", fast),
    ];
    println!(
        "| galaxies | number | model | error, %: median | 95 % | roughness: median | 95 % | lines with a rejection | ms: median | mean |\n|---|---|---|---|---|---|---|---|---|---|"
    );
    for class in CLASSES {
        let these: Vec<&Galaxy> = galaxies.iter().filter(|g| g.class == class).collect();
        for (name, settings) in &profiles {
            let releases = |seed| TableSettings {
                seed,
                ..settings.model.releases
            };
            let models: Vec<Model> = (1..=SEEDS)
                .map(|seed| ModelSettings {
                    releases: releases(seed),
                    // What the galaxy would have if it were not rejected.
                    max_halvings: MAX_HALVINGS,
                    ..settings.model
                })
                .map(|settings| Model::new(&settings).expect("a model"))
                .collect();
            let errors: Vec<f64> = these
                .par_iter()
                .flat_map_iter(|galaxy| {
                    models.iter().filter_map(|model| {
                        let found = particles(model, &galaxy.system)?;
                        Some(distance(
                            &binned(&found, BinEdges::default()),
                            &galaxy.track,
                        ))
                    })
                })
                .collect();
            let targets: Vec<StreamTarget> = these
                .iter()
                .map(|g| StreamTarget::from_track(&g.mock.track, settings).expect("a mock is data"))
                .collect();
            let pairs: Vec<(&StreamTarget, [f64; DIM])> = targets
                .iter()
                .zip(&these)
                .map(|(target, galaxy)| (target, galaxy.mock.params.to_array()))
                .collect();
            let lines: Vec<Option<f64>> = pairs
                .par_iter()
                .flat_map_iter(|(target, theta)| {
                    let prior = &prior;
                    (0..LINES).map(move |line| roughness(target.likelihood(), prior, theta, line))
                })
                .collect();
            let rejected = lines.iter().filter(|line| line.is_none()).count();
            let ms: Vec<f64> = pairs
                .iter()
                .map(|(target, theta)| {
                    let time = (0..3).map(|_| {
                        let start = Instant::now();
                        std::hint::black_box(target.likelihood().ln_likelihood(theta)).ok();
                        1e3 * start.elapsed().as_secs_f64()
                    });
                    time.fold(f64::INFINITY, f64::min)
                })
                .collect();
            let mean = ms.iter().sum::<f64>() / ms.len().max(1) as f64;
            let (error, error_95) = median_and_95(errors);
            let fraction = rejected as f64 / lines.len().max(1) as f64;
            let (rough, rough_95) = median_and_95(lines.into_iter().flatten().collect());
            let (ms, _) = median_and_95(ms);
            println!(
                "| {class} | {} | `{name}` | {error:.2} | {error_95:.2} | {rough:.2} | {rough_95:.2} | {fraction:.2} | {ms:.2} | {mean:.2} |",
                these.len()
            );
        }
    }
}
