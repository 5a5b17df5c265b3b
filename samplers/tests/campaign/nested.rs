//! Nested sampling: every kernel on the targets that it is for.

use crate::table::{Case, Column, Table, hard as case};
use crate::targets::{hard, smooth};
use oblate_samplers::control::{Control, Silent};
use oblate_samplers::nested::{Kernel, Settings, run};
use oblate_samplers::output::Status;
use oblate_samplers::{Run, Target};

/// Correlation of the likelihood ranks of new points with those of their seeds; 0 for a kernel without seeds.
const SEED_CORRELATION: Column = ("seed_correlation", |run| {
    let check = run
        .checks
        .iter()
        .find(|g| g.name == "seed-rank-correlation");
    check.map_or(0.0, |g| g.value)
});

fn sample(target: &dyn Target, settings: &Settings, seed: u64) -> Run {
    run(target, settings, seed, &mut Control::new(&mut Silent)).unwrap()
}

fn kernel(kernel: Kernel, n_live: usize) -> Settings {
    Settings {
        kernel,
        n_live,
        ..Settings::default()
    }
}

/// "random-slice, 400 live, 8 steps".
fn how(settings: &Settings, dim: usize) -> String {
    let steps = settings.steps.unwrap_or(settings.kernel.default_steps(dim));
    let steps = match settings.kernel {
        Kernel::Uniform => String::new(),
        _ => format!(", {steps} steps"),
    };
    format!("{:?}, {} live{steps}", settings.kernel, settings.n_live)
}

/// Prints the rows and holds them to limits that follow from thirty unit normals alone: |mean z| < 0.548, three errors of their mean,
/// and sd z from 0.615 to 1.418, 99.8 % of their scatter (chi with 29 degrees of freedom).
fn judge(cases: Vec<(Case, Settings)>) {
    let mut table = Table::new(&[SEED_CORRELATION]);
    for (case, settings) in cases {
        let how = how(&settings, case.dim());
        table.row(&case, &how, |target, seed| sample(target, &settings, seed));
    }
    table.judge();
}

/// Plateaus, rejected regions, many peaks and bent valleys, in few dimensions.
#[test]
#[ignore = "minutes: before a release"]
fn independent_draws() {
    let cases = [
        case("power", hard::power()),
        case("quarter", hard::quarter()),
        smooth::gauss3().into(),
        case("eggbox", hard::eggbox()),
        case("rosen", hard::rosen()),
        case("rosen wide", hard::rosen_wide()),
        case("rosen-half", hard::rosen_half()),
        case("rosen-half wide", hard::rosen_half_wide()),
        case("cake", hard::cake(2)),
        case("cake", hard::cake(5)),
    ];
    judge(
        cases
            .map(|case| (case, kernel(Kernel::Uniform, 500)))
            .into(),
    );
}

/// Thin shells, tails, correlations and separate modes, up to thirty dimensions.
fn chains(of: Kernel) {
    let cases = [
        smooth::shells(2).into(),
        smooth::shells(5).into(),
        smooth::shells(13).into(),
        smooth::shells(20).into(),
        case("log-gamma", hard::log_gamma(2)),
        case("log-gamma", hard::log_gamma(10)),
        smooth::mvn13().into(),
        smooth::far8().into(),
        smooth::twins13(0.5).into(),
        smooth::mvn30().into(),
    ];
    judge(cases.map(|case| (case, kernel(of, 400))).into());
}

#[test]
#[ignore = "minutes: before a release"]
fn random_slices() {
    chains(Kernel::RandomSlice);
}

#[test]
#[ignore = "minutes: before a release"]
fn differences() {
    chains(Kernel::Differential);
}

#[test]
#[ignore = "minutes: before a release"]
fn trajectories_along_a_surrogate() {
    chains(Kernel::Surrogate);
}

/// Likelihoods of which a surrogate can only learn a part.
#[test]
#[ignore = "minutes: before a release"]
fn trajectories_where_the_likelihood_is_rough() {
    let cases = [
        case("rough", hard::rough(5)),
        case("rough", hard::rough(13)),
    ];
    judge(
        cases
            .map(|case| (case, kernel(Kernel::Surrogate, 400)))
            .into(),
    );
}

#[test]
#[ignore = "minutes: before a release"]
fn random_walks() {
    chains(Kernel::RandomWalk);
}

/// The targets that have gradients.
#[test]
#[ignore = "minutes: before a release"]
fn reflected_galilean_trajectories() {
    let cases = [
        smooth::shells(2),
        smooth::shells(5),
        smooth::shells(13),
        smooth::mvn13(),
        smooth::far8(),
        smooth::twins13(0.5),
        smooth::mvn30(),
    ];
    judge(
        cases
            .map(|case| (case.into(), kernel(Kernel::Galilean, 400)))
            .into(),
    );
}

/// Live points added in the range of the posterior until there are 4,000 effective draws, and batches from the prior where draws of chains
/// resemble each other.
#[test]
#[ignore = "minutes: before a release"]
fn added_live_points() {
    const DRAWS: f64 = 4_000.0;
    let mut table = Table::new(&[SEED_CORRELATION]);
    for (of, case) in [
        (Kernel::Uniform, Case::from(smooth::gauss3())),
        (Kernel::RandomSlice, smooth::shells(5).into()),
        (Kernel::Differential, smooth::mvn13().into()),
    ] {
        let settings = Settings {
            target_ess: Some(DRAWS),
            max_batches: if of == Kernel::Uniform { 20 } else { 3 },
            ..kernel(of, 300)
        };
        let how = format!("{}, dynamic", how(&settings, case.dim()));
        table.row(&case, &how, |target, seed| {
            let run = sample(target, &settings, seed);
            assert_eq!(run.status, Status::Complete);
            let enough = of != Kernel::Uniform || run.ess.quoted >= DRAWS;
            assert!(enough, "seed {seed}: {}", run.ess.quoted);
            run
        });
    }
    table.judge();
}
