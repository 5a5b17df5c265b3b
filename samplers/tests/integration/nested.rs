//! Nested sampling against exact evidences and posteriors.

use crate::targets::hard::{self, Hard};
use oblate_samplers::control::{Control, Silent};
use oblate_samplers::nested::{Kernel, Settings, run};
use oblate_samplers::{Run, Target};

fn settings(n_live: usize, kernel: Kernel) -> Settings {
    Settings {
        n_live,
        kernel,
        simulations: 200,
        ..Settings::default()
    }
}

fn sample(target: &dyn Target, settings: &Settings, seed: u64) -> Run {
    run(target, settings, seed, &mut Control::new(&mut Silent)).unwrap()
}

/// Five seeds: every ln Z within four of its own errors, and their mean within four of the error of a mean of five.
fn agrees(name: &str, target: &dyn Target, truth: f64, settings: &Settings) {
    let z: Vec<f64> = (1..=5)
        .map(|seed| {
            let run = sample(target, settings, seed);
            let z = (run.evidence.ln_z - truth) / run.evidence.error;
            println!(
                "{name} seed {seed}: ln Z {:.4} +- {:.4} {:?} (truth {truth:.4}, z {z:.2}), {} calls, {:.2} s, H {:.2} ess {:.0} of {:?} failing {:?} {:?}",
                run.evidence.ln_z, run.evidence.error, run.evidence.error_parts, run.cost.calls,
                run.cost.cpu_seconds, run.evidence.information, run.ess.quoted, run.ess.kish,
                run.gates.iter().filter(|g| !g.pass).map(|g| (&g.name, g.value)).collect::<Vec<_>>(), run.warnings
            );
            z
        })
        .collect();
    assert!(z.iter().all(|z| z.abs() < 4.0), "{name}: {z:?}");
    let mean = z.iter().sum::<f64>() / 5.0;
    assert!(mean.abs() < 4.0 / 5.0_f64.sqrt(), "{name}: {z:?}");
}

fn uniform(name: &str, target: &Hard) {
    agrees(name, target, target.ln_z, &settings(500, Kernel::Uniform));
}

#[test]
fn constant_likelihood_has_evidence_one() {
    let run = sample(&hard::constant(3), &settings(50, Kernel::Uniform), 1);
    assert!(run.evidence.ln_z.abs() < 1e-12 && run.evidence.information.abs() < 1e-12);
}

#[test]
fn power_has_its_evidence() {
    uniform("power", &hard::power());
}

#[test]
fn quarter_has_its_evidence() {
    uniform("quarter", &hard::quarter());
}

#[test]
fn eggbox_has_its_evidence() {
    uniform("eggbox", &hard::eggbox());
}

#[test]
fn rosen_has_its_evidence() {
    uniform("rosen", &hard::rosen());
    uniform("rosen wide", &hard::rosen_wide());
    uniform("rosen half", &hard::rosen_half());
    uniform("rosen half wide", &hard::rosen_half_wide());
}

#[test]
fn cake_has_its_evidence() {
    uniform("cake 2", &hard::cake(2));
    uniform("cake 5", &hard::cake(5));
}

#[test]
fn log_gamma_has_its_evidence() {
    for dim in [2, 10] {
        let target = hard::log_gamma(dim);
        agrees(
            &format!("log-gamma {dim}"),
            &target,
            target.ln_z,
            &settings(500, Kernel::RandomSlice),
        );
    }
}
