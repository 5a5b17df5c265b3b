//! Splitting points into clusters, each with its own ellipsoid.

use super::Ellipsoid;
use crate::nested::live::Points;

/// Lloyd iterations of the two-means split.
const ITERATIONS: usize = 10;

/// How an ellipsoid is put around rows.
pub(super) type Fit<'a> = dyn FnMut(&[usize]) -> Option<Ellipsoid> + 'a;

/// The ellipsoids of `rows`, whose own ellipsoid is `whole`: split in two, repeatedly, while the volume decreases by
/// more than the additional parameters cost. No cluster has fewer than 2 d rows.
pub(super) fn split(
    points: &Points,
    rows: &[usize],
    whole: Ellipsoid,
    fit: &mut Fit<'_>,
) -> Vec<Ellipsoid> {
    let d = points.dim();
    if rows.len() < 4 * d {
        return vec![whole];
    }
    let Some((left, right)) = two_means(points, rows, &whole) else {
        return vec![whole];
    };
    if left.len().min(right.len()) < 2 * d {
        return vec![whole];
    }
    let (Some(first), Some(second)) = (fit(&left), fit(&right)) else {
        return vec![whole];
    };
    let count = rows.len() as f64;
    let parameters = (d * (d + 3)) as f64 / 2.0;
    let needed = parameters * count.ln() / count;
    let gain = whole.ln_volume - ln_total(&[first.ln_volume, second.ln_volume]);
    let mut pieces = split(points, &left, first, fit);
    pieces.extend(split(points, &right, second, fit));
    if gain > needed {
        return pieces;
    }
    let volumes: Vec<f64> = pieces.iter().map(|e| e.ln_volume).collect();
    let gain = whole.ln_volume - ln_total(&volumes);
    if gain > needed * (pieces.len() - 1) as f64 {
        pieces
    } else {
        vec![whole]
    }
}

fn ln_total(ln_volumes: &[f64]) -> f64 {
    crate::diagnostics::ln_sum_exp(ln_volumes)
}

/// Two clusters by k-means, every axis in units of its own scatter, started from the ends of the longest axis.
/// `None` if one of them is empty.
fn two_means(
    points: &Points,
    rows: &[usize],
    whole: &Ellipsoid,
) -> Option<(Vec<usize>, Vec<usize>)> {
    let scale = inverse_variance(points, rows);
    let (mut a, mut b) = whole.ends_of_major_axis();
    let mut left = Vec::new();
    let mut right = Vec::new();
    for _ in 0..ITERATIONS {
        let distance = |x: &[f64], c: &[f64]| -> f64 {
            x.iter()
                .zip(c)
                .zip(&scale)
                .map(|((x, c), s)| (x - c).powi(2) * s)
                .sum()
        };
        let (l, r): (Vec<usize>, Vec<usize>) = rows
            .iter()
            .copied()
            .partition(|&i| distance(points.row(i), &a) <= distance(points.row(i), &b));
        if l.is_empty() || r.is_empty() {
            return None;
        }
        let settled = l == left;
        (left, right) = (l, r);
        if settled {
            break;
        }
        a = mean(points, &left);
        b = mean(points, &right);
    }
    Some((left, right))
}

fn mean(points: &Points, rows: &[usize]) -> Vec<f64> {
    let mut mean = vec![0.0; points.dim()];
    for &i in rows {
        for (m, x) in mean.iter_mut().zip(points.row(i)) {
            *m += x / rows.len() as f64;
        }
    }
    mean
}

/// One over the variance of every axis; zero for an axis without scatter, which then does not count.
fn inverse_variance(points: &Points, rows: &[usize]) -> Vec<f64> {
    let center = mean(points, rows);
    let mut variance = vec![0.0; points.dim()];
    for &i in rows {
        for ((v, x), c) in variance.iter_mut().zip(points.row(i)).zip(&center) {
            *v += (x - c).powi(2) / rows.len() as f64;
        }
    }
    variance
        .into_iter()
        .map(|v| if v > 0.0 { 1.0 / v } else { 0.0 })
        .collect()
}
