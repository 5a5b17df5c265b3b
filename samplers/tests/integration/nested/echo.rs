//! What an echo of the seeds costs: bias and scatter of ln Z against the value of the gate, on exact targets.

use super::{sample, settings};
use crate::targets::hard;
use crate::targets::smooth;
use oblate_samplers::Target;
use oblate_samplers::nested::{Kernel, Settings};

#[test]
#[ignore = "a table of minutes: what the limit of the gate `seed-echo` rests on"]
fn bias_of_the_evidence_by_echo() {
    println!(
        "| target | kernel | live | slices | echo | jump | mean z | sd z |\n|---|---|---|---|---|---|---|---|"
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
        let (mut z, mut echo, mut jump) = (Vec::new(), 0.0, 0.0);
        for seed in 201..=230 {
            let run = sample(target, &settings, seed);
            z.push((run.evidence.ln_z - truth) / run.evidence.error);
            let gate = |name| run.gates.iter().find(|g| g.name == name).unwrap();
            echo += gate("seed-echo").value / 30.0;
            jump += gate("relative-jump").value / 30.0;
        }
        let mean = z.iter().sum::<f64>() / 30.0;
        let sd = (z.iter().map(|z| (z - mean).powi(2)).sum::<f64>() / 29.0).sqrt();
        println!(
            "| {name} | {kernel:?} | {n_live} | {steps} | {echo:.3} | {jump:.2} | {mean:+.2} | {sd:.2} |"
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
