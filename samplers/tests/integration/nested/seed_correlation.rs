//! What an rank correlation of the seeds costs: bias and scatter of ln Z against the value of the check, on exact targets.

use super::{sample, settings};
use crate::pulls::{pull, scatter};
use crate::targets::hard;
use crate::targets::smooth;
use oblate_samplers::Target;
use oblate_samplers::nested::{Kernel, Settings};

#[test]
#[ignore = "a table of minutes: what the limit of the check `seed-rank-correlation` rests on"]
fn bias_of_the_evidence_by_seed_correlation() {
    println!(
        "| target | kernel | live | slices | rank correlation | jump | mean z | sd z |\n|---|---|---|---|---|---|---|---|"
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
        let (mut z, mut seed_correlation, mut involution) = (Vec::new(), 0.0, 0.0);
        for seed in 201..=230 {
            let run = sample(target, &settings, seed);
            z.push(pull(&run, truth));
            let check = |name| run.checks.iter().find(|g| g.name == name).unwrap();
            seed_correlation += check("seed-rank-correlation").value / 30.0;
            involution += check("relative-jump-distance").value / 30.0;
        }
        let (mean, sd) = scatter(&z);
        println!(
            "| {name} | {kernel:?} | {n_live} | {steps} | {seed_correlation:.3} | {involution:.2} | {mean:+.2} | {sd:.2} |"
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

#[test]
#[ignore = "a table of minutes: whether the errors of means, and so of modes' weights, hold"]
fn errors_of_means() {
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
            for target_ess in [None, Some(6_000.0)] {
                let settings = Settings {
                    target_ess,
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
                    let check = run.checks.iter().find(|g| g.name == "lineages-left");
                    left += check.unwrap().value / 30.0;
                }
                let ((z, z_sd), (x, x_sd)) = (scatter(&ln_z), scatter(&x1));
                let batches = target_ess.map_or("static", |_| "dynamic");
                println!(
                    "| {name} | {kernel:?} | {batches} | {z:+.2}, {z_sd:.2} | {x:+.2}, {x_sd:.2} | {kish:.0} | {:.0} | {left:.1} |",
                    1.0 / square
                );
            }
        }
    }
}

#[test]
#[ignore = "a table of minutes: what values and gradients bring, kernel by kernel, at the same rank correlation"]
fn cost_of_a_draw_by_seed_correlation() {
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
