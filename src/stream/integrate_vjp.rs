//! Reverse mode of the integration: the discrete adjoint of the leapfrog, in SIMD lanes.
//!
//! Trajectories are not stored but integrated backwards from today, so memory grows with particles plus steps, not with their
//! product.

use super::cotangents::{Cotangents, sums_of_vector};
use super::lane_groups::{Interleaved, Pair, StepSchedules, UNROLL};
use super::model::Model;
use super::particles::Particles;
use super::progenitor_solution::ProgenitorSolution;
use super::settings::StepRule;
use super::step_schedules::Planner;
use crate::orbit::{State, reverse};
use crate::potential::{Halo, HaloCotangent, Plummer, PlummerCotangent};
use crate::scalar::{Isa, Kernel, LANES, LaneArray, Lanes, Level, Scalar, Vec3, compile_kernel};
use std::ops::Range;

/// The particles of some release times, and the derivatives that they give.
#[derive(Clone, Debug, Default)]
pub(super) struct Part {
    /// Their pairs of lane groups.
    pub pairs: Range<usize>,
    /// Their step schedules.
    schedules: StepSchedules,
    /// Derivatives with respect to the progenitor's positions at the kicks of the present pair.
    paths: [Vec<Vec3<f64>>; UNROLL],
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
        let mut path_bar: Vec<Vec3<Interleaved<I>>> = Vec::new();
        let mut ln_time_bar = Interleaved::<I>::zero();
        let Part {
            schedules,
            paths,
            cotangents,
            ..
        } = part;
        let mut planner = Planner::new(model, solution, schedules);
        let adaptive = model.settings.step_rule == StepRule::Adaptive;
        for number in part.pairs.clone() {
            let pair = Pair::of(&model.groups, &model.pairs[number]);
            let (end, position_bar) = ends.of::<I>(&pair);
            let limit2 = position_bar.norm2() * max_stretch2;
            let schedules = planner.schedules(&pair, ends.particles.step_sizes.of(number));
            path_bar.resize(schedules.0.drift_gyr.len(), Vec3::zero());
            let start_bar = reverse::<_, H>(
                &host,
                &progenitor,
                &schedules,
                end,
                position_bar,
                &mut host_bar,
                &mut progenitor_bar,
                &mut path_bar,
                &mut ln_time_bar,
                limit2,
            );
            cotangents.add_release_frames(&pair, &start_bar);
            // Pairs of the same release times and of equal steps are summed together.
            let [a, b] = pair.release_times();
            let next = (number + 1 < part.pairs.end)
                .then(|| Pair::of(&model.groups, &model.pairs[number + 1]).release_times());
            if adaptive || next != Some([a, b]) {
                sum_lanes(&mut path_bar, a == b, paths);
                let both = [schedules.0, schedules.1];
                // A half without particles adds no derivatives, but may hold those of an earlier pair.
                let halves = if a == b { 1 } else { UNROLL };
                for k in 0..halves {
                    cotangents.add_path(model.places([a, b][k], both[k]), &paths[k]);
                }
            }
        }
        cotangents.shared.age_gyr = ln_time_bar.sum() / solution.age_gyr;
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

/// Sums derivatives over the lanes of each half, or over those of both, and sets them to zero.
#[inline(always)]
fn sum_lanes<I: Isa>(
    lanes: &mut Vec<Vec3<Interleaved<I>>>,
    both: bool,
    out: &mut [Vec<Vec3<f64>>; UNROLL],
) {
    out.iter_mut().for_each(Vec::clear);
    for &by in lanes.iter() {
        if both {
            out[0].push(sum_vector(by));
        } else {
            let halves = sums_of_vector(by);
            for k in 0..UNROLL {
                out[k].push(halves[k]);
            }
        }
    }
    lanes.clear();
}
