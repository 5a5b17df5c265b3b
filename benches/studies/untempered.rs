//! Hamiltonian Monte Carlo without tempering on the posterior of a stream.
//!
//! `cargo bench --bench untempered` sends four independent chains through the posteriors of two gala tracks, all 13 parameters
//! free, 512 particles. A chain adapts its step size and its dense metric in windows of 50, 100, 200 and 100 transitions, as the
//! tempered sampler does; then it makes 200 transitions with both fixed, of at most 64 leapfrog steps. In the first table a chain starts
//! at the best of 1,000 draws of the prior; in the second at a draw of the posterior (`benches/draws.csv`, of a finer model). A row takes
//! some minutes of a core; `-- --quick` makes short chains on one track. The recorded table is in benches/RESULTS.md.
//!
//! R-hat is the largest over all coordinates and ln L. Modes are the eight orientation modes (sign of `dir_x`, sign of `dir_y`, oblate or
//! prolate): how many each chain visited, and all together. Gradients and seconds include the warm-up, everything else is of the last 200
//! transitions.

mod draws;

use draws::draws;
use oblate::data::ObservedTrack;
use oblate::inference::{FitSettings, StreamTarget};
use oblate::params::{DIM, REQUIRED};
use oblate_samplers::Target;
use oblate_samplers::diagnostics::{r_hat, weighted_quantile};
use oblate_samplers::hmc::{
    End, Evaluator, LocalSampler, Metric, Moments, Plan, Point, StepSize, shorten,
};
use oblate_samplers::output::Calls;
use oblate_samplers::rng::{Domain, RandomStream, stream};
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::f64::consts::FRAC_PI_2;
use std::path::Path;

const CHAINS: usize = 4;
const SEED: u64 = 1;

/// Draws of the prior with a likelihood, at the best of which a chain starts.
const START_DRAWS: usize = 1_000;

/// Step that a chain begins with, in units of the prior.
const FIRST_STEP: f64 = 0.1;

/// Target of the mean acceptance.
const ACCEPTANCE: f64 = 0.8;

/// Transitions between two updates of the step: the acceptance of a single one is near 0 or 1, whatever the step.
const TRANSITIONS_PER_UPDATE: usize = 5;

/// Maximum length of a score that a metric is estimated from, in units of sqrt(d): otherwise one chaotic point would
/// outweigh all others.
const MAX_SCORE: f64 = 1_000.0;

/// Transitions while a chain descends from the prior: short ones, with energies that may vary with the descent.
const FALLING: Plan = Plan {
    step: FIRST_STEP,
    length: FRAC_PI_2,
    max_leapfrogs: 32,
    max_energy_range: f64::INFINITY,
    slack: 0.05,
};

/// Transitions after that.
const SETTLED: Plan = Plan {
    max_leapfrogs: 64,
    max_energy_range: 1_000.0,
    slack: 0.0,
    ..FALLING
};

/// The schedule of a chain.
struct Schedule {
    /// Transitions of each window; the metric is updated between windows, so that in the last one the step is adapted to the
    /// metric that it will be used with.
    warm_up: &'static [(Plan, usize)],
    /// Transitions without adaptation.
    frozen: usize,
}

const FULL: Schedule = Schedule {
    warm_up: &[
        (FALLING, 50),
        (FALLING, 100),
        (SETTLED, 200),
        (SETTLED, 100),
    ],
    frozen: 200,
};

const QUICK: Schedule = Schedule {
    warm_up: &[(FALLING, 50), (SETTLED, 50)],
    frozen: 50,
};

/// A chain: its state, its metric and its step size.
struct Chain<'a> {
    target: &'a StreamTarget,
    rng: RandomStream,
    at: Point,
    metric: Metric,
    step: f64,
    calls: Calls,
}

/// The results of a chain.
#[derive(Default)]
struct Record {
    z: [Vec<f64>; REQUIRED],
    ln_likelihood: Vec<f64>,
    q: Vec<f64>,
    modes: BTreeSet<(bool, bool, bool)>,
    acceptance: f64,
    diverged: usize,
    gradients: u64,
    cpu_seconds: f64,
}

impl<'a> Chain<'a> {
    fn new(target: &'a StreamTarget, at: Point, number: usize) -> Self {
        Self {
            target,
            rng: stream(SEED, Domain::PtExplore, number as u64, 0),
            at,
            metric: Metric::identity(REQUIRED),
            step: FIRST_STEP,
            calls: Calls::default(),
        }
    }

    fn run(mut self, schedule: &Schedule) -> Record {
        let mut moments = Moments::new(REQUIRED);
        for (plan, moves) in schedule.warm_up {
            self.update_metric(&moments);
            moments = self.adapt(plan, *moves);
        }
        self.record(schedule.frozen)
    }

    /// Updates the metric from the moments of a window, if they allow it, and the step so that it is no longer than before in any
    /// direction.
    fn update_metric(&mut self, moments: &Moments) {
        if let Some(metric) = self.metric.refined(moments) {
            self.step /= self.metric.ln_stretch(&metric).exp();
            self.metric = metric;
        }
    }

    /// A window of warm-up, in which the step is adapted; its moments are for the metric.
    fn adapt(&mut self, plan: &Plan, moves: usize) -> Moments {
        let mut step = StepSize::new(self.step);
        let mut moments = Moments::new(REQUIRED);
        let mut local_sampler = LocalSampler::new(self.target, 1.0, &self.metric);
        let updates = moves / TRANSITIONS_PER_UPDATE;
        for update in 0..updates {
            let plan = Plan {
                step: step.step(),
                ..*plan
            };
            let mut met = Vec::new();
            for _ in 0..TRANSITIONS_PER_UPDATE {
                let moved = local_sampler
                    .transition(&mut self.at, &plan, &mut self.rng)
                    .expect("a target that never fails");
                // No step is short enough for a discontinuity; but during the descent a rejected point may be the overflow of a
                // step far too long.
                if plan.slack > 0.0 || moved.end != End::Rejected {
                    met.push(moved.acceptance);
                }
                if self.at.has_gradient {
                    let slopes = self.at.gradient.iter().zip(&self.at.z);
                    let mut score: Vec<f64> = slopes.map(|(g, z)| g - z).collect();
                    shorten(&mut score, MAX_SCORE);
                    moments.push(&self.at.z, &score);
                }
            }
            if !met.is_empty() {
                step.learn(mean(&met), ACCEPTANCE, update, updates);
            }
        }
        self.calls.add(&local_sampler.evaluator.calls);
        self.step = step.ln_found().exp();
        moments
    }

    /// The transitions with fixed step and metric.
    fn record(mut self, moves: usize) -> Record {
        let plan = Plan {
            step: self.step,
            ..SETTLED
        };
        let mut record = Record::default();
        let mut local_sampler = LocalSampler::new(self.target, 1.0, &self.metric);
        let mut theta = [0.0; REQUIRED];
        for _ in 0..moves {
            let moved = local_sampler
                .transition(&mut self.at, &plan, &mut self.rng)
                .expect("a target that never fails");
            record.acceptance += moved.acceptance / moves as f64;
            record.diverged += usize::from(moved.end == End::Diverged);
            self.target.prior().theta_from_z(&self.at.z, &mut theta);
            let params = self.target.params(&theta);
            let q = self.target.stream_prior().shape(&params).q;
            let mode = (params.dir_x >= 0.0, params.dir_y >= 0.0, q > 1.0);
            record.modes.insert(mode);
            record.q.push(q);
            record.ln_likelihood.push(self.at.ln_likelihood);
            for (column, z) in record.z.iter_mut().zip(&self.at.z) {
                column.push(*z);
            }
        }
        self.calls.add(&local_sampler.evaluator.calls);
        record.gradients = self.calls.gradients;
        record
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// The best of some draws of the prior.
fn best_of_prior(target: &StreamTarget, number: usize) -> Point {
    let mut rng = stream(SEED, Domain::Prior, number as u64, 0);
    let mut evaluator = Evaluator::new(target);
    let mut best = Point::new(REQUIRED);
    let mut found = 0;
    while found < START_DRAWS {
        let mut point = Point::new(REQUIRED);
        evaluator.draw_reference(&mut point.z, &mut rng);
        let value = evaluator.value(&point.z);
        point.ln_likelihood = value.expect("a target that never fails");
        found += usize::from(point.ln_likelihood.is_finite());
        if point.ln_likelihood > best.ln_likelihood {
            best = point;
        }
    }
    best
}

/// A start for each chain among the draws of a track's posterior that are in benches/draws.csv, spread over them.
fn posterior_draws(target: &StreamTarget, track: &str) -> Vec<Point> {
    let own: Vec<[f64; DIM]> = draws()
        .into_iter()
        .filter(|draw| draw.track == track)
        .map(|draw| draw.theta)
        .collect();
    own.iter()
        .step_by(own.len() / CHAINS)
        .map(|theta| {
            let mut point = Point::new(REQUIRED);
            target.prior().z_from_theta(theta, &mut point.z);
            point
        })
        .collect()
}

/// CPU time of this thread, on which the chain stays; NaN where the system has no such clock (Linux has).
fn cpu_seconds() -> f64 {
    let nanoseconds = std::fs::read_to_string("/proc/thread-self/schedstat")
        .ok()
        .and_then(|text| text.split(' ').next()?.parse::<f64>().ok());
    nanoseconds.map_or(f64::NAN, |count| 1e-9 * count)
}

/// The largest R-hat.
fn worst_r_hat(chains: &[Record]) -> f64 {
    let of =
        |column: &dyn Fn(&Record) -> &[f64]| r_hat(&chains.iter().map(column).collect::<Vec<_>>());
    (0..REQUIRED)
        .map(|i| of(&|chain| &chain.z[i]))
        .fold(of(&|chain| &chain.ln_likelihood), f64::max)
}

/// A row of a table.
fn row(track: &str, chains: &[Record]) -> String {
    let each = |say: &dyn Fn(&Record) -> String| {
        let words: Vec<String> = chains.iter().map(say).collect();
        words.join(", ")
    };
    let sum = |of: &dyn Fn(&Record) -> f64| chains.iter().map(of).sum::<f64>();
    let together: BTreeSet<_> = chains.iter().flat_map(|chain| &chain.modes).collect();
    let median = |values: &[f64]| weighted_quantile(values, &vec![1.0; values.len()], 0.5);
    format!(
        "| {track} | {:.2} | {} | {} | {} | {} | {:.2} | {} | {} | {:.0} |",
        worst_r_hat(chains),
        each(&|chain| chain.modes.len().to_string()),
        together.len(),
        each(&|chain| format!("{:.1}", mean(&chain.ln_likelihood))),
        each(&|chain| format!("{:.2}", median(&chain.q))),
        sum(&|chain| chain.acceptance) / chains.len() as f64,
        chains.iter().map(|chain| chain.diverged).sum::<usize>(),
        chains.iter().map(|chain| chain.gradients).sum::<u64>(),
        sum(&|chain| chain.cpu_seconds),
    )
}

fn main() {
    let quick = std::env::args().any(|argument| argument == "--quick");
    let tracks = ["s0_oblate_tilted", "s2_spherical"];
    let (tracks, schedule) = if quick {
        (&tracks[..1], QUICK)
    } else {
        (&tracks[..], FULL)
    };
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut config = FitSettings::default();
    config.model.releases.particles = 512;
    for (from, at_posterior) in [("the prior", false), ("the posterior", true)] {
        println!(
            "\n| from {from} | R-hat | modes | together | mean ln L | median q | acceptance | divergent | gradients | CPU s |\n|---|---|---|---|---|---|---|---|---|---|"
        );
        for name in tracks {
            let track = ObservedTrack::read(&folder.join(format!("examples/tracks/{name}.ecsv")))
                .expect("a gala track");
            let target = StreamTarget::from_track(&track, &config).expect("a gala track is data");
            let draws = posterior_draws(&target, name);
            let chains: Vec<Record> = (0..CHAINS)
                .into_par_iter()
                .map(|number| {
                    let begun = cpu_seconds();
                    let start = if at_posterior {
                        draws[number].clone()
                    } else {
                        best_of_prior(&target, number)
                    };
                    let mut record = Chain::new(&target, start, number).run(&schedule);
                    record.cpu_seconds = cpu_seconds() - begun;
                    record
                })
                .collect();
            println!("{}", row(name, &chains));
        }
    }
}
