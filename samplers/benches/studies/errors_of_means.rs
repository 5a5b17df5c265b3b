//! Errors of posterior means, and so of mode weights: differences from the exact means in the quoted errors.
//!
//! `cargo bench -p oblate-samplers --bench errors_of_means` samples four targets with thirty seeds each, static and dynamic, by slice
//! updates along differences and along random directions. Some ten minutes of a core; the recorded table is in docs/targets.md.

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
    println!(
        "| target | kernel | batches | mean z, sd z of ln Z | mean z, sd z of x1 | Kish | true draws of x1 | lineages |\n|---|---|---|---|---|---|---|---|"
    );
    for (name, target, variance) in [
        ("mvn13", smooth::mvn13(), None),
        // Modes at +- 1.5; shells of radius 2 about +- 3.5.
        ("twins13", smooth::twins13(0.5), Some(1.5_f64.powi(2))),
        ("shells5", smooth::shells(5), Some(3.5_f64.powi(2) + 0.8)),
        ("shells13", smooth::shells(13), Some(3.5_f64.powi(2) + 0.3)),
    ] {
        for kernel in [Kernel::Differential, Kernel::RandomSlice] {
            for max_batches in [1, 4] {
                let settings = Settings {
                    // More than there will be.
                    target_ess: Some(1e6),
                    max_batches,
                    ..settings(300, kernel)
                };
                let (mut ln_z, mut x1, mut square) = (Vec::new(), Vec::new(), 0.0);
                let (mut kish, mut left) = (0.0, 0.0);
                for seed in 301..=330 {
                    let run = sample(&target, &settings, seed);
                    ln_z.push(pull(&run, target.ln_z));
                    let (weights, column) = (run.draws.weights(), run.draws.column(0));
                    let rows = || column.iter().zip(&weights);
                    // By symmetry, or because the Gaussian is about 0, the mean is 0.
                    let mean: f64 = rows().map(|(x, w)| w * x).sum();
                    let own: f64 = rows().map(|(x, w)| w * (x - mean).powi(2)).sum();
                    x1.push(mean / (own / run.ess.bulk[0]).sqrt());
                    square += mean * mean / variance.unwrap_or(own) / 30.0;
                    kish += run.ess.kish / 30.0;
                    let check = run.checks.iter().find(|g| g.name == "effective-lineages");
                    left += check.unwrap().value / 30.0;
                }
                let ((z, z_sd), (x, x_sd)) = (scatter(&ln_z), scatter(&x1));
                println!(
                    "| {name} | {kernel:?} | {max_batches} | {z:+.2}, {z_sd:.2} | {x:+.2}, {x_sd:.2} | {kish:.0} | {:.0} | {left:.1} |",
                    1.0 / square
                );
            }
        }
    }
}
