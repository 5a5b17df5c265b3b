//! Sums over the particles of each bin, on any number type.

use super::grid::{BinGrid, NearestEdge, SkyPoint};
use super::smear::{Displacement, Smear, StreamExtent, WHOLE_MOMENTS, moments_below};
use crate::orbit::FinalParticle;
use crate::scalar::{LANES, Real, Scalar};
use crate::spray::Neighbourhood;
use crate::stream::Particles;
use crate::units::KM_S_IN_KPC_PER_GYR;

/// Sums over the particles of each bin: weight, and weight times radius, radius squared, line-of-sight velocity and velocity squared.
#[derive(Clone, Debug, PartialEq)]
pub struct Sums<S> {
    /// Sum of the weights: the number of particles, where one in several bins adds a fraction to each.
    pub weight: Vec<S>,
    /// Sum of r, kpc.
    pub r: Vec<S>,
    /// Sum of r^2, kpc^2.
    pub r2: Vec<S>,
    /// Sum of v, km/s, away from the observer and relative to the host; empty where velocities are not summed.
    pub v: Vec<S>,
    /// Sum of v^2, km^2/s^2; empty where velocities are not summed.
    pub v2: Vec<S>,
    /// The mean of the squares of the particles' weights, which are 1 in the mean: the variance of a bin's mean is so many times larger than
    /// with even weights.
    pub mean_square_weight: S,
}

impl<S: Scalar> Default for Sums<S> {
    fn default() -> Self {
        Self {
            weight: Vec::new(),
            r: Vec::new(),
            r2: Vec::new(),
            v: Vec::new(),
            v2: Vec::new(),
            mean_square_weight: S::one(),
        }
    }
}

impl<S: Scalar> Sums<S> {
    /// Sets the sums of `len` bins to zero, without those of velocities; the buffers are reused.
    pub fn reset(&mut self, len: usize) {
        for column in [&mut self.weight, &mut self.r, &mut self.r2] {
            column.clear();
            column.resize(len, S::zero());
        }
        self.v.clear();
        self.v2.clear();
        self.mean_square_weight = S::one();
    }

    /// Sets the sums of the velocities to zero.
    pub fn reset_velocities(&mut self) {
        for column in [&mut self.v, &mut self.v2] {
            column.clear();
            column.resize(self.weight.len(), S::zero());
        }
    }

    /// Whether velocities are summed.
    #[must_use]
    pub fn has_velocities(&self) -> bool {
        !self.v.is_empty()
    }
}

/// Mean and variance of a quantity from its sums.
#[inline(always)]
pub(crate) fn moments<S: Scalar>(weight: S, sum: S, sum_of_squares: S) -> (S, S) {
    let mean = sum / weight;
    (mean, (sum_of_squares / weight - mean * mean).max(S::zero()))
}

/// What is averaged over the particles of a bin.
pub(super) struct Quantity<'a, S> {
    /// The places of all particles.
    pub points: &'a [SkyPoint<S>],
    /// Its value for each particle.
    pub values: &'a [S],
    /// Their neighbours, if they are smeared.
    pub neighbourhood: Option<&'a Neighbourhood>,
    /// Their weights; none if all are 1.
    pub weights: &'a [S],
}

impl BinGrid {
    /// Sums over the bins of particles on any number type, smeared if there is a neighbourhood, and of their velocities if `velocities`:
    /// the reference for [`sum`](Self::sum). `weights` is empty if all are 1. `offset_deg` is the offset of the grid with its derivatives.
    pub fn sum_final_particles<S: Real>(
        &self,
        particles: &[FinalParticle<S>],
        weights: &[S],
        neighbourhood: Option<&Neighbourhood>,
        offset_deg: S,
        velocities: bool,
        sums: &mut Sums<S>,
    ) {
        sums.reset(self.len);
        let offset = offset_deg / self.width_deg;
        let points: Vec<SkyPoint<S>> = particles
            .iter()
            .map(|particle| {
                self.sky_point(
                    particle.state.x.x,
                    particle.state.x.y,
                    particle.winding_number,
                    offset,
                )
            })
            .collect();
        let radii: Vec<S> = points.iter().map(|point| point.sky.r).collect();
        let quantity = Quantity {
            points: &points,
            values: &radii,
            neighbourhood,
            weights,
        };
        self.deposit(&quantity, Smear::of_radius, |_, bin, [weight, r, r2]| {
            sums.weight[bin] += weight;
            sums.r[bin] += r;
            sums.r2[bin] += r2;
        });
        if velocities {
            let velocities: Vec<S> = (particles.iter())
                .map(|particle| line_of_sight_km_s(particle.state.v.z))
                .collect();
            let quantity = Quantity {
                values: &velocities,
                ..quantity
            };
            self.deposit_velocities(&quantity, sums);
        }
    }

    /// Adds the sums of the velocities of particles whose radii are summed.
    pub fn sum_velocities(&self, particles: &Particles, sums: &mut Sums<f64>) {
        let velocities: Vec<f64> = particles.v[2]
            .iter()
            .map(|v| line_of_sight_km_s(*v))
            .collect();
        let quantity = Quantity {
            points: &self.sky_points(particles),
            values: &velocities,
            neighbourhood: particles.neighbourhood.as_deref(),
            weights: &particles.weights,
        };
        self.deposit_velocities(&quantity, sums);
    }

    /// The places of all particles.
    pub(super) fn sky_points(&self, particles: &Particles) -> Vec<SkyPoint<f64>> {
        let Particles {
            x,
            y,
            winding_numbers,
            ..
        } = particles;
        (0..particles.len())
            .map(|i| self.sky_point(x[i], y[i], winding_numbers[i], self.offset()))
            .collect()
    }

    fn deposit_velocities<S: Real>(&self, quantity: &Quantity<'_, S>, sums: &mut Sums<S>) {
        sums.reset_velocities();
        let smear = |moments, _| Smear::of_velocity(moments);
        self.deposit(quantity, smear, |_, bin, [_, v, v2]| {
            sums.v[bin] += v;
            sums.v2[bin] += v2;
        });
    }

    /// Calls `add` with the number of a particle, the index of a bin and the particle's sums there: of its weight, of the quantity and of its
    /// square. `smear` has the smearing of a particle from the moments of the stream around it and its radius.
    pub(super) fn deposit<S: Real>(
        &self,
        quantity: &Quantity<'_, S>,
        smear: impl Fn((S, S), S) -> Smear<S>,
        mut add: impl FnMut(usize, usize, [S; 3]),
    ) {
        for (i, (point, &value)) in quantity.points.iter().zip(quantity.values).enumerate() {
            let position = point.position;
            let of_particle = quantity.weight(i);
            let mut add = |bin, sums: [S; 3]| add(i, bin, sums.map(|sum| sum * of_particle));
            let Some(extent) = quantity.extent(i) else {
                let NearestEdge { edge, above } = self.nearest_edge(position);
                let bins = self.bins_beside(edge.re());
                for (bin, weight) in bins.into_iter().zip([S::one() - above, above]) {
                    if let Some(bin) = bin {
                        add(bin, [weight, weight * value, weight * value * value]);
                    }
                }
                continue;
            };
            let smear = smear(extent.moments(), point.sky.r);
            let half_width = smear.half_width(self.soft());
            let (middle, reach) = self.edges_within(position.re(), half_width.re());
            let scale = S::one() / (half_width * self.per_radian());
            let rise = smear.slope * half_width;
            let mut before = [S::zero(); 3];
            for k in -reach..=reach + 1 {
                let edge = middle + f64::from(k);
                let here = if k > reach {
                    WHOLE_MOMENTS.map(S::from_f64)
                } else {
                    moments_below((-position + edge) * scale)
                };
                let [weight, offset, offset2]: [S; 3] =
                    std::array::from_fn(|c| here[c] - before[c]);
                let sum = weight * value + rise * offset;
                let square = value * (sum * 2.0 - weight * value) + rise * rise * offset2;
                if let Some(bin) = self.bins_beside(edge)[0] {
                    add(bin, [weight, sum, square]);
                }
                before = here;
            }
        }
    }
}

/// The line-of-sight velocity in km/s, away from the observer, of a velocity along z in kpc/Gyr.
pub(super) fn line_of_sight_km_s<S: Scalar>(vz: S) -> S {
    -vz / KM_S_IN_KPC_PER_GYR
}

impl<S: Scalar> Quantity<'_, S> {
    /// The weight of particle number `i`.
    pub(super) fn weight(&self, i: usize) -> S {
        self.weights.get(i).copied().unwrap_or(S::one())
    }

    /// The displacement from particle number `i` to number `j`.
    fn displacement(&self, i: usize, j: usize) -> Displacement<S> {
        let change = self.values[j] - self.values[i];
        self.points[i]
            .sky
            .displacement_with(self.points[j].sky, change)
    }

    /// The extent of the stream around particle number `i`, if it is smeared.
    pub(super) fn extent(&self, i: usize) -> Option<StreamExtent<S>> {
        let neighbourhood = self.neighbourhood?;
        let (block, lane) = (i / LANES, i % LANES);
        let partner = neighbourhood.partners[block][lane] as usize;
        let mut extent = StreamExtent::from_partner(self.displacement(i, partner));
        for j in 0..neighbourhood.count {
            let at = block * neighbourhood.count + j;
            let displacement = self.displacement(i, neighbourhood.indices[at][lane] as usize);
            for k in 0..neighbourhood.normals {
                let weight = neighbourhood.weights[at * neighbourhood.normals + k][lane];
                extent.add(k, S::from_f64(weight), displacement);
            }
        }
        Some(extent)
    }
}
