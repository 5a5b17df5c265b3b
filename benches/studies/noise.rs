//! Error of a track by numbers of particles and steps, and the time of each setting.
//!
//! `cargo bench --bench noise` prints a table: for mocks that meet the paper's criteria, the rms over bins (with at least one per
//! cent of the particles) of the relative difference of the mean radius from that of 131,072 Sobol particles with 800 equal steps, in
//! per cent; four tables of releases for each mock. The data's errors are 2 per cent. `time` is that of one stream and its bins on one
//! thread, the median over mocks, relative to the first row; the settings are timed in turn for each mock.
//!
//! A second table gives the effect of soft edges: the same difference between soft and hard bins of the reference's particles.
//!
//! The recorded tables are in benches/RESULTS.md.

mod tracks;

use oblate::inference::Profile;
use oblate::spray::{SamplingScheme, TableSettings};
use oblate::stream::{Model, ModelSettings, Particles, StepRule, StepsPer};
use oblate::track::{BinEdges, Track};
use rayon::prelude::*;
use std::time::Instant;
use tracks::{binned, distance, particles, systems, track};

const MOCKS: usize = 60;
const SEEDS: u64 = 4;

/// A setting with a name.
struct Row {
    name: &'static str,
    settings: ModelSettings,
}

fn rows() -> Vec<Row> {
    let with = |particles, release_times, sampling_scheme, steps, step_rule| ModelSettings {
        releases: TableSettings {
            particles,
            release_times,
            sampling_scheme,
            ..TableSettings::default()
        },
        steps,
        steps_per: StepsPer::Particle,
        step_rule,
        ..ModelSettings::default()
    };
    let sobol = |particles, per_release_time, steps, rule| {
        with(
            particles,
            particles / per_release_time,
            SamplingScheme::Sobol,
            steps,
            rule,
        )
    };
    let row = |name, settings| Row { name, settings };
    let age = |particles, per_release_time, steps, rule| ModelSettings {
        steps_per: StepsPer::Age,
        ..sobol(particles, per_release_time, steps, rule)
    };
    let segments = |particles, per_release_time| ModelSettings {
        steps_per: StepsPer::Age,
        ..with(
            particles,
            particles / per_release_time,
            SamplingScheme::SobolSegments,
            120,
            StepRule::Uniform,
        )
    };
    use StepRule::{Dynamical, Uniform};
    vec![
        row("paper", Profile::Paper.model()),
        row(
            "random, 10,000, accurate orbit",
            with(10_000, 100, SamplingScheme::Random, 100, Uniform),
        ),
        row("fast", Profile::Fast.model()),
        row("fast, without segments", age(2_560, 32, 120, Uniform)),
        row("segments, 512", segments(512, 16)),
        row("segments, 1,024", segments(1_024, 16)),
        row("segments, 2,048", segments(2_048, 32)),
        row("segments, 3,584", segments(3_584, 32)),
        row("segments, 4,096", segments(4_096, 32)),
        row("sobol, 1,024", sobol(1_024, 16, 100, Uniform)),
        row("sobol, 4,096", sobol(4_096, 16, 100, Uniform)),
        row(
            "sobol, 4,096, 8 per release time",
            sobol(4_096, 8, 100, Uniform),
        ),
        row(
            "sobol, 4,096, 50 dynamical",
            sobol(4_096, 16, 50, Dynamical),
        ),
        row(
            "sobol, 4,096, 100 dynamical",
            sobol(4_096, 16, 100, Dynamical),
        ),
        row("sobol, 4,096, 400", sobol(4_096, 16, 400, Uniform)),
        row("sobol, 4,096, 100 per age", age(4_096, 16, 100, Uniform)),
        row("sobol, 4,096, 140 per age", age(4_096, 16, 140, Uniform)),
        row(
            "sobol, 4,096, 140 dynamical per age",
            age(4_096, 16, 140, Dynamical),
        ),
        row("sobol, 4,096, 400 per age", age(4_096, 16, 400, Uniform)),
        row(
            "sobol, 3,072, 32 per release time, 128 per age",
            age(3_072, 32, 128, Uniform),
        ),
        row("sobol, 3,584, 120 per age", age(3_584, 32, 120, Uniform)),
        row("sobol, 1,024, 100 per age", age(1_024, 16, 100, Uniform)),
        row("sobol, 1,024, 200 per age", age(1_024, 16, 200, Uniform)),
    ]
}

/// The models of a setting, one per seed of the table.
fn models(settings: &ModelSettings, seeds: u64) -> Vec<Model> {
    let one = |seed| {
        let releases = TableSettings {
            seed,
            ..settings.releases
        };
        // Errors are to be seen, not rejected.
        Model::new(&ModelSettings {
            releases,
            min_steps_per_orbit: 0,
            ..*settings
        })
        .expect("a model")
    };
    (1..=seeds).map(one).collect()
}

/// The values at the middle and at 95 per cent.
fn median_and_95(mut values: Vec<f64>) -> (f64, f64) {
    values.sort_by(f64::total_cmp);
    let last = values.len() - 1;
    (values[last / 2], values[last * 95 / 100])
}

fn main() {
    let systems = systems(MOCKS);
    let exact = ModelSettings {
        releases: TableSettings {
            particles: 131_072,
            sampling_scheme: SamplingScheme::Sobol,
            seed: 77,
            ..TableSettings::default()
        },
        steps: 800,
        steps_per: StepsPer::Particle,
        orbit_steps: 1_024,
        ..ModelSettings::default()
    };
    let reference = Model::new(&exact).expect("a model");
    let exact: Vec<Option<Particles>> = systems
        .par_iter()
        .map(|system| particles(&reference, system))
        .collect();
    let references: Vec<Option<Track>> = exact
        .iter()
        .map(|particles| Some(binned(particles.as_ref()?, BinEdges::default())))
        .collect();
    let rows = rows();
    let models: Vec<Vec<Model>> = rows.iter().map(|r| models(&r.settings, SEEDS)).collect();
    let mut seconds = vec![Vec::new(); rows.len()];
    for system in &systems {
        for (models, seconds) in models.iter().zip(&mut seconds) {
            let best = (0..3).map(|_| {
                let start = Instant::now();
                std::hint::black_box(track(&models[0], system));
                start.elapsed().as_secs_f64()
            });
            seconds.push(best.fold(f64::INFINITY, f64::min));
        }
    }
    println!("| setting | median | 95 % | time |\n|---|---|---|---|");
    let mut unit = None;
    for ((row, models), seconds) in rows.iter().zip(&models).zip(seconds) {
        let errors: Vec<f64> = systems
            .par_iter()
            .zip(&references)
            .flat_map_iter(|(system, reference)| {
                models.iter().filter_map(move |model| {
                    Some(distance(&track(model, system)?, reference.as_ref()?))
                })
            })
            .collect();
        let (median, p95) = median_and_95(errors);
        let (seconds, _) = median_and_95(seconds);
        let unit = *unit.get_or_insert(seconds);
        println!(
            "| {} | {median:.3} | {p95:.2} | {:.3} |",
            row.name,
            seconds / unit
        );
    }
    println!("\n| edges, half-width in degrees | median | 95 % |\n|---|---|---|");
    for half_width_deg in [1.0, 2.0, 3.0, 5.0] {
        let shifts = exact.iter().flatten().map(|particles| {
            let soft = binned(particles, BinEdges::Soft { half_width_deg });
            distance(&soft, &binned(particles, BinEdges::Hard))
        });
        let (median, p95) = median_and_95(shifts.collect());
        println!("| {half_width_deg} | {median:.3} | {p95:.2} |");
    }
}
