//! Particles in lanes, and lane groups in pairs: the arithmetic units work on one group while the other waits for its square roots.

use super::progenitor_solution::{ProgenitorSolution, ReleaseFrame};
use crate::orbit::{State, StepSchedule};
use crate::potential::Halo;
use crate::scalar::{Isa, LANES, LaneArray, Lanes, Vec3};
use crate::spray::ReleaseTable;
use std::ops::Range;

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

/// Number of parts that the release times are divided into. Each part sums its own derivatives, and the parts are added in order: the
/// bits do not depend on the number of threads.
pub(super) const PARTS: usize = 8;

/// Release times in a part; the last part may have fewer.
pub(super) fn release_times_per_part(release_times: usize) -> usize {
    release_times.div_ceil(PARTS)
}

/// Divides groups into pairs of equally many steps, each in one part of the release times: a range of two, or of one that is left over.
pub(super) fn pairs(groups: &[Group], steps: &[usize]) -> Vec<Range<usize>> {
    let per_part = release_times_per_part(steps.len());
    let key = |group: &Group| (group.release_time / per_part, steps[group.release_time]);
    let mut pairs = Vec::with_capacity(groups.len() / UNROLL);
    let mut first = 0;
    while first < groups.len() {
        let two = groups
            .get(first + 1)
            .is_some_and(|next| key(next) == key(&groups[first]));
        let end = first + 1 + usize::from(two);
        pairs.push(first..end);
        first = end;
    }
    pairs
}

/// Two groups of equally many steps, or one twice: then the second has no particles.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pair<'a> {
    pub groups: [&'a Group; UNROLL],
    /// Particles of each.
    pub lens: [usize; UNROLL],
}

impl<'a> Pair<'a> {
    /// The pair of a range of groups.
    #[inline]
    pub fn of(groups: &'a [Group], range: &Range<usize>) -> Self {
        let (a, b) = (&groups[range.start], &groups[range.end - 1]);
        Self {
            groups: [a, b],
            lens: [a.len, if range.len() == UNROLL { b.len } else { 0 }],
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
