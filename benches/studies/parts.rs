//! Where does the time of one ln L go?
//!
//! `cargo bench --bench parts` prints a table: for each model of a fit, on one thread, the time of the progenitor's orbit, of the releases
//! along it, of the particles in lanes, of the bins and of the likelihood, at the draws of the posterior of a gala track and at 200 draws of
//! the prior that have a stream. The parts take turns. At a draw each is the median of 31, and the table has the median over the
//! draws. Releases are what the progenitor solution takes beyond the orbit, with the attempts at the orbit that were left.

mod draws;

use oblate::data::ObservedTrack;
use oblate::inference::{FitSettings, Profile, StreamTarget, prior_draws};
use oblate::likelihood::Observation;
use oblate::orbit::{Conservative, DenseOrbit};
use oblate::params::{DIM, StreamParams};
use oblate::stream::{Particles, Precision, StepSchedules, System};
use oblate::track::{PartialSums, Sums};
use std::hint::black_box;
use std::path::Path;
use std::time::Instant;

const TURNS: usize = 31;

/// Number of draws of the prior.
const PRIOR_DRAWS: usize = 200;

fn microseconds(work: impl FnOnce()) -> f64 {
    let start = Instant::now();
    work();
    1e6 * start.elapsed().as_secs_f64()
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// The times of orbit, progenitor solution, particles, bins, ln L of the bins, and of a whole value; `None` if there is no stream.
fn times(target: &StreamTarget, theta: &[f64; DIM]) -> Option<[f64; 6]> {
    let likelihood = target.likelihood();
    let (model, track) = (likelihood.model(), likelihood.track());
    let system = System::from_params(&StreamParams::from_array(*theta), likelihood.q_range());
    let (host, today, age) = (&system.host, system.today, system.age_gyr);
    let method = model.settings().orbit;
    let first = model.progenitor_solution(&system).ok()?;
    let node_times = first.orbit.times().clone();
    let mut memory = Some(first.into_memory());
    let (mut schedules, mut particles) = (StepSchedules::default(), Particles::default());
    let (mut sums, mut partial) = (Sums::default(), PartialSums::default());
    let mut measured = [const { Vec::new() }; 6];
    for _ in 0..TURNS {
        measured[0].push(microseconds(|| {
            let orbit = DenseOrbit::integrate_at(
                &Conservative(black_box(host)),
                today,
                age,
                &node_times,
                method,
            );
            black_box(orbit);
        }));
        let mut solution = None;
        measured[1].push(microseconds(|| {
            let system = black_box(&system);
            solution = model
                .progenitor_solution_reusing(system, memory.take())
                .ok();
        }));
        let solution = solution?;
        measured[2].push(microseconds(|| {
            let solution = black_box(&solution);
            black_box(model.integrate(solution, &mut schedules, &mut particles)).ok();
        }));
        measured[3].push(microseconds(|| {
            track
                .grid()
                .sum(black_box(&particles), &mut sums, &mut partial);
        }));
        measured[4].push(microseconds(|| {
            black_box(track.ln_likelihood(black_box(&sums), &Observation::default())).ok();
        }));
        measured[5].push(microseconds(|| {
            black_box(likelihood.ln_likelihood(black_box(theta))).ok();
        }));
        memory = Some(solution.into_memory());
    }
    Some(measured.map(median))
}

fn main() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let posterior: Vec<[f64; DIM]> = draws::draws()
        .into_iter()
        .filter(|draw| draw.track == "s0_oblate_tilted")
        .map(|draw| draw.theta)
        .collect();
    let file = folder.join("examples/tracks/s0_oblate_tilted.ecsv");
    let track = ObservedTrack::read(&file).expect("a gala track");
    let fast = FitSettings::default();
    let coarse = fast.coarse(track.bin_width_deg).expect("a coarse model");
    let mut double = coarse.clone();
    double.model.precision = Precision::Double;
    let paper = FitSettings {
        model: Profile::Paper.model(),
        likelihood: Profile::Paper.likelihood(),
        ..FitSettings::default()
    };
    println!(
        "| model | draws | orbit, µs | releases | particles | bins | ln L | all | beside the particles |\n|---|---|---|---|---|---|---|---|---|"
    );
    for (name, settings) in [
        ("coarse", coarse),
        ("coarse in doubles", double),
        ("fast", fast),
        ("paper", paper),
    ] {
        let target = StreamTarget::from_track(&track, &settings).expect("a gala track is data");
        let drawn = prior_draws(&target, PRIOR_DRAWS, 3);
        let prior = (0..PRIOR_DRAWS).map(|row| target.params(drawn.theta_row(row)).to_array());
        for (draws, thetas) in [
            ("posterior of s0", posterior.clone()),
            ("prior", prior.collect()),
        ] {
            let rows: Vec<[f64; 6]> = thetas
                .iter()
                .filter_map(|theta| times(&target, theta))
                .collect();
            let over_draws = |part: fn(&[f64; 6]) -> f64| median(rows.iter().map(part).collect());
            println!(
                "| {name} | {draws} | {:.1} | {:.1} | {:.1} | {:.1} | {:.1} | {:.1} | {:.0} % |",
                over_draws(|t| t[0]),
                over_draws(|t| t[1] - t[0]),
                over_draws(|t| t[2]),
                over_draws(|t| t[3]),
                over_draws(|t| t[4]),
                over_draws(|t| t[5]),
                over_draws(|t| 100.0 * (1.0 - t[2] / t[5])),
            );
        }
    }
}
