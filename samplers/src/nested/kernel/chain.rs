//! A Markov chain above a likelihood bound: its state, what the chains of an iteration have in common, and the
//! partition that a step may not leave.

use super::along::Along;
use crate::difference_pool::{DifferencePool, PairCell};
use crate::error::Result;
use crate::nested::bound::Bound;
use crate::nested::likelihood::Likelihood;
use crate::nested::live::Points;
use crate::nested::settings::Kernel;
use crate::normal;
use crate::output::Calls;
use crate::rng::RandomStream;
use crate::surrogate::Examples;
use crate::target::{Symmetry, Target};

/// Common data of all points of an iteration.
pub(in crate::nested) struct ChainContext<'a> {
    pub target: &'a dyn Target,
    /// New points lie strictly above this log-likelihood.
    pub contour: f64,
    /// The kernel, `Auto` resolved.
    pub kernel: Kernel,
    /// None: draw from the prior, whatever the kernel. One: draw from it. Two: the metrics of chains from even and
    /// odd lineages.
    pub bounds: &'a [Bound],
    /// The surviving points of even and of odd lineages: a chain moves along differences of points of the half that does not
    /// contain its seed. Empty unless the kernel uses them.
    pub halves: &'a [DifferencePool; 2],
    /// Step length in units of the local ellipsoid.
    pub scale: f64,
    /// Step length along the difference of two points, in units of their distance.
    pub stride: f64,
    /// Slice updates, Galilean trajectories or walk steps.
    pub steps: usize,
    /// The surrogate, once there is one.
    pub along: Option<&'a Along<'a>>,
}

/// The part of the space that a step may not leave, so that the distribution of proposals is the same from everywhere
/// in it.
#[derive(Clone, Copy, Debug)]
pub(in crate::nested) enum Partition {
    /// The metric region of this label.
    Region(usize),
    /// The cell of a pair of points.
    Cell(PairCell),
}

/// Counts of steps, for the tuning of their length.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::nested) struct StepCounts {
    /// Slice updates: steps outwards. Galilean Monte Carlo: straight moves. Random walk: accepted steps.
    pub grown: u64,
    /// Slice updates: points outside. Galilean Monte Carlo: moves that met the bound. Random walk: rejected steps.
    pub shrunk: u64,
}

impl StepCounts {
    /// Adds the steps of another.
    pub fn add(&mut self, other: Self) {
        self.grown += other.grown;
        self.shrunk += other.shrunk;
    }

    /// Fraction of the steps that grew; `None` before the first.
    pub fn fraction(&self) -> Option<f64> {
        let all = self.grown + self.shrunk;
        (all > 0).then(|| self.grown as f64 / all as f64)
    }
}

/// How the chain moved.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::nested) struct Motion {
    /// Those in units of the local ellipsoid.
    pub local: StepCounts,
    /// Those along differences of points.
    pub differences: StepCounts,
    /// Those along a surrogate.
    pub trajectories: Trajectories,
    /// Independent proposals.
    pub proposals: Counts,
    /// Whether the chain ended elsewhere than it began.
    pub moved: bool,
}

/// Counts of independent proposals.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::nested) struct Counts {
    /// Number of tries.
    pub tried: u64,
    /// Of which a draw was kept.
    pub kept: u64,
    /// Of which accepted.
    pub accepted: u64,
}

impl Counts {
    /// Adds one.
    pub fn note(&mut self, kept: bool, accepted: bool) {
        self.tried += 1;
        self.kept += u64::from(kept);
        self.accepted += u64::from(accepted);
    }

    /// Adds those of another.
    pub fn add(&mut self, other: Self) {
        self.tried += other.tried;
        self.kept += other.kept;
        self.accepted += other.accepted;
    }
}

/// Counts of trajectories along a surrogate.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::nested) struct Trajectories {
    /// Number of them.
    pub made: u64,
    /// Of which accepted.
    pub accepted: u64,
    /// Sum of the probabilities of acceptance by the surrogate's own energy.
    pub energy: f64,
}

impl Trajectories {
    /// Adds one.
    pub fn note(&mut self, energy: f64, accepted: bool) {
        self.made += 1;
        self.accepted += u64::from(accepted);
        self.energy += energy;
    }

    /// Adds those of another.
    pub fn add(&mut self, other: Self) {
        self.made += other.made;
        self.accepted += other.accepted;
        self.energy += other.energy;
    }
}

/// A new point.
#[derive(Debug)]
pub(in crate::nested) struct NewPoint {
    pub u: Vec<f64>,
    pub ln_l: f64,
    pub calls: Calls,
    /// Some of its values, if a surrogate learns from them.
    pub examples: Examples,
    pub motion: Motion,
}

/// A chain above the likelihood bound, and its buffers.
pub(super) struct Chain<'a> {
    pub(super) context: &'a ChainContext<'a>,
    pub(super) bound: &'a Bound,
    /// The surviving points of the half that does not contain the seed.
    pub(super) others: &'a DifferencePool,
    pub(super) likelihood: Likelihood<'a>,
    pub(super) x: Vec<f64>,
    pub(super) ln_l: f64,
    /// Metric region of `x`.
    pub(super) label: usize,
    pub(super) trial: Vec<f64>,
    pub(super) direction: Vec<f64>,
    pub(super) ball: Vec<f64>,
    pub(super) motion: Motion,
}

impl<'a> Chain<'a> {
    /// A chain that starts at row `seed` of `kept`.
    pub(super) fn new(
        context: &'a ChainContext<'a>,
        bound: &'a Bound,
        kept: &'a Points,
        seed: usize,
    ) -> Self {
        let [even, odd] = context.halves;
        let others = if kept.genealogy[seed].lineage.is_multiple_of(2) {
            odd
        } else {
            even
        };
        let dim = kept.dim();
        Self {
            context,
            bound,
            others,
            likelihood: Likelihood::new(context.target)
                .keeping_examples(context.kernel == Kernel::Surrogate),
            x: kept.row(seed).to_vec(),
            ln_l: kept.ln_l[seed],
            label: bound.label(kept.row(seed)),
            trial: vec![0.0; dim],
            direction: vec![0.0; dim],
            ball: vec![0.0; dim],
            motion: Motion::default(),
        }
    }

    /// Writes `x + t direction` into `trial`; returns whether that is in the cube and in the partition.
    pub(super) fn set_trial(&mut self, t: f64, partition: Partition) -> bool {
        let mut in_cube = true;
        for ((o, x), v) in self.trial.iter_mut().zip(&self.x).zip(&self.direction) {
            *o = x + t * v;
            in_cube &= *o > 0.0 && *o < 1.0;
        }
        in_cube && self.inside(partition)
    }

    /// Writes `x + t direction` into `trial`; returns its log-likelihood if it is in the cube, in the partition and
    /// above the bound.
    pub(super) fn try_trial(&mut self, t: f64, partition: Partition) -> Result<Option<f64>> {
        if !self.set_trial(t, partition) {
            return Ok(None);
        }
        let ln_l = self.likelihood.at(&self.trial)?;
        Ok((ln_l > self.context.contour).then_some(ln_l))
    }

    /// Whether `trial` is inside the partition.
    pub(super) fn inside(&self, partition: Partition) -> bool {
        match partition {
            Partition::Region(label) => self.bound.has_label(&self.trial, label),
            Partition::Cell(cell) => {
                let orbit = Symmetry::first_orbit(self.context.target.symmetries());
                self.others.is_undivided(cell)
                    || self.others.holds(cell, &normals(&self.trial), orbit)
            }
        }
    }

    /// The chain's point in standard-normal coordinates.
    pub(super) fn normals(&self) -> Vec<f64> {
        normals(&self.x)
    }

    /// Moves to `trial`.
    pub(super) fn accept(&mut self, ln_l: f64) {
        std::mem::swap(&mut self.x, &mut self.trial);
        self.ln_l = ln_l;
    }

    /// Redraws the position along every declared orbit. The likelihood is the same there except for rounding, which a
    /// chaotic target amplifies; it is evaluated again (one call), because chains that start from a point with another
    /// point's value may find nothing above the bound. A draw that rounding takes below the bound is rejected.
    pub(super) fn refresh_orbits(&mut self, rng: &mut RandomStream) -> Result<()> {
        for symmetry in self.context.target.symmetries() {
            if let Symmetry::Orbit(orbit) = symmetry {
                let mut z = self.normals();
                orbit.refresh(&mut z, rng);
                cube_from_normal(&z, &mut self.trial);
                let ln_l = self.likelihood.at(&self.trial)?;
                if ln_l > self.context.contour {
                    self.accept(ln_l);
                }
            }
        }
        Ok(())
    }
}

/// A point of the cube in standard-normal coordinates.
pub(super) fn normals(u: &[f64]) -> Vec<f64> {
    u.iter().map(|u| normal::quantile(*u)).collect()
}

/// `u = Phi(z)`, kept inside the open cube where doubles would round it to a face.
pub(super) fn cube_from_normal(z: &[f64], u: &mut [f64]) {
    for (u, z) in u.iter_mut().zip(z) {
        *u = normal::cdf(*z).clamp(f64::MIN_POSITIVE, 1.0 - 0.5 * f64::EPSILON);
    }
}

/// The wall at a likelihood bound, so many widths below it: ln(1 + e^x), where e^x may overflow.
pub(super) fn wall(x: f64) -> f64 {
    x.max(0.0) + (-x.abs()).exp().ln_1p()
}
