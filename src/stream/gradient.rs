//! The exact derivative of the hot stage: the discrete adjoint of the leapfrog in lanes, joined to the dual numbers of
//! the cold stage.
//!
//! Forward mode is cheap where few numbers depend on many (13 parameters into one orbit), reverse mode where many end
//! in one (all particles into one likelihood): so the setup runs on duals, the particles backwards, and they meet at
//! the launches and the orbit's nodes. Paths are run backwards, not remembered: memory is O(particles + steps).

use super::{Arrivals, Flights, Group, LANES, Launch, Model, Setup, Threads};
use crate::orbit::{
    ByStep, Flight, InLanes, Kernel, Level, Node, Placement, State, dispatch, reverse,
};
use crate::potential::{FlattenedNfw, NfwCotangent, Plummer, PlummerCotangent};
use crate::scalar::{LaneDual, Lanes, Scalar, Vec3};
use rayon::prelude::*;
use std::ops::Range;

/// Parts that the epochs are dealt into. Each sums its own derivatives, and the parts are added up in order: the same bits
/// for any number of threads, one too.
const PARTS: usize = 8;

/// Buffers, reused from call to call.
#[derive(Clone, Debug, Default)]
pub struct Workspace {
    /// The courses of the particles on their way here.
    pub flights: Flights,
    /// The particles today.
    pub arrivals: Arrivals,
    /// Derivative of the result with respect to each particle's sky position.
    pub by_x: Vec<f64>,
    /// The y part.
    pub by_y: Vec<f64>,
    parts: Vec<Part>,
}

/// Some epochs, and the derivatives with respect to what their particles were made from.
#[derive(Clone, Debug, Default)]
struct Part {
    /// Its groups.
    groups: Range<usize>,
    /// Its first epoch.
    first_epoch: usize,
    /// The course of one epoch's particles on their way back.
    flight: Flight<f64>,
    nodes: Vec<Node<f64>>,
    /// From the first epoch on.
    launches: Vec<Launch<f64>>,
    by_course: Vec<ByStep<f64>>,
    by_times: Vec<f64>,
    by_phase: Vec<f64>,
    shared: ByShared,
}

impl Part {
    /// Forgets what was; `epochs` of these many groups each, and an orbit of `nodes`.
    fn reset(&mut self, epochs: Range<usize>, groups_per_epoch: usize, nodes: usize) {
        let zero = Vec3::zero();
        let no_node = Node {
            x: zero,
            dx: zero,
            ddx: zero,
        };
        let no_launch = Launch {
            state: State { x: zero, v: zero },
            position: [zero; 3],
            velocity: [zero; 3],
            turns: 0.0,
        };
        self.nodes.clear();
        self.nodes.resize(nodes, no_node);
        self.by_phase.clear();
        self.by_phase.resize(nodes, 0.0);
        self.launches.clear();
        self.launches.resize(epochs.len(), no_launch);
        self.first_epoch = epochs.start;
        self.groups = epochs.start * groups_per_epoch..epochs.end * groups_per_epoch;
        self.shared = ByShared::zero();
    }
}

/// Derivatives with respect to what the cold stage hands over, beside nodes and launches.
#[derive(Clone, Copy, Debug)]
struct ByShared {
    host: NfwCotangent<f64>,
    sphere: PlummerCotangent<f64>,
    age_gyr: f64,
}

impl ByShared {
    fn zero() -> Self {
        Self {
            host: NfwCotangent::zero(),
            sphere: PlummerCotangent::zero(),
            age_gyr: 0.0,
        }
    }

    fn add(&mut self, other: &Self) {
        self.host.ln_mass += other.host.ln_mass;
        self.host.ln_r_s += other.host.ln_r_s;
        self.host.flattening += other.host.flattening;
        self.host.axis += other.host.axis;
        self.sphere.ln_mass += other.sphere.ln_mass;
        self.sphere.r_s += other.sphere.r_s;
        self.age_gyr += other.age_gyr;
    }
}

impl Default for ByShared {
    fn default() -> Self {
        Self::zero()
    }
}

/// Which particles a derivative counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Counted {
    /// All, all the way: the exact derivative of the discrete model.
    All,
    /// Each as far back as its final position moves by at most [`REGULAR`] times what its position then does. A particle
    /// that meets a centre again and again in steps too long for it is chaotic: it moves a bin's mean by little, but its
    /// derivative can exceed all others together by ten orders of magnitude, and says nothing about any finite step.
    /// Forgetting its past where that happens leaves a field that samplers can follow.
    Regular,
}

/// Largest stretch of a regular particle: tides stretch by tens in the age of a stream, eccentric orbits by hundreds.
pub const REGULAR: f64 = 1_000.0;

/// Where the particles are today, and the derivative of the result with respect to that.
struct Ends<'a> {
    arrivals: &'a Arrivals,
    by_x: &'a [f64],
    by_y: &'a [f64],
}

impl Ends<'_> {
    /// Those of a group. A lane without a particle has the state of the last one, and no derivative.
    #[inline(always)]
    fn of<const FMA: bool>(
        &self,
        group: &Group,
    ) -> (State<Lanes<LANES, FMA>>, Vec3<Lanes<LANES, FMA>>) {
        let lanes = |column: &[f64]| {
            Lanes(std::array::from_fn(|l| {
                column[group.first + l.min(group.len - 1)]
            }))
        };
        let by = |column: &[f64]| {
            Lanes(std::array::from_fn(|l| {
                if l < group.len {
                    column[group.first + l]
                } else {
                    0.0
                }
            }))
        };
        let Arrivals { x, y, z, v, .. } = self.arrivals;
        let end = State {
            x: Vec3::new(lanes(x), lanes(y), lanes(z)),
            v: Vec3::new(lanes(&v[0]), lanes(&v[1]), lanes(&v[2])),
        };
        (end, Vec3::new(by(self.by_x), by(self.by_y), Lanes::zero()))
    }
}

/// The particles of a part backwards; `ALL` says whether they count all the way ([`Counted`]).
struct Backward<'a, const ALL: bool> {
    model: &'a Model,
    setup: &'a Setup<f64>,
    ends: &'a Ends<'a>,
    part: &'a mut Part,
}

impl<const ALL: bool> Kernel for Backward<'_, ALL> {
    type Output = ByShared;

    #[inline(always)]
    fn run<const FMA: bool>(self) -> ByShared {
        let Self {
            model,
            setup,
            ends,
            part,
        } = self;
        let host = FlattenedNfw::<Lanes<LANES, FMA>>::broadcast(&setup.host);
        let sphere = Plummer::<Lanes<LANES, FMA>>::broadcast(&setup.sphere);
        let steps = model.settings.steps;
        let mut by_host = NfwCotangent::<Lanes<LANES, FMA>>::zero();
        let mut by_sphere = PlummerCotangent::<Lanes<LANES, FMA>>::zero();
        let mut by_age = 0.0;
        let mut by_course = vec![ByStep::<Lanes<LANES, FMA>>::zero(); steps];
        let mut epoch = usize::MAX;
        let groups = &model.groups[part.groups.clone()];
        for (i, group) in groups.iter().enumerate() {
            if group.epoch != epoch {
                epoch = group.epoch;
                model.plan(epoch, setup, &mut part.flight);
            }
            let (end, by_position) = ends.of(group);
            let course = InLanes(&part.flight);
            let limit2 = by_position.norm2() * (REGULAR * REGULAR);
            let by_start = reverse(
                &host,
                &sphere,
                &course,
                end,
                by_position,
                &mut by_host,
                &mut by_sphere,
                &mut by_course,
                |by| if ALL { by } else { within(by, limit2) },
            );
            add_launch(
                &mut part.launches[epoch - part.first_epoch],
                group,
                &by_start,
            );
            let next = groups.get(i + 1);
            if next.is_none_or(|next| next.epoch != epoch) {
                sum_lanes(&mut by_course, &mut part.by_course);
                by_age += add_course(model, setup, epoch, part);
            }
        }
        ByShared {
            host: NfwCotangent {
                ln_mass: by_host.ln_mass.sum(),
                ln_r_s: by_host.ln_r_s.sum(),
                flattening: by_host.flattening.sum(),
                axis: by_host.axis.map(Lanes::sum),
            },
            sphere: PlummerCotangent {
                ln_mass: by_sphere.ln_mass.sum(),
                r_s: by_sphere.r_s.sum(),
            },
            age_gyr: by_age,
        }
    }
}

/// `by` where its position part is at most sqrt(`limit2`) long, zero elsewhere.
#[inline(always)]
fn within<S: Scalar>(by: State<S>, limit2: S) -> State<S> {
    let regular = by.x.norm2().lt(limit2);
    let kept = |s: S| S::select(regular, s, S::zero());
    State {
        x: by.x.map(kept),
        v: by.v.map(kept),
    }
}

// The functions below add up lanes. They are calls on purpose: sums across lanes next to the sweep's loop keep the
// compiler from putting the loop itself into vector registers.

/// Adds derivatives with respect to the starts of a group to those with respect to its launch.
#[inline(never)]
fn add_launch<const FMA: bool>(
    by_launch: &mut Launch<f64>,
    group: &Group,
    by_start: &State<Lanes<LANES, FMA>>,
) {
    let State { x, v } = *by_start;
    by_launch.state.x += x.map(Lanes::sum);
    by_launch.state.v += v.map(Lanes::sum);
    for c in 0..3 {
        by_launch.position[c] += (x * Lanes(group.position[c])).map(Lanes::sum);
        by_launch.velocity[c] += (v * Lanes(group.velocity[c])).map(Lanes::sum);
    }
}

/// Sums the derivatives with respect to a course over lanes, and forgets them there.
#[inline(never)]
fn sum_lanes<const FMA: bool>(lanes: &mut [ByStep<Lanes<LANES, FMA>>], out: &mut Vec<ByStep<f64>>) {
    out.clear();
    for by in lanes {
        out.push(ByStep {
            progenitor: by.progenitor.map(Lanes::sum),
            drift: by.drift.sum(),
            kick: by.kick.sum(),
        });
        *by = ByStep::zero();
    }
}

/// Adds the derivatives with respect to one epoch's course to those with respect to the orbit's nodes and, where the course
/// follows a clock, its phases. Returns what falls on the age.
#[inline(never)]
fn add_course(model: &Model, setup: &Setup<f64>, epoch: usize, part: &mut Part) -> f64 {
    let Part {
        flight,
        nodes,
        by_course,
        by_times,
        by_phase,
        ..
    } = part;
    let places = if setup.clock.is_some() {
        &flight.places
    } else {
        model.path_of(epoch)
    };
    for (place, by) in places.iter().zip(by_course.iter()) {
        add_place(nodes, place, by.progenitor);
    }
    let steps = by_course.len();
    // A drift is in itself and by half in the kicks at both of its ends; the kick today moves nothing.
    let by_drift = |j: usize| {
        let next = if j + 1 < steps {
            by_course[j + 1].kick
        } else {
            0.0
        };
        by_course[j].drift / flight.drift_gyr[j] + 0.5 * (by_course[j].kick + next)
    };
    let by_age = (0..steps)
        .map(|j| by_drift(j) * flight.drift_gyr[j])
        .sum::<f64>()
        / setup.age_gyr;
    if let Some(clock) = &setup.clock {
        by_times.clear();
        by_times.resize(steps + 1, 0.0);
        for j in 0..steps {
            let by = by_drift(j) * setup.age_gyr;
            by_times[j + 1] += by;
            by_times[j] += by_course[j]
                .progenitor
                .dot(setup.orbit.slope(flight.times[j]))
                - by;
        }
        clock.pull_back_times(model.table.taus[epoch], by_times, by_phase);
    }
    by_age
}

/// Adds the derivative with respect to an interpolated position to those with respect to the two nodes around it.
fn add_place(nodes: &mut [Node<f64>], place: &Placement, by: Vec3<f64>) {
    let (earlier, later) = nodes.split_at_mut(place.node + 1);
    let (a, b) = (&mut earlier[place.node], &mut later[0]);
    let slots = [
        &mut a.x, &mut a.dx, &mut a.ddx, &mut b.x, &mut b.dx, &mut b.ddx,
    ];
    for (slot, weight) in slots.into_iter().zip(place.weights) {
        *slot = slot.add_scaled(by, weight);
    }
}

impl Model {
    /// The gradient with respect to the `N` variables of the duals in `setup` of a result whose derivatives with respect
    /// to the particles' sky positions stand in `work.by_x` and `work.by_y`. `real` is the real part of `setup`, and the
    /// particles are the ones that [`carry`](Self::carry) made from it. The same bits for any [`Threads`].
    pub fn pull_back<const N: usize>(
        &self,
        setup: &Setup<LaneDual<N>>,
        real: &Setup<f64>,
        counted: Counted,
        threads: Threads,
        work: &mut Workspace,
    ) -> [f64; N] {
        self.prepare(real, work);
        let Workspace {
            arrivals,
            by_x,
            by_y,
            parts,
            ..
        } = work;
        let ends = Ends {
            arrivals,
            by_x,
            by_y,
        };
        let one = |part: &mut Part| self.pull_back_part(real, counted, &ends, part);
        match threads {
            Threads::One => parts.iter_mut().for_each(one),
            Threads::All => parts.par_iter_mut().for_each(one),
        }
        gather(setup, real, parts)
    }

    /// Deals the epochs into parts.
    fn prepare(&self, real: &Setup<f64>, work: &mut Workspace) {
        let epochs = self.table.taus.len();
        let groups_per_epoch = self.groups.len() / epochs;
        let per_part = epochs.div_ceil(PARTS);
        work.parts
            .resize_with(epochs.div_ceil(per_part), Part::default);
        for (k, part) in work.parts.iter_mut().enumerate() {
            let range = k * per_part..epochs.min((k + 1) * per_part);
            part.reset(range, groups_per_epoch, real.orbit.nodes.len());
        }
    }

    fn pull_back_part(
        &self,
        setup: &Setup<f64>,
        counted: Counted,
        ends: &Ends<'_>,
        part: &mut Part,
    ) {
        let model = self;
        let level = Level::best();
        let part_by = match counted {
            Counted::All => dispatch(
                level,
                Backward::<true> {
                    model,
                    setup,
                    ends,
                    part,
                },
            ),
            Counted::Regular => dispatch(
                level,
                Backward::<false> {
                    model,
                    setup,
                    ends,
                    part,
                },
            ),
        };
        part.shared = part_by;
    }
}

/// Adds up the parts, and joins them to the duals of the cold stage.
fn gather<const N: usize>(
    setup: &Setup<LaneDual<N>>,
    real: &Setup<f64>,
    parts: &mut [Part],
) -> [f64; N] {
    let mut sum = Contraction::<N>([0.0; N]);
    let Some((total, others)) = parts.split_first_mut() else {
        return sum.0;
    };
    for part in others {
        total.shared.add(&part.shared);
        for (sum, by) in total.by_phase.iter_mut().zip(&part.by_phase) {
            *sum += by;
        }
        for (sum, by) in total.nodes.iter_mut().zip(&part.nodes) {
            sum.x += by.x;
            sum.dx += by.dx;
            sum.ddx += by.ddx;
        }
        total.launches.append(&mut part.launches);
    }
    if let Some(clock) = &real.clock {
        clock.pull_back(&real.orbit, &total.by_phase, &mut total.nodes);
    }
    let shared = total.shared;
    sum.add(&setup.host.mass, shared.host.ln_mass / real.host.mass);
    sum.add(&setup.host.r_s, shared.host.ln_r_s / real.host.r_s);
    sum.add(&setup.host.flattening, shared.host.flattening);
    sum.add_vec(&setup.host.axis, shared.host.axis);
    sum.add(&setup.sphere.mass, shared.sphere.ln_mass / real.sphere.mass);
    sum.add(&setup.sphere.r_s, shared.sphere.r_s);
    sum.add(&setup.age_gyr, shared.age_gyr);
    for (node, by) in setup.orbit.nodes.iter().zip(&total.nodes) {
        sum.add_vec(&node.x, by.x);
        sum.add_vec(&node.dx, by.dx);
        sum.add_vec(&node.ddx, by.ddx);
    }
    for (launch, by) in setup.launches.iter().zip(&total.launches) {
        sum.add_vec(&launch.state.x, by.state.x);
        sum.add_vec(&launch.state.v, by.state.v);
        for c in 0..3 {
            sum.add_vec(&launch.position[c], by.position[c]);
            sum.add_vec(&launch.velocity[c], by.velocity[c]);
        }
    }
    sum.0
}

/// Sum of derivative times dual part: where reverse mode meets forward mode.
struct Contraction<const N: usize>([f64; N]);

impl<const N: usize> Contraction<N> {
    fn add(&mut self, number: &LaneDual<N>, by: f64) {
        for (slot, e) in self.0.iter_mut().zip(number.eps) {
            *slot += by * e;
        }
    }

    fn add_vec(&mut self, vector: &Vec3<LaneDual<N>>, by: Vec3<f64>) {
        self.add(&vector.x, by.x);
        self.add(&vector.y, by.y);
        self.add(&vector.z, by.z);
    }
}
