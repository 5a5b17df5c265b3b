//! Error of a track by numbers of particles and steps, and the time of each setting.
//!
//! `cargo bench --bench noise` prints a table: for mocks that meet the paper's criteria, the rms over bins (with at least one per
//! cent of the particles) of the relative difference of the mean radius from that of 131,072 Sobol particles with `step_phase` 0.5, in
//! per cent; four tables of releases for each mock. The data's errors are 2 per cent. `time` is that of one stream and its bins on one
//! thread, the median over mocks, relative to the first row; the settings are timed in turn for each mock.
//!
//! A second table gives the effect of soft edges: the same difference between soft and hard bins of the reference's particles.
//!
//! A third table compares the scatter of a bin's mean over tables of releases with its Monte-Carlo variance for independent particles: the
//! factor that the model noise needs.
//!
//! The recorded tables are in benches/RESULTS.md.

mod tracks;

use oblate::inference::Profile;
use oblate::spray::{SamplingScheme, TableSettings};
use oblate::stream::{Model, ModelSettings, Particles, StepRule, System};
use oblate::track::{BinEdges, Track, TrackBin};
use rayon::prelude::*;
use std::time::Instant;
use tracks::{binned, distance, median_and_95, particles, systems, track};

const MOCKS: usize = 60;
const SEEDS: u64 = 4;

/// A setting with a name.
struct Row {
    name: &'static str,
    settings: ModelSettings,
}

fn rows() -> Vec<Row> {
    let with = |particles, per_release_time, sampling_scheme, step_phase| ModelSettings {
        releases: TableSettings {
            particles,
            release_times: particles / per_release_time,
            sampling_scheme,
            ..TableSettings::default()
        },
        step_phase,
        ..ModelSettings::default()
    };
    let fast = ModelSettings::default();
    let of = |particles, per_release_time| {
        let scheme = fast.releases.sampling_scheme;
        with(particles, per_release_time, scheme, fast.step_phase)
    };
    let alone = |particles, per_release_time| {
        let scheme = SamplingScheme::Sobol;
        with(particles, per_release_time, scheme, fast.step_phase)
    };
    let row = |name, settings| Row { name, settings };
    let paper = Profile::Paper.model();
    let accurate = ModelSettings {
        orbit: fast.orbit,
        orbit_steps: 192,
        ..paper
    };
    let equal = ModelSettings {
        step_rule: StepRule::Uniform,
        steps: 120,
        orbit_steps: 192,
        ..fast
    };
    vec![
        row("paper", paper),
        row("random, 10,000, accurate orbit", accurate),
        row("fast", fast),
        row("fast, 120 equal leapfrog steps per age", equal),
        row("fast, without neighbours", alone(2_560, 32)),
        row("512", of(512, 16)),
        row("1,024", of(1_024, 16)),
        row("1,024, without neighbours", alone(1_024, 16)),
        row("4,096", of(4_096, 32)),
        row("4,096, without neighbours", alone(4_096, 32)),
        row(
            "4,096, without neighbours, step_phase 0.6",
            with(4_096, 32, SamplingScheme::Sobol, 0.6),
        ),
    ]
}

/// The models of a setting, one per seed of the table.
fn models(settings: &ModelSettings, seeds: u64) -> Vec<Model> {
    let one = |seed| {
        let releases = TableSettings {
            seed,
            ..settings.releases
        };
        Model::new(&ModelSettings {
            releases,
            ..*settings
        })
        .expect("a model")
    };
    (1..=seeds).map(one).collect()
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
        step_phase: 0.5,
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
    println!("\n| setting | scatter / Monte-Carlo variance: median | mean |\n|---|---|---|");
    for row in rows
        .iter()
        .filter(|row| row.settings.step_rule == StepRule::Adaptive)
    {
        let models = self::models(&row.settings, TABLES);
        let mut ratios: Vec<f64> = systems
            .par_iter()
            .flat_map_iter(|system| variance_ratios(&models, system))
            .collect();
        ratios.sort_by(f64::total_cmp);
        let mean = ratios.iter().sum::<f64>() / ratios.len() as f64;
        println!(
            "| {} | {:.3} | {mean:.3} |",
            row.name,
            ratios[ratios.len() / 2]
        );
    }
}

/// Tables of releases for the scatter.
const TABLES: u64 = 12;

/// For every bin that all tables have: the variance of its mean over tables, over the mean of the variance for independent particles.
fn variance_ratios(models: &[Model], system: &System<f64>) -> Vec<f64> {
    let tracks: Vec<Track> = models.iter().filter_map(|m| track(m, system)).collect();
    let Some(first) = tracks.first() else {
        return Vec::new();
    };
    let ratio = |bin: &TrackBin| {
        let found = tracks
            .iter()
            .map(|t| t.bins.iter().find(|b| b.bin == bin.bin));
        let same = found.collect::<Option<Vec<&TrackBin>>>()?;
        let n = same.len() as f64;
        let mean = same.iter().map(|b| b.r_kpc).sum::<f64>() / n;
        let scatter = same.iter().map(|b| (b.r_kpc - mean).powi(2)).sum::<f64>() / (n - 1.0);
        let expected = same.iter().map(|b| b.r_err_kpc.powi(2)).sum::<f64>() / n;
        Some(scatter / expected)
    };
    first.bins.iter().filter_map(ratio).collect()
}
