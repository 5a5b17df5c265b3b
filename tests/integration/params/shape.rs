//! From the shape vector to flattening and axis, and back.

use oblate::Error;
use oblate::params::{QRange, Shape, length_cdf, length_quantile, length_sf};
use oblate::scalar::{Vec3, gradient_of, lift};
use proptest::prelude::*;
use std::f64::consts::{FRAC_1_SQRT_2, FRAC_2_SQRT_PI};

/// `sqrt(2 / pi)`.
const SQRT_2_OVER_PI: f64 = FRAC_2_SQRT_PI * FRAC_1_SQRT_2;

const RANGE: QRange = QRange {
    q_min: 0.5,
    q_max: 1.5,
};

#[test]
fn series_and_closed_form_join() {
    // On both sides of the joint against the closed form, whose rounding error is 2e-16 / F(1) = 1e-15.
    for r in [0.9, 0.99, 0.999_999, 1.0, 1.000_001, 1.1] {
        let closed = libm::erf(r * FRAC_1_SQRT_2) - SQRT_2_OVER_PI * r * (-0.5 * r * r).exp();
        let f = length_cdf(r);
        assert!((f / closed - 1.0).abs() < 3e-15, "{r}: {f} {closed}");
    }
}

#[test]
fn the_origin_follows_the_cubic_law_to_the_last_digits() {
    for r in [1e-100, 1e-30, 1e-9] {
        let law = SQRT_2_OVER_PI * r * r * r / 3.0;
        assert!((length_cdf(r) / law - 1.0).abs() < 1e-15, "{r}");
    }
}

#[test]
fn the_two_tails_add_up_to_one() {
    for i in 0..80 {
        let r = 0.1 * f64::from(i);
        assert!((length_cdf(r) + length_sf(r) - 1.0).abs() < 4e-16, "{r}");
    }
}

#[test]
fn q_and_its_gradient_are_finite_at_and_near_the_origin() {
    for dir in [
        [0.0, 0.0, 0.0],
        [1e-200, 0.0, 0.0],
        [0.0, -1e-13, 1e-13],
        [1e-11, 2e-11, 3e-11],
        [1e-5, 0.0, 0.0],
    ] {
        let shape = RANGE.shape(Vec3::from(lift(&dir)));
        assert!((shape.q.re - 0.5).abs() < 1e-14);
        assert!((shape.axis.map(|a| a.re).norm2() - 1.0).abs() < 1e-15);
        for part in [shape.q, shape.axis.x, shape.axis.y, shape.axis.z] {
            assert!(gradient_of(&part).iter().all(|g| g.is_finite()), "{dir:?}");
        }
        assert!(gradient_of(&shape.q).iter().all(|g| g.abs() < 1e-9));
    }
}

#[test]
fn derivative_of_the_fraction_matches_central_differences_across_the_joint() {
    for i in 1..=60 {
        let r = 0.1 * f64::from(i) + 1e-4;
        let h = 1e-5 * r;
        let central = (length_cdf(r + h) - length_cdf(r - h)) / (2.0 * h);
        let dual = RANGE.shape(Vec3::from(lift(&[r, 0.0, 0.0]))).q;
        let exact = SQRT_2_OVER_PI * r * r * (-0.5 * r * r).exp();
        assert!((gradient_of(&dual)[0] / exact - 1.0).abs() < 1e-14, "{r}");
        // Truncation h^2 F'''/6 and rounding 2e-16 F / h.
        let tolerance = h * h + 2e-16 / h;
        assert!(
            (central - exact).abs() < tolerance,
            "{r}: {central} {exact}"
        );
    }
}

#[test]
fn gradient_of_q_and_axis_matches_central_differences() {
    for dir in [[0.3, -0.4, 0.2], [1.5, 0.7, 2.0], [-0.01, 0.02, 0.005]] {
        let dual = RANGE.shape(Vec3::from(lift(&dir)));
        let parts = |s: Shape<f64>| [s.q, s.axis.x, s.axis.y, s.axis.z];
        let exact = [dual.q, dual.axis.x, dual.axis.y, dual.axis.z].map(|d| gradient_of(&d));
        for j in 0..3 {
            let h = 1e-6 * dir[j].abs();
            let at = |sign: f64| {
                let mut moved = dir;
                moved[j] += sign * h;
                parts(RANGE.shape(Vec3::from(moved)))
            };
            let (up, down) = (at(1.0), at(-1.0));
            for i in 0..4 {
                let central = (up[i] - down[i]) / (2.0 * h);
                // Rounding 2e-16 / h dominates; the derivatives of the axis are of the order 1 / |dir|.
                let tolerance = 4e-16 / h + 1e-9 * (1.0 + 1.0 / dir[j].abs());
                assert!((central - exact[i][j]).abs() < tolerance, "{dir:?} {i} {j}");
            }
        }
    }
}

#[test]
fn impossible_shapes_are_refused_by_name() {
    let axis = Vec3::new(0.0, 0.0, 1.0);
    for q in [0.49, 1.5, f64::NAN] {
        let error = RANGE.dir(q, axis).unwrap_err();
        assert!(matches!(error, Error::OutsidePrior { ref name, .. } if name == "q"));
    }
    assert!(matches!(
        RANGE.dir(1.0, Vec3::zero()),
        Err(Error::Setting { .. })
    ));
}

proptest! {
    #[test]
    fn shape_and_dir_invert_each_other(
        q in 0.5_f64..1.5, x in -1.0_f64..1.0, y in -1.0_f64..1.0, z in 0.0_f64..1.0, size in -3.0_f64..3.0
    ) {
        prop_assume!(x * x + y * y + z * z > 1e-6);
        let axis = Vec3::new(x, y, z) * 10_f64.powf(size);
        let dir = RANGE.dir(q, axis).unwrap();
        let back = RANGE.shape(dir);
        prop_assert!((back.q - q).abs() < 1e-15 * 4.0);
        let unit = axis * (1.0 / axis.norm2().sqrt());
        // At q_min exactly the direction is lost by nature.
        prop_assume!(q > 0.5);
        prop_assert!((back.axis - unit).norm2().sqrt() < 1e-15 * 4.0);
    }

    #[test]
    fn length_and_probability_invert_each_other(r in 1e-9_f64..30.0) {
        let back = length_quantile(length_cdf(r), length_sf(r));
        prop_assert!((back / r - 1.0).abs() < 1e-14, "{} {}", r, back);
    }
}
