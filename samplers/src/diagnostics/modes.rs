//! Whether several chains give the modes of a posterior the same weights.

use super::{bulk_ess, chi2_p_value, mean_ess};
use nalgebra::DMatrix;

/// Maximum number of iterations of 2-means, which needs a few.
const ITERATIONS: usize = 10;

/// Labels draws (row-major, `dim` columns) by 2-means in coordinates scaled to unit deviation, started at the two ends
/// of the major axis. Two modes get two labels; a single one is cut in two halves, whose weights chains must agree on
/// as well.
#[must_use]
pub fn two_means(draws: &[f64], dim: usize) -> Vec<bool> {
    let count = draws.len() / dim.max(1);
    if count < 2 {
        return vec![false; count];
    }
    let scaled = scaled(draws, dim);
    let rows = || scaled.chunks_exact(dim);
    let mut covariance = DMatrix::<f64>::zeros(dim, dim);
    for row in rows() {
        for i in 0..dim {
            for j in 0..dim {
                covariance[(i, j)] += row[i] * row[j] / count as f64;
            }
        }
    }
    let eigen = covariance.symmetric_eigen();
    let axis = eigen.eigenvectors.column(eigen.eigenvalues.imax());
    let along = |row: &[f64]| row.iter().zip(axis.iter()).map(|(x, a)| x * a).sum::<f64>();
    let mut labels: Vec<bool> = rows().map(|row| along(row) > 0.0).collect();
    for _ in 0..ITERATIONS {
        let mut centres = [vec![0.0; dim], vec![0.0; dim]];
        let mut sizes = [0.0_f64; 2];
        for (row, label) in rows().zip(&labels) {
            let side = usize::from(*label);
            sizes[side] += 1.0;
            for (c, x) in centres[side].iter_mut().zip(row) {
                *c += x;
            }
        }
        for (centre, size) in centres.iter_mut().zip(sizes) {
            centre.iter_mut().for_each(|c| *c /= size.max(1.0));
        }
        let distance = |row: &[f64], side: usize| -> f64 {
            row.iter()
                .zip(&centres[side])
                .map(|(x, c)| (x - c).powi(2))
                .sum()
        };
        labels = rows()
            .map(|row| distance(row, 1) < distance(row, 0))
            .collect();
    }
    labels
}

/// p-value of the hypothesis that all chains give a label the same weight: chi-square over chains of the differences
/// from the common weight, each with the binomial error of the effective size of its own label.
///
/// For a chain that never changes its label the ESS of `trace` is taken, some other quantity of the same chains (ln L): such a
/// chain has to agree with the others as well. 1 if no chain ever changes and all agree.
#[must_use]
pub fn mode_agreement(labels: &[&[bool]], traces: &[&[f64]]) -> f64 {
    let weights: Vec<f64> = labels
        .iter()
        .map(|l| l.iter().filter(|x| **x).count() as f64 / l.len().max(1) as f64)
        .collect();
    let sizes: Vec<f64> = labels
        .iter()
        .zip(traces)
        .zip(&weights)
        .map(|((label, trace), weight)| {
            if *weight > 0.0 && *weight < 1.0 {
                let numbers: Vec<f64> = label.iter().map(|x| f64::from(u8::from(*x))).collect();
                mean_ess(&[&numbers])
            } else {
                bulk_ess(&[trace])
            }
        })
        .collect();
    let total: f64 = sizes.iter().sum();
    let common = weights.iter().zip(&sizes).map(|(w, n)| w * n).sum::<f64>() / total;
    if !common.is_finite() {
        return 0.0;
    }
    if common <= 0.0 || common >= 1.0 {
        return 1.0;
    }
    let chi2: f64 = weights
        .iter()
        .zip(&sizes)
        .map(|(w, n)| (w - common).powi(2) * n / (common * (1.0 - common)))
        .sum();
    chi2_p_value(chi2, weights.len())
}

fn scaled(draws: &[f64], dim: usize) -> Vec<f64> {
    let count = (draws.len() / dim) as f64;
    let mut scaled = draws.to_vec();
    for j in 0..dim {
        let column = || draws.iter().skip(j).step_by(dim);
        let mean = column().sum::<f64>() / count;
        let sd = (column().map(|x| (x - mean).powi(2)).sum::<f64>() / count).sqrt();
        let scale = if sd > 0.0 { 1.0 / sd } else { 0.0 };
        for x in scaled.iter_mut().skip(j).step_by(dim) {
            *x = (*x - mean) * scale;
        }
    }
    scaled
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Domain, standard_normal, stream, unit_open};

    /// Chains that hop between two modes with this probability per step, toward `+` with weight `plus`.
    fn hopping(hop: f64, plus: f64, start_plus: &[bool]) -> (Vec<f64>, Vec<Vec<f64>>) {
        let mut draws = Vec::new();
        let mut traces = Vec::new();
        for (chain, start) in start_plus.iter().enumerate() {
            let mut rng = stream(5, Domain::Test, chain as u64, 0);
            let mut up = *start;
            let mut trace = Vec::new();
            for _ in 0..2000 {
                if unit_open(&mut rng) < hop {
                    up = unit_open(&mut rng) < plus;
                }
                let centre = if up { 1.5 } else { -1.5 };
                draws.push(centre + 0.1 * standard_normal(&mut rng));
                draws.push(0.1 * standard_normal(&mut rng));
                trace.push(standard_normal(&mut rng));
            }
            traces.push(trace);
        }
        (draws, traces)
    }

    fn agreement(draws: &[f64], traces: &[Vec<f64>]) -> f64 {
        let labels = two_means(draws, 2);
        let labels: Vec<&[bool]> = labels.chunks_exact(2000).collect();
        let traces: Vec<&[f64]> = traces.iter().map(Vec::as_slice).collect();
        mode_agreement(&labels, &traces)
    }

    #[test]
    fn two_clumps_get_two_labels() {
        let (draws, _) = hopping(0.5, 0.5, &[true]);
        let labels = two_means(&draws, 2);
        let right = draws[0] > 0.0;
        for (row, label) in draws.chunks_exact(2).zip(&labels) {
            assert_eq!((row[0] > 0.0) == right, *label == labels[0]);
        }
    }

    #[test]
    fn hopping_chains_agree_and_stuck_ones_do_not() {
        let (draws, traces) = hopping(0.3, 0.7, &[true, false, true, false]);
        assert!(agreement(&draws, &traces) > 0.01);
        let (draws, traces) = hopping(0.0, 0.5, &[true, false, true, true]);
        assert!(agreement(&draws, &traces) < 1e-6);
        // One chain that never changes its mode, among others that do.
        let (mut draws, traces) = hopping(0.3, 0.5, &[true, false, true, false]);
        for row in draws[..4000].chunks_exact_mut(2) {
            row[0] = row[0].abs();
        }
        assert!(agreement(&draws, &traces) < 1e-6);
    }
}
