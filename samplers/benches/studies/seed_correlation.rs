//! Bias and standard deviation of ln Z in its errors, against the rank correlation of new points with their seeds: on which the limit
//! of the check `seed-rank-correlation` rests.
//!
//! `cargo bench -p oblate-samplers --bench seed_correlation` samples four targets of known evidence with thirty seeds each, by slice
//! updates along differences and along random directions, with 2 to 16 steps per point. Some ten minutes of a core.

#[path = "../../tests/integration/pulls.rs"]
mod pulls;
#[allow(dead_code, reason = "some targets belong to tests")]
#[path = "../../tests/integration/targets/mod.rs"]
mod targets;

use oblate_samplers::control::{Control, Silent};
use oblate_samplers::nested::{self, Kernel, Settings};
use oblate_samplers::{Run, Target};
use pulls::{pull, scatter};
use targets::{hard, smooth};

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
    println!(
        "| target | kernel | live | steps | rank correlation | jump | mean z | sd z |\n|---|---|---|---|---|---|---|---|"
    );
    let row = |name: &str,
               target: &dyn Target,
               truth: f64,
               kernel: Kernel,
               n_live: usize,
               steps: usize| {
        let settings = Settings {
            steps: Some(steps),
            ..settings(n_live, kernel)
        };
        let (mut z, mut seed_correlation, mut jump) = (Vec::new(), 0.0, 0.0);
        for seed in 201..=230 {
            let run = sample(target, &settings, seed);
            z.push(pull(&run, truth));
            let check = |name| run.checks.iter().find(|g| g.name == name).unwrap();
            seed_correlation += check("seed-rank-correlation").value / 30.0;
            jump += check("relative-jump-distance").value / 30.0;
        }
        let (mean, sd) = scatter(&z);
        println!(
            "| {name} | {kernel:?} | {n_live} | {steps} | {seed_correlation:.3} | {jump:.2} | {mean:+.2} | {sd:.2} |"
        );
    };
    for kernel in [Kernel::Differential, Kernel::RandomSlice] {
        for steps in [2, 4, 8, 16] {
            let t = smooth::mvn13();
            row("mvn13", &t, t.ln_z, kernel, 300, steps);
            let t = smooth::shells(13);
            row("shells13", &t, t.ln_z, kernel, 300, steps);
            let t = smooth::twins13(0.5);
            row("twins13", &t, t.ln_z, kernel, 300, steps);
            let t = hard::log_gamma(10);
            row("log-gamma10", &t, t.ln_z, kernel, 300, steps);
        }
        let t = smooth::mvn13();
        for n_live in [75, 1200] {
            row("mvn13", &t, t.ln_z, kernel, n_live, 4);
        }
    }
}
