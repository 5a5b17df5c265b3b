//! What does plain Hamiltonian Monte Carlo, without tempering, make of the posterior of a stream?
//!
//! `cargo bench --bench untempered` sends four independent chains through the posterior of each of five gala tracks, all 13
//! parameters free, 512 particles: windows of warm-up in which a chain learns its step and its metric as the tempered sampler does,
//! then 400 moves with both frozen, of which the tables tell. In the first table a chain starts at the best of 64 draws of the
//! prior, in the second at a draw of the posterior (`benches/draws.csv`, of a finer model), so that what is then still missing is
//! the way between modes alone. A track's row takes about a minute of a core; `-- --quick` does one track with short windows.
//!
//! R-hat is the largest of all coordinates' and ln L's. Cells are those of the signs of the axis on the sky, oblate or prolate, that
//! each chain has visited, and all together. Mean ln L and median q are per chain. Gradients and seconds include the warm-up.

use oblate::config::FitConfig;
use oblate::data::ObservedTrack;
use oblate::inference::StreamTarget;
use oblate::params::DIM;
use oblate::run::target;
use oblate_samplers::Target;
use oblate_samplers::diagnostics::{r_hat, weighted_quantile};
use oblate_samplers::hmc::{
    End, Evaluator, Explorer, Metric, MetricKind, Moments, Plan, Point, StepSize, Tally, shorten,
};
use oblate_samplers::rng::{Domain, Stream, stream};
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::f64::consts::FRAC_PI_2;
use std::path::Path;

const CHAINS: u64 = 4;
const SEED: u64 = 1;

/// Draws of the prior, each with a likelihood, of which a chain starts at the best.
const START_DRAWS: usize = 1_000;

/// Mean acceptance that the step is steered to.
const ACCEPTANCE: f64 = 0.8;

/// Moves from one lesson of the step to the next: the acceptance of one alone is near 0 or 1, whatever the step.
const MOVES_PER_LESSON: usize = 5;

/// Longest score that a metric is estimated from, in units of sqrt(d): one chaotic point would outweigh all others.
const LONGEST_SCORE: f64 = 1_000.0;

/// Moves of the stages of a chain.
struct Stages {
    /// Windows of warm-up while the chain falls from the prior: trajectories are short, and energies may vary with the fall.
    falling: &'static [usize],
    /// Windows after that.
    settling: &'static [usize],
    /// The last stretch, in which nothing is learnt.
    frozen: usize,
}

const FULL: Stages = Stages {
    falling: &[50, 100],
    settling: &[200, 100],
    frozen: 250,
};

const QUICK: Stages = Stages {
    falling: &[25],
    settling: &[50],
    frozen: 50,
};

/// What is fixed of a move but its step, while the chain falls and after that.
const FALLING: Plan = Plan {
    step: 0.0,
    length: FRAC_PI_2,
    max_leapfrogs: 32,
    max_energy_range: f64::INFINITY,
    slack: 0.05,
};
const SETTLED: Plan = Plan {
    max_leapfrogs: 64,
    max_energy_range: 1_000.0,
    slack: 0.0,
    ..FALLING
};

/// A chain: where it is, and what it has learnt.
struct Chain<'a> {
    target: &'a StreamTarget,
    rng: Stream,
    at: Point,
    metric: Metric,
    step: f64,
    tally: Tally,
}

impl<'a> Chain<'a> {
    fn new(target: &'a StreamTarget, at: Point, number: u64) -> Self {
        Self {
            target,
            rng: stream(SEED, Domain::PtExplore, number, 0),
            at,
            metric: Metric::identity(MetricKind::Dense, DIM),
            step: 0.1,
            tally: Tally::default(),
        }
    }

    /// A window of warm-up: the step learns on the way; the moments are what the metric may be refined from.
    fn learn(&mut self, plan: &Plan, moves: usize) -> Moments {
        self.leave_floor(plan);
        let mut step = StepSize::new(self.step);
        let mut moments = Moments::new(DIM);
        let mut explorer = Explorer::new(self.target, 1.0, &self.metric);
        let lessons = moves / MOVES_PER_LESSON;
        for lesson in 0..lessons {
            let plan = Plan {
                step: step.step(),
                ..*plan
            };
            let mut met = Vec::new();
            for _ in 0..MOVES_PER_LESSON {
                let moved = explorer
                    .transition(&mut self.at, &plan, &mut self.rng)
                    .expect("a target that never fails");
                // No step is short enough for a cliff; a chain that falls may well have overflowed for a step that is too long.
                if plan.slack > 0.0 || moved.end != End::Rejected {
                    met.push(moved.acceptance);
                }
                if self.at.has_gradient {
                    let slopes = self.at.gradient.iter().zip(&self.at.z);
                    let mut score: Vec<f64> = slopes.map(|(g, z)| g - z).collect();
                    shorten(&mut score, LONGEST_SCORE);
                    moments.push(&self.at.z, &score);
                }
            }
            if !met.is_empty() {
                let mean = met.iter().sum::<f64>() / met.len() as f64;
                step.learn(mean, ACCEPTANCE, lesson, lessons);
            }
        }
        self.tally.add(&explorer.evaluator);
        self.step = step.ln_found().exp();
        moments
    }

    /// The metric that moments ask for, and the step no longer than it was in any direction.
    fn refine(&mut self, moments: &Moments) {
        if let Some(metric) = self.metric.refined(moments) {
            self.step /= self.metric.ln_stretch(&metric).exp();
            self.metric = metric;
        }
    }

    /// Where the largest number of leapfrogs sets the length of trajectories, the metric's size does not: it is made smaller, and the
    /// step longer by as much, which changes no path but leaves the step farther from the shortest that it can learn.
    fn leave_floor(&mut self, plan: &Plan) {
        let longer = plan.length / plan.max_leapfrogs as f64 / self.step;
        let smaller = self.metric.covariance() / (longer * longer);
        if longer > 1.0
            && let Some(metric) = Metric::from_covariance(MetricKind::Dense, &smaller)
        {
            self.metric = metric;
            self.step *= longer;
        }
    }

    /// The last stretch.
    fn record(&mut self, moves: usize) -> Record {
        let plan = Plan {
            step: self.step,
            ..SETTLED
        };
        let mut record = Record::default();
        let mut explorer = Explorer::new(self.target, 1.0, &self.metric);
        let mut theta = [0.0; DIM];
        for _ in 0..moves {
            let moved = explorer
                .transition(&mut self.at, &plan, &mut self.rng)
                .expect("a target that never fails");
            record.acceptance += moved.acceptance / moves as f64;
            record.diverged += usize::from(moved.end == End::Diverged);
            if std::env::var("DBG").is_ok() {
                record.dbg.0 += usize::from(moved.capped);
                record.dbg.1 += usize::from(moved.end == End::Rejected);
                record.dbg.2 += moved.leapfrogs;
                record.dbg.3 = self.step;
                record.dbg.4 += usize::from(moved.accepted)
            }
            self.target.prior().theta_from_z(&self.at.z, &mut theta);
            let params = self.target.params(&theta);
            let q = self.target.stream_prior().shape(&params).q;
            record
                .cells
                .insert((params.dir_x >= 0.0, params.dir_y >= 0.0, q > 1.0));
            record.q.push(q);
            record.ln_likelihood.push(self.at.ln_likelihood);
            for (column, z) in record.z.iter_mut().zip(&self.at.z) {
                column.push(*z);
            }
        }
        self.tally.add(&explorer.evaluator);
        record
    }
}

/// What a chain did in its last stretch.
#[derive(Default)]
struct Record {
    z: [Vec<f64>; DIM],
    ln_likelihood: Vec<f64>,
    q: Vec<f64>,
    cells: BTreeSet<(bool, bool, bool)>,
    acceptance: f64,
    diverged: usize,
    /// Of the whole chain.
    gradients: u64,
    cpu_seconds: f64,
    dbg: (usize, usize, usize, f64, usize),
}

impl Record {
    fn of(target: &StreamTarget, start: Point, number: u64, stages: &Stages) -> Self {
        let before = cpu_seconds();
        let mut chain = Chain::new(target, start, number);
        let mut moments: Option<Moments> = None;
        let falling = stages.falling.iter().map(|moves| (FALLING, *moves));
        let settling = stages.settling.iter().map(|moves| (SETTLED, *moves));
        for (plan, moves) in falling.chain(settling) {
            // Between windows only: in the last one the step learns in the metric that it will be used in.
            if let Some(moments) = &moments {
                chain.refine(moments);
            }
            moments = Some(chain.learn(&plan, moves));
            if std::env::var("DBG").is_ok() {
                eprintln!(
                    "  chain {number} window {moves}: lnL {:.1} step {:.4} grads {}",
                    chain.at.ln_likelihood, chain.step, chain.tally.gradients
                );
            }
        }
        let mut record = chain.record(stages.frozen);
        record.gradients = chain.tally.gradients;
        record.cpu_seconds = cpu_seconds() - before;
        if std::env::var("DBG").is_ok() {
            eprintln!(
                "  chain {number} acc {:.2} div {} capped {} rej {} leapf {} step {:.4} accepted {} cpu {:.1} grads {} per {:.2} ms",
                record.acceptance,
                record.diverged,
                record.dbg.0,
                record.dbg.1,
                record.dbg.2,
                record.dbg.3,
                record.dbg.4,
                record.cpu_seconds,
                record.gradients,
                1e3 * record.cpu_seconds / record.gradients as f64
            );
        }
        record
    }
}

/// The best of a handful of draws of the prior.
fn best_of_prior(target: &StreamTarget, number: u64) -> Point {
    let mut rng = stream(SEED, Domain::Prior, number, 0);
    let mut evaluator = Evaluator::new(target);
    let mut best = Point::new(DIM);
    let mut found = 0;
    while found < std::env::var("SD").map_or(START_DRAWS, |s| s.parse().unwrap()) {
        let mut point = Point::new(DIM);
        evaluator
            .draw_reference(&mut point.z, &mut rng)
            .expect("a prior without walls");
        point.ln_likelihood = evaluator
            .value(&point.z)
            .expect("a target that never fails");
        found += usize::from(point.ln_likelihood.is_finite());
        if point.ln_likelihood > best.ln_likelihood {
            best = point;
        }
    }
    best
}

/// Four of the draws of a track's posterior that are kept beside this file.
fn posterior_draws(folder: &Path, target: &StreamTarget, track: &str) -> Vec<Point> {
    let mut reader = csv::ReaderBuilder::new()
        .comment(Some(b'#'))
        .from_path(folder.join("benches/draws.csv"))
        .expect("the draws");
    let rows = reader.deserialize::<(String, [f64; DIM])>();
    let own: Vec<[f64; DIM]> = rows
        .map(|row| row.expect("a name and 13 numbers"))
        .filter(|(name, _)| name == track)
        .map(|(_, theta)| theta)
        .collect();
    let apart = own.len() / CHAINS as usize;
    own.iter()
        .step_by(apart)
        .map(|theta| {
            let mut point = Point::new(DIM);
            target.prior().z_from_theta(theta, &mut point.z);
            point
        })
        .collect()
}

/// Time that this thread has been on a core; NaN where the system does not tell (Linux does).
fn cpu_seconds() -> f64 {
    let nanoseconds = std::fs::read_to_string("/proc/thread-self/schedstat")
        .ok()
        .and_then(|text| text.split(' ').next()?.parse::<f64>().ok());
    nanoseconds.map_or(f64::NAN, |ns| 1e-9 * ns)
}

/// A row of a table.
fn row(name: &str, chains: &[Record]) -> String {
    let worst = |of: &dyn Fn(&Record) -> &[f64]| r_hat(&chains.iter().map(of).collect::<Vec<_>>());
    let r_hat = (0..DIM)
        .map(|i| worst(&|chain| &chain.z[i]))
        .fold(worst(&|chain| &chain.ln_likelihood), f64::max);
    let each =
        |of: &dyn Fn(&Record) -> String| chains.iter().map(of).collect::<Vec<_>>().join(", ");
    let together: BTreeSet<_> = chains.iter().flat_map(|chain| &chain.cells).collect();
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let acceptance: Vec<f64> = chains.iter().map(|chain| chain.acceptance).collect();
    format!(
        "| {name} | {r_hat:.2} | {} | {} | {} | {} | {:.2} | {} | {} | {:.0} |",
        each(&|chain| chain.cells.len().to_string()),
        together.len(),
        each(&|chain| format!("{:.1}", mean(&chain.ln_likelihood))),
        each(&|chain| format!(
            "{:.2}",
            weighted_quantile(&chain.q, &vec![1.0; chain.q.len()], 0.5)
        )),
        mean(&acceptance),
        chains.iter().map(|chain| chain.diverged).sum::<usize>(),
        chains.iter().map(|chain| chain.gradients).sum::<u64>(),
        chains.iter().map(|chain| chain.cpu_seconds).sum::<f64>(),
    )
}

fn main() {
    let quick = std::env::args().any(|argument| argument == "--quick");
    let stages = if quick { QUICK } else { FULL };
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut config = FitConfig::default();
    config.model.releases.particles = 512;
    let tracks = [
        "s0_oblate_tilted",
        "s1_prolate_tilted",
        "s2_spherical",
        "s3_oblate_edge_on",
        "s4_prolate_wrapped",
    ];
    let tracks = if quick { &tracks[..1] } else { &tracks };
    for from_prior in [true, false] {
        if std::env::var("TAB").is_ok_and(|t| (t == "1") != from_prior) {
            continue;
        }
        println!(
            "\n| from {} | R-hat | cells | together | mean ln L | median q | acceptance | divergent | gradients | CPU s |\n|---|---|---|---|---|---|---|---|---|---|",
            if from_prior {
                "the prior"
            } else {
                "draws of the posterior"
            }
        );
        for name in tracks {
            let file = folder.join(format!("examples/tracks/{name}.ecsv"));
            let track = ObservedTrack::read(&file).expect("a gala track");
            let target = target(&track, &config).expect("a gala track is data");
            let draws = posterior_draws(folder, &target, name);
            let chains: Vec<Record> = (0..CHAINS)
                .into_par_iter()
                .map(|number| {
                    let start = if from_prior {
                        best_of_prior(&target, number)
                    } else {
                        draws[number as usize].clone()
                    };
                    Record::of(&target, start, number, &stages)
                })
                .collect();
            println!("{}", row(name, &chains));
        }
    }
}
