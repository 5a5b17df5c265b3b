//! The hot stage in SIMD lanes.

use super::{LANES, Launch, Model, Setup};
use crate::error::{Rejection, Tally};
use crate::orbit::{Arrival, Flight, InLanes, Kernel, Level, State, advance, dispatch};
use crate::potential::{FlattenedNfw, Plummer};
use crate::scalar::Lanes;
use crate::spray::ReleaseTable;

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

    fn resize(&mut self, n: usize) {
        let [vx, vy, vz] = &mut self.v;
        for column in [
            &mut self.x,
            &mut self.y,
            &mut self.z,
            &mut self.turns,
            vx,
            vy,
            vz,
        ] {
            column.resize(n, 0.0);
        }
    }

    #[inline(always)]
    fn store<const FMA: bool>(&mut self, group: &Group, a: &Arrival<Lanes<LANES, FMA>>) {
        let range = group.first..group.first + group.len;
        let [vx, vy, vz] = &mut self.v;
        let columns = [
            (&mut self.x, a.state.x.x),
            (&mut self.y, a.state.x.y),
            (&mut self.z, a.state.x.z),
            (vx, a.state.v.x),
            (vy, a.state.v.y),
            (vz, a.state.v.z),
            (&mut self.turns, a.turns),
        ];
        for (column, lanes) in columns {
            column[range.clone()].copy_from_slice(&lanes.0[..group.len]);
        }
    }
}

struct Forward<'a> {
    model: &'a Model,
    setup: &'a Setup<f64>,
    flight: &'a mut Flight<f64>,
    out: &'a mut Arrivals,
}

impl Kernel for Forward<'_> {
    type Output = f64;

    /// Carries every group; returns the number of unsafe turns, NaN if any state is not finite.
    #[inline(always)]
    fn run<const FMA: bool>(self) -> f64 {
        let Self {
            model,
            setup,
            flight,
            out,
        } = self;
        let host = FlattenedNfw::<Lanes<LANES, FMA>>::broadcast(&setup.host);
        let sphere = Plummer::<Lanes<LANES, FMA>>::broadcast(&setup.sphere);
        let mut unsafe_turns = 0.0;
        let mut epoch = usize::MAX;
        for group in &model.groups {
            if group.epoch != epoch {
                epoch = group.epoch;
                model.plan(epoch, setup, flight);
            }
            let launch = Launch::broadcast(&setup.launches[epoch]);
            let (start, turns) =
                launch.release(group.position.map(Lanes), group.velocity.map(Lanes));
            let arrival = advance(&host, &sphere, &InLanes(flight), start, turns);
            unsafe_turns += arrival.unsafe_turns.0[..group.len].iter().sum::<f64>();
            let State { x, v } = arrival.state;
            // Zero for finite states, NaN otherwise.
            unsafe_turns += ((x.norm2() + v.norm2()) * 0.0).sum();
            out.store(group, &arrival);
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
        flight: &mut Flight<f64>,
        out: &mut Arrivals,
    ) -> Result<(), Rejection> {
        self.carry_at(Level::best(), setup, flight, out)
    }

    /// As [`carry`](Self::carry), at a chosen level: how the levels are tested against each other.
    ///
    /// # Errors
    /// As [`carry`](Self::carry).
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a count below particles times steps"
    )]
    pub fn carry_at(
        &self,
        level: Level,
        setup: &Setup<f64>,
        flight: &mut Flight<f64>,
        out: &mut Arrivals,
    ) -> Result<(), Rejection> {
        out.resize(self.table.len());
        let unsafe_turns = dispatch(
            level,
            Forward {
                model: self,
                setup,
                flight,
                out,
            },
        );
        if !unsafe_turns.is_finite() {
            return Err(Rejection::BadParticle);
        }
        out.tally = setup.tally;
        out.tally.unsafe_turns += unsafe_turns as u64;
        Ok(())
    }
}
