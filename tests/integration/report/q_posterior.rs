//! The figure of q: densities of runs, their prior and their truth.

use super::sound;
use crate::runs;
use oblate::params::QPrior;
use oblate::report::{QCurve, q_posterior};
use oblate_samplers::output::Run;

#[test]
fn the_density_of_uniform_draws_is_flat_to_the_ends_of_the_prior() {
    let q: Vec<f64> = (0..1000)
        .map(|i| 0.5 + (f64::from(i) + 0.5) / 1000.0)
        .collect();
    let height = |ess: f64| {
        let curve = QCurve {
            name: "uniform".to_owned(),
            weights: vec![1e-3; q.len()],
            q: q.clone(),
            ess,
        };
        let svg = q_posterior(&[curve], Some(QPrior::Uniform { lo: 0.5, hi: 1.5 }), None);
        let line = svg
            .lines()
            .find(|line| line.contains("fill=\"none\""))
            .unwrap();
        let d = line.split('"').nth(1).unwrap().trim_start_matches('M');
        let y = d
            .split('L')
            .map(|p| p.split_once(' ').unwrap().1.parse::<f64>().unwrap());
        let y: Vec<f64> = y.collect();
        // Without the two feet; the panel ends at 182 points.
        y[1..y.len() - 1]
            .iter()
            .map(|y| 182.0 - y)
            .collect::<Vec<_>>()
    };
    for ess in [50.0, 1000.0] {
        let heights = height(ess);
        let [lo, hi] = [f64::min, f64::max].map(|f| heights.iter().copied().reduce(f).unwrap());
        assert!(hi / lo < 1.02, "{ess}: {lo} {hi}");
    }
}

#[test]
fn q_figure_overlays_runs_with_truth_and_prior() {
    let curve = |name: &str, run: &Run| QCurve {
        name: name.to_owned(),
        q: run.draws.derived_column(0),
        weights: run.draws.weights(),
        ess: 4000.0,
    };
    let curves = [
        curve("nested", &runs::nested(4000, 3)),
        curve("pt-hmc", &runs::tempered(4000, 4)),
    ];
    let svg = q_posterior(
        &curves,
        Some(QPrior::Uniform { lo: 0.5, hi: 1.5 }),
        Some(0.83),
    );
    let svg = sound("q", svg);
    assert_eq!(svg.matches("class=\"median\"").count(), 2);
    for word in ["prior", "truth", "nested", "pt-hmc"] {
        assert!(svg.contains(word), "{word}");
    }
    sound("q_bare", q_posterior(&curves[..1], None, None));
}
