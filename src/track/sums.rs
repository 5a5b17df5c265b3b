//! Sums over the particles of each bin, on any number type.

use super::grid::{BinGrid, Placed, SkyPoint};
use super::smear::{Sky, Smear, Surroundings, WHOLE, below};
use crate::orbit::FinalParticle;
use crate::scalar::{LANES, Real, Scalar};
use crate::spray::Neighbourhood;

/// Sums over the particles of each bin: weight, weight times radius, weight times radius squared.
#[derive(Clone, Debug, PartialEq)]
pub struct Sums<S> {
    /// Total weight: the number of particles, those in several bins counted in parts.
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

    /// Adds to the bin of this number, if it is in the grid.
    fn add(&mut self, bin: Option<usize>, [weight, r, r2]: [S; 3]) {
        if let Some(i) = bin {
            self.weight[i] += weight;
            self.r[i] += r;
            self.r2[i] += r2;
        }
    }
}

impl BinGrid {
    /// Bins particles of any number type, smeared if they have neighbours.
    pub fn sum_final_particles<S: Real>(
        &self,
        particles: &[FinalParticle<S>],
        neighbourhood: Option<&Neighbourhood>,
        sums: &mut Sums<S>,
    ) {
        sums.reset(self.len);
        let points: Vec<SkyPoint<S>> = particles
            .iter()
            .map(|FinalParticle { state, turns, .. }| self.sky_point(state.x.x, state.x.y, *turns))
            .collect();
        for (i, point) in points.iter().enumerate() {
            let SkyPoint { position, sky } = *point;
            let Some(neighbourhood) = neighbourhood else {
                let Placed { edge, above } = self.place(position);
                let bins = self.beside(edge.re());
                for (bin, share) in bins.into_iter().zip([S::one() - above, above]) {
                    sums.add(bin, [share, share * sky.r, share * sky.r * sky.r]);
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
                WHOLE.map(S::from_f64)
            } else {
                below((-position + edge) * scale)
            };
            let [share, offset, offset2]: [S; 3] = std::array::from_fn(|c| here[c] - before[c]);
            let r = share * sky.r + rise * offset;
            let r2 = sky.r * (r * 2.0 - share * sky.r) + rise * rise * offset2;
            sums.add(self.beside(edge)[0], [share, r, r2]);
            before = here;
        }
    }
}

/// What particle number `i` is smeared over.
pub(super) fn surroundings<S: Scalar>(
    neighbourhood: &Neighbourhood,
    i: usize,
    sky: impl Fn(usize) -> Sky<S>,
) -> Surroundings<S> {
    let (block, lane) = (i / LANES, i % LANES);
    let here = sky(i);
    let partner = neighbourhood.partners[block][lane] as usize;
    let mut around = Surroundings::of_partner(here.apart(sky(partner)));
    for j in 0..neighbourhood.count {
        let at = block * neighbourhood.count + j;
        let apart = here.apart(sky(neighbourhood.indices[at][lane] as usize));
        for k in 0..neighbourhood.numbers {
            let weight = neighbourhood.weights[at * neighbourhood.numbers + k][lane];
            around.add(k, S::from_f64(weight), apart);
        }
    }
    around
}

fn smear<S: Scalar>(
    neighbourhood: &Neighbourhood,
    i: usize,
    sky: impl Fn(usize) -> Sky<S>,
) -> Smear<S> {
    let r = sky(i).r;
    Smear::new(surroundings(neighbourhood, i, sky).moments(), r)
}
