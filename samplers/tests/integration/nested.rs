//! Nested sampling against exact evidences and posteriors.

use crate::targets::hard::{self, Hard};
use crate::targets::smooth::{self, Smooth};
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

fn smooth(target: &Smooth, n_live: usize, kernel: Kernel) {
    agrees(
        &format!("{} {} {kernel:?}", target.name, target.dim()),
        target,
        target.ln_z,
        &settings(n_live, kernel),
    );
}

#[test]
fn gauss3_has_its_evidence() {
    smooth(&smooth::gauss3(), 500, Kernel::Uniform);
}

#[test]
fn shells_have_their_evidence() {
    smooth(&smooth::shells(2), 500, Kernel::RandomSlice);
    smooth(&smooth::shells(5), 500, Kernel::RandomSlice);
    smooth(&smooth::shells(13), 200, Kernel::RandomSlice);
}

#[test]
fn mvn13_has_its_evidence() {
    smooth(&smooth::mvn13(), 200, Kernel::RandomSlice);
}

#[test]
fn far8_has_its_evidence() {
    smooth(&smooth::far8(), 500, Kernel::RandomSlice);
}

#[test]
fn random_walks_find_the_same_evidences() {
    smooth(&smooth::shells(5), 500, Kernel::RandomWalk);
    smooth(&smooth::mvn13(), 200, Kernel::RandomWalk);
    smooth(&smooth::far8(), 500, Kernel::RandomWalk);
}

#[test]
fn walls_of_the_prior_are_kept() {
    smooth(&smooth::wall2(), 500, Kernel::Uniform);
    smooth(&smooth::wall2_as_reject(), 500, Kernel::Uniform);
}

#[test]
#[ignore = "long"]
fn thirty() {
    let show = |name: &str, target: &dyn Target, truth: f64, settings: &Settings| {
        let z: Vec<f64> = (101..=130)
            .map(|seed| {
                let run = sample(target, settings, seed);
                (run.evidence.ln_z - truth) / run.evidence.error
            })
            .collect();
        let mean = z.iter().sum::<f64>() / 30.0;
        let sd = (z.iter().map(|z| (z - mean).powi(2)).sum::<f64>() / 29.0).sqrt();
        println!("{name}: mean z {mean:.3} sd {sd:.3}");
    };
    let u = settings(500, Kernel::Uniform);
    let cube = Settings {
        bound: oblate_samplers::nested::BoundKind::Cube,
        ..settings(200, Kernel::Uniform)
    };
    let g = smooth::gauss3();
    if std::env::var("ALL").is_ok() {
        show("iso2 cube", &smooth::iso(2), smooth::iso(2).ln_z, &cube);
        show("gauss3", &g, g.ln_z, &u);
    }
    for t in [
        hard::rosen(),
        hard::rosen_wide(),
        hard::rosen_half(),
        hard::eggbox(),
        hard::power(),
        hard::cake(2),
        hard::cake(5),
    ] {
        show("hard", &t, t.ln_z, &u);
        if std::env::var("ALL").is_err() {
            break;
        }
    }
    for k in [Kernel::RandomSlice, Kernel::RandomWalk] {
        for t in [
            smooth::shells(2),
            smooth::shells(5),
            smooth::mvn13(),
            smooth::far8(),
            smooth::shells(13),
        ] {
            show(
                &format!("{} {} {k:?}", t.name, t.dim()),
                &t,
                t.ln_z,
                &settings(200, k),
            );
        }
        for d in [2, 10] {
            let t = hard::log_gamma(d);
            show(
                &format!("loggamma {d} {k:?}"),
                &t,
                t.ln_z,
                &settings(200, k),
            );
        }
    }
}
