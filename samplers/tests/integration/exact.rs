//! The targets themselves: gradients against differences, evidences against other ways to compute them.

use crate::targets::smooth::{
    Flip, binomial, far8, gauss3, half_plane, iso, mvn13, mvn30, quarter, shells, stiff13, twins13,
};
use oblate_samplers::rng::{Domain, standard_normal, stream};
use oblate_samplers::{Symmetry, Target};
use std::f64::consts::PI;

/// Largest difference between the gradient at `theta` and central differences, relative to the largest slope.
fn gradient_error(target: &dyn Target, theta: &[f64]) -> f64 {
    let mut gradient = vec![0.0; theta.len()];
    let value = target.ln_likelihood_and_gradient(theta, &mut gradient);
    assert_eq!(value, target.ln_likelihood(theta), "one value, two ways");
    let at = |j: usize, step: f64| {
        let mut moved = theta.to_vec();
        moved[j] += step;
        target.ln_likelihood(&moved).ln_likelihood(&moved).unwrap()
    };
    let top = gradient.iter().fold(1e-3_f64, |a, g| a.max(g.abs()));
    (0..theta.len())
        .map(|j| {
            // Fourth order: the step can be long enough for the digits of a value of -1e6.
            let h = 1e-3;
            let slope =
                (8.0 * (at(j, h) - at(j, -h)) - at(j, 2.0 * h) + at(j, -2.0 * h)) / (12.0 * h);
            (slope - gradient[j]).abs() / top
        })
        .fold(0.0, f64::max)
}

#[test]
fn gradients_match_central_differences() {
    let all = [
        iso(2),
        iso(13),
        mvn13(),
        mvn30(),
        stiff13(),
        far8(),
        gauss3(),
        twins13(0.5),
        twins13(0.9),
        binomial(),
        shells(2),
        shells(5),
        shells(13),
    ];
    for target in &all {
        let mut rng = stream(7, Domain::Test, 0, 0);
        let mut worst: f64 = 0.0;
        for _ in 0..100 {
            let z: Vec<f64> = (0..target.dim())
                .map(|_| standard_normal(&mut rng))
                .collect();
            let mut theta = z.clone();
            target.prior().theta_from_z(&z, &mut theta);
            // Close to p = 0 and p = 1 the binomial is curved over any step that is not lost in rounding.
            if target.name == "binomial" {
                theta.iter_mut().for_each(|p| *p = 0.2 + 0.6 * *p);
            }
            worst = worst.max(gradient_error(target, &theta));
        }
        assert!(worst < 1e-6, "{}: {worst}", target.name);
    }
}

#[test]
fn evidences_are_those_of_the_table() {
    let table = [
        (iso(2), -10_f64.ln()),
        (iso(13), -14.966_803),
        (mvn13(), -24.695_225),
        (mvn30(), -24.75 * 10_f64.ln()),
        (twins13(0.5), -31.112_145),
        (twins13(0.9), -31.112_145),
        (far8(), -109.264_917),
        (gauss3(), -8.987_197),
        (half_plane(), -1.175_912),
        (quarter(), -1.386_294),
    ];
    for (target, ln_z) in table {
        assert!(
            (target.ln_z - ln_z).abs() < 6e-7,
            "{}: {}",
            target.name,
            target.ln_z
        );
    }
    // In two dimensions a grid over the cube is enough: the mid-point rule is exact to all digits for such smooth
    // peaks.
    for target in [shells(2), binomial()] {
        let cells = 2000;
        let mut theta = [0.0; 2];
        let mut sum = 0.0;
        for i in 0..cells * cells {
            let u = [i / cells, i % cells].map(|k| (f64::from(k) + 0.5) / f64::from(cells));
            target.prior().theta_from_u(&u, &mut theta);
            sum += target
                .ln_likelihood(&theta)
                .ln_likelihood(&theta)
                .unwrap()
                .exp();
        }
        let ln_z = (sum / f64::from(cells).powi(2)).ln();
        assert!((ln_z - target.ln_z).abs() < 2e-6, "{}: {ln_z}", target.name);
    }
}

#[test]
fn shells_have_the_evidence_of_their_radii() {
    // Neither shell reaches the other or a face of the box: each is the area of a sphere times an integral over its
    // radius.
    for dim in [2, 5, 10, 13, 20, 30] {
        let d = dim as f64;
        let ln_area = 2_f64.ln() + 0.5 * d * PI.ln() - libm::lgamma(0.5 * d);
        let cells = 20_000;
        let width = 2.0 / f64::from(cells);
        let sum: f64 = (0..cells)
            .map(|i| 1.0 + (f64::from(i) + 0.5) * width)
            .map(|r| r.powi(dim as i32 - 1) * (-0.5 * ((r - 2.0) / 0.1).powi(2)).exp())
            .sum();
        let normal = (0.1 * (2.0 * PI).sqrt()).ln();
        let ln_z = 2_f64.ln() + ln_area + (sum * width).ln() - normal - d * 12_f64.ln();
        let told = shells(dim).ln_z;
        assert!((ln_z - told).abs() < 2e-6, "{dim}: {ln_z} {told}");
    }
}

#[test]
fn a_flip_leaves_equal_twins_unchanged() {
    let target = twins13(0.5).with_symmetries(vec![Symmetry::Involution(Box::new(Flip))]);
    let Symmetry::Involution(flip) = &target.symmetries()[0] else {
        panic!("declared as an involution");
    };
    let mut z = vec![0.3; 13];
    let before = target.ln_likelihood(&z);
    assert_eq!(flip.apply(&mut z), Some(0.0));
    assert_eq!(target.ln_likelihood(&z), before);
}
