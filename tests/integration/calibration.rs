//! Ranks of true values: posteriors of known calibration.

use oblate::data::TrackExtent;
use oblate::posterior::{Calibration, RankedFit, rank, trends};
use oblate::report::{calibration, q_errors};
use oblate_samplers::rng::{Domain, standard_normal, stream};

const FITS: usize = 400;

/// Fits of y ~ Normal(θ, 1) with θ ~ Normal(0, 1), whose posterior is Normal(y / 2, 1 / 2); here moved by `shift` and as wide as `width` times
/// the right one, both in its standard deviations. Every second fit has passed its checks.
fn normal_fits(shift: f64, width: f64) -> Vec<RankedFit> {
    let sd = 0.5_f64.sqrt();
    let fit = |i: usize| {
        let mut rng = stream(17, Domain::Prior, 0, i as u64);
        let truth = standard_normal(&mut rng);
        let y = truth + standard_normal(&mut rng);
        let draws: Vec<f64> = (0..2_000)
            .map(|_| 0.5 * y + sd * (shift + width * standard_normal(&mut rng)))
            .collect();
        RankedFit {
            name: format!("fit {i}"),
            r_kpc: vec![10.0; 10 + i % 20],
            extent: TrackExtent {
                length_deg: 10.0 * (10 + i % 20) as f64,
                length_kpc: 200.0 + i as f64,
                mean_kpc: 10.0,
                spread_kpc: y.abs(),
            },
            // 0.3 with 10 bins, and 0.01 less with each more; and twice the error in every other fit.
            q_error: Some((0.3 - 0.01 * (i % 20) as f64) * (1.0 + (i / 20 % 2) as f64)),
            converged: i.is_multiple_of(2),
            ess: 400.0,
            calls: 1_000,
            cpu_seconds: 1.0 + i as f64,
            ranks: vec![("q".to_owned(), rank(&draws, &vec![1.0; draws.len()], truth))],
        }
    };
    (0..FITS).map(fit).collect()
}

#[test]
fn a_rank_is_the_weight_below_the_truth_and_half_of_that_at_it() {
    let (values, weights) = ([1.0, 2.0, 3.0, 4.0], [0.1, 0.2, 0.3, 0.4]);
    for (truth, expected) in [(0.0, 0.0), (2.5, 0.3), (3.0, 0.45), (9.0, 1.0)] {
        assert!((rank(&values, &weights, truth) - expected).abs() < 1e-15);
    }
}

#[test]
fn right_posteriors_are_calibrated() {
    let found = Calibration::new(&normal_fits(0.0, 1.0));
    assert!(found.is_uniform(), "{found:?}");
    let row = &found.all[0];
    assert_eq!((row.fits, found.converged[0].fits), (FITS, FITS / 2));
    for (level, coverage) in oblate::posterior::LEVELS.iter().zip(row.coverage) {
        // Four standard errors: a probability of 6e-5 for each level.
        assert!(
            (coverage - level).abs() < 4.0 * row.coverage_error(*level),
            "{row:?}"
        );
    }
}

/// Three fits that have passed and one that has not: lines of known slope.
#[test]
fn lines_through_the_errors_of_q_are_those_of_least_squares() {
    let mut fits = normal_fits(0.0, 1.0);
    fits.truncate(4);
    for (fit, (x, error)) in fits
        .iter_mut()
        .zip([(1.0, 1.0), (2.0, 3.0), (3.0, 2.0), (9.0, 9.0)])
    {
        (fit.extent.length_kpc, fit.extent.mean_kpc) = (x, 2.0 * error);
        (fit.q_error, fit.converged) = (Some(error), x < 9.0);
    }
    let found = trends(&fits);
    let line = |name: &str| found.iter().find(|t| t.name == name).unwrap();
    let length = line("length_kpc");
    assert_eq!((length.fits, length.mean, length.q_error), (3, 2.0, 2.0));
    let expected = [
        (length.slope, 0.5),
        (length.slope_error, 0.75_f64.sqrt()),
        (length.correlation, 0.5),
    ];
    let radius = line("mean_kpc");
    let exact = [
        (radius.slope, 0.5),
        (radius.slope_error, 0.0),
        (radius.correlation, 1.0),
    ];
    for (found, expected) in expected.into_iter().chain(exact) {
        assert!((found - expected).abs() < 1e-12, "{found} {expected}");
    }
    let svg = q_errors(&fits, &found).unwrap();
    assert_eq!(svg.matches("class=\"fit\"").count(), 4 * found.len());
    assert!(
        found
            .iter()
            .all(|t| t.slope.is_finite() && t.correlation.is_finite())
    );
    // Where none has passed all count.
    fits.iter_mut().for_each(|fit| fit.converged = false);
    assert_eq!(trends(&fits)[0].fits, 4);
    assert!(trends(&fits[..2]).is_empty() && q_errors(&fits[..2], &[]).is_none());
}

#[test]
fn posteriors_that_are_too_narrow_or_moved_are_not() {
    let narrow = Calibration::new(&normal_fits(0.0, 0.5));
    assert!(!narrow.is_uniform());
    // The central 68 % interval of half the width holds a true value with the probability of 0.4972 standard deviations to both sides, 0.381.
    let row = &narrow.all[0];
    let error = (0.381 * 0.619 / FITS as f64).sqrt();
    assert!((row.coverage[1] - 0.381).abs() < 4.0 * error, "{row:?}");
    let high = Calibration::new(&normal_fits(0.5, 1.0));
    assert!(!high.is_uniform());
    // The mean of Φ(x - 1/2) over a standard normal x is Φ(-1/2 / √2) = 0.3618; a rank varies by less than a uniform number, 0.29.
    let error = 0.29 / (FITS as f64).sqrt();
    assert!((high.all[0].mean_rank - 0.3618).abs() < 4.0 * error);
}

#[test]
fn the_verdict_is_about_fits_that_have_passed() {
    let mut fits = normal_fits(0.0, 1.0);
    for fit in fits.iter_mut().filter(|fit| !fit.converged) {
        fit.ranks[0].1 = 0.99;
    }
    assert!(Calibration::new(&fits).is_uniform());
    fits.retain(|fit| !fit.converged);
    let none_passed = Calibration::new(&fits);
    assert!(none_passed.converged.is_empty() && !none_passed.is_uniform());
    assert!(Calibration::new(&[]).is_uniform());
}

#[test]
fn groups_hold_every_fit_that_has_passed_once_and_never_divide_a_number_of_bins() {
    let fits = normal_fits(0.0, 1.0);
    let groups = Calibration::new(&fits).q_by_bins;
    assert_eq!(groups.len(), 3);
    assert_eq!(groups.iter().map(|g| g.row.fits).sum::<usize>(), FITS / 2);
    assert_eq!((groups[0].bins.0, groups[2].bins.1), (10, 28));
    assert!(
        groups
            .windows(2)
            .all(|pair| pair[0].bins.1 < pair[1].bins.0)
    );
    let mut one_length = fits;
    for fit in &mut one_length {
        fit.r_kpc = vec![10.0; 12];
    }
    let groups = Calibration::new(&one_length).q_by_bins;
    assert_eq!(
        groups.iter().map(|g| g.row.fits).collect::<Vec<_>>(),
        [FITS / 2]
    );
}

#[test]
fn the_figure_has_a_panel_for_each_quantity() {
    let mut fits = normal_fits(0.0, 1.0);
    for fit in &mut fits {
        fit.ranks.push(("age_gyr".to_owned(), 0.5));
    }
    let svg = calibration(&fits).expect("a figure");
    for title in [">q<", ">age<"] {
        assert_eq!(svg.matches(title).count(), 1, "{title}");
    }
    // In each panel one line of all fits, one of those that have passed, a level and ticks.
    assert!(
        svg.matches("<rect").count() == 3,
        "background and two frames"
    );
    assert!(calibration(&[]).is_none());
}
