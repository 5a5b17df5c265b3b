//! Where does the time of one ln L go?
//!
//! `cargo bench --bench parts` prints a table: for each model of a fit, on one thread, the time of the progenitor's orbit, of the releases
//! along it, of the particles in lanes, and of the rest (bins and likelihood), at a draw of the posterior of a gala track. The parts
//! take turns, each is the median of 101. Releases are what the progenitor solution takes beyond the orbit, bins and ln L what
//! the whole takes beyond the progenitor solution and the particles.

mod draws;

use oblate::data::ObservedTrack;
use oblate::inference::{FitSettings, Profile, StreamTarget};
use oblate::orbit::DenseOrbit;
use oblate::stream::{Particles, Precision, StepSchedules, System};
use std::hint::black_box;
use std::path::Path;
use std::time::Instant;

const TURNS: usize = 101;

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
    let draw = draws::draws()
        .into_iter()
        .find(|draw| draw.track == "s0_oblate_tilted");
    let theta = draw.expect("a draw of s0").theta;
    let file = folder.join("examples/tracks/s0_oblate_tilted.ecsv");
    let track = ObservedTrack::read(&file).expect("a gala track");
    println!(
        "| model | orbit, ms | particles | releases | bins and ln L | all | beside orbit and particles |\n|---|---|---|---|---|---|---|"
    );
    let fast = FitSettings::default();
    let coarse = fast.coarse(track.bin_width_deg).expect("a coarse model");
    let mut double = coarse.clone();
    double.model.precision = Precision::Double;
    let paper = FitSettings {
        model: Profile::Paper.model(),
        likelihood: Profile::Paper.likelihood(),
        ..FitSettings::default()
    };
    for (name, config) in [
        ("fast", fast),
        ("coarse", coarse),
        ("coarse in doubles", double),
        ("paper", paper),
    ] {
        let target = StreamTarget::from_track(&track, &config).expect("a gala track is data");
        let likelihood = target.likelihood();
        let (model, system) = (
            likelihood.model(),
            likelihood.system(&target.params(&theta)),
        );
        let intervals = model
            .progenitor_solution(&system)
            .map_or(1, |solution| solution.orbit.intervals());
        let (mut schedules, mut particles) = (StepSchedules::default(), Particles::default());
        let [mut orbit, mut solution_ms, mut particles_ms, mut whole] = [const { Vec::new() }; 4];
        for _ in 0..TURNS {
            orbit.push(milliseconds(|| {
                let System {
                    host,
                    today,
                    age_gyr,
                    ..
                } = black_box(&system);
                let (steps, method) = (intervals, config.model.orbit);
                black_box(DenseOrbit::integrate(host, *today, *age_gyr, steps, method));
            }));
            let mut solution = None;
            solution_ms.push(milliseconds(|| {
                solution = model.progenitor_solution(black_box(&system)).ok()
            }));
            let solution = solution.expect("an orbit");
            particles_ms.push(milliseconds(|| {
                let tally = model.integrate(black_box(&solution), &mut schedules, &mut particles);
                black_box(tally).expect("particles");
            }));
            whole.push(milliseconds(|| {
                black_box(likelihood.ln_likelihood(black_box(&theta))).ok();
            }));
        }
        let [orbit, solution_ms, particles_ms, whole] =
            [orbit, solution_ms, particles_ms, whole].map(median);
        println!(
            "| {name} | {orbit:.3} | {particles_ms:.3} | {:.3} | {:.3} | {whole:.3} | {:.1} % |",
            solution_ms - orbit,
            whole - solution_ms - particles_ms,
            100.0 * (1.0 - (orbit + particles_ms) / whole)
        );
    }
}
