//! What does single precision cost in ln L and its gradient, and what does it gain?
//!
//! `cargo bench --bench precision` prints a table for the coarse model of a fit at the draws of `benches/draws.csv`, by largest phase of a
//! step. *Rounding* is ln L in single precision minus that in double precision with the same steps, *gradient* the norm of the difference
//! of the gradients over the norm of that in double precision. *Steps, double* and *steps, single* are ln L of the model minus that with
//! steps of a phase of 0.4: in single precision more particles share their steps, which are shorter therefore. Each is the median of
//! magnitudes, the number above 84 % of them, and the largest. Times of a value and of a gradient, in double and in single precision on
//! one thread, are medians over draws of the least of 15 turns. A second table has the times of the coarse model's particles by
//! instruction set.

mod draws;

use oblate::data::ObservedTrack;
use oblate::inference::{FitSettings, StreamTarget};
use oblate::likelihood::StreamLikelihood;
use oblate::params::{DIM, StreamParams};
use oblate::potential::Nfw;
use oblate::scalar::{Dual, Level, gradient_of, lift};
use oblate::stream::{Model, ModelSettings, Particles, Precision, StepSchedules, System};
use std::cell::RefCell;
use std::hint::black_box;
use std::path::Path;
use std::time::Instant;

const TURNS: usize = 15;

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Of magnitudes the median, the number above 84 % of them, and the largest.
fn summary(values: &[f64]) -> String {
    let mut magnitudes: Vec<f64> = values.iter().map(|value| value.abs()).collect();
    magnitudes.sort_by(f64::total_cmp);
    let n = magnitudes.len();
    let [middle, high, largest] = [n / 2, 84 * n / 100, n - 1].map(|i| magnitudes[i]);
    format!("{middle:.1e}, {high:.1e}, {largest:.1e}")
}

/// The least of the times of each piece of work in milliseconds; they take turns.
fn milliseconds<const N: usize>(work: [&dyn Fn(); N]) -> [f64; N] {
    let mut least = [f64::INFINITY; N];
    for _ in 0..TURNS {
        for (least, work) in least.iter_mut().zip(work) {
            let start = Instant::now();
            work();
            *least = least.min(1e3 * start.elapsed().as_secs_f64());
        }
    }
    least
}

/// The likelihood with other settings of the model.
fn with(likelihood: &StreamLikelihood, settings: ModelSettings) -> StreamLikelihood {
    likelihood.with_model(Model::new(&settings).expect("a model"))
}

fn norm(gradient: &[f64; DIM]) -> f64 {
    gradient.iter().map(|g| g * g).sum::<f64>().sqrt()
}

/// The target of the coarse model of a fit to the track of a draw, with steps of this phase.
fn target(draw: &draws::Draw, step_phase: f64) -> StreamTarget {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/tracks");
    let track = ObservedTrack::read(&folder.join(format!("{}.ecsv", draw.track)));
    let track = track.expect("a gala track");
    let coarse = FitSettings::default().coarse(track.bin_width_deg);
    let mut coarse = coarse.expect("a coarse model");
    coarse.model.step_phase = step_phase;
    StreamTarget::from_track(&track, &coarse).expect("a target")
}

fn main() {
    errors_and_times();
    times_by_instruction_set();
}

fn times_by_instruction_set() {
    println!("\n| instruction set | particles in doubles, ms | in singles |\n|---|---|---|");
    for &level in Level::available() {
        let mut times: [Vec<f64>; 2] = Default::default();
        for draw in draws::draws() {
            let target = target(&draw, 1.6);
            let model = |precision| {
                let settings = *target.likelihood().model().settings();
                with(
                    target.likelihood(),
                    ModelSettings {
                        precision,
                        ..settings
                    },
                )
            };
            let [double, single] = [Precision::Double, Precision::Single].map(model);
            let system = System::from_params(&target.params(&draw.theta), double.q_range());
            let solution = double.model().progenitor_solution(&system);
            let solution = solution.expect("an orbit");
            let buffers = RefCell::new((StepSchedules::default(), Particles::default()));
            let particles = |likelihood: &StreamLikelihood| {
                let (schedules, out) = &mut *buffers.borrow_mut();
                let model = likelihood.model();
                let tally = model.integrate_at(level, black_box(&solution), schedules, out);
                tally.expect("particles");
            };
            let least = milliseconds([&|| particles(&double), &|| particles(&single)]);
            for (times, time) in times.iter_mut().zip(least) {
                times.push(time);
            }
        }
        let [double, single] = times.map(median);
        println!("| {level:?} | {double:.3} | {single:.3} |");
    }
}

fn errors_and_times() {
    println!(
        "| phase | rounding | gradient | steps, double | steps, single | value, ms | gradient, ms |\n|---|---|---|---|---|---|---|"
    );
    for step_phase in [0.85, 1.6, 1.8, 2.0] {
        let [mut rounding, mut gradients, mut of_double, mut of_single] = [const { Vec::new() }; 4];
        let mut times: [Vec<f64>; 4] = Default::default();
        for draw in draws::draws() {
            let target = target(&draw, step_phase);
            let settings = |precision, step_phase| ModelSettings {
                precision,
                step_phase,
                ..*target.likelihood().model().settings()
            };
            let likelihood =
                |precision, phase| with(target.likelihood(), settings(precision, phase));
            let double = likelihood(Precision::Double, step_phase);
            let single = likelihood(Precision::Single, step_phase);
            let fine = likelihood(Precision::Double, 0.4);
            let value = |likelihood: &StreamLikelihood| {
                let evaluation = likelihood.ln_likelihood(&draw.theta);
                evaluation.expect("a draw has a likelihood").ln_likelihood
            };
            let gradient = |likelihood: &StreamLikelihood| {
                let evaluation = likelihood.gradient(&draw.theta);
                evaluation.expect("a draw has a gradient").1
            };
            let exact = single
                .ln_likelihood_on::<Nfw, Dual<DIM>>(&StreamParams::from_array(lift(&draw.theta)))
                .expect("a draw has a likelihood");
            rounding.push(value(&single) - exact.re);
            of_double.push(value(&double) - value(&fine));
            of_single.push(value(&single) - value(&fine));
            let (ours, exact) = (gradient(&single), gradient_of(&exact));
            let difference: [f64; DIM] = std::array::from_fn(|i| ours[i] - exact[i]);
            gradients.push(norm(&difference) / norm(&exact));
            let of_draw = milliseconds([
                &|| _ = black_box(value(black_box(&double))),
                &|| _ = black_box(value(black_box(&single))),
                &|| _ = black_box(gradient(black_box(&double))),
                &|| _ = black_box(gradient(black_box(&single))),
            ]);
            for (times, time) in times.iter_mut().zip(of_draw) {
                times.push(time);
            }
        }
        let [double, single, double_gradient, single_gradient] = times.map(median);
        println!(
            "| {step_phase} | {} | {} | {} | {} | {double:.3}, {single:.3} | {double_gradient:.3}, {single_gradient:.3} |",
            summary(&rounding),
            summary(&gradients),
            summary(&of_double),
            summary(&of_single)
        );
    }
}
