//! Pairs of points near a chain, whose differences are directions of its moves (differential evolution: ter Braak 2006,
//! here with pairs chosen near the present point).
//!
//! A posterior of thin, curved ridges has no single shape: the difference of two arbitrary points crosses most of them,
//! and the interval of a slice update along it becomes very short. Two points near the chain lie on its ridge.
//!
//! # Why a move along such a pair is exact
//!
//! The points, and the cells that divide the space about some of them, are held fixed while the chain moves. A scale is
//! drawn independently of the state; the pair is drawn from the points in the chain's cell of that scale, and the move
//! does not leave the cell. So all states that the move can connect have the same distribution of pairs, and the move
//! leaves the density invariant within each cell, hence everywhere.
//!
//! Where the target has an orbit with levels, the two points are first moved along it to the level of the present state, and pairs that cannot be
//! are drawn again. Their distribution then depends on the cell and the level, which is constant on the line between them. If none of many pairs can be, the
//! state stays: any other move would leave the level, and could end where pairs can be moved.

use crate::diagnostics::column_moments;
use crate::rng::{RandomStream, below};
use crate::target::Orbit;
use crate::valid::{Valid, ensure, moderate, rows};
use serde::{Deserialize, Serialize};

/// Maximum number of points kept: more take more time and add no useful directions.
const MAX_POINTS: usize = 1024;

/// Mean number of points in a cell of each scale; the last scale is one cell for all. Few, because a cell should
/// contain one bend of a ridge only, and its pairs need not span the space.
const SIZES: [usize; 2] = [8, 32];

/// Minimum number of points of a cell.
const MIN_POINTS: usize = 4;

/// Maximum number of pairs that are drawn until one can be moved to the level of the present state. That none can is rare where one in three can.
const MAX_PAIRS: usize = 32;

/// Points in standard-normal coordinates, and the cells about them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct DifferencePool {
    dim: usize,
    /// Rows of coordinates, one after the other.
    rows: Vec<f64>,
    /// Coordinates of the rows that are constant along the target's orbit, in units of their standard deviations: their
    /// places.
    places: Vec<f64>,
    /// One over the standard deviation of each coordinate of a place; 0 where it does not vary.
    inverse_sd: Vec<f64>,
    scales: Vec<Cells>,
}

/// A division of the space by the nearest of some points.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Cells {
    /// Numbers of the points that cells are about.
    centres: Vec<usize>,
    /// Numbers of the points in each cell.
    points: Vec<Vec<usize>>,
}

impl Cells {
    /// Checks a division of so many points that was read from a file. A pair is drawn from any cell.
    fn check(&self, count: usize) -> Valid {
        let known = |numbers: &[usize]| numbers.iter().all(|i| *i < count);
        ensure(
            !self.centres.is_empty()
                && self.centres.len() == self.points.len()
                && known(&self.centres)
                && self.points.iter().all(|m| m.len() >= 2 && known(m)),
            "a cell has fewer than two points, or one that does not exist",
        )
    }
}

/// The cell that a pair is from.
#[derive(Clone, Copy, Debug)]
pub struct PairCell {
    scale: usize,
    cell: usize,
}

/// Two points of one cell, at one level of the target's orbit if it has levels.
#[derive(Clone, Debug)]
pub struct Pair {
    /// The points in standard-normal coordinates.
    pub ends: [Vec<f64>; 2],
    /// Their cell.
    pub cell: PairCell,
}

impl DifferencePool {
    /// From rows of coordinates, one after the other, of which at most 1,024 are kept, evenly spaced; `orbit` is the
    /// target's exact symmetry, if it has one.
    #[must_use]
    pub fn new(rows: &[f64], dim: usize, orbit: Option<&dyn Orbit>) -> Self {
        let count = rows.len() / dim;
        let kept = count.min(MAX_POINTS);
        let rows: Vec<f64> = (0..kept)
            .flat_map(|k| rows[k * count / kept * dim..][..dim].iter().copied())
            .collect();
        let mut places: Vec<f64> = rows
            .chunks_exact(dim)
            .flat_map(|row| place_of(row, orbit))
            .collect();
        let inverse_sd: Vec<f64> = column_moments(&places, dim)
            .into_iter()
            .map(|(mean, variance)| {
                // A spread of the size of rounding counts as none.
                if variance > 1e-20 * mean * mean {
                    1.0 / variance.sqrt()
                } else {
                    0.0
                }
            })
            .collect();
        for place in places.chunks_exact_mut(dim) {
            scale(place, &inverse_sd);
        }
        let mut difference_pool = Self {
            dim,
            rows,
            places,
            inverse_sd,
            scales: Vec::new(),
        };
        let sizes = SIZES.into_iter().filter(|size| 2 * size <= kept);
        difference_pool.scales = sizes
            .chain((kept > 1).then_some(kept))
            .map(|size| difference_pool.divide(size))
            .collect();
        difference_pool
    }

    /// Checks points of `dim` coordinates that were read from a file.
    pub(crate) fn check(&self, dim: usize) -> Valid {
        let count = self.len();
        let none = self.dim == 0 && self.rows.is_empty() && self.scales.is_empty();
        ensure(
            none || self.dim == dim
                && count <= MAX_POINTS
                && rows(self.rows.len(), count, dim)
                && self.places.len() == self.rows.len()
                && self.inverse_sd.len() == dim,
            "a pool has other numbers of coordinates and places",
        )?;
        let all = self.rows.iter().chain(&self.places).chain(&self.inverse_sd);
        ensure(moderate(all), "a pool is not finite")?;
        self.scales.iter().try_for_each(|cells| cells.check(count))
    }

    /// Number of points.
    #[must_use]
    pub fn len(&self) -> usize {
        self.rows.len().checked_div(self.dim).unwrap_or(0)
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Whether there are two points.
    #[must_use]
    pub fn has_pairs(&self) -> bool {
        !self.scales.is_empty()
    }

    /// Draws a scale, and two points of the cell where `at` is, which are moved along the orbit to the level of `at`. `None` if that is possible for none of
    /// many pairs, or if there are fewer than two points.
    #[must_use]
    pub fn pick(
        &self,
        at: &[f64],
        orbit: Option<&dyn Orbit>,
        rng: &mut RandomStream,
    ) -> Option<Pair> {
        if !self.has_pairs() {
            return None;
        }
        let scale = below(rng, self.scales.len());
        let cells = &self.scales[scale];
        let cell = self.cell(cells, at, orbit);
        let points = &cells.points[cell];
        (0..MAX_PAIRS).find_map(|_| {
            let i = below(rng, points.len());
            let j = (i + 1 + below(rng, points.len() - 1)) % points.len();
            let ends = self.at_level([points[i], points[j]], at, orbit)?;
            let cell = PairCell { scale, cell };
            Some(Pair { ends, cell })
        })
    }

    /// Two points, moved along the orbit until they have the level of `at`; `None` if one of them cannot have it.
    fn at_level(
        &self,
        points: [usize; 2],
        at: &[f64],
        orbit: Option<&dyn Orbit>,
    ) -> Option<[Vec<f64>; 2]> {
        let mut ends = points.map(|i| self.row(i).to_vec());
        let orbit = orbit.filter(|orbit| orbit.has_levels());
        let level = orbit.is_none_or(|orbit| ends.iter_mut().all(|end| orbit.align(end, at)));
        level.then_some(ends)
    }

    /// Whether the cell is the whole space, so that moves along its pairs are unconstrained.
    #[must_use]
    pub fn is_undivided(&self, cell: PairCell) -> bool {
        self.scales[cell.scale].centres.len() == 1
    }

    /// Whether `at` is in a cell, which a move along a pair from it must not leave.
    #[must_use]
    pub fn holds(&self, cell: PairCell, at: &[f64], orbit: Option<&dyn Orbit>) -> bool {
        self.cell(&self.scales[cell.scale], at, orbit) == cell.cell
    }

    fn row(&self, i: usize) -> &[f64] {
        &self.rows[i * self.dim..(i + 1) * self.dim]
    }

    fn place(&self, i: usize) -> &[f64] {
        &self.places[i * self.dim..(i + 1) * self.dim]
    }

    /// Cells of about `size` points each, none of fewer than [`MIN_POINTS`] unless it is the only one.
    fn divide(&self, size: usize) -> Cells {
        let count = self.len();
        let mut centres: Vec<usize> = (0..count / size)
            .map(|k| k * count / (count / size))
            .collect();
        loop {
            let mut points = vec![Vec::new(); centres.len()];
            for i in 0..count {
                points[self.nearest(&centres, self.place(i))].push(i);
            }
            let smallest = (0..centres.len()).min_by_key(|c| points[*c].len());
            match smallest {
                Some(c) if centres.len() > 1 && points[c].len() < MIN_POINTS => {
                    centres.remove(c);
                }
                _ => return Cells { centres, points },
            }
        }
    }

    /// Which of the centres is nearest.
    fn nearest(&self, centres: &[usize], place: &[f64]) -> usize {
        let away = |c: usize| {
            let squares = place.iter().zip(self.place(centres[c]));
            squares.map(|(a, b)| (a - b) * (a - b)).sum::<f64>()
        };
        let mut best = (0, f64::INFINITY);
        for c in 0..centres.len() {
            let away = away(c);
            if away < best.1 {
                best = (c, away);
            }
        }
        best.0
    }

    fn cell(&self, cells: &Cells, at: &[f64], orbit: Option<&dyn Orbit>) -> usize {
        if cells.centres.len() == 1 {
            return 0;
        }
        let mut place = place_of(at, orbit);
        scale(&mut place, &self.inverse_sd);
        self.nearest(&cells.centres, &place)
    }
}

/// Puts a place into units of the standard deviations.
fn scale(place: &mut [f64], inverse_sd: &[f64]) {
    for (p, s) in place.iter_mut().zip(inverse_sd) {
        *p *= s;
    }
}

/// The place of a point, which does not depend on its position along its orbit.
fn place_of(z: &[f64], orbit: Option<&dyn Orbit>) -> Vec<f64> {
    let mut place = z.to_vec();
    if let Some(orbit) = orbit {
        orbit.invariants(z, &mut place);
    }
    place
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Domain, standard_normal, stream};

    fn normals(count: usize, task: u64) -> Vec<f64> {
        let mut rng = stream(5, Domain::Test, task, 0);
        (0..count).map(|_| standard_normal(&mut rng)).collect()
    }

    #[test]
    fn cells_divide_the_points_and_none_is_too_small() {
        let near = DifferencePool::new(&normals(3 * 500, 0), 3, None);
        assert_eq!(near.scales.len(), 3);
        for cells in &near.scales {
            let mut all = cells.points.concat();
            all.sort_unstable();
            assert_eq!(all, (0..500).collect::<Vec<_>>());
            assert!(cells.points.iter().all(|m| m.len() >= MIN_POINTS));
            for (c, points) in cells.points.iter().enumerate() {
                assert!(
                    points
                        .iter()
                        .all(|i| near.cell(cells, near.row(*i), None) == c)
                );
            }
        }
        assert_eq!(near.scales[2].points.len(), 1);
        assert!(near.scales[0].points.len() > 20);
    }

    #[test]
    fn a_pair_is_of_the_cell_where_the_chain_is() {
        let near = DifferencePool::new(&normals(2 * 200, 1), 2, None);
        let mut rng = stream(6, Domain::Test, 0, 0);
        for at in normals(2 * 500, 2).chunks_exact(2) {
            let Pair { ends, cell } = near.pick(at, None, &mut rng).unwrap();
            assert!(near.holds(cell, at, None) && ends[0] != ends[1]);
            assert!(ends.iter().all(|end| near.holds(cell, end, None)));
        }
    }

    #[test]
    fn many_points_are_thinned_and_one_gives_no_pair() {
        assert_eq!(
            DifferencePool::new(&normals(3_000, 3), 1, None).len(),
            MAX_POINTS
        );
        let mut rng = stream(7, Domain::Test, 0, 0);
        let alone = DifferencePool::new(&[1.0, 2.0], 2, None);
        assert!(alone.pick(&[0.0, 0.0], None, &mut rng).is_none());
        assert!(
            DifferencePool::default()
                .pick(&[0.0], None, &mut rng)
                .is_none()
        );
    }

    /// Adds the same to both coordinates, as far as the second stays within its bounds. The level is the first.
    struct Diagonal;

    impl Orbit for Diagonal {
        fn name(&self) -> &str {
            "diagonal"
        }
        fn refresh(&self, _: &mut [f64], _: &mut RandomStream) {}
        fn has_levels(&self) -> bool {
            true
        }
        fn align(&self, z: &mut [f64], to: &[f64]) -> bool {
            let second = z[1] + to[0] - z[0];
            let could = second.abs() < 1.5;
            if could {
                (z[0], z[1]) = (to[0], second);
            }
            could
        }
        fn invariants(&self, z: &[f64], out: &mut [f64]) {
            (out[0], out[1]) = (0.0, z[1] - z[0]);
        }
    }

    /// The means of the magnitudes of both coordinates after three moves of many chains that start in a standard-normal plane, minus their expectation,
    /// in standard errors. A move draws the position on its line independently: repeatedly until it is in the cell, or
    /// once wherever it is.
    fn drift(confined: bool, orbit: Option<&dyn Orbit>) -> [f64; 2] {
        // Points off the centre, so that the distribution of pairs depends on the position.
        let mut rows = normals(2 * 60, 4);
        for row in rows.chunks_exact_mut(2).skip(30) {
            row[0] = 2.0 + 0.2 * row[0];
        }
        let near = DifferencePool::new(&rows, 2, orbit);
        let chains = 300_000;
        let mut rng = stream(8, Domain::Test, 0, 0);
        let mut sums = [0.0; 2];
        for _ in 0..chains {
            let mut x = [standard_normal(&mut rng), standard_normal(&mut rng)];
            for _ in 0..3 {
                let Some(Pair { ends, cell }) = near.pick(&x, orbit, &mut rng) else {
                    continue;
                };
                let v = [0, 1].map(|c| ends[0][c] - ends[1][c]);
                let square = v[0] * v[0] + v[1] * v[1];
                for _ in 0..10_000 {
                    let t = (standard_normal(&mut rng) * square.sqrt() - x[0] * v[0] - x[1] * v[1])
                        / square;
                    let y = [x[0] + t * v[0], x[1] + t * v[1]];
                    if !confined || near.holds(cell, &y, orbit) {
                        x = y;
                        break;
                    }
                }
            }
            for (sum, x) in sums.iter_mut().zip(x) {
                *sum += x.abs();
            }
        }
        let n = f64::from(chains);
        let mean = (2.0 / std::f64::consts::PI).sqrt();
        sums.map(|sum| (sum / n - mean) / ((1.0 - mean * mean) / n).sqrt())
    }

    #[test]
    fn moves_inside_cells_are_exact_and_would_not_be_across_them() {
        let exact = drift(true, None);
        assert!(exact.iter().all(|drift| drift.abs() < 4.0), "{exact:?}");
        let wrong = drift(false, None);
        assert!(wrong[0].abs() > 6.0, "{wrong:?}");
    }

    #[test]
    fn moves_along_pairs_of_one_level_are_exact_where_others_cannot_have_it() {
        let exact = drift(true, Some(&Diagonal));
        assert!(exact.iter().all(|drift| drift.abs() < 4.0), "{exact:?}");
    }
}
