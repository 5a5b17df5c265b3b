//! Mocks at the ends of their ranges: criteria that no stream meets, and populations beyond the prior.

use oblate::Error;
use oblate::data::{MockSettings, QPopulation, mocks};
use oblate::params::{PriorSettings, StreamPrior};

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
