//! Sums over the particles of each bin, on any number type.

use super::grid::{BinGrid, Placed};
use super::segment::{SegmentRun, SkyPoint};
use crate::orbit::FinalParticle;
use crate::scalar::{Real, Scalar};

/// Sums over the particles of each bin: weight, weight times radius, weight times radius squared.
#[derive(Clone, Debug, PartialEq)]
pub struct Sums<S> {
    /// Total weight: the number of particles, those in two bins counted in parts.
    pub weight: Vec<S>,
    /// Sum of r, kpc.
    pub r: Vec<S>,
    /// Sum of r^2, kpc^2.
    pub r2: Vec<S>,
}

impl<S> Default for Sums<S> {
    fn default() -> Self {
        Self {
            weight: Vec::new(),
            r: Vec::new(),
            r2: Vec::new(),
        }
    }
}

impl<S: Scalar> Sums<S> {
    /// Empty bins; reuses the buffers.
    pub fn reset(&mut self, len: usize) {
        for column in [&mut self.weight, &mut self.r, &mut self.r2] {
            column.clear();
            column.resize(len, S::zero());
        }
    }
}

impl BinGrid {
    /// Adds a weight at a quadrature point beside an edge.
    #[inline(always)]
    fn add<S: Scalar>(
        &self,
        edge: f64,
        above: S,
        [r, r2]: [S; 2],
        weight: f64,
        sums: &mut Sums<S>,
    ) {
        for (i, share) in self.beside(edge).into_iter().zip([S::one() - above, above]) {
            if let Some(i) = i {
                let weight = share * weight;
                sums.weight[i] += weight;
                sums.r[i] += weight * r;
                sums.r2[i] += weight * r2;
            }
        }
    }

    /// Bins particles of any number type; the neighbour of each is `neighbour_offset` after it, 0 if there are none.
    pub fn sum_final_particles<S: Real>(
        &self,
        particles: &[FinalParticle<S>],
        neighbour_offset: usize,
        sums: &mut Sums<S>,
    ) {
        sums.reset(self.len);
        let sky_point = |i: usize| {
            let FinalParticle { state, turns, .. } = &particles[i];
            self.sky_point(state.x.x, state.x.y, *turns)
        };
        for run in SegmentRun::all(0..particles.len(), particles.len(), neighbour_offset) {
            for i in run.particles.clone() {
                let here = sky_point(i);
                let segment = here.segment(sky_point(run.neighbour(i))).limited(here.r);
                for k in 0..run.points {
                    let SkyPoint { position, r, r2 } = run.sky_point(here, segment, k);
                    let Placed { edge, above } = self.place(position);
                    self.add(edge.re(), above, [r, r2], run.weight(), sums);
                }
            }
        }
    }
}
