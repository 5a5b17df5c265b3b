//! Points of a nested run, and the choice of those that die next.

use crate::diagnostics::effective_kinds;
use crate::target::Target;
use crate::valid::{Valid, ensure, rows};
use serde::{Deserialize, Serialize};

/// Log-likelihood of a rejected point: below every likelihood, and above minus infinity, the bound of the first points. So a
/// point born above the plateau of rejected points is distinguished from a first point.
pub(super) const REJECTED: f64 = f64::MIN;

/// Number of lineages of this many live points: even, so that both halves have as many. Of many few are left at the posterior only if few first
/// points have descendants there.
pub(super) fn lineages(n_live: usize) -> usize {
    const MAX: usize = 100;
    divisions(n_live, MAX)
}

/// Number of recent lineages of this many live points, even too: so few that each lasts for many iterations.
pub(super) fn recent_lineages(n_live: usize) -> usize {
    const MAX: usize = 20;
    divisions(n_live, MAX)
}

fn divisions(n_live: usize, max: usize) -> usize {
    const MIN_POINTS: usize = 5;
    (n_live / MIN_POINTS).clamp(2, max) & !1
}

/// A count as it is stored.
pub(super) fn narrow(n: usize) -> u32 {
    u32::try_from(n).unwrap_or(u32::MAX)
}

/// The lineages of a point. A point drawn by a chain has those of its seed, because it resembles the seed while steps
/// are few; one drawn without a seed has those of the point that it replaces.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Genealogy {
    /// Eve index: the first point from which it descends, modulo the number of lineages, counted on from batch to batch of those that
    /// begin with the prior; of a point of a later batch without a seed, its number in the batch modulo the same. Even and odd ones are the two halves.
    pub lineage: u32,
    /// The same with ancestors chosen anew whenever few recent lineages are left ([`Points::begin_recent_lineages`]):
    /// the errors of the volumes depend on the correlation that chains still have with their seeds. In the half of its
    /// lineage.
    pub recent_lineage: u32,
}

impl From<u32> for Genealogy {
    /// Of this lineage, and the recent lineage of the same number.
    fn from(lineage: u32) -> Self {
        Self {
            lineage,
            recent_lineage: lineage,
        }
    }
}

/// Points in rows.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Points {
    dim: usize,
    /// Cube coordinates, row-major.
    u: Vec<f64>,
    /// Log-likelihoods; [`REJECTED`] where there is none.
    pub ln_l: Vec<f64>,
    /// Likelihood bound (log) above which each was drawn; minus infinity for the prior itself.
    pub birth: Vec<f64>,
    /// The genealogy of each.
    pub genealogy: Vec<Genealogy>,
}

impl Points {
    pub fn new(dim: usize) -> Self {
        Self {
            dim,
            ..Self::default()
        }
    }

    /// Checks points that were read from a file: of `dim` coordinates inside the open cube, each above the likelihood
    /// bound of its birth, of so many lineages and recent lineages at most.
    pub fn check(&self, dim: usize, lineages: u32, recent_lineages: u32) -> Valid {
        ensure(
            self.dim == dim
                && rows(self.u.len(), self.len(), dim)
                && self.birth.len() == self.len()
                && self.genealogy.len() == self.len(),
            "points have other numbers of coordinates, likelihoods, births or lineages",
        )?;
        ensure(
            self.u.iter().all(|u| *u > 0.0 && *u < 1.0),
            "a coordinate is outside the unit cube",
        )?;
        let above = |(ln_l, birth): (&f64, &f64)| birth < ln_l && ln_l.is_finite();
        ensure(
            self.ln_l.iter().zip(&self.birth).all(above),
            "a log-likelihood is not finite, or not above the likelihood bound of its birth",
        )?;
        ensure(
            (self.genealogy.iter()).all(|genealogy| {
                genealogy.lineage < lineages && genealogy.recent_lineage < recent_lineages
            }),
            "a lineage or recent lineage does not exist",
        )
    }

    pub fn len(&self) -> usize {
        self.ln_l.len()
    }

    pub fn dim(&self) -> usize {
        self.dim
    }

    pub fn row(&self, i: usize) -> &[f64] {
        &self.u[i * self.dim..(i + 1) * self.dim]
    }

    pub fn push(&mut self, u: &[f64], ln_l: f64, birth: f64, genealogy: impl Into<Genealogy>) {
        self.u.extend_from_slice(u);
        self.ln_l.push(ln_l);
        self.birth.push(birth);
        self.genealogy.push(genealogy.into());
    }

    pub fn push_from(&mut self, other: &Self, i: usize) {
        self.push(
            other.row(i),
            other.ln_l[i],
            other.birth[i],
            other.genealogy[i],
        );
    }

    /// Replaces row `i`.
    pub fn replace(&mut self, i: usize, u: &[f64], ln_l: f64, birth: f64, genealogy: Genealogy) {
        self.u[i * self.dim..(i + 1) * self.dim].copy_from_slice(u);
        self.ln_l[i] = ln_l;
        self.birth[i] = birth;
        self.genealogy[i] = genealogy;
    }

    /// Keeps the rows named, in the order given.
    pub fn select(&self, rows: &[usize]) -> Self {
        let mut out = Self::new(self.dim);
        for &i in rows {
            out.push_from(self, i);
        }
        out
    }

    /// Effective number of recent lineages (Kish).
    pub fn effective_recent_lineages(&self) -> f64 {
        effective_kinds(
            self.genealogy
                .iter()
                .map(|genealogy| genealogy.recent_lineage),
        )
    }

    /// Begins new recent lineages, `count` of them from this number on, each in the half where it was.
    pub fn begin_recent_lineages(&mut self, first: u32, count: u32) {
        for (half, rows) in (0..).zip(self.halves()) {
            for (turn, row) in (0..count / 2).cycle().zip(rows) {
                self.genealogy[row].recent_lineage = first + 2 * turn + half;
            }
        }
    }

    /// Rows of the even lineages, then those of the odd ones. Metrics and directions of a chain come from the half that its
    /// seed is not in.
    pub fn halves(&self) -> [Vec<usize>; 2] {
        let of = |half: u32| -> Vec<usize> {
            (0..self.len())
                .filter(|&i| self.genealogy[i].lineage % 2 == half)
                .collect()
        };
        [of(0), of(1)]
    }

    /// Physical parameters of all points, row-major.
    pub fn physical(&self, target: &dyn Target) -> Vec<f64> {
        let mut theta = vec![0.0; self.u.len()];
        for (i, row) in theta.chunks_exact_mut(self.dim).enumerate() {
            target.prior().theta_from_u(self.row(i), row);
        }
        theta
    }

    /// The largest log-likelihood.
    pub fn best(&self) -> f64 {
        self.ln_l.iter().copied().fold(f64::NEG_INFINITY, f64::max)
    }
}

/// The points that die together, and the likelihood bound that their successors must exceed.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Replacement {
    /// The largest log-likelihood among the dying points.
    pub contour: f64,
    /// Rows that die, lowest first, ties in row order.
    pub dying: Vec<usize>,
    /// Rows that stay, in row order.
    pub kept: Vec<usize>,
}

/// The `size` lowest points and all that are equal to the highest of them: a plateau dies as a whole.
pub(super) fn lowest(live: &Points, size: usize) -> Replacement {
    let mut order: Vec<usize> = (0..live.len()).collect();
    order.sort_by(|&a, &b| live.ln_l[a].total_cmp(&live.ln_l[b]));
    let contour = order
        .get(size.clamp(1, live.len().max(1)) - 1)
        .map_or(f64::INFINITY, |&i| live.ln_l[i]);
    let dying: Vec<usize> = order
        .into_iter()
        .take_while(|&i| live.ln_l[i] <= contour)
        .collect();
    let kept = (0..live.len())
        .filter(|&i| live.ln_l[i] > contour)
        .collect();
    Replacement {
        contour,
        dying,
        kept,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ties_with_the_last_one_die_with_it() {
        let mut live = Points::new(1);
        for (i, l) in (0..).zip([3.0, 1.0, 2.0, 2.0, 5.0, 2.0]) {
            live.push(&[0.5], l, f64::NEG_INFINITY, i);
        }
        let replacement = lowest(&live, 2);
        assert_eq!(replacement.dying, [1, 2, 3, 5]);
        assert_eq!(replacement.kept, [0, 4]);
        assert!((replacement.contour - 2.0).abs() < 1e-15);
        assert!(lowest(&live, 6).kept.is_empty());
    }

    #[test]
    fn recent_lineages_are_founded_anew_each_in_its_half() {
        let mut live = Points::new(1);
        for lineage in [0_u32, 0, 0, 3, 2, 3, 0, 3] {
            live.push(&[0.5], 0.0, 0.0, lineage);
        }
        // Four of one, three of another, one alone.
        assert!((live.effective_recent_lineages() - 64.0 / 26.0).abs() < 1e-12);
        let halves = live.halves();
        live.begin_recent_lineages(20, 4);
        let recent_lineages: Vec<u32> = live
            .genealogy
            .iter()
            .map(|genealogy| genealogy.recent_lineage)
            .collect();
        assert_eq!(recent_lineages, [20, 22, 20, 21, 22, 23, 20, 21]);
        assert_eq!(live.halves(), halves);
    }
}
