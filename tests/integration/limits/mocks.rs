//! Mocks at the ends of their ranges: criteria that no stream meets, and populations beyond the prior.

use super::ranges;
use oblate::Error;
use oblate::data::{MockSettings, QPopulation, mocks, selection};
use oblate::params::{PriorSettings, StreamPrior};
use oblate::samplers::limits::OutOfRange;

#[test]
fn criteria_that_no_draw_meets_end_the_search_for_mocks() {
    let mut settings = MockSettings {
        min_length_kpc: 100_000.0,
        ..MockSettings::default()
    };
    let model = &mut settings.model;
    (model.releases.particles, model.releases.release_times) = (2, 1);
    (model.steps, model.orbit_steps) = (1, 1);
    let prior = StreamPrior::new(&PriorSettings::default()).expect("the prior");
    let error = mocks(&prior, &settings, 1, 1).unwrap_err();
    assert!(
        matches!(error, Error::TooFewMocks { found: 0, .. }),
        "{error}"
    );
}

#[test]
fn a_population_of_q_beyond_the_prior_is_at_its_nearer_end() {
    let prior = StreamPrior::new(&PriorSettings::default()).expect("the prior");
    for (mu, sigma, q) in [(0.0, 1e-3, 0.5), (3.0, 1e-3, 1.5), (1.2, 1e-300, 1.2)] {
        let mut settings = MockSettings {
            population: Some(QPopulation::gaussian(mu, sigma)),
            ..MockSettings::default()
        };
        settings.model.releases.particles = 200;
        let found = mocks(&prior, &settings, 1, 1).expect("a mock");
        assert!(
            (found.mocks[0].q - q).abs() < 1e-6,
            "{mu}: {}",
            found.mocks[0].q
        );
    }
}

#[test]
fn the_numbers_of_a_selection_are_those_of_the_page() {
    let found = ranges("`oblate selection` makes");
    let [draws, points] = found[..] else {
        panic!("{found:?}");
    };
    let prior = StreamPrior::new(&PriorSettings::default()).expect("the prior");
    let mut settings = MockSettings::default();
    settings.model.releases.particles = 64;
    let refused = |draws: f64, points: f64| {
        let made = selection(
            &prior,
            &settings,
            points as usize,
            draws as usize,
            1,
            &mut |_| (),
        );
        match made {
            Err(Error::OutOfRange(OutOfRange { key, .. })) => Some(key),
            _ => None,
        }
    };
    // The largest numbers take hours; those beyond them are refused before the first stream.
    assert_eq!(refused(draws.0, points.0), None);
    for beyond in [draws.0 - 1.0, draws.1 + 1.0] {
        assert_eq!(refused(beyond, points.0).as_deref(), Some("draws"));
    }
    for beyond in [points.0 - 1.0, points.1 + 1.0] {
        assert_eq!(refused(draws.0, beyond).as_deref(), Some("points"));
    }
}
