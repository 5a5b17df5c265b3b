//! The minor axes of haloes, and how those of a population lie: exact densities, evidences and hyperparameters.

use oblate::params::{DIM, QRange, StreamParams};
use oblate::population::{Alignment, AlignmentEvidence, AxisPosterior, alignments};
use oblate::potential::HaloKind;
use oblate::scalar::Vec3;
use oblate::stream::MinorAxis;

/// A stream whose axis is known: all its draws have one cosine.
fn known(mu: f64) -> AxisPosterior {
    drawn(vec![mu; 4])
}

fn drawn(cosines: Vec<f64>) -> AxisPosterior {
    AxisPosterior {
        name: "a stream".to_owned(),
        weights: vec![1.0; cosines.len()],
        effective_size: cosines.len() as f64,
        converged: true,
        cosines: cosines.into_iter().map(|mu| vec![mu]).collect(),
    }
}

/// The cosine with this fraction of axes below it, of axes within `scale_deg` of the direction.
fn quantile(scale_deg: f64, fraction: f64) -> f64 {
    let concentration = 0.5 / scale_deg.to_radians().powi(2);
    let cells = 20_000;
    let density =
        |cell: usize| (concentration * (((cell as f64 + 0.5) / cells as f64).powi(2) - 1.0)).exp();
    let total: f64 = (0..cells).map(density).sum();
    let mut below = 0.0;
    for cell in 0..cells {
        below += density(cell) / total;
        if below >= fraction {
            return (cell as f64 + 0.5) / cells as f64;
        }
    }
    1.0
}

/// Axes of `count` streams, evenly over the quantiles of their distribution.
fn population(count: usize, cosine: impl Fn(f64) -> f64) -> Vec<AxisPosterior> {
    (0..count)
        .map(|i| known(cosine((i as f64 + 0.5) / count as f64)))
        .collect()
}

fn of(found: &[AlignmentEvidence], alignment: Alignment) -> &AlignmentEvidence {
    let found = found.iter().find(|one| one.alignment == alignment);
    found.expect("all three")
}

/// An axis that is known to point there: the density of aligned axes is `sqrt(k) / D(sqrt(k))` with Dawson's function D, here by its
/// series, and the odds are its mean over the scale.
#[test]
fn the_evidence_of_one_axis_is_the_mean_of_its_density() {
    let dawson = |x: f64| {
        let (mut term, mut sum) = (x, x);
        for n in 1..400 {
            term *= -2.0 * x * x / f64::from(2 * n + 1);
            sum += term;
        }
        sum
    };
    // By Simpson's rule where the series would cancel.
    let normalisation = |k: f64| {
        if k < 9.0 {
            return dawson(k.sqrt()) / k.sqrt();
        }
        let n = 4_000;
        let f = |i: usize| (k * ((i as f64 / f64::from(n)).powi(2) - 1.0)).exp();
        let inner: f64 = (1..n as usize)
            .map(|i| f(i) * if i % 2 == 1 { 4.0 } else { 2.0 })
            .sum();
        (f(0) + inner + f(n as usize)) / (3.0 * f64::from(n))
    };
    let cells = 5_500;
    let mean: f64 = (0..cells)
        .map(|cell| 5.0 + 55.0 * (f64::from(cell) + 0.5) / f64::from(cells))
        .map(|scale: f64| 1.0 / normalisation(0.5 / scale.to_radians().powi(2)))
        .sum::<f64>()
        / f64::from(cells);
    let found = alignments(&[known(1.0)]).expect("a population");
    let aligned = of(&found, Alignment::Aligned);
    // The grid over the scale has cells of half a degree.
    assert!(
        (aligned.ln_odds - mean.ln()).abs() < 1e-3,
        "{} {}",
        aligned.ln_odds,
        mean.ln()
    );
    assert!(aligned.error < 1e-12);
    // A mixture of which the mean fraction is aligned: the likelihood is linear in the fraction.
    let mixture = of(&found, Alignment::Mixture);
    assert!((mixture.ln_odds - (0.5 + 0.5 * mean).ln()).abs() < 1e-3);
    assert!(of(&found, Alignment::Isotropic).ln_odds.abs() < f64::MIN_POSITIVE);
}

#[test]
fn axes_that_are_not_measured_tell_nothing() {
    let isotropic: Vec<f64> = (0..4_000).map(|i| (f64::from(i) + 0.5) / 4_000.0).collect();
    let found = alignments(&vec![drawn(isotropic); 12]).expect("a population");
    for one in &found {
        assert!(one.ln_odds.abs() < 1e-3, "{one:?}");
    }
    let scale = of(&found, Alignment::Aligned)
        .scale_deg
        .as_ref()
        .expect("a scale");
    assert!((scale.median - 32.5).abs() < 0.6, "{scale:?}");
}

#[test]
fn aligned_axes_are_found_with_their_scale() {
    let found = alignments(&population(30, |u| quantile(15.0, u))).expect("a population");
    let aligned = of(&found, Alignment::Aligned);
    let scale = aligned.scale_deg.as_ref().expect("a scale");
    assert!(scale.lo68 < 15.0 && 15.0 < scale.hi68, "{scale:?}");
    assert!(aligned.ln_odds > 30.0, "{aligned:?}");
    let mixture = of(&found, Alignment::Mixture);
    assert!(
        mixture.fraction.as_ref().expect("a fraction").lo95 > 0.7,
        "{mixture:?}"
    );
    // The simpler one has the larger evidence.
    assert!(mixture.ln_odds < aligned.ln_odds);
}

#[test]
fn isotropic_axes_are_found_isotropic() {
    let found = alignments(&population(30, |u| u)).expect("a population");
    assert!(of(&found, Alignment::Aligned).ln_odds < -1.0, "{found:?}");
    assert!(of(&found, Alignment::Mixture).ln_odds < 0.0, "{found:?}");
}

#[test]
fn a_mixture_is_found_with_its_fraction() {
    let mut streams = population(20, |u| quantile(10.0, u));
    streams.extend(population(20, |u| u));
    let found = alignments(&streams).expect("a population");
    let mixture = of(&found, Alignment::Mixture);
    let fraction = mixture.fraction.as_ref().expect("a fraction");
    assert!(fraction.lo68 < 0.5 && 0.5 < fraction.hi68, "{fraction:?}");
    assert!(
        mixture.ln_odds > of(&found, Alignment::Aligned).ln_odds + 5.0,
        "{found:?}"
    );
}

/// The error by the number of draws: the scatter of the odds over posteriors with other draws. The odds are a mean over scales and the error is that
/// at the best one: of so many streams the scale is known so well that the two do not differ.
#[test]
fn the_error_is_the_scatter_over_draws() {
    let odds = |seed: u64| {
        let mut rng = oblate_samplers::rng::stream(seed, oblate_samplers::rng::Domain::Prior, 0, 0);
        let streams: Vec<AxisPosterior> = (0..40)
            .map(|_| {
                let normal = |_| oblate_samplers::rng::standard_normal(&mut rng);
                // Cosines of a posterior that prefers the direction.
                drawn(
                    (0..100)
                        .map(normal)
                        .map(|x: f64| (-0.25 * x.abs()).exp())
                        .collect(),
                )
            })
            .collect();
        let found = alignments(&streams).expect("a population");
        let aligned = of(&found, Alignment::Aligned);
        (aligned.ln_odds, aligned.error)
    };
    let runs: Vec<(f64, f64)> = (0..100).map(odds).collect();
    let count = runs.len() as f64;
    let mean = runs.iter().map(|run| run.0).sum::<f64>() / count;
    let scatter =
        (runs.iter().map(|run| (run.0 - mean).powi(2)).sum::<f64>() / (count - 1.0)).sqrt();
    let stated = runs.iter().map(|run| run.1).sum::<f64>() / count;
    // Four standard errors of the standard deviation of as many values: 28 %.
    let error = 1.0 / (2.0 * (count - 1.0)).sqrt();
    assert!(
        (scatter / stated - 1.0).abs() < 4.0 * error,
        "{scatter} {stated}"
    );
}

#[test]
fn a_stream_without_draws_is_refused() {
    let refused = alignments(&[known(0.3), drawn(Vec::new())]).expect_err("refused");
    assert!(refused.to_string().contains("a stream"), "{refused}");
}

/// Parameters of a halo with this shape vector and second axis.
fn halo(dir: [f64; 3], p_halo: f64, psi_halo_deg: f64) -> StreamParams<f64> {
    let [dir_x, dir_y, dir_z] = dir;
    StreamParams {
        dir_x,
        dir_y,
        dir_z,
        p_halo,
        psi_halo_deg,
        ..StreamParams::from_array([0.0; DIM])
    }
}

/// By hand: with the axis `n` along the line of sight the second axis is at the angle psi from the sky's x axis.
#[test]
fn the_minor_axis_is_the_shortest_one() {
    let q_range = QRange::default();
    let (x, y, z) = (
        Vec3::new(1.0, 0.0, 0.0),
        Vec3::new(0.0, 1.0, 0.0),
        Vec3::new(0.0, 0.0, 1.0),
    );
    // Shape vectors of these lengths have q = 0.86 and 1.24.
    let (oblate, prolate) = ([0.0, 0.0, 1.3], [0.0, 0.0, 2.0]);
    let (sin, cos) = 30.0_f64.to_radians().sin_cos();
    for (kind, dir, p, expected) in [
        (HaloKind::Nfw, oblate, 1.0, [0.0, 0.0, 1.0]),
        (HaloKind::NfwTriaxial, oblate, 0.9, [0.0, 0.0, 1.0]),
        (HaloKind::NfwTriaxial, oblate, 1.3, [0.0, 0.0, 1.0]),
        (HaloKind::NfwTriaxial, oblate, 0.8, [cos, sin, 0.0]),
        (HaloKind::NfwTriaxial, prolate, 0.9, [cos, sin, 0.0]),
        (HaloKind::NfwTriaxial, prolate, 1.1, [sin, cos, 0.0]),
    ] {
        let minor = MinorAxis::new(kind, &halo(dir, p, 30.0), q_range);
        for (direction, expected) in [x, y, z].into_iter().zip(expected) {
            let cosines = minor.cosines(direction);
            assert_eq!(cosines.len(), 1, "{kind:?} {p}");
            assert!(
                (cosines[0] - expected).abs() < 1e-12,
                "{kind:?} {p}: {cosines:?}"
            );
        }
    }
    // All directions on the sky: the mean of |cos| over the circle is 2 / pi, that of cos^2 is a half.
    let minor = MinorAxis::new(HaloKind::Nfw, &halo(prolate, 1.0, 0.0), q_range);
    assert!(minor.cosines(z).iter().all(|cosine| cosine.abs() < 1e-12));
    let on_the_sky = minor.cosines(y);
    let mean = |power: i32| {
        on_the_sky.iter().map(|c| c.powi(power)).sum::<f64>() / on_the_sky.len() as f64
    };
    assert!((mean(1) - std::f64::consts::FRAC_2_PI).abs() < 1e-3);
    assert!((mean(2) - 0.5).abs() < 1e-12);
}

/// Isotropic symmetry axes of prolate haloes have isotropic minor axes: each gives the likelihood of isotropic axes on the mean.
#[test]
fn minor_axes_of_isotropic_prolate_haloes_are_isotropic() {
    let direction = Vec3::new(0.0, 0.0, 1.0);
    let cosines: Vec<Vec<f64>> = (0..2_000)
        .map(|i| {
            let mu = (f64::from(i) + 0.5) / 2_000.0;
            let axis = Vec3::new((1.0 - mu * mu).sqrt(), 0.0, mu);
            MinorAxis::PerpendicularTo(axis).cosines(direction)
        })
        .collect();
    let stream = AxisPosterior {
        name: "a stream".to_owned(),
        weights: vec![1.0; cosines.len()],
        effective_size: cosines.len() as f64,
        converged: true,
        cosines,
    };
    let angle = stream.angle_deg();
    assert!((angle.median - 60.0).abs() < 0.2, "{angle:?}");
    let found = alignments(&[stream]).expect("a population");
    let aligned = of(&found, Alignment::Aligned);
    assert!(aligned.ln_odds.abs() < 0.01, "{aligned:?}");
}
