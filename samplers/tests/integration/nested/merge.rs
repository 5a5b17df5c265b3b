//! Merged runs.

use super::{sample, settings};
use crate::targets::{hard, smooth};
use oblate_samplers::nested::{Kernel, merge};
use oblate_samplers::output::{History, Method};
use oblate_samplers::{Error, Run, Target};

fn runs(target: &dyn Target, n_live: usize, seeds: std::ops::RangeInclusive<u64>) -> Vec<Run> {
    seeds
        .map(|seed| sample(target, &settings(n_live, Kernel::Uniform), seed))
        .collect()
}

fn merged(target: &dyn Target, runs: &[Run]) -> Run {
    merge(target, &runs.iter().collect::<Vec<_>>()).unwrap()
}

#[test]
fn runs_of_four_seeds_weigh_as_one_of_four_times_the_live_points() {
    let target = hard::quarter();
    let parts = runs(&target, 200, 1..=4);
    let whole = merged(&target, &parts);
    assert!(whole.converged(), "{:#?}", whole.checks);
    let (evidence, part) = (&whole.evidence, &parts[0].evidence);
    // A fixed seed: four errors are one in 15,000.
    assert!((evidence.ln_z - target.ln_z).abs() < 4.0 * evidence.error);
    // The error of an error by 20 lineages of one run is a sixth of it.
    let simulated = |e: &oblate_samplers::output::Evidence| e.error_parts["simulated"];
    let ratio = simulated(evidence) / simulated(part);
    assert!((0.4..0.6).contains(&ratio), "{ratio}");
    let sum = |of: fn(&Run) -> f64| parts.iter().map(of).sum::<f64>();
    assert!((whole.ess.kish / sum(|r| r.ess.kish) - 1.0).abs() < 0.05);
    assert_eq!(
        whole.draws.len(),
        parts.iter().map(|r| r.draws.len()).sum::<usize>()
    );
    let calls: u64 = parts.iter().map(|r| r.cost.calls).sum();
    assert_eq!(whole.cost.calls, calls);
    let History::Nested { live, .. } = &whole.history else {
        panic!("a nested run")
    };
    let History::Nested { live: one, .. } = &parts[0].history else {
        panic!("a nested run")
    };
    // Rejected points are drawn until there are 200 others, so that each begins with about 800.
    assert!(live[0] > 3 * one[0] && live[0] < 5 * one[0]);
    // Lineages of one run are not those of another, and stay in their half.
    let groups = whole.draws.clusters();
    assert_eq!(groups.iter().filter(|g| !g.is_empty()).count(), 160);
}

#[test]
fn a_mode_that_one_run_missed_fails_the_merged_run() {
    let target = smooth::shells(2);
    let mut parts = runs(&target, 200, 1..=3);
    let verdict = |parts: &[Run]| -> Vec<bool> {
        let whole = merged(&target, parts);
        let seeds = whole
            .checks
            .iter()
            .filter(|g| g.name.ends_with("-of-seeds"));
        seeds.map(|g| g.pass).collect()
    };
    assert_eq!(verdict(&parts), [true, true]);
    // As if it had found the right-hand shell alone.
    let draws = &mut parts[2].draws;
    for row in 0..draws.len() {
        if draws.theta_row(row)[0] < 0.0 {
            draws.ln_weight[row] = f64::NEG_INFINITY;
        }
    }
    let ln_sum = draws.weights().iter().sum::<f64>().ln();
    draws.ln_weight.iter_mut().for_each(|w| *w -= ln_sum);
    assert_eq!(verdict(&parts), [true, false]);
    parts[2].evidence.ln_z -= 5.0 * parts[2].evidence.error;
    assert_eq!(verdict(&parts), [false, false]);
}

#[test]
fn what_does_not_belong_together_is_refused() {
    let target = hard::power();
    let parts = runs(&target, 50, 1..=2);
    let refused = |runs: &[&Run]| merge(&target, runs).unwrap_err();
    let alone = refused(&[&parts[0]]);
    assert!(matches!(alone, Error::TooFewRuns { given: 1 }), "{alone}");
    let twice = refused(&[&parts[0], &parts[0]]);
    assert!(matches!(twice, Error::SameSeed { seed: 1 }), "{twice}");
    // A merger keeps the first seed alone.
    let both = merge(&target, &[&parts[0], &parts[1]]).unwrap();
    let again = refused(&[&both, &parts[1]]);
    assert!(matches!(again, Error::SharedDraws { seed: 2 }), "{again}");
    let other = sample(&hard::quarter(), &settings(50, Kernel::Uniform), 3);
    let other = refused(&[&parts[0], &other]);
    assert!(matches!(other, Error::OtherLikelihood { .. }), "{other}");
    let mut tempered = parts[1].clone();
    tempered.method = Method::Bridge;
    tempered.history = History::Bridge {
        fraction: Vec::new(),
        ln_ratio: Vec::new(),
        ancestors: Vec::new(),
        correlation: Vec::new(),
    };
    let bridged = refused(&[&parts[0], &tempered]);
    assert!(matches!(bridged, Error::NotNested { seed: 2 }), "{bridged}");
}
