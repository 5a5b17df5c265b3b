//! Where does the time of one ln L go?
//!
//! `cargo bench --bench parts` prints a table: for each profile, on one thread, the time of the progenitor's orbit, of the releases
//! along it, of the particles in lanes, and of the rest (bins and likelihood), at a draw of the posterior of a gala track. The parts
//! take turns, each is the median of 101. Releases are what the progenitor solution takes beyond the orbit, bins and ln L what
//! the whole takes beyond the progenitor solution and the particles.

use oblate::data::ObservedTrack;
use oblate::inference::{FitSettings, Profile, StreamTarget};
use oblate::orbit::DenseOrbit;
use oblate::params::DIM;
use oblate::stream::{Particles, StepSchedules, System};
use std::hint::black_box;
use std::path::Path;
use std::time::Instant;

const TURNS: usize = 101;

/// A draw of the posterior of s0.
fn theta(folder: &Path) -> [f64; DIM] {
    let mut reader = csv::ReaderBuilder::new()
        .comment(Some(b'#'))
        .from_path(folder.join("benches/draws.csv"))
        .expect("the draws");
    let mut rows = reader.deserialize::<(String, [f64; DIM])>();
    rows.find_map(|row| {
        let (track, theta) = row.expect("a name and 13 numbers");
        (track == "s0_oblate_tilted").then_some(theta)
    })
    .expect("a draw of s0")
}

fn milliseconds(work: impl FnOnce()) -> f64 {
    let start = Instant::now();
    work();
    1e3 * start.elapsed().as_secs_f64()
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn main() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let theta = theta(folder);
    let file = folder.join("examples/tracks/s0_oblate_tilted.ecsv");
    let track = ObservedTrack::read(&file).expect("a gala track");
    println!(
        "| profile | orbit, ms | particles | releases | bins and ln L | all | beside orbit and particles |\n|---|---|---|---|---|---|---|"
    );
    for (name, profile) in [("fast", Profile::Fast), ("paper", Profile::Paper)] {
        let config = FitSettings {
            model: profile.model(),
            likelihood: profile.likelihood(),
            ..FitSettings::default()
        };
        let target = StreamTarget::from_track(&track, &config).expect("a gala track is data");
        let likelihood = target.likelihood();
        let (model, system) = (
            likelihood.model(),
            likelihood.system(&target.params(&theta)),
        );
        let (mut schedules, mut stars) = (StepSchedules::default(), Particles::default());
        let [mut orbit, mut cold, mut hot, mut whole] = [const { Vec::new() }; 4];
        for _ in 0..TURNS {
            orbit.push(milliseconds(|| {
                let System {
                    host,
                    today,
                    age_gyr,
                    ..
                } = black_box(&system);
                let (steps, method) = (config.model.orbit_steps, config.model.orbit);
                black_box(DenseOrbit::integrate(host, *today, *age_gyr, steps, method));
            }));
            let mut solution = None;
            cold.push(milliseconds(|| {
                solution = model.progenitor_solution(black_box(&system)).ok()
            }));
            let solution = solution.expect("an orbit");
            hot.push(milliseconds(|| {
                let carried = model.integrate(black_box(&solution), &mut schedules, &mut stars);
                black_box(carried).expect("particles");
            }));
            whole.push(milliseconds(|| {
                black_box(likelihood.ln_likelihood(black_box(&theta))).ok();
            }));
        }
        let [orbit, cold, hot, whole] = [orbit, cold, hot, whole].map(median);
        println!(
            "| {name} | {orbit:.3} | {hot:.3} | {:.3} | {:.3} | {whole:.3} | {:.1} % |",
            cold - orbit,
            whole - cold - hot,
            100.0 * (1.0 - (orbit + hot) / whole)
        );
    }
}
