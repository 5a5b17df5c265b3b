//! The particles of a stream today, as columns.

use super::lane_groups::Bundle;
use super::progenitor_solution::Releases;
use super::step_sizes::StepSizes;
use crate::error::Tally;
use crate::orbit::{FinalParticle, MAX_TOGETHER, State};
use crate::scalar::{LANES, LaneArray, Lanes, Vectors, angle};
use crate::spray::Neighbourhood;
use std::f64::consts::TAU;
use std::sync::Arc;

/// Present-day particles, component by component, in the order of the table.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Particles {
    /// Sky x, kpc.
    pub x: Vec<f64>,
    /// Sky y, kpc.
    pub y: Vec<f64>,
    /// z, towards the observer, kpc.
    pub z: Vec<f64>,
    /// Velocity, kpc/Gyr, x, y and z.
    pub v: [Vec<f64>; 3],
    /// Winding numbers.
    pub winding_numbers: Vec<f64>,
    /// Their weights, which are 1 in the mean; none if all are 1.
    pub weights: Vec<f64>,
    /// Their neighbours in release space, if they are smeared.
    pub neighbourhood: Option<Arc<Neighbourhood>>,
    /// The sizes of their steps.
    pub step_sizes: StepSizes,
    /// The approximations made for them.
    pub tally: Tally,
}

impl Particles {
    /// Number of particles.
    #[must_use]
    pub fn len(&self) -> usize {
        self.x.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.x.is_empty()
    }

    /// Sets the weights to those of release times with `per_release_time` particles each.
    pub(super) fn set_weights(&mut self, releases: &Releases<f64>, per_release_time: usize) {
        self.weights.clear();
        (self.weights).extend(releases.weights_of_particles(per_release_time));
    }

    /// The weight of particle number `i`.
    #[must_use]
    pub fn weight(&self, i: usize) -> f64 {
        self.weights.get(i).copied().unwrap_or(1.0)
    }

    /// The mean of the squares of the weights.
    #[must_use]
    pub fn mean_square_weight(&self) -> f64 {
        if self.weights.is_empty() {
            return 1.0;
        }
        self.weights.iter().map(|w| w * w).sum::<f64>() / self.weights.len() as f64
    }

    /// Angle phi of particle number `i` in radians: on the sky from the progenitor, unwrapped (docs/physics.md, section 6).
    #[must_use]
    pub fn angle(&self, i: usize) -> f64 {
        angle(self.y[i], self.x[i]) + TAU * self.winding_numbers[i]
    }

    /// All columns with the length `n`, to be written, and the record of step sizes.
    pub(super) fn columns(&mut self, n: usize) -> (Columns<'_>, &mut StepSizes) {
        let [vx, vy, vz] = &mut self.v;
        let columns = [
            &mut self.x,
            &mut self.y,
            &mut self.z,
            vx,
            vy,
            vz,
            &mut self.winding_numbers,
        ];
        let columns = Columns {
            first: 0,
            columns: columns.map(|column| {
                column.resize(n, 0.0);
                column.as_mut_slice()
            }),
        };
        (columns, &mut self.step_sizes)
    }
}

/// The columns of [`Particles`] for consecutive particles.
pub(super) struct Columns<'a> {
    /// Number of its first particle.
    first: usize,
    /// x, y, z, the velocity and the winding number.
    columns: [&'a mut [f64]; 7],
}

impl<'a> Columns<'a> {
    /// The columns of the particles before number `at`, and of those from it on.
    pub fn split(self, at: usize) -> (Self, Self) {
        let first = self.first;
        let [x, y, z, vx, vy, vz, winding] = self.columns.map(|c| c.split_at_mut(at - first));
        let before = Self {
            first,
            columns: [x.0, y.0, z.0, vx.0, vy.0, vz.0, winding.0],
        };
        let after = Self {
            first: at,
            columns: [x.1, y.1, z.1, vx.1, vy.1, vz.1, winding.1],
        };
        (before, after)
    }

    /// Stores the lanes of a bundle. Returns their number of ambiguous windings, NaN if any state is not finite.
    #[inline(always)]
    pub fn store<V: Vectors, const K: usize>(
        &mut self,
        bundle: &Bundle<'_>,
        particle: &FinalParticle<Lanes<V, K>>,
    ) -> f64 {
        let State { x, v } = particle.state;
        // Zero for finite states, NaN otherwise.
        let not_finite = (x.norm2() + v.norm2()) * 0.0;
        let columns = [
            x.x,
            x.y,
            x.z,
            v.x,
            v.y,
            v.z,
            particle.winding_number,
            particle.ambiguous_windings + not_finite,
        ];
        let mut values = [LaneArray([[0.0; LANES]; MAX_TOGETHER]); 8];
        for i in 0..columns.len() {
            columns[i].store_groups(&mut values[i].0);
        }
        self.copy(bundle, &values)
    }

    /// Copies lanes into the columns. Returns the number of ambiguous windings.
    #[inline(never)]
    fn copy(&mut self, bundle: &Bundle<'_>, values: &[LaneArray<MAX_TOGETHER>; 8]) -> f64 {
        let [columns @ .., ambiguous_windings] = values;
        let mut sum = 0.0;
        for (k, len) in bundle
            .lens
            .into_iter()
            .enumerate()
            .filter(|(_, len)| *len > 0)
        {
            sum += ambiguous_windings.0[k][..len].iter().sum::<f64>();
            let from = bundle.lane_groups[k].first - self.first;
            for (column, values) in self.columns.iter_mut().zip(columns) {
                column[from..from + len].copy_from_slice(&values.0[k][..len]);
            }
        }
        sum
    }
}
