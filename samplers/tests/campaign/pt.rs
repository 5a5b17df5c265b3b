//! Parallel tempering: how often the quoted error, the larger of those from chain sets and from scans, covers the
//! truth.

use crate::table::{Case, Column, Table};
use crate::targets::smooth;
use oblate_samplers::control::{Control, Silent};
use oblate_samplers::pt::{self, Settings};

const COLUMNS: [Column; 2] = [
    ("gradients", |run| run.cost.gradients as f64),
    ("forward - backward", |run| {
        (run.evidence.estimates["forward"] - run.evidence.estimates["backward"]).abs()
    }),
];

/// Runs thirty seeds of each target, prints the table and holds it to its limits.
fn judge(cases: &[Case], how: &str, settings: &Settings) {
    let mut table = Table::new(&COLUMNS);
    for case in cases {
        table.row(case, how, |target, seed| {
            pt::run(target, settings, seed, &mut Control::new(&mut Silent)).unwrap()
        });
    }
    table.judge();
}

/// Holds thirty seeds of each target to limits that follow from thirty unit normals alone: |mean z| < 0.548, three errors of their
/// mean, and sd z from 0.615 to 1.418, 99.8 % of their scatter (chi with 29 degrees of freedom).
#[test]
#[ignore = "minutes: before a release"]
fn chain_sets() {
    let cases: [Case; 11] = [
        smooth::iso(2).into(),
        smooth::iso(13).into(),
        smooth::mvn13().into(),
        smooth::stiff13().into(),
        smooth::binomial().into(),
        smooth::gauss3().into(),
        smooth::far8().into(),
        smooth::shells(2).into(),
        smooth::shells(5).into(),
        smooth::twins13(0.5).into(),
        Case::from(smooth::twins13(0.9)).called("twins13, 9 to 1"),
    ];
    let settings = Settings::default();
    let how = format!(
        "{} chain sets, {} rounds",
        settings.chain_sets, settings.rounds
    );
    judge(&cases, &how, &settings);
}

/// The same limits for paths from a mixture fitted to SMC particles, whose last round is extended until the checks
/// pass, as in the fit of a stream.
#[test]
#[ignore = "minutes: before a release"]
fn paths_from_mixtures() {
    let cases: [Case; 7] = [
        smooth::mvn13().into(),
        smooth::stiff13().into(),
        smooth::far8().into(),
        smooth::shells(2).into(),
        smooth::shells(5).into(),
        smooth::twins13(0.5).into(),
        Case::from(smooth::twins13(0.9)).called("twins13, 9 to 1"),
    ];
    let settings = Settings {
        smc_particles: 96,
        slice_updates: 4,
        max_leapfrogs: 1,
        target_acceptance: 0.6,
        first_scans: 128,
        rounds: 3,
        mixture_rounds: 3,
        extensions: 7,
        ..Settings::default()
    };
    let how = "from mixtures of 384 SMC particles, 3 rounds, going on";
    judge(&cases, how, &settings);
}

/// Along a surrogate, from references that it screens, with the defaults of the fit of a stream before checkpoint format 30.
#[test]
#[ignore = "an hour: before a release"]
fn paths_along_a_surrogate() {
    let cases: [Case; 5] = [
        smooth::stiff13().into(),
        smooth::far8().into(),
        smooth::shells(5).into(),
        Case::from(smooth::twins13(0.9)).called("twins13, 9 to 1"),
        smooth::emerging13().into(),
    ];
    let settings = Settings {
        smc_particles: 800,
        mcmc_steps: 2,
        slice_updates: 1,
        hmc_transitions: 0,
        surrogate: true,
        target_acceptance: 0.8,
        min_temperatures: 4,
        first_scans: 32,
        rounds: 4,
        mixture_rounds: 4,
        extensions: 13,
        ..Settings::default()
    };
    let how = "along a surrogate, 3,200 SMC particles, 4 rounds, going on";
    judge(&cases, how, &settings);
}
