//! Mocks with parameters of the observation.

use oblate::data::{Mock, MockSettings, QPopulation, mocks};
use oblate::params::{PriorSettings, REQUIRED, StreamPrior};

/// The first mock with these fixed parameters.
fn mock(fixed: &[(&str, f64)], noise: f64) -> Mock {
    let mut settings = MockSettings {
        noise,
        ..MockSettings::default()
    };
    settings.model.releases.particles = 600;
    settings.model.steps = 100;
    let mut prior = PriorSettings::default();
    for (name, value) in fixed {
        prior.fix(name, *value).unwrap();
    }
    let prior = StreamPrior::new(&prior).unwrap();
    mocks(&prior, &settings, 1, 5).unwrap().mocks.remove(0)
}

#[test]
fn a_mock_is_as_it_would_be_measured() {
    let plain = mock(&[], 0.02);
    let seen = mock(&[("phi0_deg", 30.0), ("distance_factor", 1.05)], 0.02);
    assert_eq!(plain.track.len(), seen.track.len());
    for row in 0..plain.track.len() {
        let turned = seen.track.phi_deg[row] - plain.track.phi_deg[row];
        assert!((turned - 30.0).abs() < 1e-9);
        for (ours, all) in [
            (seen.track.r_kpc[row], plain.track.r_kpc[row]),
            (seen.track.r_err_lo_kpc[row], plain.track.r_err_lo_kpc[row]),
        ] {
            assert!((1.05 * ours / all - 1.0).abs() < 1e-12);
        }
    }
    // The truth names what is present.
    let keys = |mock: &Mock| mock.track.meta["truth"].as_object().unwrap().len();
    assert_eq!((keys(&plain), keys(&seen)), (REQUIRED + 1, REQUIRED + 3));
    assert_eq!(seen.track.meta["truth"]["phi0_deg"], 30.0);
}

#[test]
fn a_jitter_adds_to_the_noise_but_not_to_the_errors() {
    let exact = mock(&[], 0.0);
    let [quiet, loud] = [0.0, 0.08].map(|jitter| mock(&[("jitter", jitter)], 0.06));
    for row in 0..exact.track.len() {
        let off = |mock: &Mock| mock.track.r_kpc[row] / exact.track.r_kpc[row] - 1.0;
        // In quadrature: 0.1.
        assert!((off(&loud) / off(&quiet) - 0.1 / 0.06).abs() < 1e-9);
        let error = loud.track.r_err_lo_kpc[row] / loud.track.r_kpc[row];
        assert!((error - 0.06).abs() < 1e-12);
    }
}

#[test]
fn half_of_the_mocks_are_around_each_of_two_means() {
    let mut settings = MockSettings {
        population: Some(QPopulation {
            other_mu: Some(1.3),
            ..QPopulation::gaussian(0.7, 0.02)
        }),
        ..MockSettings::default()
    };
    settings.model.releases.particles = 200;
    settings.model.steps = 60;
    let prior = StreamPrior::new(&PriorSettings::default()).unwrap();
    let found = mocks(&prior, &settings, 40, 3).unwrap().mocks;
    // Six standard deviations from the nearer mean at most, and 20 of 40 each, give or take four standard deviations of 3.2.
    let near = |mean: f64| found.iter().filter(|m| (m.q - mean).abs() < 0.12).count();
    assert_eq!(near(0.7) + near(1.3), 40);
    assert!((8..=32).contains(&near(0.7)), "{}", near(0.7));
}
