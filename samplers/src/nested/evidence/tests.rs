use super::*;
use crate::nested::live::Genealogy;

const NEVER: f64 = f64::NEG_INFINITY;

#[test]
fn a_constant_likelihood_has_evidence_one_for_any_history() {
    for n in 1..=50_usize {
        for replacement in [1, 2, n.div_ceil(3), n] {
            // n points at 0; then the points of an iteration die and are born again, with likelihoods that are equal
            // for the weights.
            let mut birth = vec![NEVER; n];
            let mut ln_l = vec![0.0; n];
            let mut top = 0.0;
            for _ in 0..5 {
                for slot in 0..replacement {
                    birth.push(top);
                    ln_l.push(top + 1.0 + if slot % 2 == 0 { 0.5 } else { 0.0 });
                }
                top += 2.0;
            }
            let lineage = vec![Genealogy::default(); ln_l.len()];
            let history = DeadPoints::new(&ln_l, &birth, &lineage);
            let flat = vec![0.0; ln_l.len()];
            let weighted = weigh(&flat, &history.expected_ln_t());
            assert!(weighted.ln_z.abs() < 1e-12, "n = {n}: {}", weighted.ln_z);
            assert!(weighted.information.abs() < 1e-12);
            assert!((weighted.p.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        }
    }
}

#[test]
fn births_and_deaths_reproduce_a_run_made_by_hand() {
    // Four points, and at the end four points left.
    let ln_l = [1.0, 1.0, 2.0, 5.0, 3.0, 4.0, 2.5, 3.5, 3.5, 7.0, 6.0, 5.5];
    let birth = [
        NEVER, NEVER, NEVER, NEVER, 1.0, 1.0, 2.0, 2.5, 3.0, 3.5, 3.5, 4.0,
    ];
    let lineage = [0, 1, 2, 3, 0, 1, 2, 2, 0, 2, 0, 1].map(Genealogy::from);
    let history = DeadPoints::new(&ln_l, &birth, &lineage);
    let sorted = [1.0, 1.0, 2.0, 2.5, 3.0, 3.5, 3.5, 4.0, 5.0, 5.5, 6.0, 7.0];
    assert!(
        history
            .ln_l
            .iter()
            .zip(sorted)
            .all(|(a, b)| (a - b).abs() < 1e-15)
    );
    // By hand: at each death, births strictly below it minus the deaths before it. Two pairs die together, each counted
    // 4 and 3; the last four are the final live points.
    assert_eq!(history.live, [4, 3, 4, 4, 4, 4, 3, 4, 4, 3, 2, 1]);
}

#[test]
fn simulated_volumes_have_the_moments_of_beta_draws() {
    // With L = 1/X at the last point alone, ln Z is ln X there: all weight sits on one point.
    let n = [20_u32, 20, 20, 19, 18, 20, 20];
    let count = n.len();
    let mut history = DeadPoints::new(&[0.0; 7], &[NEVER; 7], &[Genealogy::default(); 7]);
    history.live = n.to_vec();
    history.ln_l = vec![-1e6; count];
    history.ln_l[count - 1] = 0.0;
    let draws = history.simulate(1, 40_000);
    // The last cell is X_{N-1} (1 + t_N) / 2: the mean over t_N by quadrature, its variance likewise.
    let last = f64::from(n[count - 1]);
    let moments = (0..20_000).map(|i| {
        let u = (f64::from(i) + 0.5) / 20_000.0;
        (0.5 * (1.0 + u.powf(1.0 / last))).ln()
    });
    let (sum, sum2) = moments.fold((0.0, 0.0), |(a, b), m| (a + m / 2e4, b + m * m / 2e4));
    let before = &n[..count - 1];
    let mean = sum - before.iter().map(|&n| 1.0 / f64::from(n)).sum::<f64>();
    let variance = sum2 - sum * sum + before.iter().map(|&n| f64::from(n).powi(-2)).sum::<f64>();
    let m = draws.iter().sum::<f64>() / 4e4;
    let v = draws.iter().map(|d| (d - m).powi(2)).sum::<f64>() / 4e4;
    // Three standard errors; the kurtosis of a sum of seven exponentials is below 3 + 6/5.
    assert!(
        (m - mean).abs() < 3.0 * (variance / 4e4).sqrt(),
        "{m} {mean}"
    );
    assert!(
        (v / variance - 1.0).abs() < 3.0 * (3.2_f64 / 4e4).sqrt(),
        "{v} {variance}"
    );
}

#[test]
fn bootstrap_of_all_lineages_once_is_the_run_itself() {
    let ln_l = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
    let birth = [NEVER, NEVER, NEVER, 1.0, 2.0, 3.0];
    let lineage = [0, 1, 2, 0, 1, 2].map(Genealogy::from);
    let history = DeadPoints::new(&ln_l, &birth, &lineage);
    let (rows, weighted) = history.weigh_groups(&history.lineages, &[1.0; 3]);
    assert_eq!(rows, [0, 1, 2, 3, 4, 5]);
    assert!((weighted.ln_z - history.weigh().ln_z).abs() < 1e-14);
    // A single lineage is a run with one live point: every death shrinks the volume by e.
    let (rows, weighted) = history.weigh_groups(&history.lineages, &[0.0, 1.0, 0.0]);
    assert_eq!(rows, [1, 4]);
    let single = weigh(&[2.0, 5.0], &[-1.0, -1.0]);
    assert!((weighted.ln_z - single.ln_z).abs() < 1e-14);
}

#[test]
fn expected_error_of_ln_z_is_that_of_simulated_volumes() {
    // A Gaussian in five dimensions: ln L = -r^2 / 2s^2 where X = r^5, 100 live points all along.
    let count = 3_000;
    let ln_l: Vec<f64> = (0..count)
        .map(|i| -0.5 * (-2.0 * f64::from(i) / 500.0).exp() / 0.01_f64.powi(2))
        .collect();
    let birth: Vec<f64> = (0..count)
        .map(|i| {
            if i < 100 {
                NEVER
            } else {
                ln_l[i as usize - 100]
            }
        })
        .collect();
    let history = DeadPoints::new(&ln_l, &birth, &vec![Genealogy::default(); ln_l.len()]);
    assert!(history.live[1..2_900].iter().all(|n| *n == 100));
    let simulated = history.simulate(2, 2_000);
    let mean = simulated.iter().sum::<f64>() / 2e3;
    let variance = simulated.iter().map(|z| (z - mean).powi(2)).sum::<f64>() / 2e3;
    let expected = history.expected_error(&history.weigh());
    // The deviation of 2,000 has an error of 1.6 %; the first order errs by less.
    assert!(
        (expected / variance.sqrt() - 1.0).abs() < 0.06,
        "{expected} {variance}"
    );
}
