//! Runs side by side: which differ, and by how much.

use crate::runs;
use oblate::posterior::{Comparison, compare, compare_models};
use oblate_samplers::Run;

/// A run with changed parameters in each draw.
fn with(run: &Run, change: impl FnMut(&mut [f64])) -> Run {
    let mut run = run.clone();
    let dim = run.draws.dim;
    run.draws.theta.chunks_exact_mut(dim).for_each(change);
    run
}

/// Places of `dir_x` and `dir_y` among [`runs::PARAMETERS`].
const DIR: [usize; 2] = [2, 3];

#[test]
fn a_comparison_holds_distances_against_chance_and_sums_the_prolate_side() {
    let (a, b) = (runs::nested(20_000, 7), runs::tempered(20_000, 8));
    let c = compare("a", &a, "b", &b).unwrap();
    assert!(c.agree() && c.verdict().starts_with("they agree"));
    for row in &c.marginals {
        // A distance is nearly Gaussian in few numbers: five times its mean is far outside of chance.
        assert!(row.wasserstein < 5.0 * row.wasserstein_expected, "{row:?}");
        assert!(row.wasserstein_expected < 0.1, "{row:?}");
    }
    for row in &c.modes {
        // Of the tempered run's four chains, so with a few degrees of freedom.
        let error = row.error[0].hypot(row.error[1]);
        let by_error = (row.weight[0] - row.weight[1]) / error.max(0.01);
        assert!(
            row.sigma.abs() < 4.0 && row.sigma.abs() <= by_error.abs() + 1e-12,
            "{row:?}"
        );
        assert!(row.sigma * by_error >= 0.0, "{row:?}");
    }
    let prolate = c.modes.last().unwrap();
    assert_eq!(prolate.name, "prolate");
    for run in 0..2 {
        let cells = c.modes.iter().filter(|m| m.name.ends_with(" prolate"));
        let sum: f64 = cells.map(|m| m.weight[run]).sum();
        assert!((sum - prolate.weight[run]).abs() < 1e-9, "{prolate:?}");
        let rate = c.cost[run].q_ess_per_cpu_second.unwrap();
        let draws = rate * c.cost[run].cpu_seconds;
        assert!(draws > 10_000.0 && draws < 40_000.0, "{draws}");
    }
    // What fixed parameters alone give is the same in all draws, and no row; other fixed values are.
    let with_constant = |run: &Run, value: f64| with(run, |row| row[0] = value);
    let c = compare("a", &with_constant(&a, 0.5), "b", &with_constant(&b, 0.5)).unwrap();
    assert!(
        c.marginals
            .iter()
            .all(|row| row.name != a.names[0] && row.sigma.is_finite())
    );
    let c = compare("a", &with_constant(&a, 0.5), "b", &with_constant(&b, 0.6)).unwrap();
    assert!(!c.agree() && c.marginals[0].name == a.names[0]);
    // The same draws, moved.
    let c = compare("a", &a, "moved", &with(&a, |row| row[0] += 1.0)).unwrap();
    let row = &c.marginals[0];
    assert!(!c.agree() && row.sigma < -100.0, "{row:?}");
    assert!((row.wasserstein - row.shift.abs()).abs() < 1e-6, "{row:?}");
    assert!(row.wasserstein > 5.0 * row.wasserstein_expected, "{row:?}");
}

#[test]
fn runs_whose_evidences_differ_by_more_than_three_errors_disagree() {
    let (a, b) = (runs::nested(4_000, 7), runs::tempered(4_000, 8));
    let moved = |sigma: f64| {
        let mut moved = b.clone();
        moved.evidence.ln_z += sigma * a.evidence.error.hypot(b.evidence.error);
        compare("a", &a, "b", &moved).unwrap()
    };
    for (sigma, agree) in [(2.9, true), (3.1, false), (10.0, false), (-10.0, false)] {
        let c = moved(sigma);
        assert!((c.ln_z_sigma + sigma).abs() < 1e-9, "{sigma}");
        assert_eq!(c.agree(), agree, "{sigma}: {}", c.verdict());
        assert_eq!(c.verdict().starts_with("they DISAGREE (ln Z by "), !agree);
    }
    // Two models need not agree.
    let mut other = b.clone();
    other.evidence.ln_z += 2.0;
    let c = compare_models("a", &a, "b", &other).unwrap();
    assert!(c.agree(), "{}", c.verdict());
    // e^2 = 7.389.
    let odds = "two models; ln Z -2.00 +- 0.18, odds of 7.4 to 1 for b";
    assert_eq!(c.verdict(), odds);
    for (difference, words) in [(5.0, "148 to 1"), (7.0, "1e3 to 1"), (250.0, "4e108 to 1")] {
        other.evidence.ln_z = b.evidence.ln_z + difference;
        let verdict = compare_models("a", &a, "b", &other).unwrap().verdict();
        assert!(verdict.contains(&format!("odds of {words}")), "{verdict}");
    }
}

#[test]
fn a_mean_that_differs_by_more_than_three_and_a_half_errors_disagrees() {
    let a = runs::nested(4_000, 7);
    // Draws of nested runs are independent here, so that the error of a mean is sd / sqrt(ESS) in both.
    let error = runs::PARAMETERS[0].3 * (2.0 / a.ess.kish).sqrt();
    for (shift, agree) in [(3.0, true), (-3.0, true), (4.0, false), (-4.0, false)] {
        let b = with(&a, |row| row[0] += shift * error);
        let c = compare("a", &a, "b", &b).unwrap();
        // The standard deviation of 3,000 effective draws is known to 1.3 %.
        assert!((c.marginals[0].sigma / -shift - 1.0).abs() < 0.052);
        assert_eq!(c.agree(), agree, "{shift}: {}", c.verdict());
        let worst = c.worst_marginal().unwrap();
        assert_eq!(worst.name, a.names[0]);
    }
}

/// The weights of the two signs of `dir_x` are 0.909 and 0.091.
#[test]
fn runs_with_exchanged_modes_disagree() {
    let a = runs::nested(4_000, 7);
    let exchanged = compare("a", &a, "b", &with(&a, |row| row[DIR[0]] *= -1.0)).unwrap();
    assert!(!exchanged.agree());
    let row = |c: &Comparison, name: &str| {
        let found = c.modes.iter().find(|row| row.name == name);
        found.cloned().unwrap_or_else(|| panic!("no {name}"))
    };
    for rest in ["dir_y+ oblate", "dir_y- oblate", "dir_y- prolate"] {
        let [plus, minus] = ["+", "-"].map(|sign| row(&exchanged, &format!("dir_x{sign} {rest}")));
        for run in 0..2 {
            let difference = plus.weight[run] - minus.weight[1 - run];
            assert!(difference.abs() < 1e-12, "{plus:?} {minus:?}");
        }
    }
    let plus = row(&exchanged, "dir_x+ dir_y- oblate");
    assert!(plus.weight[0] > 5.0 * plus.weight[1] && plus.sigma > 10.0);
    let prolate = row(&exchanged, "prolate");
    assert!(prolate.sigma.abs() < 1e-12, "{prolate:?}");

    // Modes that no marginal tells apart: both components of one sign, or of opposite ones.
    let signs = |together: bool| {
        let mut count = 0_u32;
        with(&a, |row| {
            count += 1;
            let sign = if count.is_multiple_of(2) { 1.0 } else { -1.0 };
            let other = if together { sign } else { -sign };
            row[DIR[0]] = sign * row[DIR[0]].abs();
            row[DIR[1]] = other * row[DIR[1]].abs();
        })
    };
    let (together, apart) = (signs(true), signs(false));
    assert!(compare("a", &together, "b", &together).unwrap().agree());
    let c = compare("a", &together, "b", &apart).unwrap();
    let worst = c.worst_marginal().unwrap();
    assert!(worst.sigma.abs() < 3.0, "{worst:?}");
    assert!(!c.agree());
    let verdict = c.verdict();
    let mode = c.worst_mode().unwrap();
    assert!(mode.sigma.abs() > 10.0 && mode.name.contains(" oblate"));
    assert!(verdict.contains("the worst mode is dir_x"), "{verdict}");
}
