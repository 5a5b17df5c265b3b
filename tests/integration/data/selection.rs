//! The selection of mocks by q: against the mocks themselves, and what is refused.

use oblate::Error;
use oblate::data::{MockSettings, QPopulation, Selection, mocks, selection};
use oblate::params::{PriorSettings, StreamPrior};

/// Streams of few particles.
fn settings() -> MockSettings {
    let mut settings = MockSettings::default();
    settings.model.releases.particles = 600;
    settings.model.steps = 100;
    settings
}

fn prior() -> StreamPrior {
    StreamPrior::new(&PriorSettings::default()).unwrap()
}

#[test]
fn the_fractions_are_those_of_mocks_with_this_q() {
    const DRAWS: usize = 60;
    let mut done = Vec::new();
    let found = selection(&prior(), &settings(), 2, DRAWS, 5, &mut |points| {
        done.push(points)
    });
    let found = found.unwrap();
    found.check().unwrap();
    assert_eq!(
        (found.q.as_slice(), done.as_slice()),
        (&[0.75, 1.25][..], &[1, 2][..])
    );
    for ((q, kept), error) in found.q.iter().zip(&found.kept).zip(&found.error) {
        let settings = MockSettings {
            population: Some(QPopulation::gaussian(*q, 0.0)),
            ..settings()
        };
        let count = (kept * DRAWS as f64).round() as usize;
        let tried = |count| mocks(&prior(), &settings, count, 5).unwrap().tried as usize;
        assert!(count > 0 && count < DRAWS, "{found:?}");
        assert!(tried(count) <= DRAWS && tried(count + 1) > DRAWS);
        let binomial = (kept * (1.0 - kept) / DRAWS as f64).sqrt();
        assert!((error / binomial - 1.0).abs() < 0.1, "{error} {binomial}");
    }
}

#[test]
fn a_fraction_is_linear_between_values_of_q_and_constant_beyond() {
    let selection = Selection {
        q: vec![0.6, 0.8, 1.2],
        kept: vec![0.1, 0.5, 0.3],
        error: vec![0.0; 3],
    };
    for (q, kept) in [
        (0.5, 0.1),
        (0.6, 0.1),
        (0.7, 0.3),
        (0.8, 0.5),
        (1.1, 0.35),
        (1.2, 0.3),
        (1.5, 0.3),
    ] {
        assert!((selection.at(q) - kept).abs() < 1e-15, "{q}");
    }
}

#[test]
fn selections_that_cannot_be_made_are_refused() {
    let make = |settings: &MockSettings, points, draws| {
        selection(&prior(), settings, points, draws, 1, &mut |_| ()).unwrap_err()
    };
    assert!(matches!(make(&settings(), 1, 10), Error::OutOfRange(e) if e.key == "points"));
    assert!(matches!(make(&settings(), 2, 9), Error::OutOfRange(e) if e.key == "draws"));
    let of_a_population = MockSettings {
        population: Some(QPopulation::gaussian(0.8, 0.1)),
        ..settings()
    };
    assert!(
        matches!(make(&of_a_population, 2, 10), Error::Setting { key, .. } if key == "population")
    );
    let impossible = MockSettings {
        min_length_kpc: 100_000.0,
        ..settings()
    };
    // Other criteria would be another selection: the remedy is draws.
    let error = make(&impossible, 2, 10);
    assert!(
        matches!(error, Error::NoneKept { q, tries: 10 } if (q - 0.75).abs() < 1e-12),
        "{error:?}"
    );
    let words = error.to_string();
    assert!(words.ends_with("make more draws at each q"), "{words}");
}
