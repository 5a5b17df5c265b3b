//! The exact derivative of the hot stage: the discrete adjoint of the leapfrog in lanes, joined to the dual numbers of
//! the cold stage.
//!
//! Forward mode is cheap where many numbers depend on few (an orbit on the 15 numbers of a [`System`]), reverse mode where
//! many end in one (all particles in one likelihood): so the particles run backwards, the setup once more on duals, and they
//! meet at the launches and the orbit's nodes. Paths are run backwards, not remembered: memory is O(particles + steps).

use super::cotangents::{Cotangents, sums_of_vector};
use super::lane_groups::{Interleaved, Pair, StepSchedules, UNROLL};
use super::model::Model;
use super::particles::Particles;
use super::progenitor_solution::ProgenitorSolution;
use super::step_schedules::Planner;
use super::system::System;
use super::threads::Threads;
use crate::orbit::{State, StepCotangent, reverse};
use crate::potential::{FlattenedNfw, NfwCotangent, Plummer, PlummerCotangent};
use crate::scalar::{Isa, Kernel, LANES, LaneArray, Lanes, Level, Scalar, Vec3, compile_kernel};
use rayon::prelude::*;
use std::ops::Range;

/// Parts that the epochs are dealt into. Each sums its own derivatives, and the parts are added up in order: the same bits
/// for any number of threads, one too.
const PARTS: usize = 8;

/// Buffers, reused from call to call.
#[derive(Clone, Debug, Default)]
pub struct Workspace {
    /// The courses of the particles on their way here.
    pub schedules: StepSchedules,
    /// The particles today.
    pub particles: Particles,
    /// Derivative of the result with respect to each particle's sky position.
    pub x_bar: Vec<f64>,
    /// The y part.
    pub y_bar: Vec<f64>,
    parts: Vec<Part>,
}

/// Some epochs on their way back.
#[derive(Clone, Debug, Default)]
struct Part {
    /// Their groups.
    groups: Range<usize>,
    /// Their courses.
    schedules: StepSchedules,
    /// Derivatives with respect to the courses in flight.
    sums: [Vec<StepCotangent<f64>>; UNROLL],
    /// What comes of it.
    by: Cotangents,
}

/// Which particles a derivative counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Adjoint {
    /// All, all the way: the exact derivative of the discrete model.
    Exact,
    /// Each as far back as its final position moves by at most [`MAX_STRETCH`] times what its position then does. A particle
    /// that meets a centre again and again in steps too long for it is chaotic: it moves a bin's mean by little, but its
    /// derivative can exceed all others together by ten orders of magnitude, and says nothing about any finite step.
    /// Forgetting its past where that happens leaves a field that samplers can follow.
    Truncated,
}

/// Largest stretch of a regular particle: tides stretch by tens in the age of a stream, eccentric orbits by hundreds.
pub const MAX_STRETCH: f64 = 1_000.0;

/// Where the particles are today, and the derivative of the result with respect to that.
struct Ends<'a> {
    particles: &'a Particles,
    x_bar: &'a [f64],
    y_bar: &'a [f64],
}

impl Ends<'_> {
    /// Those of a pair. A lane without a particle has a state of another, and no derivative.
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

/// A pair's parts of a column; the last number of each again in lanes without a particle.
#[inline(always)]
fn repeated<I: Isa>(pair: &Pair<'_>, column: &[f64]) -> Interleaved<I> {
    let mut lanes = LaneArray([[0.0; LANES]; UNROLL]);
    for (lanes, group) in lanes.0.iter_mut().zip(pair.groups) {
        let (part, rest) = lanes.split_at_mut(group.len);
        part.copy_from_slice(&column[group.first..group.first + group.len]);
        rest.fill(part[group.len - 1]);
    }
    Lanes::load(&lanes)
}

/// A pair's parts of a column; zeros in lanes without a particle.
#[inline(always)]
fn padded<I: Isa>(pair: &Pair<'_>, column: &[f64]) -> Interleaved<I> {
    let mut lanes = LaneArray([[0.0; LANES]; UNROLL]);
    for ((lanes, group), len) in lanes.0.iter_mut().zip(pair.groups).zip(pair.lens) {
        lanes[..len].copy_from_slice(&column[group.first..group.first + len]);
    }
    Lanes::load(&lanes)
}

/// The particles of a part backwards.
struct VjpKernel<'a> {
    model: &'a Model,
    solution: &'a ProgenitorSolution<f64>,
    ends: &'a Ends<'a>,
    /// Square of the largest stretch that counts.
    max_stretch2: f64,
    part: &'a mut Part,
}

impl Kernel for VjpKernel<'_> {
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
        let host = FlattenedNfw::<Interleaved<I>>::broadcast(&solution.host);
        let progenitor = Plummer::<Interleaved<I>>::broadcast(&solution.progenitor);
        let mut host_bar = NfwCotangent::<Interleaved<I>>::zero();
        let mut progenitor_bar = PlummerCotangent::<Interleaved<I>>::zero();
        let mut schedule_bar = vec![StepCotangent::<Interleaved<I>>::zero(); model.settings.steps];
        let Part {
            schedules,
            sums,
            by,
            ..
        } = part;
        let mut planner = Planner::new(model, solution, schedules);
        let mut pairs = Pair::all(&model.steps, &model.groups[part.groups.clone()]).peekable();
        while let Some(pair) = pairs.next() {
            let (end, position_bar) = ends.of::<I>(&pair);
            let limit2 = position_bar.norm2() * max_stretch2;
            let schedules = planner.schedules(&pair);
            let schedule_bar = &mut schedule_bar[..model.steps[pair.groups[0].release_time]];
            let start_bar = reverse(
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
            by.add_release_frames(&pair, &start_bar);
            // Pairs of the same epochs are summed together.
            if pairs
                .peek()
                .is_none_or(|next| next.release_times() != pair.release_times())
            {
                sum_lanes(schedule_bar, sums);
                // A half without particles has no derivatives of its own, but may hold those of an earlier pair.
                for ((sums, schedule), release_time) in sums
                    .iter()
                    .zip([schedules.0, schedules.1])
                    .zip(pair.release_times())
                {
                    by.add_course(model, solution, release_time, schedule, sums);
                }
            }
        }
        by.shared.host = NfwCotangent {
            ln_mass: host_bar.ln_mass.sum(),
            ln_r_s: host_bar.ln_r_s.sum(),
            flattening: host_bar.flattening.sum(),
            axis: sum_vector(host_bar.axis),
        };
        by.shared.progenitor = PlummerCotangent {
            ln_mass: progenitor_bar.ln_mass.sum(),
            r_s: progenitor_bar.r_s.sum(),
        };
    }
}

compile_kernel!(VjpKernel);

/// The sum of all lanes of a vector.
#[inline(always)]
fn sum_vector<I: Isa>(v: Vec3<Interleaved<I>>) -> Vec3<f64> {
    Vec3::new(v.x.sum(), v.y.sum(), v.z.sum())
}

/// Sums the derivatives with respect to courses over the lanes of each half, and forgets them there.
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

impl Model {
    /// The gradient with respect to the [numbers](System::numbers) of a galaxy of a result whose derivatives with respect to
    /// the particles' sky positions stand in `work.by_x` and `work.by_y`. `setup` was made from this galaxy, and the
    /// particles are the ones that [`integrate`](Self::integrate) made from it. The same bits for any [`Threads`].
    pub fn vjp(
        &self,
        system: &System<f64>,
        solution: &ProgenitorSolution<f64>,
        adjoint: Adjoint,
        threads: Threads,
        work: &mut Workspace,
    ) -> [f64; System::<f64>::LEN] {
        self.prepare(solution, work);
        let Workspace {
            particles,
            x_bar,
            y_bar,
            parts,
            ..
        } = work;
        let ends = Ends {
            particles,
            x_bar,
            y_bar,
        };
        let one = |part: &mut Part| self.part_vjp(solution, adjoint, &ends, part);
        match threads {
            Threads::One => parts.iter_mut().for_each(one),
            Threads::All => parts.par_iter_mut().for_each(one),
        }
        let [Part { by: total, .. }, others @ ..] = parts.as_mut_slice() else {
            return [0.0; System::<f64>::LEN];
        };
        for part in others {
            total.append(&mut part.by);
        }
        if let Some(grid) = &solution.grid {
            grid.vjp(&solution.orbit, &total.phases, &mut total.nodes);
        }
        self.progenitor_solution_vjp(system, total)
    }

    /// Deals the epochs into parts.
    fn prepare(&self, solution: &ProgenitorSolution<f64>, work: &mut Workspace) {
        let release_times = self.table.taus.len();
        let groups_per_release_time = self.groups.len() / release_times;
        let per_part = release_times.div_ceil(PARTS);
        work.parts
            .resize_with(release_times.div_ceil(per_part), Part::default);
        for (k, part) in work.parts.iter_mut().enumerate() {
            let range = k * per_part..release_times.min((k + 1) * per_part);
            part.by.reset(&range, solution.orbit.nodes.len());
            part.groups =
                range.start * groups_per_release_time..range.end * groups_per_release_time;
        }
    }

    fn part_vjp(
        &self,
        solution: &ProgenitorSolution<f64>,
        adjoint: Adjoint,
        ends: &Ends<'_>,
        part: &mut Part,
    ) {
        let max_stretch2 = match adjoint {
            Adjoint::Exact => f64::INFINITY,
            Adjoint::Truncated => MAX_STRETCH * MAX_STRETCH,
        };
        let backward = VjpKernel {
            model: self,
            solution,
            ends,
            max_stretch2,
            part,
        };
        backward.dispatch(Level::best());
    }
}
