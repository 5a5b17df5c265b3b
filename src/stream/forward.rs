//! The hot stage in SIMD lanes.

use super::pair::{Flights, Group, IN_FLIGHT, Pair, Planner, Wide};
use super::{Model, Setup};
use crate::error::{Rejection, Tally};
use crate::orbit::{Arrival, State, advance};
use crate::potential::{FlattenedNfw, Plummer};
use crate::scalar::{Eights, Isa, Kernel, Level, angle, compile_kernel};
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Present-day particles, component by component, in the order of the table.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Arrivals {
    /// Sky x, kpc.
    pub x: Vec<f64>,
    /// Sky y, kpc.
    pub y: Vec<f64>,
    /// Towards the observer, kpc.
    pub z: Vec<f64>,
    /// Velocity, kpc/Gyr, x, y and z.
    pub v: [Vec<f64>; 3],
    /// Winding counts.
    pub turns: Vec<f64>,
    /// How much further on each particle's partner is; 0 if they have none.
    pub links: usize,
    /// What was unsafe on the way.
    pub tally: Tally,
}

impl Arrivals {
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

    /// Angle of particle number `i` on the sky in radians, its turns counted.
    #[must_use]
    pub fn angle(&self, i: usize) -> f64 {
        angle(self.y[i], self.x[i]) + TAU * self.turns[i]
    }

    /// All columns at the length `n`, to be written.
    fn columns(&mut self, n: usize) -> Columns<'_> {
        let [vx, vy, vz] = &mut self.v;
        let columns = [
            &mut self.x,
            &mut self.y,
            &mut self.z,
            vx,
            vy,
            vz,
            &mut self.turns,
        ];
        Columns {
            first: 0,
            columns: columns.map(|column| {
                column.resize(n, 0.0);
                column.as_mut_slice()
            }),
        }
    }
}

/// A part of the columns of [`Arrivals`].
struct Columns<'a> {
    /// Number of its first particle.
    first: usize,
    /// x, y, z, the velocity and the turns.
    columns: [&'a mut [f64]; 7],
}

impl<'a> Columns<'a> {
    /// The parts before and from particle number `at`.
    fn split(self, at: usize) -> (Self, Self) {
        let first = self.first;
        let [x, y, z, vx, vy, vz, turns] = self.columns.map(|c| c.split_at_mut(at - first));
        let before = Self {
            first,
            columns: [x.0, y.0, z.0, vx.0, vy.0, vz.0, turns.0],
        };
        let after = Self {
            first: at,
            columns: [x.1, y.1, z.1, vx.1, vy.1, vz.1, turns.1],
        };
        (before, after)
    }

    /// Stores the lanes of a pair. Returns their unsafe turns, NaN if any state is not finite.
    #[inline(always)]
    fn store<I: Isa>(&mut self, pair: &Pair<'_>, arrival: &Arrival<Wide<I>>) -> f64 {
        let State { x, v } = arrival.state;
        // Zero for finite states, NaN otherwise.
        let lost = ((x.norm2() + v.norm2()) * 0.0).sum();
        let values = [
            x.x.store(),
            x.y.store(),
            x.z.store(),
            v.x.store(),
            v.y.store(),
            v.z.store(),
            arrival.turns.store(),
        ];
        lost + self.copy(pair, &values, &arrival.unsafe_turns.store())
    }

    /// As [`store`](Self::store), of lanes in memory.
    #[inline(never)]
    fn copy(
        &mut self,
        pair: &Pair<'_>,
        values: &[Eights<IN_FLIGHT>; 7],
        unsafe_turns: &Eights<IN_FLIGHT>,
    ) -> f64 {
        let mut sum = 0.0;
        for (k, len) in pair
            .lens
            .into_iter()
            .enumerate()
            .filter(|(_, len)| *len > 0)
        {
            sum += unsafe_turns.0[k][..len].iter().sum::<f64>();
            let from = pair.groups[k].first - self.first;
            for (column, values) in self.columns.iter_mut().zip(values) {
                column[from..from + len].copy_from_slice(&values.0[k][..len]);
            }
        }
        sum
    }
}

struct Forward<'a> {
    model: &'a Model,
    setup: &'a Setup<f64>,
    groups: &'a [Group],
    flights: &'a mut Flights,
    out: Columns<'a>,
}

impl Kernel for Forward<'_> {
    type Output = f64;

    /// Carries every group; returns the number of unsafe turns, NaN if any state is not finite.
    #[inline(always)]
    fn run<I: Isa>(self) -> f64 {
        let Self {
            model,
            setup,
            groups,
            flights,
            mut out,
        } = self;
        let host = FlattenedNfw::<Wide<I>>::broadcast(&setup.host);
        let sphere = Plummer::<Wide<I>>::broadcast(&setup.sphere);
        let mut planner = Planner::new(model, setup, flights);
        let mut unsafe_turns = 0.0;
        for pair in Pair::all(model, groups) {
            let launch = pair.launches::<I>(setup);
            let (start, turns) = launch.release(pair.position(), pair.velocity());
            let arrival = advance(&host, &sphere, &planner.courses(&pair), start, turns);
            unsafe_turns += out.store(&pair, &arrival);
        }
        unsafe_turns
    }
}

compile_kernel!(Forward);

impl Model {
    /// Every particle today, in lanes, at the best level of this CPU. Buffers are reused: no allocation after the first
    /// call.
    ///
    /// # Errors
    /// [`Rejection::BadParticle`] if a state is not finite.
    pub fn carry(
        &self,
        setup: &Setup<f64>,
        flights: &mut Flights,
        out: &mut Arrivals,
    ) -> Result<(), Rejection> {
        self.carry_at(Level::best(), setup, flights, out)
    }

    /// As [`carry`](Self::carry), at a chosen level: how the levels are tested against each other.
    ///
    /// # Errors
    /// As [`carry`](Self::carry).
    pub fn carry_at(
        &self,
        level: Level,
        setup: &Setup<f64>,
        flights: &mut Flights,
        out: &mut Arrivals,
    ) -> Result<(), Rejection> {
        let forward = Forward {
            model: self,
            setup,
            groups: &self.groups,
            flights,
            out: out.columns(self.table.len()),
        };
        let unsafe_turns = forward.dispatch(level);
        out.links = self.table.links;
        out.tally = tally(setup, unsafe_turns)?;
        Ok(())
    }

    /// As [`carry`](Self::carry), over the threads of the present rayon pool and with buffers of its own. The same bits.
    ///
    /// # Errors
    /// As [`carry`](Self::carry).
    pub fn carry_in_parallel(
        &self,
        setup: &Setup<f64>,
        out: &mut Arrivals,
    ) -> Result<(), Rejection> {
        // More parts than threads, as one may be late; whole pairs of groups, as those fly together.
        let parts = 4 * rayon::current_num_threads();
        let per_part = self
            .groups
            .len()
            .div_ceil(parts)
            .next_multiple_of(IN_FLIGHT);
        let mut left = out.columns(self.table.len());
        let mut work = Vec::with_capacity(parts);
        for groups in self.groups.chunks(per_part) {
            let end = groups.last().map_or(0, |group| group.first + group.len);
            let (part, rest) = left.split(end);
            work.push((groups, part));
            left = rest;
        }
        let unsafe_turns: Vec<f64> = work
            .into_par_iter()
            .map(|(groups, out)| {
                let forward = Forward {
                    model: self,
                    setup,
                    groups,
                    flights: &mut Flights::default(),
                    out,
                };
                forward.dispatch(Level::best())
            })
            .collect();
        out.links = self.table.links;
        out.tally = tally(setup, unsafe_turns.iter().sum())?;
        Ok(())
    }
}

/// What was unsafe, with this many unsafe turns; NaN stands for a particle that is lost.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a count below particles times steps"
)]
fn tally(setup: &Setup<f64>, unsafe_turns: f64) -> Result<Tally, Rejection> {
    if !unsafe_turns.is_finite() {
        return Err(Rejection::BadParticle);
    }
    let mut tally = setup.tally;
    tally.unsafe_turns += unsafe_turns as u64;
    Ok(tally)
}
