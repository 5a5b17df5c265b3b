//! The neighbours of each particle of a table in the space of its random numbers, and what they say about the stream around it.

use super::recipe::MAX_NORMALS;
use crate::scalar::LANES;
use nalgebra::{DMatrix, DVector};

/// Neighbours of a particle among those of its tail and release time, where there are as many.
const NEIGHBOURS: usize = 8;

/// Particles of one tail and release time among which neighbours are sought.
const COMPARED: usize = 64;

/// Added to the squared distance of a neighbour, in the denominator of its weight in the fit.
const SOFTENING: f64 = 0.5;

/// Added to the diagonal of the fit's matrix, as a fraction of its mean.
const RIDGE: f64 = 0.03;

/// The neighbours of each particle, in blocks of [`LANES`] particles.
///
/// Each particle stands for all random numbers near its own: a normal distribution around them of standard deviation s. On the sky this is
/// an ellipse, whose axes are a linear fit to where the neighbours are.
#[derive(Clone, Debug, PartialEq)]
pub struct Neighbourhood {
    /// Neighbours of a particle.
    pub count: usize,
    /// Random numbers of a release.
    pub numbers: usize,
    /// How far in the table neighbours and partners are at most.
    pub reach: usize,
    /// The neighbours' numbers in the table: by block, neighbour, lane. Lanes beyond the last particle repeat it.
    pub indices: Vec<[u32; LANES]>,
    /// The partner at the next release time, or that before for the last: by block, lane.
    pub partners: Vec<[u32; LANES]>,
    /// Weight of a neighbour's displacement in the stream's extent along each random number: by block, neighbour, random number, lane.
    pub weights: Vec<[f64; LANES]>,
}

/// Standard deviation of what a particle of `particles` stands for, in those of the random numbers: fewer particles must be smeared over
/// more, and what is smeared over curves is biased.
pub(super) fn smearing(particles: usize) -> f64 {
    (0.4 * (512.0 / particles as f64).powf(0.18)).min(0.5)
}

impl Neighbourhood {
    /// From the random numbers of all particles, in the order of the table: `per_tail` of each tail at each release time.
    pub(super) fn new(
        xi: &[[f64; MAX_NORMALS]],
        numbers: usize,
        per_tail: usize,
        smearing: f64,
    ) -> Self {
        let n = xi.len();
        let count = NEIGHBOURS.min(per_tail - 1);
        let blocks = n.div_ceil(LANES);
        let mut found = Self {
            count,
            numbers,
            reach: 2 * per_tail,
            indices: vec![[0; LANES]; blocks * count],
            partners: vec![[0; LANES]; blocks],
            weights: vec![[0.0; LANES]; blocks * count * numbers],
        };
        let offset = found.reach;
        for place in 0..blocks * LANES {
            let (block, lane) = (place / LANES, place % LANES);
            let i = place.min(n - 1);
            let partner = if i + offset < n {
                i + offset
            } else {
                i - offset
            };
            found.partners[block][lane] = index(partner);
            let (nearest, weights) = fit(xi, i, numbers, per_tail, count, smearing);
            for (j, neighbour) in nearest.iter().enumerate() {
                let at = block * count + j;
                found.indices[at][lane] = index(*neighbour);
                for k in 0..numbers {
                    found.weights[at * numbers + k][lane] = weights[(k, j)];
                }
            }
        }
        found
    }
}

#[allow(
    clippy::cast_possible_truncation,
    reason = "a table has far less than 2^32 particles"
)]
fn index(i: usize) -> u32 {
    i as u32
}

/// The nearest neighbours of particle `i`, and the matrix that makes the stream's extent along each random number of their displacements: a
/// linear fit with weights that fall with distance.
fn fit(
    xi: &[[f64; MAX_NORMALS]],
    i: usize,
    numbers: usize,
    per_tail: usize,
    count: usize,
    smearing: f64,
) -> (Vec<usize>, DMatrix<f64>) {
    // Many of one release time are not all compared with each other.
    let (place, some) = (i % per_tail, per_tail.min(COMPARED));
    let first = i - place + place.saturating_sub(some / 2).min(per_tail - some);
    let distance2 = |j: usize| {
        (0..numbers)
            .map(|k| (xi[j][k] - xi[i][k]).powi(2))
            .sum::<f64>()
    };
    let mut nearest: Vec<usize> = (first..first + some).filter(|j| *j != i).collect();
    nearest.sort_by(|a, b| distance2(*a).total_cmp(&distance2(*b)));
    nearest.truncate(count);
    let d = DMatrix::from_fn(count, numbers, |j, k| xi[nearest[j]][k] - xi[i][k]);
    let w = DVector::from_iterator(
        count,
        nearest.iter().map(|j| 1.0 / (SOFTENING + distance2(*j))),
    );
    let weighted = d.transpose() * DMatrix::from_diagonal(&w);
    let mut a = &weighted * &d;
    // Never singular, whatever the number of neighbours.
    let ridge = RIDGE * a.trace() / numbers as f64 + f64::MIN_POSITIVE;
    for k in 0..numbers {
        a[(k, k)] += ridge;
    }
    let inverse = a
        .try_inverse()
        .unwrap_or_else(|| DMatrix::zeros(numbers, numbers));
    (nearest, inverse * weighted * smearing)
}
