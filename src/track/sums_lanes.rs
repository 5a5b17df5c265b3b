//! Sums over the particles of each bin, in SIMD lanes and over threads.

use super::grid::{BinGrid, Placed, SkyPoint};
use super::smear::{Apart, Sky, Smear, Surroundings, WHOLE, below};
use super::sums::Sums;
use crate::scalar::{Isa, Kernel, LANES, LaneArray, Lanes, Level, Scalar, compile_kernel};
use crate::spray::Neighbourhood;
use crate::stream::Particles;
use rayon::prelude::*;

/// Number of particles that are binned together, whole vectors of lanes. Sums over all particles are sums of these sums, so the bits do
/// not depend on the number of threads.
const AT_A_TIME: usize = 1_024;

/// Largest number of bins of all sums that are made at once: 256 MB.
const MAX_BINS_AT_ONCE: usize = 1 << 22;

/// Sums over some particles, in memory that is used again: weight, r and r^2 of a bin beside each other, and one more bin at
/// each end for what lies outside. Neighbouring particles often fall in one bin, and the second addition would wait for the first: so
/// particles are added to two sets of bins in turn.
#[derive(Clone, Debug, Default)]
pub struct PartialSums {
    bins: Vec<[f64; 4]>,
    /// Positions in bin widths of all particles, whole vectors of lanes.
    positions: Vec<f64>,
    /// Their directions and radii.
    skies: Vec<Sky<f64>>,
}

impl PartialSums {
    fn reset(&mut self, len: usize) {
        self.bins.clear();
        self.bins.resize(2 * (len + 2), [0.0; 4]);
    }

    /// Adds to the bin of this number, counted from the first; `turn` chooses the set of bins.
    #[inline(always)]
    fn add(&mut self, turn: usize, bin: f64, [weight, r, r2]: [f64; 3]) {
        let half = self.bins.len() / 2;
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "between -1 and the number of bins"
        )]
        let row = (bin.max(-1.0).min(half as f64 - 2.0) + 1.0) as usize + (turn % 2) * half;
        let bin = &mut self.bins[row];
        let all = [weight, r, r2, 0.0];
        for c in 0..4 {
            bin[c] += all[c];
        }
    }

    /// Adds these to the sums of all particles.
    fn add_to(&self, sums: &mut Sums<f64>) {
        let (even, odd) = self.bins.split_at(self.bins.len() / 2);
        let bins = even.iter().zip(odd).skip(1);
        let columns = sums.weight.iter_mut().zip(&mut sums.r).zip(&mut sums.r2);
        for ((even, odd), ((weight, r), r2)) in bins.zip(columns) {
            *weight += even[0] + odd[0];
            *r += even[1] + odd[1];
            *r2 += even[2] + odd[2];
        }
    }
}

impl BinGrid {
    /// Bins the particles of the fast path, some thousand at a time; `part` is memory for that.
    pub fn sum(&self, particles: &Particles, sums: &mut Sums<f64>, part: &mut PartialSums) {
        self.sum_at(Level::best(), particles, sums, part);
    }

    /// As [`sum`](Self::sum), at a chosen level: how the levels are tested against each other.
    pub fn sum_at(
        &self,
        level: Level,
        particles: &Particles,
        sums: &mut Sums<f64>,
        part: &mut PartialSums,
    ) {
        sums.reset(self.len);
        for first in (0..particles.len()).step_by(AT_A_TIME) {
            self.sum_some(level, particles, first, part);
            part.add_to(sums);
        }
    }

    /// As [`sum`](Self::sum), over the threads of the present rayon pool. The same bits.
    pub fn sum_in_parallel(&self, particles: &Particles, sums: &mut Sums<f64>) {
        sums.reset(self.len);
        // Some parts at a time, so that memory does not grow with the number of particles.
        let fitting = MAX_BINS_AT_ONCE / (self.len + 1);
        let count = (4 * rayon::current_num_threads()).min(fitting.max(1));
        let mut parts = vec![PartialSums::default(); count];
        let at_once = parts.len() * AT_A_TIME;
        for first in (0..particles.len()).step_by(at_once) {
            let firsts = (first..particles.len().min(first + at_once)).step_by(AT_A_TIME);
            let firsts: Vec<usize> = firsts.collect();
            let some = &mut parts[..firsts.len()];
            some.par_iter_mut().zip(firsts).for_each(|(part, first)| {
                self.sum_some(Level::best(), particles, first, part);
            });
            some.iter().for_each(|part| part.add_to(sums));
        }
    }

    /// Bins the [`AT_A_TIME`] particles from number `first` on, or as many as there are.
    fn sum_some(&self, level: Level, particles: &Particles, first: usize, sums: &mut PartialSums) {
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

/// Adds particles to sums: their bins are computed in lanes, and they are added one by one.
struct BinKernel<'a> {
    grid: &'a BinGrid,
    particles: &'a Particles,
    first: usize,
    sums: &'a mut PartialSums,
}

/// The next eight numbers of a column, or as many as there are; then the last of them.
#[inline(always)]
fn eight(column: &[f64]) -> LaneArray<1> {
    match column.first_chunk() {
        Some(whole) => LaneArray([*whole]),
        None => {
            let mut eights = [1.0; LANES];
            for lane in 0..LANES {
                eights[lane] = column[lane.min(column.len() - 1)];
            }
            LaneArray([eights])
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
        let last = len.min(first + AT_A_TIME);
        let neighbourhood = particles.neighbourhood.as_deref();
        // Neighbours are at the same release time, partners at the next or the one before.
        let margin = neighbourhood.map_or(0, |n| n.reach.next_multiple_of(LANES));
        let (from, to) = (first.saturating_sub(margin), len.min(last + margin));
        sums.positions.clear();
        sums.skies.clear();
        for at in (from..to).step_by(LANES) {
            let x = Lanes::<I, 1>::load(&eight(&particles.x[at..]));
            let y = Lanes::load(&eight(&particles.y[at..]));
            let turns = Lanes::load(&eight(&particles.turns[at..]));
            let SkyPoint { position, sky } = grid.sky_point(x, y, turns);
            sums.positions.extend_from_slice(&position.store().0[0]);
            let (x, y, r) = (sky.x.store().0[0], sky.y.store().0[0], sky.r.store().0[0]);
            for lane in 0..LANES {
                sums.skies.push(Sky {
                    x: x[lane],
                    y: y[lane],
                    r: r[lane],
                });
            }
        }
        for at in (first..last).step_by(LANES) {
            let n = LANES.min(last - at);
            let position = Lanes::<I, 1>::load(&eight(&sums.positions[at - from..]));
            let mut skies = [Sky {
                x: 0.0,
                y: 0.0,
                r: 0.0,
            }; LANES];
            skies.copy_from_slice(&sums.skies[at - from..at - from + LANES]);
            let sky = load::<I>(&skies);
            match neighbourhood {
                None => add_points(grid, position, sky, n, sums),
                Some(neighbourhood) => {
                    let smear = smear(neighbourhood, at / LANES, from, sky, sums);
                    add_smeared(grid, position, sky, smear, n, sums);
                }
            }
        }
    }
}

compile_kernel!(BinKernel);

/// Eight directions and radii.
#[inline(always)]
fn load<I: Isa>(skies: &[Sky<f64>; LANES]) -> Sky<Lanes<I, 1>> {
    let [mut x, mut y, mut r] = [LaneArray([[0.0; LANES]]); 3];
    for lane in 0..LANES {
        x.0[0][lane] = skies[lane].x;
        y.0[0][lane] = skies[lane].y;
        r.0[0][lane] = skies[lane].r;
    }
    Sky {
        x: Lanes::load(&x),
        y: Lanes::load(&y),
        r: Lanes::load(&r),
    }
}

/// What the particles of a block are smeared over; `from` is the first particle whose direction is known.
#[inline(always)]
fn smear<I: Isa>(
    neighbourhood: &Neighbourhood,
    block: usize,
    from: usize,
    here: Sky<Lanes<I, 1>>,
    sums: &PartialSums,
) -> Smear<Lanes<I, 1>> {
    let partner = apart(here, &neighbourhood.partners[block], from, sums);
    let mut around = Surroundings::of_partner(partner);
    for j in 0..neighbourhood.count {
        let row = block * neighbourhood.count + j;
        let neighbour = apart(here, &neighbourhood.indices[row], from, sums);
        for k in 0..neighbourhood.numbers {
            let weights = &neighbourhood.weights[row * neighbourhood.numbers + k];
            around.add(k, Lanes::load(&LaneArray([*weights])), neighbour);
        }
    }
    Smear::new(around.moments(), here.r)
}

/// Where eight others are.
#[inline(always)]
fn apart<I: Isa>(
    here: Sky<Lanes<I, 1>>,
    others: &[u32; LANES],
    from: usize,
    sums: &PartialSums,
) -> Apart<Lanes<I, 1>> {
    let mut skies = [sums.skies[0]; LANES];
    for lane in 0..LANES {
        skies[lane] = sums.skies[others[lane] as usize - from];
    }
    here.apart(load(&skies))
}

/// Adds `n` particles, each in the two bins beside its nearest edge.
#[inline(always)]
fn add_points<I: Isa>(
    grid: &BinGrid,
    position: Lanes<I, 1>,
    sky: Sky<Lanes<I, 1>>,
    n: usize,
    sums: &mut PartialSums,
) {
    let Placed { edge, above } = grid.place(position);
    let (edge, above, r) = (
        (edge - grid.first as f64).store().0[0],
        above.store().0[0],
        sky.r.store().0[0],
    );
    for i in 0..n {
        let shares = [1.0 - above[i], above[i]];
        for k in 0..2 {
            let (share, r) = (shares[k], r[i]);
            sums.add(
                i,
                edge[i] - 1.0 + k as f64,
                [share, share * r, share * r * r],
            );
        }
    }
}

/// Adds `n` smeared particles.
#[inline(always)]
fn add_smeared<I: Isa>(
    grid: &BinGrid,
    position: Lanes<I, 1>,
    sky: Sky<Lanes<I, 1>>,
    smear: Smear<Lanes<I, 1>>,
    n: usize,
    sums: &mut PartialSums,
) {
    let half_width = smear.half_width(grid.soft());
    let mut widest = 0.0;
    for width in half_width.store().0[0] {
        widest = f64::max(widest, width);
    }
    let (_, reach) = grid.edges_within(0.0, widest);
    let middle = position.round_ties_even();
    let scale = Lanes::one() / (half_width * grid.per_radian());
    let rise = smear.slope * half_width;
    let bins = (middle - (grid.first as f64 + 1.0)).store().0[0];
    let rise2 = rise * rise;
    let mut before = [Lanes::<I, 1>::zero(); 3];
    for k in -reach..=reach + 1 {
        let here = if k > reach {
            let [share, offset, offset2] = WHOLE;
            [
                Lanes::from_f64(share),
                Lanes::from_f64(offset),
                Lanes::from_f64(offset2),
            ]
        } else {
            below((middle - position + f64::from(k)) * scale)
        };
        let [share, offset, offset2] = [
            here[0] - before[0],
            here[1] - before[1],
            here[2] - before[2],
        ];
        let r = share * sky.r + rise * offset;
        let r2 = sky.r * (r * 2.0 - share * sky.r) + rise2 * offset2;
        let (share, r, r2) = (share.store().0[0], r.store().0[0], r2.store().0[0]);
        for i in 0..n {
            sums.add(i, bins[i] + f64::from(k), [share[i], r[i], r2[i]]);
        }
        before = here;
    }
}
