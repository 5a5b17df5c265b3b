//! The hot stage in SIMD lanes.

use super::{LANES, Launch, Model, Setup};
use crate::error::{Rejection, Tally};
use crate::orbit::{Arrival, Flight, HalfAndHalf, Kernel, Level, State, advance, dispatch};
use crate::potential::{FlattenedNfw, Plummer};
use crate::scalar::{Lanes, Vec3};
use crate::spray::ReleaseTable;
use rayon::prelude::*;

/// Particles of one epoch that travel side by side; short groups repeat their last particle.
#[derive(Clone, Copy, Debug)]
pub struct Group {
    /// Their epoch.
    pub epoch: usize,
    /// The first one's number in the table.
    pub first: usize,
    /// How many of the lanes are particles.
    pub len: usize,
    /// Kicks, component by component.
    pub position: [[f64; LANES]; 3],
    /// The velocity parts.
    pub velocity: [[f64; LANES]; 3],
}

/// Groups side by side in the hot loop: one alone leaves the arithmetic units waiting for its square roots.
const IN_FLIGHT: usize = 2;

/// All their lanes.
const WIDE: usize = IN_FLIGHT * LANES;

/// The courses of the groups in flight; buffers, reused from call to call.
pub type Flights = [Flight<f64>; IN_FLIGHT];

/// Deals the particles of a table into groups, epoch by epoch.
pub(super) fn groups(table: &ReleaseTable) -> Vec<Group> {
    let mut groups = Vec::new();
    for epoch in 0..table.taus.len() {
        let begin = epoch * table.per_epoch;
        let end = begin + table.per_epoch;
        for first in (begin..end).step_by(LANES) {
            let len = LANES.min(end - first);
            let kick = |lane: usize| table.particles[first + lane.min(len - 1)].kick;
            groups.push(Group {
                epoch,
                first,
                len,
                position: std::array::from_fn(|c| std::array::from_fn(|l| kick(l).position[c])),
                velocity: std::array::from_fn(|c| std::array::from_fn(|l| kick(l).velocity[c])),
            });
        }
    }
    groups
}

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

    /// Stores the lanes of groups side by side. Returns their unsafe turns, NaN if any state is not finite.
    ///
    /// A call on purpose: work on single lanes next to the hot loop keeps the compiler from putting the loop itself into
    /// vector registers.
    #[inline(never)]
    fn store<const FMA: bool>(
        &mut self,
        groups: &[Group],
        arrival: &Arrival<Lanes<WIDE, FMA>>,
    ) -> f64 {
        let State { x, v } = arrival.state;
        // Zero for finite states, NaN otherwise.
        let mut unsafe_turns = ((x.norm2() + v.norm2()) * 0.0).sum();
        let values = [x.x, x.y, x.z, v.x, v.y, v.z, arrival.turns];
        for (k, group) in groups.iter().enumerate() {
            let lanes = k * LANES..k * LANES + group.len;
            unsafe_turns += arrival.unsafe_turns.0[lanes.clone()].iter().sum::<f64>();
            let from = group.first - self.first;
            for (column, values) in self.columns.iter_mut().zip(&values) {
                column[from..from + group.len].copy_from_slice(&values.0[lanes.clone()]);
            }
        }
        unsafe_turns
    }
}

/// The same component of two groups, or of one twice.
#[inline(always)]
fn side_by_side<const FMA: bool>(a: &[f64; LANES], b: &[f64; LANES]) -> Lanes<WIDE, FMA> {
    Lanes(std::array::from_fn(|l| {
        if l < LANES { a[l] } else { b[l - LANES] }
    }))
}

/// The launches of two groups.
#[inline(always)]
fn launches<const FMA: bool>(a: &Launch<f64>, b: &Launch<f64>) -> Launch<Lanes<WIDE, FMA>> {
    let both = |a: f64, b: f64| Lanes(std::array::from_fn(|l| if l < LANES { a } else { b }));
    let vector =
        |a: Vec3<f64>, b: Vec3<f64>| Vec3::new(both(a.x, b.x), both(a.y, b.y), both(a.z, b.z));
    Launch {
        state: State {
            x: vector(a.state.x, b.state.x),
            v: vector(a.state.v, b.state.v),
        },
        position: std::array::from_fn(|c| vector(a.position[c], b.position[c])),
        velocity: std::array::from_fn(|c| vector(a.velocity[c], b.velocity[c])),
        turns: both(a.turns, b.turns),
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
    fn run<const FMA: bool>(self) -> f64 {
        let Self {
            model,
            setup,
            groups,
            flights: [one, other],
            mut out,
        } = self;
        let host = FlattenedNfw::<Lanes<WIDE, FMA>>::broadcast(&setup.host);
        let sphere = Plummer::<Lanes<WIDE, FMA>>::broadcast(&setup.sphere);
        let mut unsafe_turns = 0.0;
        let mut planned = [usize::MAX; IN_FLIGHT];
        for groups in groups.chunks(IN_FLIGHT) {
            // The last one flies alone, twice.
            let (a, b) = (&groups[0], groups.get(1).unwrap_or(&groups[0]));
            if planned[0] != a.epoch {
                planned[0] = a.epoch;
                model.plan(a.epoch, setup, one);
            }
            let second = if b.epoch == a.epoch {
                &*one
            } else {
                if planned[1] != b.epoch {
                    planned[1] = b.epoch;
                    model.plan(b.epoch, setup, other);
                }
                &*other
            };
            let launch = launches(&setup.launches[a.epoch], &setup.launches[b.epoch]);
            let position = std::array::from_fn(|c| side_by_side(&a.position[c], &b.position[c]));
            let velocity = std::array::from_fn(|c| side_by_side(&a.velocity[c], &b.velocity[c]));
            let (start, turns) = launch.release(position, velocity);
            let arrival = advance(&host, &sphere, &HalfAndHalf(one, second), start, turns);
            unsafe_turns += out.store(groups, &arrival);
        }
        unsafe_turns
    }
}

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
        let unsafe_turns = dispatch(
            level,
            Forward {
                model: self,
                setup,
                groups: &self.groups,
                flights,
                out: out.columns(self.table.len()),
            },
        );
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
                dispatch(Level::best(), forward)
            })
            .collect();
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
