//! Reverse mode of the integration, in SIMD lanes (docs/physics.md, section 8).
//!
//! Trajectories are not stored but integrated backwards from today, so memory grows with particles plus steps, not with their
//! product.

use super::cotangents::{Cotangents, sums_of_vector};
use super::lane_groups::{Bundle, Interleaved, StepSchedules, UNROLL};
use super::model::Model;
use super::particles::Particles;
use super::progenitor_solution::ProgenitorSolution;
use super::settings::StepRule;
use super::step_schedules::Planner;
use crate::orbit::{State, advance_vjp};
use crate::potential::{
    BaryonsCotangent, DiscCotangent, HernquistCotangent, Host, HostCotangent, Plummer,
    PlummerCotangent,
};
use crate::scalar::{Isa, Kernel, LANES, LaneArray, Lanes, Level, Scalar, Vec3, compile_kernel};
use std::ops::Range;

/// Consecutive release times whose derivatives are summed together.
#[derive(Clone, Debug, Default)]
pub(super) struct ReleaseTimeChunk {
    /// Numbers of their pairs of lane groups.
    pub pairs: Range<usize>,
    /// Their step schedules.
    schedules: StepSchedules,
    /// Derivatives with respect to the progenitor's positions at the kicks of the present pair, for each of its lane groups.
    positions_bar: [Vec<Vec3<f64>>; UNROLL],
    /// Derivatives with respect to the progenitor solution.
    pub cotangents: Cotangents,
}

/// The particles today, and the derivatives of the result with respect to their sky positions and line-of-sight velocities.
pub(super) struct ObservedCotangents<'a> {
    pub particles: &'a Particles,
    pub x_bar: &'a [f64],
    pub y_bar: &'a [f64],
    /// Empty if the result does not depend on velocities.
    pub vz_bar: &'a [f64],
}

impl ObservedCotangents<'_> {
    /// The states of a pair and the derivatives with respect to them. A lane without a particle has the state of another particle
    /// and derivatives of zero.
    #[inline(always)]
    fn lanes<I: Isa>(&self, pair: &Bundle<'_>) -> [State<Interleaved<I>>; 2] {
        let Particles { x, y, z, v, .. } = self.particles;
        let state = State {
            x: Vec3::new(repeated(pair, x), repeated(pair, y), repeated(pair, z)),
            v: Vec3::new(
                repeated(pair, &v[0]),
                repeated(pair, &v[1]),
                repeated(pair, &v[2]),
            ),
        };
        let mut state_bar = State {
            x: Vec3::new(
                padded(pair, self.x_bar),
                padded(pair, self.y_bar),
                Lanes::zero(),
            ),
            v: Vec3::zero(),
        };
        if !self.vz_bar.is_empty() {
            state_bar.v.z = padded(pair, self.vz_bar);
        }
        [state, state_bar]
    }
}

/// The time by which a derivative with respect to a velocity is compared with one with respect to a position, Gyr: a tenth of the period of
/// a typical orbit.
const VELOCITY_GYR: f64 = 0.1;

/// A pair's numbers of a column; lanes without a particle repeat the last one.
#[inline(always)]
fn repeated<I: Isa>(pair: &Bundle<'_>, column: &[f64]) -> Interleaved<I> {
    let mut lanes = LaneArray([[0.0; LANES]; UNROLL]);
    for k in 0..UNROLL {
        let lane_group = pair.lane_groups[k];
        let numbers = &column[lane_group.first..lane_group.first + lane_group.len];
        for lane in 0..LANES {
            lanes.0[k][lane] = numbers[lane.min(lane_group.len - 1)];
        }
    }
    Lanes::load(&lanes)
}

/// A pair's numbers of a column; zeros in lanes without a particle.
#[inline(always)]
fn padded<I: Isa>(pair: &Bundle<'_>, column: &[f64]) -> Interleaved<I> {
    let mut lanes = LaneArray([[0.0; LANES]; UNROLL]);
    for k in 0..UNROLL {
        let first = pair.lane_groups[k].first;
        lanes.0[k][..pair.lens[k]].copy_from_slice(&column[first..first + pair.lens[k]]);
    }
    Lanes::load(&lanes)
}

/// The reverse mode of the integration of the particles of some release times.
pub struct VjpKernel<'a, H: Host> {
    pub(super) model: &'a Model,
    pub(super) solution: &'a ProgenitorSolution<f64, H>,
    pub(super) today: &'a ObservedCotangents<'a>,
    /// Square of [`MAX_STRETCH`](super::MAX_STRETCH), or infinity for the exact derivative.
    pub(super) max_stretch2: f64,
    pub(super) chunk: &'a mut ReleaseTimeChunk,
}

impl<H: Host> Kernel for VjpKernel<'_, H> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let Self {
            model,
            solution,
            today,
            max_stretch2,
            chunk,
        } = self;
        let host = H::broadcast::<Interleaved<I>>(&solution.host);
        let progenitor = Plummer::<Interleaved<I>>::broadcast(&solution.progenitor);
        let mut host_bar = HostCotangent::<Interleaved<I>>::zero();
        let mut progenitor_bar = PlummerCotangent::<Interleaved<I>>::zero();
        let mut progenitor_positions_bar: Vec<Vec3<Interleaved<I>>> = Vec::new();
        let mut ln_time_bar = Interleaved::<I>::zero();
        let ReleaseTimeChunk {
            schedules,
            positions_bar,
            cotangents,
            ..
        } = chunk;
        let mut planner = Planner::new(model, solution, schedules);
        let adaptive = model.settings.step_rule == StepRule::Adaptive;
        for number in chunk.pairs.clone() {
            let pair = Bundle::new(&model.lane_groups, &model.pairs[number]);
            let [end, end_bar] = today.lanes::<I>(&pair);
            let velocity_bar2 = end_bar.v.norm2() * (1.0 / (VELOCITY_GYR * VELOCITY_GYR));
            let limit2 = (end_bar.x.norm2() + velocity_bar2) * max_stretch2;
            let schedules =
                planner.schedules::<I, UNROLL>(&pair, today.particles.step_sizes.of_pair(number));
            progenitor_positions_bar.resize(schedules.0[0].kick_gyr.len(), Vec3::zero());
            let start_bar = advance_vjp::<_, H>(
                &host,
                &progenitor,
                &schedules,
                end,
                end_bar,
                &mut host_bar,
                &mut progenitor_bar,
                &mut progenitor_positions_bar,
                &mut ln_time_bar,
                limit2,
            );
            cotangents.release_vjp(&pair, &start_bar);
            // With equal steps, consecutive pairs of the same release times have the same schedules, and their lanes are added.
            let [a, b, ..] = pair.release_times();
            let next = (number + 1 < chunk.pairs.end)
                .then(|| Bundle::new(&model.lane_groups, &model.pairs[number + 1]).release_times());
            if adaptive || next != Some([a, b, b, b]) {
                sum_lanes(&mut progenitor_positions_bar, a == b, positions_bar);
                let release_times = if a == b { 1 } else { UNROLL };
                for k in 0..release_times {
                    cotangents.progenitor_positions_vjp(
                        model.hermite_weights([a, b][k], schedules.0[k]),
                        &positions_bar[k],
                    );
                }
            }
        }
        cotangents.shared.age_gyr = ln_time_bar.sum() / solution.age_gyr;
        cotangents.shared.host = HostCotangent {
            halo: host_bar.halo.map(|lanes| lanes.sum()),
            baryons: BaryonsCotangent {
                disc: DiscCotangent {
                    ln_mass: host_bar.baryons.disc.ln_mass.sum(),
                    ln_r_s: host_bar.baryons.disc.ln_r_s.sum(),
                    normal: sum_vector(host_bar.baryons.disc.normal),
                },
                bulge: HernquistCotangent {
                    ln_mass: host_bar.baryons.bulge.ln_mass.sum(),
                    ln_r_s: host_bar.baryons.bulge.ln_r_s.sum(),
                },
            },
        };
        cotangents.shared.progenitor = PlummerCotangent {
            ln_mass: progenitor_bar.ln_mass.sum(),
            r_s: progenitor_bar.r_s.sum(),
            mass_loss: progenitor_bar.mass_loss.sum(),
        };
    }
}

compile_kernel!(VjpKernel<H: crate::potential::Host>);

/// Runs the kernel for an instruction set.
pub(super) fn integrate_vjp<H: Host>(kernel: VjpKernel<'_, H>, level: Level) {
    kernel.dispatch(level);
}

/// The sum of all lanes of a vector.
#[inline(always)]
fn sum_vector<I: Isa>(v: Vec3<Interleaved<I>>) -> Vec3<f64> {
    Vec3::new(v.x.sum(), v.y.sum(), v.z.sum())
}

/// Sums derivatives over the lanes of each lane group, or over those of both into the first of `out`, and clears `lanes`.
#[inline(always)]
fn sum_lanes<I: Isa>(
    lanes: &mut Vec<Vec3<Interleaved<I>>>,
    same_release_time: bool,
    out: &mut [Vec<Vec3<f64>>; UNROLL],
) {
    out.iter_mut().for_each(Vec::clear);
    for &position_bar in lanes.iter() {
        if same_release_time {
            out[0].push(sum_vector(position_bar));
        } else {
            let sums = sums_of_vector(position_bar);
            for k in 0..UNROLL {
                out[k].push(sums[k]);
            }
        }
    }
    lanes.clear();
}
