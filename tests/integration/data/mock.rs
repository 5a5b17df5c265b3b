//! Mocks with parameters of the observation.

use oblate::data::{Mock, MockSettings, MockStars, QPopulation, StarVelocity, mocks};
use oblate::params::{PriorSettings, REQUIRED, StreamPrior};
use oblate::stream::{MassLoss, Model, ModelSettings, Particles, StepSchedules, System};
use oblate::track::{BinEdges, BinQuantity, Track, TrackBin};

/// The first mock with these fixed parameters.
fn mock(fixed: &[(&str, f64)], noise: f64) -> Mock {
    let mut settings = MockSettings {
        noise,
        star_scatter: false,
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

/// Mean square residual of mocks from tracks of many more particles at their true parameters, in standard errors, and the number of bins.
fn mean_square_residual(star_scatter: bool) -> (f64, usize) {
    let settings = MockSettings {
        star_scatter,
        ..MockSettings::default()
    };
    let prior = StreamPrior::new(&PriorSettings::default()).unwrap();
    let mut finer = ModelSettings::default();
    finer.releases.particles = 40_000;
    let model = Model::new(&finer).unwrap();
    let mut squares = Vec::new();
    for mock in mocks(&prior, &settings, 12, 1).unwrap().mocks {
        let system = System::from_params(&mock.params, prior.q_range());
        let solution = model.progenitor_solution(&system).unwrap();
        let (mut schedules, mut particles) = (StepSchedules::default(), Particles::default());
        model
            .integrate(&solution, &mut schedules, &mut particles)
            .unwrap();
        let track = Track::new(&particles, 10.0, BinEdges::Hard, 1.0).unwrap();
        for (row, phi_deg) in mock.track.phi_deg.iter().enumerate() {
            let same = |bin: &&TrackBin| (bin.phi_deg - phi_deg).abs() < 1.0;
            let bin = track.bins.iter().find(same).unwrap();
            let residual = (bin.r_kpc - mock.track.r_kpc[row]) / mock.track.r_err_lo_kpc[row];
            squares.push(residual * residual);
        }
    }
    let mean = squares.iter().sum::<f64>() / squares.len() as f64;
    (mean, squares.len())
}

#[test]
fn errors_of_mocks_are_those_of_their_radii() {
    let (mean, bins) = mean_square_residual(true);
    // Four standard deviations of the mean of squares of so many unit normals.
    let limit = 4.0 * (2.0 / bins as f64).sqrt();
    assert!((mean - 1.0).abs() < limit, "{mean} of {bins} bins");
    // Those of the paper leave out that a bin has few stars.
    let (of_paper, _) = mean_square_residual(false);
    assert!(of_paper > 1.0 + limit, "{of_paper}");
}

/// Of a progenitor that has dissolved at 0.3 of the age the particles of later releases have no weight.
fn dissolved(count: usize) -> Mock {
    let mut settings = MockSettings {
        stars: Some(MockStars {
            count,
            velocity_noise_km_s: 5.0,
        }),
        velocity_noise_km_s: Some(0.01),
        width_noise: Some(0.001),
        ..MockSettings::default()
    };
    settings.model.mass_loss = Some(MassLoss::Complete);
    let mut prior = PriorSettings::default();
    prior.fix("dissolved_at", 0.3).unwrap();
    let prior = StreamPrior::new(&prior).unwrap();
    mocks(&prior, &settings, 1, 3).unwrap().mocks.remove(0)
}

#[test]
fn particles_that_have_not_left_the_progenitor_are_no_stars() {
    let particles = MockSettings::default().model.releases.particles;
    let count = dissolved(100_000).track.stars.len();
    // Some of the particles that have left lie in no bin of the track.
    assert!(count > 100 && 3 * particles > 10 * (count - 1), "{count}");
}

/// With uneven weights means, widths and densities are as uncertain as those of fewer particles of equal weight.
#[test]
fn errors_of_a_bin_are_those_of_its_effective_number_of_particles() {
    let track = dissolved(1).track;
    let n = track.n.as_ref().unwrap();
    for (row, width) in track.measured[&BinQuantity::Width].iter().enumerate() {
        let width = width.expect("a width");
        // Three tenths of the releases have weights.
        let effective = 0.3 * n[row];
        let expected = width.value / (2.0 * effective).sqrt();
        let of_width = (width.error.powi(2) - (0.001 * width.value).powi(2)).sqrt();
        assert!(
            (of_width / expected - 1.0).abs() < 0.05,
            "{row}: {of_width} {expected}"
        );
    }
}

#[test]
fn single_stars_of_a_mock_are_particles_of_its_bins_with_noise() {
    let prior = StreamPrior::new(&PriorSettings::default()).unwrap();
    let mock = |stars: Option<(usize, f64)>| {
        let stars = stars.map(|(count, velocity_noise_km_s)| MockStars {
            count,
            velocity_noise_km_s,
        });
        let settings = MockSettings {
            stars,
            velocity_noise_km_s: Some(0.01),
            ..MockSettings::default()
        };
        let mut found = mocks(&prior, &settings, 1, 3).unwrap();
        found.mocks.remove(0).track
    };
    let (none, precise, noisy) = (mock(None), mock(Some((200, 0.01))), mock(Some((200, 50.0))));
    // Everything else is as without stars.
    assert_eq!((none.stars.len(), &none.measured), (0, &precise.measured));
    assert_eq!(none.r_kpc, precise.r_kpc);
    assert_eq!(precise.stars.len(), 200);
    assert!(
        precise
            .stars
            .windows(2)
            .all(|w| w[0].phi_deg <= w[1].phi_deg)
    );
    // Stars are particles: the mean of those in a bin is that of all its particles, within its own scatter.
    let velocities = &precise.measured[&BinQuantity::Velocity];
    let mut chi2 = Vec::new();
    for (row, bin) in precise.bins().into_iter().enumerate() {
        let own = |star: &&StarVelocity| precise.bin_at(star.phi_deg) == bin;
        let v = precise
            .stars
            .iter()
            .filter(own)
            .map(|star| star.v_km_s.value);
        let v: Vec<f64> = v.collect();
        if v.len() < 10 {
            continue;
        }
        let (n, mean) = (v.len() as f64, v.iter().sum::<f64>() / v.len() as f64);
        let variance = v.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
        let expected = velocities[row].expect("a velocity").value;
        chi2.push((mean - expected).powi(2) / (variance / n));
    }
    // Each is the square of a number of Student's, with at least nine degrees of freedom: 99.9 % of them are below 23.
    assert!(
        chi2.len() >= 4 && chi2.iter().all(|z2| *z2 < 23.0),
        "{chi2:?}"
    );
    // The same stars with more noise: 200 normal numbers have a mean square of 1 +- 0.1.
    let mut sum = 0.0;
    for (a, b) in precise.stars.iter().zip(&noisy.stars) {
        assert_eq!(a.phi_deg.to_bits(), b.phi_deg.to_bits());
        sum += ((a.v_km_s.value - b.v_km_s.value) / 50.0).powi(2);
    }
    assert!((sum / 200.0 - 1.0).abs() < 0.3, "{sum}");
    // As many as there are particles in the bins, if more are asked for.
    let all = mock(Some((100_000, 5.0)));
    let within: f64 = all.n.expect("numbers of stars").iter().sum();
    assert!((all.stars.len() as f64 - within).abs() < 0.5);
}
