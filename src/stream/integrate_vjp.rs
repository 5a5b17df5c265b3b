//! Reverse mode of the integration: the discrete adjoint of the leapfrog, in SIMD lanes.
//!
//! Trajectories are not stored but integrated backwards from today, so memory grows with particles plus steps, not with their
//! product.

use super::cotangents::{Cotangents, sums_of_vector};
use super::lane_groups::{Interleaved, Pair, StepSchedules, UNROLL};
use super::model::Model;
use super::particles::Particles;
use super::progenitor_solution::ProgenitorSolution;
use super::step_schedules::Planner;
use crate::orbit::{State, StepCotangent, reverse};
use crate::potential::{Halo, HaloCotangent, Plummer, PlummerCotangent};
use crate::scalar::{Isa, Kernel, LANES, LaneArray, Lanes, Level, Scalar, Vec3, compile_kernel};
use std::ops::Range;

/// The particles of some release times, and the derivatives that they give.
#[derive(Clone, Debug, Default)]
pub(super) struct Part {
    /// Their lane groups.
    pub groups: Range<usize>,
    /// Their step schedules.
    schedules: StepSchedules,
    /// Derivatives with respect to the step schedules of the present pair.
    sums: [Vec<StepCotangent<f64>>; UNROLL],
    /// Derivatives with respect to the progenitor solution.
    pub cotangents: Cotangents,
}

/// The particles today, and the derivative of the result with respect to their sky positions.
pub(super) struct Ends<'a> {
    pub particles: &'a Particles,
    pub x_bar: &'a [f64],
    pub y_bar: &'a [f64],
}

impl Ends<'_> {
    /// Those of a pair. A lane without a particle has the state of another particle, and derivatives of zero.
    #[inline(always)]
    fn of<I: Isa>(&self, pair: &Pair<'_>) -> (State<Interleaved<I>>, Vec3<Interleaved<I>>) {
        let Particles { x, y, z, v, .. } = self.particles;
        let end = State {
            x: Vec3::new(repeated(pair, x), repeated(pair, y), repeated(pair, z)),
            v: Vec3::new(
                repeated(pair, &v[0]),
                repeated(pair, &v[1]),
                repeated(pair, &v[2]),
            ),
        };
        let position_bar = Vec3::new(
            padded(pair, self.x_bar),
            padded(pair, self.y_bar),
            Lanes::zero(),
        );
        (end, position_bar)
    }
}

/// A pair's parts of a column; lanes without a particle repeat the last number.
#[inline(always)]
fn repeated<I: Isa>(pair: &Pair<'_>, column: &[f64]) -> Interleaved<I> {
    let mut lanes = LaneArray([[0.0; LANES]; UNROLL]);
    for k in 0..UNROLL {
        let group = pair.groups[k];
        let part = &column[group.first..group.first + group.len];
        for lane in 0..LANES {
            lanes.0[k][lane] = part[lane.min(group.len - 1)];
        }
    }
    Lanes::load(&lanes)
}

/// A pair's parts of a column; zeros in lanes without a particle.
#[inline(always)]
fn padded<I: Isa>(pair: &Pair<'_>, column: &[f64]) -> Interleaved<I> {
    let mut lanes = LaneArray([[0.0; LANES]; UNROLL]);
    for k in 0..UNROLL {
        let first = pair.groups[k].first;
        lanes.0[k][..pair.lens[k]].copy_from_slice(&column[first..first + pair.lens[k]]);
    }
    Lanes::load(&lanes)
}

/// The reverse mode of the integration of some lane groups.
pub struct VjpKernel<'a, H: Halo> {
    pub(super) model: &'a Model,
    pub(super) solution: &'a ProgenitorSolution<f64, H>,
    pub(super) ends: &'a Ends<'a>,
    /// Square of the largest stretch of a particle whose derivative counts, see [`Adjoint`](super::Adjoint).
    pub(super) max_stretch2: f64,
    pub(super) part: &'a mut Part,
}

impl<H: Halo> Kernel for VjpKernel<'_, H> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let Self {
            model,
            solution,
            ends,
            max_stretch2,
            part,
        } = self;
        let host = H::broadcast::<Interleaved<I>>(&solution.host);
        let progenitor = Plummer::<Interleaved<I>>::broadcast(&solution.progenitor);
        let mut host_bar = HaloCotangent::<Interleaved<I>>::zero();
        let mut progenitor_bar = PlummerCotangent::<Interleaved<I>>::zero();
        let mut schedule_bar = vec![StepCotangent::<Interleaved<I>>::zero(); model.settings.steps];
        let Part {
            schedules,
            sums,
            cotangents,
            ..
        } = part;
        let mut planner = Planner::new(model, solution, schedules);
        let mut pairs = Pair::all(&model.steps, &model.groups[part.groups.clone()]).peekable();
        while let Some(pair) = pairs.next() {
            let (end, position_bar) = ends.of::<I>(&pair);
            let limit2 = position_bar.norm2() * max_stretch2;
            let schedules = planner.schedules(&pair);
            let schedule_bar = &mut schedule_bar[..model.steps[pair.groups[0].release_time]];
            let start_bar = reverse::<_, H>(
                &host,
                &progenitor,
                &schedules,
                end,
                position_bar,
                &mut host_bar,
                &mut progenitor_bar,
                schedule_bar,
                limit2,
            );
            cotangents.add_release_frames(&pair, &start_bar);
            // Pairs of the same release times are summed together.
            if pairs
                .peek()
                .is_none_or(|next| next.release_times() != pair.release_times())
            {
                sum_lanes(schedule_bar, sums);
                // A half without particles adds no derivatives, but may hold those of an earlier pair.
                let both = [schedules.0, schedules.1];
                for k in 0..UNROLL {
                    let release_time = pair.groups[k].release_time;
                    cotangents.add_schedule(model, solution, release_time, both[k], &sums[k]);
                }
            }
        }
        cotangents.shared.host = HaloCotangent {
            ln_mass: host_bar.ln_mass.sum(),
            ln_r_s: host_bar.ln_r_s.sum(),
            flattening: host_bar.flattening.sum(),
            axis: sum_vector(host_bar.axis),
        };
        cotangents.shared.progenitor = PlummerCotangent {
            ln_mass: progenitor_bar.ln_mass.sum(),
            r_s: progenitor_bar.r_s.sum(),
        };
    }
}

compile_kernel!(VjpKernel<H: crate::potential::Halo>);

/// Runs the kernel at a level.
pub(super) fn integrate_vjp<H: Halo>(kernel: VjpKernel<'_, H>, level: Level) {
    kernel.dispatch(level);
}

/// The sum of all lanes of a vector.
#[inline(always)]
fn sum_vector<I: Isa>(v: Vec3<Interleaved<I>>) -> Vec3<f64> {
    Vec3::new(v.x.sum(), v.y.sum(), v.z.sum())
}

/// Sums the derivatives with respect to step schedules over the lanes of each half, and sets them to zero.
#[inline(always)]
fn sum_lanes<I: Isa>(
    lanes: &mut [StepCotangent<Interleaved<I>>],
    out: &mut [Vec<StepCotangent<f64>>; UNROLL],
) {
    out.iter_mut().for_each(Vec::clear);
    for by in lanes {
        let progenitor = sums_of_vector(by.progenitor);
        let (drift, kick) = (by.drift.sums(), by.kick.sums());
        for k in 0..UNROLL {
            out[k].push(StepCotangent {
                progenitor: progenitor[k],
                drift: drift[k],
                kick: kick[k],
            });
        }
        *by = StepCotangent::zero();
    }
}
