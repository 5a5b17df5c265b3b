//! Pairs of points near a chain, whose differences are directions to move along (ter Braak 2006, with a choice of pairs
//! that knows where the chain is).
//!
//! A posterior of thin, bent ridges has no single shape: the difference of two points picked anywhere points across most
//! of them, and a slice along it shrinks to nothing. Two points that are both near the chain lie on its ridge.
//!
//! # Why a move along such a pair is exact
//!
//! The points are held fixed while the chain moves. It stands at `x`, picks the ordered pair `(i, j)` with probability
//! `p_ij(x)`, moves along the line through `x` in the pair's direction by any reversible kernel, to `y`, and stays there
//! with probability `min(1, p_ij(y) / p_ij(x))`, else returns to `x`. For each pair the flow from `x` to `y` is then
//! `p_ij(x) K_ij(x, y) min(1, p_ij(y) / p_ij(x))`, which with the density at `x` is the same both ways. The reach of the
//! weights is drawn without a look at the state.

use crate::rng::{Stream, unit_open};
use crate::target::Orbit;
use serde::{Deserialize, Serialize};

/// Most points kept: more take time, and pairs are plenty.
const MOST: usize = 1024;

/// Reaches are drawn evenly in their logarithm between these, in units of the points' standard deviations.
const REACH: (f64, f64) = (0.5, 4.0);

/// Points in standard-normal coordinates, and where they stand relative to each other.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Neighbours {
    dim: usize,
    /// Rows of coordinates, one after the other.
    rows: Vec<f64>,
    /// The rows' places, which do not change along the target's orbit, in units of their standard deviations.
    places: Vec<f64>,
    /// One over the standard deviation of each coordinate of a place; 0 where it does not vary.
    inverse_sd: Vec<f64>,
}

/// An ordered pair of points, and how it was come by.
#[derive(Clone, Copy, Debug)]
pub struct Pair {
    first: usize,
    second: usize,
    reach: f64,
    ln_probability: f64,
}

impl Neighbours {
    /// Of rows of coordinates, one after the other, of which at most 1,024 are kept, evenly spread; `orbit` is the target's
    /// exact symmetry, if it has one.
    #[must_use]
    pub fn new(rows: &[f64], dim: usize, orbit: Option<&dyn Orbit>) -> Self {
        let count = rows.len() / dim;
        let kept = count.min(MOST);
        let rows: Vec<f64> = (0..kept)
            .flat_map(|k| rows[k * count / kept * dim..][..dim].iter().copied())
            .collect();
        let mut places: Vec<f64> = rows
            .chunks_exact(dim)
            .flat_map(|row| place_of(row, orbit))
            .collect();
        let n = kept as f64;
        let inverse_sd: Vec<f64> = (0..dim)
            .map(|c| {
                let column = || places.iter().skip(c).step_by(dim);
                let mean = column().sum::<f64>() / n;
                let variance = column().map(|p| (p - mean).powi(2)).sum::<f64>() / n;
                // Rounding alone is no spread.
                if variance > 1e-20 * mean * mean {
                    1.0 / variance.sqrt()
                } else {
                    0.0
                }
            })
            .collect();
        for place in places.chunks_exact_mut(dim) {
            for (p, s) in place.iter_mut().zip(&inverse_sd) {
                *p *= s;
            }
        }
        Self {
            dim,
            rows,
            places,
            inverse_sd,
        }
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

    /// Picks a pair near `at`; `None` if there are fewer than two points.
    #[must_use]
    pub fn pick(&self, at: &[f64], orbit: Option<&dyn Orbit>, rng: &mut Stream) -> Option<Pair> {
        if self.len() < 2 {
            return None;
        }
        let (lo, hi) = REACH;
        let reach = lo * (hi / lo).powf(unit_open(rng));
        let mut ln_weights = self.ln_weights(at, orbit, reach);
        let (first, ln_first) = draw(&ln_weights, unit_open(rng));
        ln_weights[first] = f64::NEG_INFINITY;
        let (second, ln_second) = draw(&ln_weights, unit_open(rng));
        Some(Pair {
            first,
            second,
            reach,
            ln_probability: ln_first + ln_second,
        })
    }

    /// `ln` of how much likelier a pair is to be picked from `at` than it was where it was picked.
    #[must_use]
    pub fn ln_ratio(&self, pair: &Pair, at: &[f64], orbit: Option<&dyn Orbit>) -> f64 {
        let mut ln_weights = self.ln_weights(at, orbit, pair.reach);
        let ln_first = ln_share(&ln_weights, pair.first);
        ln_weights[pair.first] = f64::NEG_INFINITY;
        ln_first + ln_share(&ln_weights, pair.second) - pair.ln_probability
    }

    /// The two points of a pair, moved along the orbit until they are level with `at` where both can be. The level is one
    /// coordinate, which a line between them keeps: from wherever on that line, the pair is the same.
    #[must_use]
    pub fn ends(&self, pair: &Pair, at: &[f64], orbit: Option<&dyn Orbit>) -> [Vec<f64>; 2] {
        let [mut a, mut b] = [pair.first, pair.second].map(|i| self.row(i).to_vec());
        let level = orbit.is_none_or(|orbit| orbit.align(&mut a, at) && orbit.align(&mut b, at));
        if level {
            [a, b]
        } else {
            // Both as they were, or the level of one alone would be that of `at`.
            [pair.first, pair.second].map(|i| self.row(i).to_vec())
        }
    }

    fn row(&self, i: usize) -> &[f64] {
        &self.rows[i * self.dim..(i + 1) * self.dim]
    }

    /// Logarithms of Gaussian weights about `at`.
    fn ln_weights(&self, at: &[f64], orbit: Option<&dyn Orbit>, reach: f64) -> Vec<f64> {
        let mut place = place_of(at, orbit);
        for (p, s) in place.iter_mut().zip(&self.inverse_sd) {
            *p *= s;
        }
        let scale = -0.5 / (reach * reach);
        self.places
            .chunks_exact(self.dim)
            .map(|other| {
                let squares = place.iter().zip(other).map(|(a, b)| (a - b) * (a - b));
                scale * squares.sum::<f64>()
            })
            .collect()
    }
}

/// Where a point is, whatever its position along its orbit.
fn place_of(z: &[f64], orbit: Option<&dyn Orbit>) -> Vec<f64> {
    let mut place = z.to_vec();
    if let Some(orbit) = orbit {
        orbit.invariants(z, &mut place);
    }
    place
}

/// `ln sum exp` and the largest.
fn ln_sum(ln_weights: &[f64]) -> f64 {
    let most = ln_weights.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    most + ln_weights
        .iter()
        .map(|w| (w - most).exp())
        .sum::<f64>()
        .ln()
}

fn ln_share(ln_weights: &[f64], i: usize) -> f64 {
    ln_weights[i] - ln_sum(ln_weights)
}

/// The index that a uniform falls on, and the logarithm of its probability.
fn draw(ln_weights: &[f64], uniform: f64) -> (usize, f64) {
    let ln_all = ln_sum(ln_weights);
    let mut left = uniform;
    let mut last = 0;
    for (i, w) in ln_weights.iter().enumerate() {
        let share = (w - ln_all).exp();
        if share > 0.0 {
            last = i;
            left -= share;
            if left <= 0.0 {
                break;
            }
        }
    }
    (last, ln_weights[last] - ln_all)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Domain, standard_normal, stream};

    #[test]
    fn pairs_come_as_often_as_their_probability_says() {
        let rows = [0.0, 0.0, 1.0, 0.0, 0.0, 2.0, -1.0, 1.0];
        let near = Neighbours::new(&rows, 2, None);
        let at = [0.2, -0.1];
        let mut rng = stream(1, Domain::Test, 0, 0);
        let draws = 200_000;
        let mut expected = [[0.0; 4]; 4];
        let mut found = [[0.0; 4]; 4];
        for _ in 0..draws {
            let pair = near.pick(&at, None, &mut rng).unwrap();
            found[pair.first][pair.second] += 1.0;
            // The probability of every pair at this reach, by the same function that corrects moves.
            for (i, row) in expected.iter_mut().enumerate() {
                for (j, slot) in row.iter_mut().enumerate().filter(|(j, _)| *j != i) {
                    let other = Pair {
                        first: i,
                        second: j,
                        ..pair
                    };
                    *slot += (near.ln_ratio(&other, &at, None) + pair.ln_probability).exp();
                }
            }
        }
        for (found, expected) in found.iter().flatten().zip(expected.iter().flatten()) {
            // Five standard deviations of a count.
            assert!(
                (found - expected).abs() <= 5.0 * expected.sqrt(),
                "{found} {expected}"
            );
        }
    }

    #[test]
    fn the_way_back_is_known() {
        let rows: Vec<f64> = (0..40).map(|i| f64::from(i * i % 17)).collect();
        let near = Neighbours::new(&rows, 2, None);
        let (x, y) = ([1.0, 2.0], [3.0, -1.0]);
        let mut rng = stream(2, Domain::Test, 0, 0);
        let pair = near.pick(&x, None, &mut rng).unwrap();
        assert!(near.ln_ratio(&pair, &x, None).abs() < 1e-12);
        let there = near.ln_ratio(&pair, &y, None);
        let from_there = Pair {
            ln_probability: pair.ln_probability + there,
            ..pair
        };
        assert!((near.ln_ratio(&from_there, &x, None) + there).abs() < 1e-12);
    }

    /// The mean of z1 after one move of many chains that start in a standard-normal plane, and its error. A move draws the
    /// position on its line afresh.
    fn mean_after_a_move(corrected: bool) -> (f64, f64) {
        let rows = [2.0, 0.0, 2.2, 1.0, 2.4, -1.0, -1.0, 0.1, -3.0, 0.3];
        let near = Neighbours::new(&rows, 2, None);
        let chains = 200_000;
        let mut rng = stream(4, Domain::Test, 0, 0);
        let mut sum = 0.0;
        for _ in 0..chains {
            let x = [standard_normal(&mut rng), standard_normal(&mut rng)];
            let pair = near.pick(&x, None, &mut rng).unwrap();
            let [a, b] = near.ends(&pair, &x, None);
            let v = [a[0] - b[0], a[1] - b[1]];
            let square = v[0] * v[0] + v[1] * v[1];
            let t =
                (standard_normal(&mut rng) * square.sqrt() - x[0] * v[0] - x[1] * v[1]) / square;
            let y = [x[0] + t * v[0], x[1] + t * v[1]];
            let stays = corrected && unit_open(&mut rng).ln() > near.ln_ratio(&pair, &y, None);
            sum += if stays { x[0] } else { y[0] };
        }
        let n = f64::from(chains);
        (sum / n, 1.0 / n.sqrt())
    }

    #[test]
    fn moves_along_near_pairs_are_exact_and_would_not_be_without_the_way_back() {
        let (mean, error) = mean_after_a_move(true);
        assert!(mean.abs() < 4.0 * error, "{mean}");
        let (mean, error) = mean_after_a_move(false);
        assert!(mean.abs() > 6.0 * error, "{mean}");
    }

    #[test]
    fn far_from_all_points_the_nearest_are_picked() {
        let rows = [0.0, 1.0, 2.0, 10.0];
        let near = Neighbours::new(&rows, 1, None);
        let mut rng = stream(3, Domain::Test, 0, 0);
        let pair = near.pick(&[-1e6], None, &mut rng).unwrap();
        assert_eq!((pair.first, pair.second), (0, 1));
        assert!(pair.ln_probability.is_finite());
    }
}
