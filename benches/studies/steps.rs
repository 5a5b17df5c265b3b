//! Error and cost of a track by step rule and length of steps.
//!
//! `cargo bench --bench steps` prints tables, in per cent: for mocks that meet the paper's criteria, and for draws of
//! the posteriors of five gala tracks (`benches/draws.csv`), the rms over bins of the relative difference of the mean
//! radius from that of the same particles with steps of a quarter of the default's phase. The data's errors are 2 per
//! cent. `good` is the fraction of streams below half a per cent, `forces` the number of force evaluations per
//! particle. Not a timing. The recorded table is in benches/RESULTS.md.

mod tracks;

use oblate::orbit::STAGES;
use oblate::params::{PriorSettings, QRange, StreamParams, StreamPrior};
use oblate::spray::TableSettings;
use oblate::stream::{Model, ModelSettings, StepRule, System};
use oblate::track::{BinEdges, Track};
use rayon::prelude::*;
use std::path::Path;
use tracks::{binned, distance, particles, systems, track};

const MOCKS: usize = 240;
const PARTICLES: usize = 2_048;

fn model(settings: ModelSettings) -> Model {
    let releases = TableSettings {
        particles: PARTICLES,
        ..TableSettings::default()
    };
    Model::new(&ModelSettings {
        releases,
        ..settings
    })
    .expect("a model")
}

/// The systems in benches/draws.csv.
fn draws(q_range: QRange) -> Vec<System<f64>> {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/draws.csv");
    let mut reader = csv::ReaderBuilder::new()
        .comment(Some(b'#'))
        .from_path(file)
        .expect("the draws");
    let rows = reader.deserialize::<(String, [f64; 13])>();
    let system = |(_, theta)| System::from_params(&StreamParams::from(theta), q_range);
    rows.map(|row| system(row.expect("a name and 13 numbers")))
        .collect()
}

/// Its track and the number of force evaluations per particle.
fn track_and_price(model: &Model, system: &System<f64>) -> Option<(Track, f64)> {
    let particles = particles(model, system)?;
    let forces = match model.settings().step_rule {
        StepRule::Uniform => model.mean_steps(),
        StepRule::Adaptive => {
            (STAGES * particles.step_sizes.steps()) as f64 / particles.step_sizes.pairs() as f64
        }
    };
    Some((binned(&particles, BinEdges::default()), forces))
}

fn table(name: &str, systems: &[System<f64>]) {
    let default = ModelSettings::default();
    let adaptive = |step_phase| ModelSettings {
        step_phase,
        ..default
    };
    let equal = |steps| ModelSettings {
        step_rule: StepRule::Uniform,
        steps,
        orbit_steps: 1_024,
        ..default
    };
    let reference = model(ModelSettings {
        max_halvings: 10,
        ..adaptive(0.25 * default.step_phase)
    });
    let references: Vec<Option<Track>> = systems
        .par_iter()
        .map(|system| track(&reference, system))
        .collect();
    println!(
        "\n{name}\n\n| steps | median | 75 % | 90 % | 95 % | worst | good | forces: median | mean | 95 % | streams |\n|---|---|---|---|---|---|---|---|---|---|---|"
    );
    let rows = [
        ("120 equal leapfrog steps per age".to_owned(), equal(120)),
        ("480 equal leapfrog steps per age".to_owned(), equal(480)),
    ]
    .into_iter()
    .chain(
        [0.8, 0.9, 1.0, 1.1, 1.2]
            .map(|phase| (format!("adaptive, phase {phase}"), adaptive(phase))),
    );
    for (name, settings) in rows {
        let model = model(settings);
        let (mut errors, mut forces): (Vec<f64>, Vec<f64>) = systems
            .par_iter()
            .zip(&references)
            .filter_map(|(system, reference)| {
                let (track, forces) = track_and_price(&model, system)?;
                Some((distance(&track, reference.as_ref()?), forces))
            })
            .unzip();
        let mean = forces.iter().sum::<f64>() / forces.len() as f64;
        let good = errors.iter().filter(|e| **e < 0.5).count() as f64 / errors.len() as f64;
        errors.sort_by(f64::total_cmp);
        forces.sort_by(f64::total_cmp);
        let at = |of: &[f64], percent: usize| of[(of.len() - 1) * percent / 100];
        println!(
            "| {name} | {:.3} | {:.2} | {:.2} | {:.2} | {:.2} | {good:.2} | {:.0} | {mean:.0} | {:.0} | {} |",
            at(&errors, 50),
            at(&errors, 75),
            at(&errors, 90),
            at(&errors, 95),
            at(&errors, 100),
            at(&forces, 50),
            at(&forces, 95),
            errors.len()
        );
    }
}

fn main() {
    let prior = StreamPrior::new(&PriorSettings::default()).expect("a prior");
    table("Mocks", &systems(MOCKS));
    table("Posterior draws of gala tracks", &draws(prior.q_range()));
}
