//! A row of thirty runs of one target, and the limits that rows must meet.

use crate::pulls::{pull, scatter};
use crate::targets::hard::Hard;
use crate::targets::smooth::Smooth;
use oblate_samplers::{Run, Target};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::ops::RangeInclusive;

const SEEDS: RangeInclusive<u64> = 101..=130;

/// Three errors of a mean of thirty, `3 / sqrt(30)`.
const MAX_MEAN: f64 = 0.548;

/// The scatter of thirty unit normals, chi with 29 degrees of freedom: 99.8 % lie between.
const MIN_SD: f64 = 0.615;
const MAX_SD: f64 = 1.418;

/// A target and its exact ln Z.
pub struct Case {
    name: String,
    target: Box<dyn Target>,
    ln_z: f64,
    /// Posterior probability of a positive first parameter, of targets with two modes.
    right: Option<f64>,
}

impl From<Smooth> for Case {
    fn from(target: Smooth) -> Self {
        Self {
            name: target.name.to_owned(),
            ln_z: target.ln_z,
            right: target.right(),
            target: Box::new(target),
        }
    }
}

impl Case {
    /// The same under another name.
    pub fn called(mut self, name: &str) -> Self {
        name.clone_into(&mut self.name);
        self
    }

    pub fn dim(&self) -> usize {
        self.target.dim()
    }
}

/// Such a target has no name of its own.
pub fn hard(name: &str, target: Hard) -> Case {
    Case {
        name: name.to_owned(),
        ln_z: target.ln_z,
        right: None,
        target: Box::new(target),
    }
}

/// A column of means over the seeds.
pub type Column = (&'static str, fn(&Run) -> f64);

/// Rows so far, and their faults.
pub struct Table {
    columns: Vec<Column>,
    wrong: Vec<String>,
    /// z of the runs that failed a check, by its name, and of those that passed all.
    by_check: BTreeMap<String, Vec<f64>>,
}

impl Table {
    /// Prints its head: columns that all tables have, and its own.
    pub fn new(own: &[Column]) -> Self {
        let mut columns: Vec<Column> = vec![
            ("error", |run| run.evidence.error),
            ("calls", |run| run.cost.calls as f64),
            ("ESS", |run| run.ess.quoted),
            ("Kish", |run| run.ess.kish),
        ];
        columns.extend(own);
        let names: Vec<&str> = columns.iter().map(|c| c.0).collect();
        println!(
            "\n| target | d | how | mean z | sd z | mode: mean z | sd z | {} | checks failed |\n|{}",
            names.join(" | "),
            "---|".repeat(8 + names.len())
        );
        Self {
            columns,
            wrong: Vec::new(),
            by_check: BTreeMap::new(),
        }
    }

    /// Runs all seeds and prints their row.
    pub fn row(&mut self, case: &Case, how: &str, run: impl Fn(&dyn Target, u64) -> Run + Sync) {
        let seeds: Vec<u64> = SEEDS.collect();
        let runs: Vec<Run> = seeds.par_iter().map(|&s| run(&*case.target, s)).collect();
        let z: Vec<f64> = runs.iter().map(|run| pull(run, case.ln_z)).collect();
        let (mean, sd) = scatter(&z);
        for (run, z) in runs.iter().zip(&z) {
            let failed: Vec<&str> = failed(run).collect();
            let names = if failed.is_empty() {
                vec!["none"]
            } else {
                failed
            };
            for name in names {
                self.by_check.entry(name.to_owned()).or_default().push(*z);
            }
        }
        let mode = case.right.map(|right| {
            let z: Vec<f64> = runs.iter().map(|run| pull_of_mode(run, right)).collect();
            scatter(&z)
        });
        let of_mode = match mode {
            Some((mean, sd)) => format!("{mean:+.2} | {sd:.2}"),
            None => "| ".to_owned(),
        };
        let means: Vec<String> = self
            .columns
            .iter()
            .map(|(_, of)| figures(runs.iter().map(of).sum::<f64>() / runs.len() as f64))
            .collect();
        println!(
            "| {} | {} | {how} | {mean:+.2} | {sd:.2} | {of_mode} | {} | {} |",
            case.name,
            case.target.dim(),
            means.join(" | "),
            failures(&runs)
        );
        // A NaN is a fault as well.
        if !(mean.abs() < MAX_MEAN && (MIN_SD..=MAX_SD).contains(&sd)) {
            self.wrong
                .push(format!("{} {how}: {mean:+.3} {sd:.3}", case.name));
        }
        // An error that is too large is no fault here: there are few independent draws of a mode.
        if mode.is_some_and(|(mean, sd)| !(mean.abs() < MAX_MEAN && sd <= MAX_SD)) {
            self.wrong
                .push(format!("{} {how}, weight of a mode: {of_mode}", case.name));
        }
    }

    /// Prints the mean and the rms of z of the runs that failed each check.
    ///
    /// # Panics
    /// If a row was outside its limits.
    pub fn judge(self) {
        println!("\n| check failed | runs | mean z | rms z |\n|---|---|---|---|");
        for (check, z) in &self.by_check {
            let count = z.len() as f64;
            let mean = z.iter().sum::<f64>() / count;
            let rms = (z.iter().map(|z| z * z).sum::<f64>() / count).sqrt();
            println!("| {check} | {} | {mean:+.2} | {rms:.2} |", z.len());
        }
        assert!(self.wrong.is_empty(), "{:#?}", self.wrong);
    }
}

/// (weight of the mode on the right - truth) / its error, from the effective sample size of its indicator.
fn pull_of_mode(run: &Run, truth: f64) -> f64 {
    let first = run.draws.column(0).into_iter();
    let inside: Vec<f64> = first.map(|x| f64::from(u8::from(x > 0.0))).collect();
    let weights = run.draws.weights();
    let weight: f64 = inside.iter().zip(&weights).map(|(i, w)| i * w).sum();
    (weight - truth) / (truth * (1.0 - truth) / run.draws.ess_of_mean(&inside)).sqrt()
}

fn figures(value: f64) -> String {
    if value.abs() < 10.0 {
        format!("{value:.3}")
    } else {
        format!("{value:.0}")
    }
}

/// Checks that a run failed.
fn failed(run: &Run) -> impl Iterator<Item = &str> {
    let checks = run.checks.iter().filter(|g| !g.pass);
    checks.map(|g| g.name.as_str())
}

/// Checks that failed, and in how many runs.
fn failures(runs: &[Run]) -> String {
    let mut counts = BTreeMap::new();
    for check in runs.iter().flat_map(failed) {
        *counts.entry(check).or_insert(0) += 1;
    }
    let told: Vec<String> = counts.iter().map(|(n, c)| format!("{n} {c}")).collect();
    told.join(", ")
}
