//! Particles in lanes, and lane groups in bundles: arithmetic of one vector is computed while the other one's square roots are.

use super::progenitor_solution::{ProgenitorSolution, ReleaseFrame};
use super::settings::{ModelSettings, Precision, StepRule};
use crate::orbit::{MAX_TOGETHER, State, StepSchedule};
use crate::potential::Host;
use crate::scalar::{LANES, LaneArray, Lanes, Vec3, Vectors};
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

/// Number of vectors that are computed together.
pub const UNROLL: usize = 2;

/// The numbers of lane groups that are integrated together with adaptive steps: of two in double precision, of four in single precision.
pub type Interleaved<V> = Lanes<V, UNROLL>;

/// The step schedules of the lane groups that are integrated together; their buffers are reused from call to call.
pub type StepSchedules = [StepSchedule<f64>; MAX_TOGETHER];

impl ModelSettings {
    /// Number of lane groups that are integrated together. In double precision twice as many if their steps are equal: adaptive steps
    /// are those of the particle that needs the shortest.
    pub(super) fn groups_together(&self) -> usize {
        match (self.precision, self.step_rule) {
            (Precision::Double, StepRule::Adaptive) => UNROLL,
            _ => MAX_TOGETHER,
        }
    }
}

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

/// Divides lane groups into bundles with equally many steps and in the same chunk of release times: ranges of `together`, or of fewer where
/// no other fits.
pub(super) fn bundles(
    lane_groups: &[LaneGroup],
    steps: &[usize],
    together: usize,
) -> Vec<Range<usize>> {
    let per_chunk = release_times_per_chunk(steps.len());
    let key = |group: &LaneGroup| (group.release_time / per_chunk, steps[group.release_time]);
    lane_groups
        .chunk_by(|one, next| key(one) == key(next))
        .scan(0, |first, alike| {
            let range = *first..*first + alike.len();
            *first = range.end;
            Some(range)
        })
        .flat_map(|alike| split(alike, together))
        .collect()
}

/// Divides a range into ranges of `len`; the last may be shorter.
pub(super) fn split(range: Range<usize>, len: usize) -> impl Iterator<Item = Range<usize>> {
    let end = range.end;
    range
        .step_by(len)
        .map(move |first| first..end.min(first + len))
}

/// Lane groups that are integrated together, with equally many steps. The last one is repeated where there are fewer than four; the
/// repetitions have no particles.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bundle<'a> {
    pub lane_groups: [&'a LaneGroup; MAX_TOGETHER],
    /// Number of particles of each.
    pub lens: [usize; MAX_TOGETHER],
}

impl<'a> Bundle<'a> {
    /// The bundle of a range of at most four lane groups.
    #[inline]
    pub fn new(lane_groups: &'a [LaneGroup], range: &Range<usize>) -> Self {
        let mut bundle = Self {
            lane_groups: [&lane_groups[range.end - 1]; MAX_TOGETHER],
            lens: [0; MAX_TOGETHER],
        };
        for (k, lane_group) in lane_groups[range.clone()].iter().enumerate() {
            bundle.lane_groups[k] = lane_group;
            bundle.lens[k] = lane_group.len;
        }
        bundle
    }

    /// Numbers of their release times.
    #[inline]
    pub fn release_times(&self) -> [usize; MAX_TOGETHER] {
        self.lane_groups.map(|group| group.release_time)
    }

    /// The positions of their release offsets.
    #[inline(always)]
    pub fn position<V: Vectors, const K: usize>(&self) -> [Lanes<V, K>; 3] {
        let [a, b, c, d] = self.lane_groups;
        offsets([&a.position, &b.position, &c.position, &d.position])
    }

    /// The velocities of their release offsets.
    #[inline(always)]
    pub fn velocity<V: Vectors, const K: usize>(&self) -> [Lanes<V, K>; 3] {
        let [a, b, c, d] = self.lane_groups;
        offsets([&a.velocity, &b.velocity, &c.velocity, &d.velocity])
    }

    /// Their release frames.
    #[inline(always)]
    pub fn release_frames<V: Vectors, const K: usize, H: Host>(
        &self,
        solution: &ProgenitorSolution<f64, H>,
    ) -> ReleaseFrame<Lanes<V, K>> {
        let [a, b, c, d] = self.release_times();
        let frames = &solution.releases.frames;
        let [a, b, c, d] = [&frames[a], &frames[b], &frames[c], &frames[d]];
        ReleaseFrame {
            state: State {
                x: Lanes::splat_vectors(&[a.state.x, b.state.x, c.state.x, d.state.x]),
                v: Lanes::splat_vectors(&[a.state.v, b.state.v, c.state.v, d.state.v]),
            },
            position: splat_frames([&a.position, &b.position, &c.position, &d.position]),
            velocity: splat_frames([&a.velocity, &b.velocity, &c.velocity, &d.velocity]),
            winding_number: Lanes::splat_groups(&[
                a.winding_number,
                b.winding_number,
                c.winding_number,
                d.winding_number,
            ]),
        }
    }
}

/// The components of release offsets as lanes.
#[inline(always)]
fn offsets<V: Vectors, const K: usize>(
    groups: [&[[f64; LANES]; 3]; MAX_TOGETHER],
) -> [Lanes<V, K>; 3] {
    let [a, b, c, d] = groups;
    [
        Lanes::load_groups(&LaneArray([a[0], b[0], c[0], d[0]]).0),
        Lanes::load_groups(&LaneArray([a[1], b[1], c[1], d[1]]).0),
        Lanes::load_groups(&LaneArray([a[2], b[2], c[2], d[2]]).0),
    ]
}

/// The vectors of release frames as lanes.
#[inline(always)]
fn splat_frames<V: Vectors, const K: usize>(
    groups: [&[Vec3<f64>; 3]; MAX_TOGETHER],
) -> [Vec3<Lanes<V, K>>; 3] {
    let [a, b, c, d] = groups;
    [
        Lanes::splat_vectors(&[a[0], b[0], c[0], d[0]]),
        Lanes::splat_vectors(&[a[1], b[1], c[1], d[1]]),
        Lanes::splat_vectors(&[a[2], b[2], c[2], d[2]]),
    ]
}
