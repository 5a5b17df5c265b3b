//! Two groups of particles side by side: one alone leaves the arithmetic units waiting for its square roots.

use super::{Launch, Model, Setup};
use crate::orbit::{Flight, HalfAndHalf, State};
use crate::scalar::{Eights, Isa, LANES, Lanes, Vec3};
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

/// Groups side by side in the hot loops.
pub const IN_FLIGHT: usize = 2;

/// Lanes of all groups in flight.
pub type Wide<I> = Lanes<I, IN_FLIGHT>;

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

/// Two groups of equally many steps, or one twice: then the second has no particles.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pair<'a> {
    pub groups: [&'a Group; IN_FLIGHT],
    /// Particles of each.
    pub lens: [usize; IN_FLIGHT],
}

/// The pairs of a run of groups.
pub(super) struct Pairs<'a> {
    model: &'a Model,
    left: &'a [Group],
}

impl<'a> Iterator for Pairs<'a> {
    type Item = Pair<'a>;

    fn next(&mut self) -> Option<Pair<'a>> {
        let (a, rest) = self.left.split_first()?;
        let partner = rest
            .first()
            .filter(|b| self.model.steps[b.epoch] == self.model.steps[a.epoch]);
        self.left = &rest[usize::from(partner.is_some())..];
        Some(Pair {
            groups: [a, partner.unwrap_or(a)],
            lens: [a.len, partner.map_or(0, |b| b.len)],
        })
    }
}

impl<'a> Pair<'a> {
    /// All pairs of a run of groups.
    pub fn all(model: &'a Model, groups: &'a [Group]) -> Pairs<'a> {
        Pairs {
            model,
            left: groups,
        }
    }

    /// Their epochs.
    pub fn epochs(&self) -> [usize; IN_FLIGHT] {
        let [a, b] = self.groups;
        [a.epoch, b.epoch]
    }

    /// The position parts of their kicks.
    #[inline(always)]
    pub fn position<I: Isa>(&self) -> [Wide<I>; 3] {
        let [a, b] = self.groups;
        kicks(&a.position, &b.position)
    }

    /// The velocity parts.
    #[inline(always)]
    pub fn velocity<I: Isa>(&self) -> [Wide<I>; 3] {
        let [a, b] = self.groups;
        kicks(&a.velocity, &b.velocity)
    }

    /// Their launches.
    #[inline(always)]
    pub fn launches<I: Isa>(&self, setup: &Setup<f64>) -> Launch<Wide<I>> {
        let [a, b] = self.epochs();
        let (a, b) = (&setup.launches[a], &setup.launches[b]);
        Launch {
            state: State {
                x: Lanes::vectors(a.state.x, b.state.x),
                v: Lanes::vectors(a.state.v, b.state.v),
            },
            position: frames(&a.position, &b.position),
            velocity: frames(&a.velocity, &b.velocity),
            turns: Lanes::halves(a.turns, b.turns),
        }
    }
}

#[inline(always)]
fn kicks<I: Isa>(a: &[[f64; LANES]; 3], b: &[[f64; LANES]; 3]) -> [Wide<I>; 3] {
    [
        Lanes::load(&Eights([a[0], b[0]])),
        Lanes::load(&Eights([a[1], b[1]])),
        Lanes::load(&Eights([a[2], b[2]])),
    ]
}

#[inline(always)]
fn frames<I: Isa>(a: &[Vec3<f64>; 3], b: &[Vec3<f64>; 3]) -> [Vec3<Wide<I>>; 3] {
    [
        Lanes::vectors(a[0], b[0]),
        Lanes::vectors(a[1], b[1]),
        Lanes::vectors(a[2], b[2]),
    ]
}

/// Plans the courses of pair after pair, each epoch's once.
pub(super) struct Planner<'a> {
    model: &'a Model,
    setup: &'a Setup<f64>,
    flights: &'a mut Flights,
    /// The epochs that the flights are of.
    planned: [usize; IN_FLIGHT],
}

impl<'a> Planner<'a> {
    /// With the buffers of an earlier one, whatever they hold.
    pub fn new(model: &'a Model, setup: &'a Setup<f64>, flights: &'a mut Flights) -> Self {
        Self {
            model,
            setup,
            flights,
            planned: [usize::MAX; IN_FLIGHT],
        }
    }

    /// The course of each half of a pair.
    #[inline(always)]
    pub fn courses(&mut self, pair: &Pair<'_>) -> HalfAndHalf<'_> {
        let [a, b] = pair.epochs();
        let [one, other] = &mut *self.flights;
        if self.planned[0] != a {
            self.planned[0] = a;
            self.model.plan(a, self.setup, one);
        }
        if a == b {
            return HalfAndHalf(one, one);
        }
        if self.planned[1] != b {
            self.planned[1] = b;
            self.model.plan(b, self.setup, other);
        }
        HalfAndHalf(one, other)
    }
}
