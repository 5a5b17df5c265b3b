//! Corner figures: their panels, titles and regions.

use super::{corner_columns, sound};
use crate::runs;
use oblate::posterior::Column;
use oblate::report::{CornerColumn, corner};
use oblate_samplers::rng::{Domain, standard_normal, stream};

#[test]
fn corner_of_the_thirteen_and_q_has_all_panels_and_labels() {
    let run = runs::nested(6000, 21);
    let svg = sound(
        "corner",
        corner(&corner_columns(&run, 14), &run.draws.weights(), "corner"),
    );
    // 14 marginals and 91 pairs, each framed; one truth dot per pair of parameters, 13 of them.
    assert_eq!(svg.matches("<rect x=").count(), 14 + 91);
    assert_eq!(svg.matches("class=\"truth\"").count(), 13 * 12 / 2);
    assert!(svg.contains("[km s<") && svg.contains("[Gyr]") && svg.contains("[kpc]"));
}

#[test]
fn corner_of_a_population_has_three_panels() {
    let values = |k: u64, mean: f64, sd: f64| -> Vec<f64> {
        (0..3000)
            .map(|i| mean + sd * standard_normal(&mut stream(8, Domain::Test, k, i)))
            .collect()
    };
    let column = |name: &str, values: Vec<f64>, truth| CornerColumn {
        column: Column {
            name: name.to_owned(),
            unit: String::new(),
            values,
        },
        ess: 3000.0,
        truth: Some(truth),
    };
    let columns = [
        column("mu_pop", values(1, 0.9, 0.05), 0.92),
        column("sigma_pop", values(2, 0.2, 0.03), 0.18),
    ];
    let svg = sound("population", corner(&columns, &[1.0; 3000], "population"));
    assert_eq!(svg.matches("<rect x=").count(), 3);
    assert_eq!(svg.matches("class=\"truth\"").count(), 1);
}

#[test]
fn titles_of_a_corner_fit_above_their_panels_and_have_no_negative_zero() {
    let run = runs::nested(3000, 5);
    let titles = |count: usize| {
        let mut all = corner_columns(&run, count);
        all[0].column.values = (0..3000).map(|i| f64::from(i) * 1e-3 - 1.501).collect();
        let weights = [1.0; 3000];
        let svg = sound(&format!("corner_{count}"), corner(&all, &weights, "titles"));
        let texts = svg.split('>').filter(|text| text.contains(" \u{2212}"));
        let texts = texts.filter_map(|text| text.split('<').next());
        texts.map(str::to_owned).collect::<Vec<_>>()
    };
    assert!(titles(2)[0].starts_with("0.0 +1.0 "), "{:?}", titles(2));
    // Fourteen panels are narrow: the median has a line of its own.
    let narrow = titles(14);
    assert_eq!(narrow.len(), 14);
    for title in narrow {
        assert!(
            title.starts_with('+') && title.chars().count() <= 13,
            "{title}"
        );
    }
}

/// A constant column has no density to draw: the figure must still be valid.
#[test]
fn corner_of_a_constant_column_is_drawn() {
    let mut all = corner_columns(&runs::nested(300, 2), 2);
    all[0].column.values.fill(3.0);
    sound("corner_constant", corner(&all, &[1.0; 300], "constant"));
}

#[test]
fn regions_of_a_normal_hold_68_and_95_per_cent() {
    // Read off the drawing: for a round normal, the 68 % region has the area 2 pi ln(1 / 0.32) = 7.16 sd^2. The drawn
    // panel spans 5.5 sd and a margin; smoothing by 1.2 of 44 cells widens it by 2 %.
    let values = |k: u64| -> Vec<f64> {
        (0..40_000)
            .map(|i| standard_normal(&mut stream(9, Domain::Test, k, i)))
            .collect()
    };
    let columns = [1, 2].map(|k| CornerColumn {
        column: Column {
            name: format!("x{k}"),
            unit: String::new(),
            values: values(k),
        },
        ess: 40_000.0,
        truth: None,
    });
    let svg = corner(&columns, &vec![1.0; 40_000], "normal");
    let rings: Vec<Vec<(f64, f64)>> = svg
        .lines()
        .filter(|l| {
            l.contains("fill-rule=\"evenodd\"")
                && l.contains("Z")
                && l.contains("fill-opacity=\"0.6\"")
        })
        .map(|l| {
            let d = l.split('"').nth(1).unwrap();
            d.trim_start_matches('M')
                .trim_end_matches('Z')
                .split('L')
                .map(|p| {
                    let (x, y) = p.split_once(' ').unwrap();
                    (x.parse().unwrap(), y.parse().unwrap())
                })
                .collect()
        })
        .collect();
    assert_eq!(rings.len(), 1);
    let ring = &rings[0];
    let area: f64 = (0..ring.len())
        .map(|i| {
            let (a, b) = (ring[i], ring[(i + 1) % ring.len()]);
            0.5 * (a.0 * b.1 - b.0 * a.1)
        })
        .sum::<f64>()
        .abs();
    // Panel of 150 points over the 0.3 to 99.7 % range (2 x 2.748 sd) with 6 % margins.
    let point_per_sd = 150.0 / (2.0 * 2.748 * 1.12);
    let ratio =
        area / (point_per_sd * point_per_sd) / (2.0 * std::f64::consts::PI * (1.0 / 0.32_f64).ln());
    assert!((ratio - 1.02).abs() < 0.06, "{ratio}");
}
