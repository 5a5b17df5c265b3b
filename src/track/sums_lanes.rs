//! Sums over the particles of each bin, in SIMD lanes and on several threads.

use super::grid::{BinGrid, NearestEdge, SkyPoint};
use super::smear::{Displacement, Sky, SkyRow, Smear, StreamExtent, moments_below};
use super::sums::Sums;
use crate::scalar::{Isa, Kernel, LANES, LaneArray, Lanes, Level, Scalar, compile_kernel};
use crate::spray::{MAX_NORMALS, Neighbourhood};
use crate::stream::Particles;
use rayon::prelude::*;

/// Number of particles in a chunk, a multiple of [`LANES`]. The sums of chunks are added in order, so the bits do not depend on the number
/// of threads.
const PARTICLES_PER_CHUNK: usize = 1_024;

/// Largest number of bins of all chunks that are summed at once: 200 MB.
const MAX_BINS_AT_ONCE: usize = 1 << 20;

/// Sums over the particles of a chunk; the buffers are reused.
#[derive(Clone, Debug, Default)]
pub struct PartialSums {
    /// Weight, r and r^2 of each bin, of each lane for itself: additions of particles that are computed together do not wait for each other.
    bins: Vec<[LaneArray<1>; 3]>,
    /// phi in bin widths of the particles of the chunk, their neighbours and partners; a multiple of [`LANES`].
    positions: Vec<f64>,
    /// Their directions and radii.
    skies: Vec<SkyRow>,
}

impl PartialSums {
    fn reset(&mut self, len: usize) {
        self.bins.clear();
        self.bins.resize(len, [LaneArray([[0.0; LANES]]); 3]);
    }

    /// Adds the particles in lanes to the bin of this index.
    #[inline(always)]
    fn add<I: Isa>(&mut self, bin: usize, addends: [Lanes<I, 1>; 3]) {
        let bin = &mut self.bins[bin];
        for c in 0..3 {
            bin[c] = (Lanes::load(&bin[c]) + addends[c]).store();
        }
    }

    /// Adds the particle in a lane to the bin of this index, if there is one.
    #[inline(always)]
    fn add_one(&mut self, lane: usize, bin: f64, addends: [f64; 3]) {
        if bin < 0.0 || bin >= self.bins.len() as f64 {
            return;
        }
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "between 0 and the number of bins"
        )]
        let bin = &mut self.bins[bin as usize];
        for c in 0..3 {
            bin[c].0[0][lane] += addends[c];
        }
    }

    /// Adds the sums of the chunk to those of all particles.
    fn add_to(&self, sums: &mut Sums<f64>) {
        let total = |lanes: &LaneArray<1>| lanes.0[0].iter().sum::<f64>();
        let columns = sums.weight.iter_mut().zip(&mut sums.r).zip(&mut sums.r2);
        for (bin, ((weight, r), r2)) in self.bins.iter().zip(columns) {
            *weight += total(&bin[0]);
            *r += total(&bin[1]);
            *r2 += total(&bin[2]);
        }
    }
}

impl BinGrid {
    /// Sums over the bins, smeared if the particles have a neighbourhood, for the best instruction set of this CPU. `partial` is a buffer.
    pub fn sum(&self, particles: &Particles, sums: &mut Sums<f64>, partial: &mut PartialSums) {
        self.sum_at(Level::best(), particles, sums, partial);
    }

    /// As [`sum`](Self::sum), for a chosen instruction set, so that tests can compare them.
    pub fn sum_at(
        &self,
        level: Level,
        particles: &Particles,
        sums: &mut Sums<f64>,
        partial: &mut PartialSums,
    ) {
        sums.reset(self.len);
        sums.mean_square_weight = particles.mean_square_weight();
        for first in (0..particles.len()).step_by(PARTICLES_PER_CHUNK) {
            self.sum_chunk(level, particles, first, partial);
            partial.add_to(sums);
        }
    }

    /// As [`sum`](Self::sum), on the threads of the present rayon pool. The result has the same bits.
    pub fn sum_in_parallel(&self, particles: &Particles, sums: &mut Sums<f64>) {
        sums.reset(self.len);
        sums.mean_square_weight = particles.mean_square_weight();
        // A bounded number of chunks at once, so that memory does not grow with the number of particles.
        let fitting = MAX_BINS_AT_ONCE / self.len;
        let count = (4 * rayon::current_num_threads()).min(fitting.max(1));
        let mut partial = vec![PartialSums::default(); count];
        let at_once = partial.len() * PARTICLES_PER_CHUNK;
        for first in (0..particles.len()).step_by(at_once) {
            let firsts = (first..particles.len().min(first + at_once)).step_by(PARTICLES_PER_CHUNK);
            let firsts: Vec<usize> = firsts.collect();
            let chunks = &mut partial[..firsts.len()];
            chunks
                .par_iter_mut()
                .zip(firsts)
                .for_each(|(chunk, first)| {
                    self.sum_chunk(Level::best(), particles, first, chunk);
                });
            chunks.iter().for_each(|chunk| chunk.add_to(sums));
        }
    }

    /// Sums over the chunk of particles that begins with number `first`; the last chunk may be shorter.
    fn sum_chunk(&self, level: Level, particles: &Particles, first: usize, sums: &mut PartialSums) {
        sums.reset(self.len);
        let binning = BinKernel {
            grid: self,
            particles,
            first,
            sums,
        };
        binning.dispatch(level);
    }
}

/// The sums over a chunk of particles.
struct BinKernel<'a> {
    grid: &'a BinGrid,
    particles: &'a Particles,
    first: usize,
    sums: &'a mut PartialSums,
}

/// The first numbers of a column in lanes; lanes beyond its end repeat the last one.
#[inline(always)]
fn repeated(column: &[f64]) -> LaneArray<1> {
    match column.first_chunk() {
        Some(numbers) => LaneArray([*numbers]),
        None => {
            let mut lanes = [1.0; LANES];
            for lane in 0..LANES {
                lanes[lane] = column[lane.min(column.len() - 1)];
            }
            LaneArray([lanes])
        }
    }
}

impl Kernel for BinKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let Self {
            grid,
            particles,
            first,
            sums,
        } = self;
        let len = particles.len();
        let last = len.min(first + PARTICLES_PER_CHUNK);
        let offset = Lanes::from_f64(grid.offset());
        let neighbourhood = particles.neighbourhood.as_deref();
        // Neighbours and partners may be in other chunks.
        let margin = neighbourhood.map_or(0, |n| n.reach.next_multiple_of(LANES));
        let (from, to) = (first.saturating_sub(margin), len.min(last + margin));
        sums.positions.clear();
        sums.skies.clear();
        for at in (from..to).step_by(LANES) {
            let x = Lanes::<I, 1>::load(&repeated(&particles.x[at..]));
            let y = Lanes::load(&repeated(&particles.y[at..]));
            let winding_number = Lanes::load(&repeated(&particles.winding_numbers[at..]));
            let SkyPoint { position, sky } = grid.sky_point(x, y, winding_number, offset);
            sums.positions.extend_from_slice(&position.store().0[0]);
            sums.skies.extend_from_slice(&sky.rows());
        }
        for at in (first..last).step_by(LANES) {
            let n = LANES.min(last - at);
            let position = Lanes::<I, 1>::load(&repeated(&sums.positions[at - from..]));
            let mut rows = [&sums.skies[0]; LANES];
            for lane in 0..LANES {
                rows[lane] = &sums.skies[at - from + lane];
            }
            let sky = Sky::from_rows(rows);
            let weight = if particles.weights.is_empty() {
                Lanes::one()
            } else {
                Lanes::load(&repeated(&particles.weights[at..]))
            };
            let block = BlockOfParticles {
                position,
                sky,
                weight,
                n,
            };
            match neighbourhood {
                None => add_points(grid, &block, sums),
                Some(neighbourhood) => {
                    let smear = smear(neighbourhood, at / LANES, from, sky, sums);
                    add_smeared(grid, &block, smear, sums);
                }
            }
        }
    }
}

compile_kernel!(BinKernel);

/// The smearing of the particles of a block; `from` is the number of the first particle in `sums.skies`.
#[inline(always)]
fn smear<I: Isa>(
    neighbourhood: &Neighbourhood,
    block: usize,
    from: usize,
    here: Sky<Lanes<I, 1>>,
    sums: &PartialSums,
) -> Smear<Lanes<I, 1>> {
    let partner = displacements(here, &neighbourhood.partners[block], from, sums);
    let mut extent = StreamExtent::from_partner(partner);
    for j in 0..neighbourhood.count {
        let row = block * neighbourhood.count + j;
        let neighbour = displacements(here, &neighbourhood.indices[row], from, sums);
        // A constant number of iterations, so that the sums are in registers.
        for k in 0..MAX_NORMALS {
            if k < neighbourhood.normals {
                let weights = &neighbourhood.weights[row * neighbourhood.normals + k];
                extent.add(k, Lanes::load(&LaneArray([*weights])), neighbour);
            }
        }
    }
    Smear::of_radius(extent.moments(), here.r)
}

/// The displacements to the particles with the numbers `others`.
#[inline(always)]
fn displacements<I: Isa>(
    here: Sky<Lanes<I, 1>>,
    others: &[u32; LANES],
    from: usize,
    sums: &PartialSums,
) -> Displacement<Lanes<I, 1>> {
    let mut rows = [&sums.skies[0]; LANES];
    for lane in 0..LANES {
        rows[lane] = &sums.skies[others[lane] as usize - from];
    }
    here.displacement_to(Sky::from_rows(rows))
}

/// Particles in lanes, `n` of them.
struct BlockOfParticles<I: Isa> {
    position: Lanes<I, 1>,
    sky: Sky<Lanes<I, 1>>,
    weight: Lanes<I, 1>,
    n: usize,
}

/// Adds particles, each to the two bins beside its nearest edge.
#[inline(always)]
fn add_points<I: Isa>(grid: &BinGrid, block: &BlockOfParticles<I>, sums: &mut PartialSums) {
    let BlockOfParticles {
        position,
        sky,
        weight: of_particle,
        n,
    } = *block;
    let NearestEdge { edge, above } = grid.nearest_edge(position);
    let (edge, above, r, of_particle) = (
        (edge - grid.first as f64).store().0[0],
        above.store().0[0],
        sky.r.store().0[0],
        of_particle.store().0[0],
    );
    for i in 0..n {
        let weights = [(1.0 - above[i]) * of_particle[i], above[i] * of_particle[i]];
        for k in 0..2 {
            let (weight, r) = (weights[k], r[i]);
            sums.add_one(
                i,
                edge[i] - 1.0 + k as f64,
                [weight, weight * r, weight * r * r],
            );
        }
    }
}

/// Adds smeared particles, which are computed together in every bin that one of them reaches.
#[inline(always)]
fn add_smeared<I: Isa>(
    grid: &BinGrid,
    block: &BlockOfParticles<I>,
    smear: Smear<Lanes<I, 1>>,
    sums: &mut PartialSums,
) {
    let BlockOfParticles {
        position,
        sky,
        weight: of_particle,
        n,
    } = *block;
    let half_width = smear.half_width(grid.soft());
    let reach = half_width * grid.per_radian();
    let place = position - grid.first as f64;
    // Lanes without a particle repeat the last one.
    let mut lowest = (place - reach).store().0[0];
    let mut highest = (place + reach).store().0[0];
    for half in [LANES / 2, LANES / 4, LANES / 8] {
        for i in 0..half {
            lowest[i] = Scalar::min(lowest[i], lowest[i + half]);
            highest[i] = Scalar::max(highest[i], highest[i + half]);
        }
    }
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "between 0 and the number of bins"
    )]
    let (first, end) = (
        lowest[0].max(0.0) as usize,
        highest[0].ceil().clamp(0.0, grid.len as f64) as usize,
    );
    if first >= end {
        return;
    }
    // Lanes without a particle have theirs beyond all bins.
    let mut places = place.store();
    for i in n..LANES {
        places.0[0][i] = f64::INFINITY;
    }
    let place = Lanes::<I, 1>::load(&places);
    let scale = Lanes::one() / reach;
    let rise = smear.slope * half_width;
    let rise2 = rise * rise;
    let mut before = moments_below((-place + first as f64) * scale);
    for bin in first..end {
        let here = moments_below((-place + (bin + 1) as f64) * scale);
        let [weight, offset, offset2] = [
            here[0] - before[0],
            here[1] - before[1],
            here[2] - before[2],
        ];
        let r = weight * sky.r + rise * offset;
        let r2 = sky.r * (r * 2.0 - weight * sky.r) + rise2 * offset2;
        sums.add(
            bin,
            [weight * of_particle, r * of_particle, r2 * of_particle],
        );
        before = here;
    }
}
