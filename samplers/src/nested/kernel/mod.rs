//! Drawing a new point above a contour: directly from the bound, or by a chain of steps from a live point.

mod difference;
mod flight;
mod jump;
mod slice;
mod uniform;
mod walk;

use super::bound::Bound;
use super::likelihood::{Likelihood, Tally};
use super::live::Points;
use super::settings::Kernel;
use crate::error::Result;
use crate::neighbours::{Neighbours, Pair};
use crate::normal;
use crate::rng::Stream;
use crate::target::{Symmetry, Target};

/// What all points of a batch share.
pub(super) struct Setting<'a> {
    pub target: &'a dyn Target,
    /// New points lie strictly above this log-likelihood.
    pub contour: f64,
    /// The kernel, `Auto` resolved.
    pub kernel: Kernel,
    /// None: draw from the prior, whatever the kernel. One: draw from it. Two: the metrics of chains from even and
    /// odd lineages.
    pub bounds: &'a [Bound],
    /// The survivors of even and of odd lineages: a chain moves along differences of points of the half that its seed is not
    /// in. Empty but for the kernel that asks for them.
    pub halves: &'a [Neighbours; 2],
    /// Step length in units of the local ellipsoid.
    pub scale: f64,
    /// Step length along the difference of two points, in units of their distance.
    pub stride: f64,
    /// Slices, flights or walk steps.
    pub steps: usize,
}

/// What a step does not leave, lest its law change on the way.
#[derive(Clone, Copy, Debug)]
pub(super) enum Fence {
    /// The metric region of this label.
    Region(usize),
    /// The cell of a pair of points.
    Cell(Pair),
}

/// What steps did, for the tuning of their length.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Pace {
    /// Slices: steps outward. Flights: moves straight on. Walk: steps accepted.
    pub grown: u64,
    /// Slices: points that fell outside. Flights: moves that met an edge. Walk: steps refused.
    pub shrunk: u64,
}

impl Pace {
    /// Adds the steps of another.
    pub fn add(&mut self, other: Self) {
        self.grown += other.grown;
        self.shrunk += other.shrunk;
    }

    /// Share of the steps that grew; `None` before the first.
    pub fn share(&self) -> Option<f64> {
        let all = self.grown + self.shrunk;
        (all > 0).then(|| self.grown as f64 / all as f64)
    }
}

/// The steps of a chain.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Motion {
    /// Those in units of the local ellipsoid.
    pub local: Pace,
    /// Those along differences of points.
    pub differences: Pace,
    /// Whether the chain ended elsewhere than it began.
    pub moved: bool,
}

/// A new point.
#[derive(Debug)]
pub(super) struct Newborn {
    pub u: Vec<f64>,
    pub ln_l: f64,
    pub tally: Tally,
    pub motion: Motion,
}

/// The bound of chains that start from a point of this lineage.
pub(super) fn bound_of(bounds: &[Bound], lineage: u32) -> Option<&Bound> {
    let index = (lineage as usize).checked_rem(bounds.len())?;
    bounds.get(index)
}

/// Draws a point above the contour. Chains start at row `seed` of the survivors.
pub(super) fn draw(
    setting: &Setting<'_>,
    kept: &Points,
    seed: usize,
    mut rng: Stream,
) -> Result<Newborn> {
    let rng = &mut rng;
    let bound = bound_of(setting.bounds, kept.kin[seed].lineage);
    let Some(bound) = bound.filter(|_| setting.kernel != Kernel::Uniform) else {
        return uniform::draw(setting, bound, rng);
    };
    let mut chain = Chain::new(setting, bound, kept, seed);
    for step in 0..setting.steps {
        match setting.kernel {
            Kernel::RandomWalk => walk::step(&mut chain, rng)?,
            Kernel::Differential => difference::step(&mut chain, rng)?,
            Kernel::Reflective => flight::step(&mut chain, rng)?,
            _ => slice::step(&mut chain, rng)?,
        }
        if step == 0 {
            jump::try_all(&mut chain, rng)?;
        }
    }
    chain.refresh_orbits(rng)?;
    chain.motion.moved = chain.x != kept.row(seed);
    Ok(Newborn {
        u: chain.x,
        ln_l: chain.ln_l,
        tally: chain.likelihood.tally,
        motion: chain.motion,
    })
}

/// A walker above the contour and the workspace of its steps.
struct Chain<'a> {
    setting: &'a Setting<'a>,
    bound: &'a Bound,
    /// The survivors of the half that the seed is not in.
    others: &'a Neighbours,
    likelihood: Likelihood<'a>,
    x: Vec<f64>,
    ln_l: f64,
    /// Metric region of `x`.
    label: usize,
    trial: Vec<f64>,
    direction: Vec<f64>,
    ball: Vec<f64>,
    motion: Motion,
}

impl<'a> Chain<'a> {
    /// A chain that starts at row `seed` of `kept`.
    fn new(setting: &'a Setting<'a>, bound: &'a Bound, kept: &'a Points, seed: usize) -> Self {
        let [even, odd] = setting.halves;
        let others = if kept.kin[seed].lineage.is_multiple_of(2) {
            odd
        } else {
            even
        };
        let dim = kept.dim();
        Self {
            setting,
            bound,
            others,
            likelihood: Likelihood::new(setting.target),
            x: kept.row(seed).to_vec(),
            ln_l: kept.ln_l[seed],
            label: bound.label(kept.row(seed)),
            trial: vec![0.0; dim],
            direction: vec![0.0; dim],
            ball: vec![0.0; dim],
            motion: Motion::default(),
        }
    }

    /// Puts `x + t direction` into `trial`; whether it is in the cube, inside the walls and inside the fence.
    fn aim(&mut self, t: f64, fence: Fence) -> bool {
        let mut in_cube = true;
        for ((o, x), v) in self.trial.iter_mut().zip(&self.x).zip(&self.direction) {
            *o = x + t * v;
            in_cube &= *o > 0.0 && *o < 1.0;
        }
        in_cube && self.inside(fence) && self.likelihood.inside_walls(&self.trial)
    }

    /// Puts `x + t direction` into `trial`; its log-likelihood if the chain may go there and it is above the contour.
    fn look(&mut self, t: f64, fence: Fence) -> Result<Option<f64>> {
        if !self.aim(t, fence) {
            return Ok(None);
        }
        let ln_l = self.likelihood.at(&self.trial)?;
        Ok((ln_l > self.setting.contour).then_some(ln_l))
    }

    /// Whether `trial` is inside the fence.
    fn inside(&self, fence: Fence) -> bool {
        match fence {
            Fence::Region(label) => self.bound.has_label(&self.trial, label),
            Fence::Cell(pair) => {
                let orbit = Symmetry::first_orbit(self.setting.target.symmetries());
                self.others.unfenced(&pair)
                    || self.others.holds(&pair, &normals(&self.trial), orbit)
            }
        }
    }

    /// The chain's point in standard-normal coordinates.
    fn normals(&self) -> Vec<f64> {
        normals(&self.x)
    }

    /// Moves to `trial`.
    fn accept(&mut self, ln_l: f64) {
        std::mem::swap(&mut self.x, &mut self.trial);
        self.ln_l = ln_l;
    }

    /// Draws the position along every declared orbit afresh. The likelihood is the same there but for rounding, which a
    /// chaotic target amplifies: a point must carry the value of its own digits, or chains that start from it may find
    /// nothing above the contour. So it costs one call. A draw beyond a wall, or one that rounding takes below the
    /// contour, is refused.
    fn refresh_orbits(&mut self, rng: &mut Stream) -> Result<()> {
        for symmetry in self.setting.target.symmetries() {
            if let Symmetry::Orbit(orbit) = symmetry {
                let mut z = self.normals();
                orbit.refresh(&mut z, rng);
                cube_from_normal(&z, &mut self.trial);
                if self.likelihood.inside_walls(&self.trial) {
                    let ln_l = self.likelihood.at(&self.trial)?;
                    if ln_l > self.setting.contour {
                        self.accept(ln_l);
                    }
                }
            }
        }
        Ok(())
    }
}

/// A point of the cube in standard-normal coordinates.
fn normals(u: &[f64]) -> Vec<f64> {
    u.iter().map(|u| normal::quantile(*u)).collect()
}

/// The survivors of even and of odd lineages, for chains of the other half.
pub(super) fn halves(target: &dyn Target, kept: &Points) -> [Neighbours; 2] {
    let orbit = Symmetry::first_orbit(target.symmetries());
    kept.halves().map(|rows| {
        let z: Vec<f64> = rows.iter().flat_map(|&i| normals(kept.row(i))).collect();
        Neighbours::new(&z, kept.dim(), orbit)
    })
}

/// `u = Phi(z)`, kept inside the open cube where doubles would round it to a wall.
fn cube_from_normal(z: &[f64], u: &mut [f64]) {
    for (u, z) in u.iter_mut().zip(z) {
        *u = normal::cdf(*z).clamp(f64::MIN_POSITIVE, 1.0 - 0.5 * f64::EPSILON);
    }
}

#[cfg(test)]
mod tests;
