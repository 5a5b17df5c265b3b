//! Sums over the particles of each bin, on any number type.

use super::grid::{BinGrid, NearestEdge, SkyPoint};
use super::smear::{Sky, Smear, StreamExtent, WHOLE_MOMENTS, moments_below};
use crate::orbit::FinalParticle;
use crate::scalar::{LANES, Real, Scalar};
use crate::spray::Neighbourhood;

/// Sums over the particles of each bin: weight, weight times radius, weight times radius squared.
#[derive(Clone, Debug, PartialEq)]
pub struct Sums<S> {
    /// Sum of the weights: the number of particles, where one in several bins adds a fraction to each.
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
    /// Sets the sums of `len` bins to zero; the buffers are reused.
    pub fn reset(&mut self, len: usize) {
        for column in [&mut self.weight, &mut self.r, &mut self.r2] {
            column.clear();
            column.resize(len, S::zero());
        }
    }

    /// Adds to the bin of this index, if it is in the grid.
    fn add(&mut self, bin: Option<usize>, [weight, r, r2]: [S; 3]) {
        if let Some(i) = bin {
            self.weight[i] += weight;
            self.r[i] += r;
            self.r2[i] += r2;
        }
    }
}

impl BinGrid {
    /// Sums over the bins of particles on any number type, smeared if there is a neighbourhood: the reference for [`sum`](Self::sum).
    /// `offset_deg` is the offset of the grid with its derivatives.
    pub fn sum_final_particles<S: Real>(
        &self,
        particles: &[FinalParticle<S>],
        neighbourhood: Option<&Neighbourhood>,
        offset_deg: S,
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
        for (i, point) in points.iter().enumerate() {
            let SkyPoint { position, sky } = *point;
            let Some(neighbourhood) = neighbourhood else {
                let NearestEdge { edge, above } = self.nearest_edge(position);
                let bins = self.bins_beside(edge.re());
                for (bin, weight) in bins.into_iter().zip([S::one() - above, above]) {
                    sums.add(bin, [weight, weight * sky.r, weight * sky.r * sky.r]);
                }
                continue;
            };
            let smear = smear(neighbourhood, i, |j| points[j].sky);
            self.sum_smeared(position, sky, smear, sums);
        }
    }

    /// Adds one smeared particle.
    fn sum_smeared<S: Real>(&self, position: S, sky: Sky<S>, smear: Smear<S>, sums: &mut Sums<S>) {
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
            let [weight, offset, offset2]: [S; 3] = std::array::from_fn(|c| here[c] - before[c]);
            let r = weight * sky.r + rise * offset;
            let r2 = sky.r * (r * 2.0 - weight * sky.r) + rise * rise * offset2;
            sums.add(self.bins_beside(edge)[0], [weight, r, r2]);
            before = here;
        }
    }
}

/// The extent of the stream around particle number `i`; `sky` gives the place of a particle by its number.
pub(super) fn stream_extent<S: Scalar>(
    neighbourhood: &Neighbourhood,
    i: usize,
    sky: impl Fn(usize) -> Sky<S>,
) -> StreamExtent<S> {
    let (block, lane) = (i / LANES, i % LANES);
    let here = sky(i);
    let partner = neighbourhood.partners[block][lane] as usize;
    let mut extent = StreamExtent::from_partner(here.displacement_to(sky(partner)));
    for j in 0..neighbourhood.count {
        let at = block * neighbourhood.count + j;
        let displacement = here.displacement_to(sky(neighbourhood.indices[at][lane] as usize));
        for k in 0..neighbourhood.normals {
            let weight = neighbourhood.weights[at * neighbourhood.normals + k][lane];
            extent.add(k, S::from_f64(weight), displacement);
        }
    }
    extent
}

/// The smearing of particle number `i`.
fn smear<S: Scalar>(
    neighbourhood: &Neighbourhood,
    i: usize,
    sky: impl Fn(usize) -> Sky<S>,
) -> Smear<S> {
    let r = sky(i).r;
    Smear::new(stream_extent(neighbourhood, i, sky).moments(), r)
}
