use super::*;
use crate::rng::standard_normal;

fn blobs(centers: &[[f64; 2]], sd: f64, each: usize) -> Points {
    let mut rng = stream(3, Domain::Test, 0, 0);
    let mut points = Points::new(2);
    for c in centers {
        for _ in 0..each {
            let u = [
                c[0] + sd * standard_normal(&mut rng),
                c[1] + sd * standard_normal(&mut rng),
            ];
            points.push(&u, 0.0, 0.0, u32::from(points.len().is_multiple_of(2)));
        }
    }
    points
}

/// Distance to the nearest ellipsoid in its own units: at most 1 inside.
fn nearest(bound: &Bound, x: &[f64]) -> f64 {
    let distances = bound.pieces().iter().map(|e| e.distance(x));
    distances.fold(f64::INFINITY, f64::min)
}

#[test]
fn two_blobs_make_two_ellipsoids_that_hold_all_points() {
    let points = blobs(&[[0.3, 0.3], [0.7, 0.6]], 0.02, 200);
    let drawn = Bound::for_draws(&points, 1, 0).unwrap();
    assert!((0..points.len()).all(|i| nearest(&drawn, points.row(i)) <= 1.0));
    let mut bounds = Bound::for_steps(&points);
    bounds.push(drawn);
    for bound in bounds {
        assert_eq!(bound.pieces().len(), 2);
        assert_ne!(bound.label(points.row(0)), bound.label(points.row(399)));
    }
}

#[test]
fn chains_use_the_metric_of_the_other_half() {
    // Even lineages in the left blob, odd ones in the right.
    let mut points = blobs(&[[0.3, 0.3], [0.7, 0.6]], 0.02, 50);
    points.genealogy = (0..100).map(|i| u32::from(i >= 50).into()).collect();
    let bounds = Bound::for_steps(&points);
    for (i, bound) in [(99, &bounds[0]), (0, &bounds[1])] {
        assert!(nearest(bound, points.row(i)) <= 1.0);
        assert!(nearest(bound, points.row(99 - i)) > 3.0);
    }
}

#[test]
fn one_blob_stays_one_ellipsoid() {
    let points = blobs(&[[0.5, 0.5]], 0.1, 400);
    for bound in Bound::for_steps(&points) {
        assert_eq!(bound.pieces().len(), 1);
        assert_eq!(bound.label(&[0.0, 0.0]), bound.label(&[0.5, 0.5]));
    }
}

#[test]
fn labels_agree_with_their_test() {
    let bound = overlapping();
    let mut rng = stream(4, Domain::Test, 0, 0);
    for _ in 0..2000 {
        let x = [unit_open(&mut rng), unit_open(&mut rng)];
        let label = bound.label(&x);
        for other in 0..=bound.parts.len() {
            assert_eq!(bound.has_label(&x, other), other == label);
        }
    }
}

/// Two ellipsoids with a large overlap.
pub(in crate::nested) fn overlapping() -> Bound {
    let points = blobs(&[[0.4, 0.5], [0.58, 0.5]], 0.05, 60);
    let rows: Vec<usize> = (0..120).collect();
    let bound = Bound {
        whole: Ellipsoid::fit(&points, &rows).unwrap(),
        parts: vec![
            Ellipsoid::fit(&points, &rows[..60]).unwrap(),
            Ellipsoid::fit(&points, &rows[60..]).unwrap(),
        ],
    };
    let shared = (0..200)
        .flat_map(|i| (0..200).map(move |j| [f64::from(i) / 200.0, f64::from(j) / 200.0]))
        .filter(|x| bound.parts.iter().all(|e| e.contains(x)))
        .count();
    assert!(shared > 300, "the ellipsoids share {shared} of 40000 cells");
    bound
}

#[test]
fn draws_from_overlapping_ellipsoids_are_uniform() {
    // Cells of a fine grid that lie wholly inside the union must be hit equally often.
    const SIDE: usize = 25;
    let bound = overlapping();
    let corner = |i: usize, j: usize| [i as f64 / SIDE as f64, j as f64 / SIDE as f64];
    let inside = |i, j| nearest(&bound, &corner(i, j)) <= 1.0;
    let mut hits = vec![0_u32; SIDE * SIDE];
    let mut rng = stream(5, Domain::Test, 0, 0);
    let (mut ball, mut x) = ([0.0; 2], [0.0; 2]);
    for _ in 0..200_000 {
        if bound.draw(&mut rng, &mut ball, &mut x) && x.iter().all(|x| (0.0..1.0).contains(x)) {
            let cell = |x: f64| {
                (0..SIDE)
                    .rev()
                    .find(|&k| x >= k as f64 / SIDE as f64)
                    .unwrap()
            };
            hits[cell(x[0]) * SIDE + cell(x[1])] += 1;
        }
    }
    let full: Vec<f64> = (0..SIDE)
        .flat_map(|i| (0..SIDE).map(move |j| (i, j)))
        .filter(|&(i, j)| {
            inside(i, j) && inside(i + 1, j) && inside(i, j + 1) && inside(i + 1, j + 1)
        })
        .map(|(i, j)| f64::from(hits[i * SIDE + j]))
        .collect();
    let cells = full.len() as f64;
    let mean = full.iter().sum::<f64>() / cells;
    let chi2: f64 = full.iter().map(|h| (h - mean).powi(2) / mean).sum();
    // Wilson-Hilferty normal deviate of a chi-square with cells - 1 degrees, within 3.5.
    let k = cells - 1.0;
    let z = ((chi2 / k).cbrt() - (1.0 - 2.0 / (9.0 * k))) / (2.0 / (9.0 * k)).sqrt();
    assert!(cells > 60.0 && z.abs() < 3.5, "{cells} cells, z = {z}");
}
