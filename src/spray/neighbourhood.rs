//! The neighbours of each particle of a table in the space of its standard normals (docs/physics.md, section 6).

use super::recipe::MAX_NORMALS;
use crate::scalar::LANES;
use nalgebra::{DMatrix, DVector};

/// Number of neighbours of a particle, if its tail and release time have as many others.
const NEIGHBOURS: usize = 8;

/// Largest number of particles of one tail and release time among which neighbours are sought.
const COMPARED: usize = 64;

/// Added to the squared distance of a neighbour, in the denominator of its weight in the fit.
const SOFTENING: f64 = 0.5;

/// Added to the diagonal of the fit's matrix, over the mean of the diagonal.
const RIDGE: f64 = 0.03;

/// The neighbours of each particle, in blocks of [`LANES`] particles.
///
/// Each particle stands for a normal distribution around its own standard normals. On the sky this is about an ellipse, by a linear fit to
/// the places of the neighbours.
#[derive(Clone, Debug, PartialEq)]
pub struct Neighbourhood {
    /// Number of neighbours of a particle.
    pub count: usize,
    /// Number of standard normals of a release.
    pub normals: usize,
    /// Largest difference of numbers in the table to a neighbour or the partner.
    pub reach: usize,
    /// Numbers of the neighbours in the table: by block, neighbour, lane. Lanes beyond the last particle repeat it.
    pub indices: Vec<[u32; LANES]>,
    /// Number of the partner in the table: by block, lane.
    pub partners: Vec<[u32; LANES]>,
    /// Weight of a neighbour's displacement in the stream's extent along each standard normal, the matrix C of docs/physics.md, section 6:
    /// by block, neighbour, standard normal, lane.
    pub weights: Vec<[f64; LANES]>,
}

/// Standard deviation s of the smearing in the space of the standard normals (docs/physics.md, section 4). Few particles need a large one;
/// it is bounded, because smearing over a curved stream is biased.
pub(super) fn smearing(particles: usize) -> f64 {
    (0.4 * (512.0 / particles as f64).powf(0.18)).min(0.5)
}

impl Neighbourhood {
    /// From the standard normals `xi` of all particles, in the order of the table: `per_tail` of each tail at each release time.
    pub(super) fn new(
        xi: &[[f64; MAX_NORMALS]],
        normals: usize,
        per_tail: usize,
        smearing: f64,
    ) -> Self {
        let n = xi.len();
        let count = NEIGHBOURS.min(per_tail - 1);
        let blocks = n.div_ceil(LANES);
        let mut neighbourhood = Self {
            count,
            normals,
            reach: 2 * per_tail,
            indices: vec![[0; LANES]; blocks * count],
            partners: vec![[0; LANES]; blocks],
            weights: vec![[0.0; LANES]; blocks * count * normals],
        };
        let to_next = neighbourhood.reach;
        for slot in 0..blocks * LANES {
            let (block, lane) = (slot / LANES, slot % LANES);
            let i = slot.min(n - 1);
            let partner = if i + to_next < n {
                i + to_next
            } else {
                i - to_next
            };
            neighbourhood.partners[block][lane] = index(partner);
            let (nearest, weights) = fit(xi, i, normals, per_tail, count, smearing);
            for (j, neighbour) in nearest.iter().enumerate() {
                let row = block * count + j;
                neighbourhood.indices[row][lane] = index(*neighbour);
                for k in 0..normals {
                    neighbourhood.weights[row * normals + k][lane] = weights[(k, j)];
                }
            }
        }
        neighbourhood
    }
}

#[allow(
    clippy::cast_possible_truncation,
    reason = "a table has far less than 2^32 particles"
)]
fn index(i: usize) -> u32 {
    i as u32
}

/// The nearest neighbours of particle `i`, and its matrix C (docs/physics.md, section 6).
fn fit(
    xi: &[[f64; MAX_NORMALS]],
    i: usize,
    normals: usize,
    per_tail: usize,
    count: usize,
    smearing: f64,
) -> (Vec<usize>, DMatrix<f64>) {
    // At most `COMPARED` particles are compared, because the cost of all grows with the square of their number.
    let (within, compared) = (i % per_tail, per_tail.min(COMPARED));
    let first = i - within + within.saturating_sub(compared / 2).min(per_tail - compared);
    let distance2 = |j: usize| {
        (0..normals)
            .map(|k| (xi[j][k] - xi[i][k]).powi(2))
            .sum::<f64>()
    };
    let mut nearest: Vec<usize> = (first..first + compared).filter(|j| *j != i).collect();
    nearest.sort_by(|a, b| distance2(*a).total_cmp(&distance2(*b)));
    nearest.truncate(count);
    let d = DMatrix::from_fn(count, normals, |j, k| xi[nearest[j]][k] - xi[i][k]);
    let w = DVector::from_iterator(
        count,
        nearest.iter().map(|j| 1.0 / (SOFTENING + distance2(*j))),
    );
    let weighted = d.transpose() * DMatrix::from_diagonal(&w);
    let mut a = &weighted * &d;
    // The matrix is then not singular, whatever the number of neighbours.
    let ridge = RIDGE * a.trace() / normals as f64 + f64::MIN_POSITIVE;
    for k in 0..normals {
        a[(k, k)] += ridge;
    }
    let inverse = a
        .try_inverse()
        .unwrap_or_else(|| DMatrix::zeros(normals, normals));
    (nearest, inverse * weighted * smearing)
}
