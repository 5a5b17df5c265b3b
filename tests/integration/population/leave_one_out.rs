//! Streams left out by weighting, against quadrature without them.

use super::{by_quadrature, synthetic, target, weighted};
use oblate::population::{Population, QPosterior};
use oblate::posterior::{MAX_PARETO_K, PopulationSummary};
use oblate_samplers::output::Draws;

/// The posterior of (mu, sigma) as weighted draws on a regular grid.
pub fn on_a_grid(streams: &[QPosterior]) -> Draws {
    on_a_grid_above(streams, 0.0, 200)
}

/// The same where sigma is between this and 1, with so many cells on each side.
pub fn on_a_grid_above(streams: &[QPosterior], least_sigma: f64, cells: u32) -> Draws {
    let target = target(streams);
    let centre = |i: u32| (f64::from(i) + 0.5) / f64::from(cells);
    let sigma = |i: u32| least_sigma + (1.0 - least_sigma) * centre(i);
    let alphas: Vec<[f64; 2]> = (0..cells * cells)
        .map(|i| [0.5 + centre(i / cells), sigma(i % cells)])
        .collect();
    let ln_l: Vec<f64> = alphas.iter().map(|a| target.ln_product(*a)).collect();
    let ln_sum = oblate_samplers::diagnostics::ln_sum_exp(&ln_l);
    let rows = alphas.len();
    Draws {
        dim: 2,
        theta: alphas.concat(),
        ln_weight: ln_l.iter().map(|l| l - ln_sum).collect(),
        ln_likelihood: ln_l,
        chain: vec![0; rows],
        cluster: vec![0; rows],
        ..Draws::default()
    }
}

#[test]
fn weighting_leaves_a_stream_out() {
    let streams = synthetic(150);
    let (ln_z, mean, sd) = by_quadrature(&target(&streams));
    let found = target(&streams).leave_one_out(&on_a_grid(&streams));
    assert_eq!(found.len(), streams.len());
    let reliable = found.iter().filter(|without| without.reliable()).count();
    assert!(reliable >= 3, "only {reliable} can be compared");
    for (n, without) in found.iter().enumerate().filter(|(_, w)| w.reliable()) {
        let mut others = streams.clone();
        others.remove(n);
        let (ln_z_others, mean_others, sd_others) = by_quadrature(&target(&others));
        // 2000 systematic draws, whose error is at most that of independent ones; weights lose at most two thirds of them. Four
        // standard errors: 0.15.
        for k in 0..2 {
            let (_, moved) = &without.parameters[k];
            assert!(
                (moved.mean - mean_others[k]).abs() < 0.15 * sd_others[k],
                "{n} {k}: {moved:?}, exact {}",
                mean_others[k]
            );
            assert!((moved.sd / sd_others[k] - 1.0).abs() < 0.15, "{n} {k}");
            let exact_move = (mean_others[k] - mean[k]) / sd[k];
            assert!(
                (moved.mean_move - exact_move).abs() < 0.2,
                "{n} {k}: {moved:?} {exact_move}"
            );
            assert!((moved.width_ratio * sd[k] / sd_others[k] - 1.0).abs() < 0.2);
        }
        // The evidence of all over that of the others is what the others predict for the stream.
        let exact = ln_z - ln_z_others;
        assert!(
            (without.ln_predictive_density - exact).abs() < 0.1,
            "{n}: {} {exact}",
            without.ln_predictive_density
        );
    }
}

#[test]
fn the_stream_that_differs_is_the_most_influential_and_said_to_be_unreliable() {
    // Seven equal streams and one far away, all measured well.
    let mut streams: Vec<QPosterior> = (0..7)
        .map(|i| {
            weighted(
                &format!("near {i}"),
                (0.8 + 0.005 * f64::from(i), 0.02),
                400,
            )
        })
        .collect();
    streams.push(weighted("far", (1.3, 0.02), 400));
    let target = target(&streams);
    let draws = on_a_grid(&streams);
    let mut rows = target.streams_given_population(&draws);
    for (row, without) in rows.iter_mut().zip(target.leave_one_out(&draws)) {
        row.without = Some(without);
    }
    let far = rows[7].without.clone().unwrap();
    // No population of all eight is as narrow as that of the seven.
    assert!(far.pareto_k > MAX_PARETO_K, "{far:?}");
    assert!(
        far.parameters[1].1.mean_move < 0.0,
        "the population is narrower without it"
    );
    for near in &rows[..7] {
        let near = near.without.as_ref().unwrap();
        assert!(near.reliable() && near.ln_predictive_density > far.ln_predictive_density + 1.0);
    }
    let mut summary = PopulationSummary {
        streams: rows,
        ..PopulationSummary::default()
    };
    let sentence = summary.influence().unwrap();
    assert!(
        sentence
            .starts_with("Most influential stream: far; without it the mean of sigma_pop is 0."),
        "{sentence}"
    );
    assert!(
        sentence.contains("which is not reliable (Pareto k"),
        "{sentence}"
    );
    summary.streams.truncate(1);
    assert_eq!(summary.influence(), None);
}

#[test]
fn a_summary_of_before_is_read() {
    let interval = r#"{"median":1,"lo68":1,"hi68":1,"lo95":1,"hi95":1,"unit":""}"#;
    let text = format!(
        r#"{{"streams":[{{"name":"a","q":{interval},"q_given_population":{interval},"effective_draws":9,"pareto_k":"-inf","ln_likelihood_variance":0.1}}],"information":{{}}}}"#
    );
    let summary: PopulationSummary = serde_json::from_str(&text).unwrap();
    assert_eq!(summary.streams[0].without, None);
    assert!(summary.predictive.is_empty() && summary.influence().is_none());
}
