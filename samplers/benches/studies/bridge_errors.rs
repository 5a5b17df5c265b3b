//! Errors of bridges from a coarse likelihood to a fine one of known evidence.
//!
//! `cargo bench -p oblate-samplers --bench bridge_errors` makes thirty nested runs on each of three coarse likelihoods and continues
//! them. Two minutes of a core; the recorded table is in docs/targets.md.

#[path = "../../tests/integration/pulls.rs"]
mod pulls;
#[allow(dead_code, reason = "some targets belong to tests")]
#[path = "../../tests/integration/targets/mod.rs"]
mod targets;

use oblate_samplers::control::{Control, Silent};
use oblate_samplers::output::History;
use oblate_samplers::{Run, Target, bridge, nested};
use pulls::{pull, scatter};
use targets::bell::Bell;
use targets::smooth;

/// A nested run on the coarse likelihood, continued to the fine one.
fn sample(fine: &dyn Target, coarse: &dyn Target, seed: u64) -> Run {
    let settings = nested::Settings {
        n_live: 400,
        simulations: 100,
        ..nested::Settings::default()
    };
    let mut silent = Silent;
    let mut control = Control::new(&mut silent);
    let parent = nested::run(coarse, &settings, seed, &mut control).expect("a run");
    let settings = bridge::Settings::default();
    bridge::run(fine, coarse, &parent, &settings, seed, &mut control).expect("a bridge")
}

fn main() {
    println!(
        "| coarse and fine | mean z, sd z | error | ancestors | correlation |\n|---|---|---|---|---|"
    );
    let bells = [3.0, 10.0].map(|factor| {
        (
            Bell::new(13, 10.0, 0.8),
            Bell::new(13, 10.0 * factor, 1.0),
            format!("Gaussians of 13 d, precision 10 and {}", 10.0 * factor),
        )
    });
    for (coarse, fine, name) in &bells {
        row(name, coarse, fine, fine.ln_z());
    }
    let (coarse, fine) = (smooth::twins13(0.5), smooth::twins13(0.9));
    row(
        "two narrow modes, of weights 1/2 and 9/10",
        &coarse,
        &fine,
        fine.ln_z,
    );
}

fn row(name: &str, coarse: &dyn Target, fine: &dyn Target, truth: f64) {
    let runs: Vec<Run> = (1..=30).map(|seed| sample(fine, coarse, seed)).collect();
    let pulls: Vec<f64> = runs.iter().map(|run| pull(run, truth)).collect();
    let (mean, sd) = scatter(&pulls);
    let of = |value: &dyn Fn(&Run) -> f64| scatter(&runs.iter().map(value).collect::<Vec<_>>()).0;
    let correlation = |run: &Run| match &run.history {
        History::Bridge { correlation, .. } => correlation.iter().copied().fold(0.0, f64::max),
        other => panic!("{other:?}"),
    };
    println!(
        "| {name} | {mean:+.2}, {sd:.2} | {:.3} | {:.0} | {:.2} |",
        of(&|run| run.evidence.error),
        of(&|run| run.ess.kish),
        of(&correlation),
    );
}
