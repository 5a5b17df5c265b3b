//! Particles in lanes, and lane groups in pairs: arithmetic of one lane group is computed while the other one's square roots are.

use super::progenitor_solution::{ProgenitorSolution, ReleaseFrame};
use crate::orbit::{State, StepSchedule};
use crate::potential::Halo;
use crate::scalar::{Isa, LANES, LaneArray, Lanes, Vec3};
use crate::spray::ReleaseTable;
use std::ops::Range;

/// Particles of one release time that are integrated together in SIMD lanes. Lanes without a particle repeat the last one.
#[derive(Clone, Copy, Debug)]
pub struct LaneGroup {
    /// Number of their release time.
    pub release_time: usize,
    /// Number of the first particle in the table.
    pub first: usize,
    /// Number of particles, at most [`LANES`].
    pub len: usize,
    /// Positions of the release offsets, by component and lane.
    pub position: [[f64; LANES]; 3],
    /// Velocities of the release offsets, by component and lane.
    pub velocity: [[f64; LANES]; 3],
}

/// Number of lane groups that are integrated together.
pub const UNROLL: usize = 2;

/// The numbers of a pair of lane groups.
pub type Interleaved<I> = Lanes<I, UNROLL>;

/// The step schedules of a pair of lane groups; their buffers are reused from call to call.
pub type StepSchedules = [StepSchedule<f64>; UNROLL];

/// Divides the particles of each release time of a table into lane groups.
pub(super) fn lane_groups(table: &ReleaseTable) -> Vec<LaneGroup> {
    let per_release_time = table.per_release_time.div_ceil(LANES);
    let mut lane_groups = Vec::with_capacity(table.taus.len() * per_release_time);
    for release_time in 0..table.taus.len() {
        let begin = release_time * table.per_release_time;
        let end = begin + table.per_release_time;
        for first in (begin..end).step_by(LANES) {
            let len = LANES.min(end - first);
            let offset = |lane: usize| table.releases[first + lane.min(len - 1)].offset;
            lane_groups.push(LaneGroup {
                release_time,
                first,
                len,
                position: std::array::from_fn(|c| std::array::from_fn(|l| offset(l).position[c])),
                velocity: std::array::from_fn(|c| std::array::from_fn(|l| offset(l).velocity[c])),
            });
        }
    }
    lane_groups
}

/// Number of chunks that the release times are divided into for a gradient. The derivatives are summed in each chunk, and the sums are
/// added in order, so that the bits do not depend on the number of threads.
pub(super) const RELEASE_TIME_CHUNKS: usize = 8;

/// Release times in a chunk; the last chunk may have fewer.
pub(super) fn release_times_per_chunk(release_times: usize) -> usize {
    release_times.div_ceil(RELEASE_TIME_CHUNKS)
}

/// Divides lane groups into pairs with equally many steps and in the same chunk of release times: ranges of two, or of one where no other
/// fits.
pub(super) fn pairs(lane_groups: &[LaneGroup], steps: &[usize]) -> Vec<Range<usize>> {
    let per_chunk = release_times_per_chunk(steps.len());
    let key = |group: &LaneGroup| (group.release_time / per_chunk, steps[group.release_time]);
    let mut pairs = Vec::with_capacity(lane_groups.len() / UNROLL);
    let mut first = 0;
    while first < lane_groups.len() {
        let two = lane_groups
            .get(first + 1)
            .is_some_and(|next| key(next) == key(&lane_groups[first]));
        let end = first + 1 + usize::from(two);
        pairs.push(first..end);
        first = end;
    }
    pairs
}

/// Two lane groups with equally many steps, or one twice: then the second has no particles.
#[derive(Clone, Copy, Debug)]
pub(super) struct LaneGroupPair<'a> {
    pub lane_groups: [&'a LaneGroup; UNROLL],
    /// Number of particles of each.
    pub lens: [usize; UNROLL],
}

impl<'a> LaneGroupPair<'a> {
    /// The pair of a range that [`pairs`] has made.
    #[inline]
    pub fn new(lane_groups: &'a [LaneGroup], range: &Range<usize>) -> Self {
        let (a, b) = (&lane_groups[range.start], &lane_groups[range.end - 1]);
        Self {
            lane_groups: [a, b],
            lens: [a.len, if range.len() == UNROLL { b.len } else { 0 }],
        }
    }

    /// Numbers of their release times.
    #[inline]
    pub fn release_times(&self) -> [usize; UNROLL] {
        let [a, b] = self.lane_groups;
        [a.release_time, b.release_time]
    }

    /// The positions of their release offsets.
    #[inline(always)]
    pub fn position<I: Isa>(&self) -> [Interleaved<I>; 3] {
        let [a, b] = self.lane_groups;
        offsets(&a.position, &b.position)
    }

    /// The velocities of their release offsets.
    #[inline(always)]
    pub fn velocity<I: Isa>(&self) -> [Interleaved<I>; 3] {
        let [a, b] = self.lane_groups;
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
                x: Lanes::interleave_vectors(a.state.x, b.state.x),
                v: Lanes::interleave_vectors(a.state.v, b.state.v),
            },
            position: frames(&a.position, &b.position),
            velocity: frames(&a.velocity, &b.velocity),
            winding_number: Lanes::interleave(a.winding_number, b.winding_number),
        }
    }
}

/// The components of two release offsets as lanes.
#[inline(always)]
fn offsets<I: Isa>(a: &[[f64; LANES]; 3], b: &[[f64; LANES]; 3]) -> [Interleaved<I>; 3] {
    [
        Lanes::load(&LaneArray([a[0], b[0]])),
        Lanes::load(&LaneArray([a[1], b[1]])),
        Lanes::load(&LaneArray([a[2], b[2]])),
    ]
}

/// The vectors of two release frames as lanes.
#[inline(always)]
fn frames<I: Isa>(a: &[Vec3<f64>; 3], b: &[Vec3<f64>; 3]) -> [Vec3<Interleaved<I>>; 3] {
    [
        Lanes::interleave_vectors(a[0], b[0]),
        Lanes::interleave_vectors(a[1], b[1]),
        Lanes::interleave_vectors(a[2], b[2]),
    ]
}
