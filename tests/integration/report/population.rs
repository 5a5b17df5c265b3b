//! Figures of a population: its density, its streams, and what each stream moves.

use super::sound;
use oblate::population::PopulationDensity;
use oblate::posterior::{
    Interval, MeanWithoutStream, PopulationSummary, StreamInPopulation, WithoutStream,
};
use oblate::report::{influence, population_density, streams_of_population};

#[test]
fn the_density_of_a_population_is_drawn_with_its_bands() {
    let q: Vec<f64> = (0..=100).map(|i| 0.5 + 0.01 * f64::from(i)).collect();
    let bell = |scale: f64| -> Vec<f64> {
        q.iter()
            .map(|q| scale * (-50.0 * (q - 0.8) * (q - 0.8)).exp())
            .collect()
    };
    let svg = sound(
        "population_density",
        population_density(&PopulationDensity {
            mean: bell(4.0),
            median: bell(3.9),
            lo68: bell(3.0),
            hi68: bell(5.0),
            lo95: bell(2.0),
            hi95: bell(6.0),
            q: q.clone(),
        }),
    );
    // Two bands; two curves and their keys, the line at q = 1.
    assert_eq!(svg.matches("fill-rule").count(), 2);
    assert!(
        svg.matches("stroke-dasharray=\"4 2\"").count() == 2,
        "median and its key"
    );
    let flat = PopulationDensity {
        mean: vec![0.0; 101],
        median: vec![0.0; 101],
        lo68: vec![0.0; 101],
        hi68: vec![0.0; 101],
        lo95: vec![0.0; 101],
        hi95: vec![0.0; 101],
        q,
    };
    sound("population_density_of_zeros", population_density(&flat));
}

#[test]
fn the_streams_of_a_population_are_drawn_twice_each() {
    let interval = |centre: f64, half: f64| Interval {
        median: centre,
        lo68: centre - half,
        hi68: centre + half,
        lo95: centre - 2.0 * half,
        hi95: centre + 2.0 * half,
        unit: String::new(),
    };
    let streams: Vec<StreamInPopulation> = (0..3)
        .map(|i| StreamInPopulation {
            name: format!("a stream of a long name <{i}>"),
            q: interval(0.8 + 0.1 * f64::from(i), 0.1),
            q_given_population: interval(0.9, 0.05),
            effective_draws: 100.0,
            pareto_k: f64::NEG_INFINITY,
            ln_likelihood_variance: 0.1,
            without: None,
        })
        .collect();
    let svg = sound("streams_of_population", streams_of_population(&streams));
    assert_eq!(svg.matches("<circle").count(), 6);
    assert!(svg.contains("a stream of a long\u{2026}"), "names are cut");
    sound("streams_of_no_population", streams_of_population(&[]));
    // Runs of earlier versions do not know what each stream moves.
    let mut population = PopulationSummary {
        streams,
        ..PopulationSummary::default()
    };
    assert_eq!(influence(&population), None);
    for (k, stream) in (0_u8..).zip(&mut population.streams) {
        let moved = MeanWithoutStream {
            mean: 1.0,
            sd: 0.1,
            mean_move: 0.3 * f64::from(k),
            width_ratio: 1.1,
        };
        stream.without = Some(WithoutStream {
            ln_predictive_density: -0.1,
            pareto_k: 0.4 * f64::from(k),
            parameters: ["mu_pop", "sigma_pop"]
                .map(|name| (name.to_owned(), moved))
                .to_vec(),
        });
    }
    let svg = sound("influence", influence(&population).expect("a figure"));
    assert_eq!(svg.matches("<circle").count(), 6);
    assert_eq!(
        svg.matches("fill-opacity=\"0.3\"").count(),
        2,
        "the last weights are not reliable"
    );
    assert!(svg.contains(">\u{3c3}</tspan>") && svg.contains(">pop</tspan>"));
}
