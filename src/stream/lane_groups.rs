//! Particles in lanes, and lane groups in pairs: the arithmetic units work on one group while the other waits for its square roots.

use super::progenitor_solution::{ProgenitorSolution, ReleaseFrame};
use crate::orbit::{State, StepSchedule};
use crate::potential::Halo;
use crate::scalar::{Isa, LANES, LaneArray, Lanes, Vec3};
use crate::spray::ReleaseTable;

/// Particles of one release time that are integrated in the lanes of one vector; short groups repeat their last particle.
#[derive(Clone, Copy, Debug)]
pub struct Group {
    /// Their release time.
    pub release_time: usize,
    /// The first one's number in the table.
    pub first: usize,
    /// How many of the lanes are particles.
    pub len: usize,
    /// Position parts of the release offsets, by component.
    pub position: [[f64; LANES]; 3],
    /// The velocity parts.
    pub velocity: [[f64; LANES]; 3],
}

/// Number of lane groups that are integrated together.
pub const UNROLL: usize = 2;

/// Lanes of a pair of groups.
pub type Interleaved<I> = Lanes<I, UNROLL>;

/// The step schedules of a pair of groups; buffers, reused from call to call.
pub type StepSchedules = [StepSchedule<f64>; UNROLL];

/// Divides the particles of each release time of a table into groups.
pub(super) fn groups(table: &ReleaseTable) -> Vec<Group> {
    let per_release_time = table.per_release_time.div_ceil(LANES);
    let mut groups = Vec::with_capacity(table.taus.len() * per_release_time);
    for release_time in 0..table.taus.len() {
        let begin = release_time * table.per_release_time;
        let end = begin + table.per_release_time;
        for first in (begin..end).step_by(LANES) {
            let len = LANES.min(end - first);
            let offset = |lane: usize| table.releases[first + lane.min(len - 1)].offset;
            groups.push(Group {
                release_time,
                first,
                len,
                position: std::array::from_fn(|c| std::array::from_fn(|l| offset(l).position[c])),
                velocity: std::array::from_fn(|c| std::array::from_fn(|l| offset(l).velocity[c])),
            });
        }
    }
    groups
}

/// Two groups of equally many steps, or one twice: then the second has no particles.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pair<'a> {
    pub groups: [&'a Group; UNROLL],
    /// Particles of each.
    pub lens: [usize; UNROLL],
}

/// The pairs of a run of groups.
pub(super) struct Pairs<'a> {
    steps: &'a [usize],
    left: &'a [Group],
}

impl<'a> Iterator for Pairs<'a> {
    type Item = Pair<'a>;

    #[inline]
    fn next(&mut self) -> Option<Pair<'a>> {
        let (a, rest) = self.left.split_first()?;
        let partner = rest
            .first()
            .filter(|b| self.steps[b.release_time] == self.steps[a.release_time]);
        self.left = &rest[usize::from(partner.is_some())..];
        Some(Pair {
            groups: [a, partner.unwrap_or(a)],
            lens: [a.len, partner.map_or(0, |b| b.len)],
        })
    }
}

impl<'a> Pair<'a> {
    /// All pairs of a run of groups, whose particles take `steps` by release time.
    #[inline]
    pub fn all(steps: &'a [usize], groups: &'a [Group]) -> Pairs<'a> {
        Pairs {
            steps,
            left: groups,
        }
    }

    /// Their release times.
    #[inline]
    pub fn release_times(&self) -> [usize; UNROLL] {
        let [a, b] = self.groups;
        [a.release_time, b.release_time]
    }

    /// The position parts of their release offsets.
    #[inline(always)]
    pub fn position<I: Isa>(&self) -> [Interleaved<I>; 3] {
        let [a, b] = self.groups;
        offsets(&a.position, &b.position)
    }

    /// The velocity parts.
    #[inline(always)]
    pub fn velocity<I: Isa>(&self) -> [Interleaved<I>; 3] {
        let [a, b] = self.groups;
        offsets(&a.velocity, &b.velocity)
    }

    /// Their release frames.
    #[inline(always)]
    pub fn release_frames<I: Isa, H: Halo>(
        &self,
        solution: &ProgenitorSolution<f64, H>,
    ) -> ReleaseFrame<Interleaved<I>> {
        let [a, b] = self.release_times();
        let (a, b) = (&solution.release_frames[a], &solution.release_frames[b]);
        ReleaseFrame {
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
fn offsets<I: Isa>(a: &[[f64; LANES]; 3], b: &[[f64; LANES]; 3]) -> [Interleaved<I>; 3] {
    [
        Lanes::load(&LaneArray([a[0], b[0]])),
        Lanes::load(&LaneArray([a[1], b[1]])),
        Lanes::load(&LaneArray([a[2], b[2]])),
    ]
}

#[inline(always)]
fn frames<I: Isa>(a: &[Vec3<f64>; 3], b: &[Vec3<f64>; 3]) -> [Vec3<Interleaved<I>>; 3] {
    [
        Lanes::vectors(a[0], b[0]),
        Lanes::vectors(a[1], b[1]),
        Lanes::vectors(a[2], b[2]),
    ]
}
