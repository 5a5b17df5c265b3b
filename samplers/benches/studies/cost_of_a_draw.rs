//! Likelihood calls and gradients per draw, kernel by kernel.
//!
//! `cargo bench -p oblate-samplers --bench cost_of_a_draw` prints two tables: by kernel and number of steps, to be compared at equal
//! rank correlation of new points with their seeds; and of dynamic runs to 20,000 draws. Some minutes of a core; the recorded tables are
//! in docs/targets.md.

#[path = "../../tests/integration/pulls.rs"]
mod pulls;
#[allow(dead_code, reason = "some targets belong to tests")]
#[path = "../../tests/integration/targets/mod.rs"]
mod targets;

use oblate_samplers::control::{Control, Silent};
use oblate_samplers::nested::{self, Kernel, Settings};
use oblate_samplers::{Run, Target};
use pulls::{pull, scatter};
use targets::smooth;

fn settings(n_live: usize, kernel: Kernel) -> Settings {
    Settings {
        n_live,
        kernel,
        simulations: 200,
        ..Settings::default()
    }
}

fn sample(target: &dyn Target, settings: &Settings, seed: u64) -> Run {
    let run = nested::run(target, settings, seed, &mut Control::new(&mut Silent));
    run.expect("targets that never fail")
}

fn main() {
    by_kernel();
    to_many_draws();
}

/// Values and gradients, kernel by kernel.
fn by_kernel() {
    println!(
        "| target | kernel | steps | rank correlation | jump | mean z | sd z | calls / Kish | gradients / Kish |\n|---|---|---|---|---|---|---|---|---|"
    );
    let seeds = 10;
    for target in [smooth::mvn13(), smooth::shells(13)] {
        for (kernel, all_steps) in [
            (Kernel::RandomSlice, [4, 6, 8]),
            (Kernel::Differential, [4, 6, 8]),
            (Kernel::Galilean, [3, 4, 6]),
        ] {
            for steps in all_steps {
                let settings = Settings {
                    steps: Some(steps),
                    ..settings(300, kernel)
                };
                let runs: Vec<[f64; 5]> = (301..301 + seeds)
                    .map(|seed| {
                        let run = sample(&target, &settings, seed);
                        let check =
                            |name| run.checks.iter().find(|g| g.name == name).unwrap().value;
                        [
                            pull(&run, target.ln_z),
                            check("seed-rank-correlation"),
                            check("relative-jump-distance"),
                            run.cost.calls as f64 / run.ess.kish,
                            run.cost.gradients as f64 / run.ess.kish,
                        ]
                    })
                    .collect();
                let mean = |k: usize| runs.iter().map(|r| r[k]).sum::<f64>() / seeds as f64;
                let (_, scatter) = scatter(&runs.iter().map(|r| r[0]).collect::<Vec<_>>());
                println!(
                    "| {} | {kernel:?} | {steps} | {:.3} | {:.2} | {:+.2} | {:.2} | {:.1} | {:.1} |",
                    target.name,
                    mean(1),
                    mean(2),
                    mean(0),
                    scatter,
                    mean(3),
                    mean(4)
                );
            }
        }
    }
}

/// Runs of nine batches.
fn to_many_draws() {
    println!(
        "| target | kernel | ln Z - truth | error | calls | Kish | quoted | calls / Kish | failed checks |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    for (name, target) in [("mvn13", smooth::mvn13()), ("shells13", smooth::shells(13))] {
        for kernel in [
            Kernel::RandomSlice,
            Kernel::Differential,
            Kernel::RandomWalk,
        ] {
            let settings = Settings {
                // More than there will be.
                target_ess: Some(1e6),
                max_batches: 9,
                ..settings(500, kernel)
            };
            let run = sample(&target, &settings, 1);
            let failed: Vec<&str> = run
                .checks
                .iter()
                .filter(|g| !g.pass)
                .map(|g| g.name.as_str())
                .collect();
            println!(
                "| {name} | {kernel:?} | {:+.3} | {:.3} | {} | {:.0} | {:.0} | {:.1} | {} |",
                run.evidence.ln_z - target.ln_z,
                run.evidence.error,
                run.cost.calls,
                run.ess.kish,
                run.ess.quoted,
                run.cost.calls as f64 / run.ess.kish,
                failed.join(", ")
            );
        }
    }
}
