//! The exact derivative of the hot stage: the discrete adjoint of the leapfrog in lanes, joined to the dual numbers of
//! the cold stage.
//!
//! Forward mode is cheap where few numbers depend on many (13 parameters into one orbit), reverse mode where many end
//! in one (all particles into one likelihood): so the setup runs on duals, the particles backwards, and they meet at
//! the launches and the orbit's nodes. Memory: one group's path at a time, O(particles + steps).

use super::{Arrivals, Group, LANES, Launch, Model, Setup};
use crate::orbit::{
    ByStep, Flight, InLanes, Kernel, Level, Node, Placement, State, advance_recorded, dispatch,
    reverse,
};
use crate::potential::{FlattenedNfw, NfwCotangent, Plummer, PlummerCotangent};
use crate::scalar::{LaneDual, Lanes, Scalar, Vec3};

/// Buffers of one thread, reused from call to call.
#[derive(Clone, Debug, Default)]
pub struct Workspace {
    /// The course of one epoch's particles.
    pub flight: Flight<f64>,
    /// The particles today.
    pub arrivals: Arrivals,
    /// Derivative of the result with respect to each particle's sky position.
    pub by_x: Vec<f64>,
    /// The y part.
    pub by_y: Vec<f64>,
    nodes: Vec<Node<f64>>,
    launches: Vec<Launch<f64>>,
    by_course: Vec<ByStep<f64>>,
    by_times: Vec<f64>,
    by_phase: Vec<f64>,
}

/// Derivatives with respect to what the cold stage hands over, beside nodes and launches.
#[derive(Clone, Copy, Debug)]
struct ByShared {
    host: NfwCotangent<f64>,
    sphere: PlummerCotangent<f64>,
    age_gyr: f64,
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

/// The particles backwards; `ALL` says whether they count all the way ([`Counted`]).
struct Backward<'a, const ALL: bool> {
    model: &'a Model,
    setup: &'a Setup<f64>,
    work: &'a mut Workspace,
}

impl<const ALL: bool> Kernel for Backward<'_, ALL> {
    type Output = ByShared;

    #[inline(always)]
    fn run<const FMA: bool>(self) -> ByShared {
        let Self { model, setup, work } = self;
        let host = FlattenedNfw::<Lanes<LANES, FMA>>::broadcast(&setup.host);
        let sphere = Plummer::<Lanes<LANES, FMA>>::broadcast(&setup.sphere);
        let steps = model.settings.steps;
        let mut by_host = NfwCotangent::<Lanes<LANES, FMA>>::zero();
        let mut by_sphere = PlummerCotangent::<Lanes<LANES, FMA>>::zero();
        let mut by_age = 0.0;
        let mut positions = vec![Vec3::<Lanes<LANES, FMA>>::zero(); steps + 1];
        let mut by_course = vec![ByStep::<Lanes<LANES, FMA>>::zero(); steps];
        let mut epoch = usize::MAX;
        for (i, group) in model.groups.iter().enumerate() {
            if group.epoch != epoch {
                epoch = group.epoch;
                model.plan(epoch, setup, &mut work.flight);
            }
            let lane = |column: &[f64]| {
                let mut lanes = [0.0; LANES];
                lanes[..group.len].copy_from_slice(&column[group.first..group.first + group.len]);
                Lanes::<LANES, FMA>(lanes)
            };
            let by_position = Vec3::new(lane(&work.by_x), lane(&work.by_y), Lanes::zero());
            let launch = Launch::broadcast(&setup.launches[epoch]);
            let (start, _) = launch.release(group.position.map(Lanes), group.velocity.map(Lanes));
            let course = InLanes(&work.flight);
            advance_recorded(&host, &sphere, &course, start, &mut positions);
            let limit2 = by_position.norm2() * (REGULAR * REGULAR);
            let by_start = reverse(
                &host,
                &sphere,
                &course,
                &positions,
                by_position,
                &mut by_host,
                &mut by_sphere,
                &mut by_course,
                |by| if ALL { by } else { within(by, limit2) },
            );
            add_launch(&mut work.launches[epoch], group, &by_start);
            let next = model.groups.get(i + 1);
            if next.is_none_or(|next| next.epoch != epoch) {
                sum_lanes(&mut by_course, &mut work.by_course);
                by_age += add_course(model, setup, epoch, work);
            }
        }
        if let Some(clock) = &setup.clock {
            clock.pull_back(&setup.orbit, &work.by_phase, &mut work.nodes);
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
fn add_course(model: &Model, setup: &Setup<f64>, epoch: usize, work: &mut Workspace) -> f64 {
    let Workspace {
        flight,
        nodes,
        by_course,
        by_times,
        by_phase,
        ..
    } = work;
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
    /// particles are the ones that [`carry`](Self::carry) made from it.
    pub fn pull_back<const N: usize>(
        &self,
        setup: &Setup<LaneDual<N>>,
        real: &Setup<f64>,
        counted: Counted,
        work: &mut Workspace,
    ) -> [f64; N] {
        let zero = Vec3::zero();
        work.nodes.clear();
        work.nodes.resize(
            setup.orbit.nodes.len(),
            Node {
                x: zero,
                dx: zero,
                ddx: zero,
            },
        );
        work.by_phase.clear();
        work.by_phase.resize(setup.orbit.nodes.len(), 0.0);
        let no_launch = Launch {
            state: State { x: zero, v: zero },
            position: [zero; 3],
            velocity: [zero; 3],
            turns: 0.0,
        };
        work.launches.clear();
        work.launches.resize(setup.launches.len(), no_launch);
        let model = self;
        let shared = match counted {
            Counted::All => dispatch(
                Level::best(),
                Backward::<true> {
                    model,
                    setup: real,
                    work,
                },
            ),
            Counted::Regular => dispatch(
                Level::best(),
                Backward::<false> {
                    model,
                    setup: real,
                    work,
                },
            ),
        };
        let mut sum = Contraction::<N>([0.0; N]);
        sum.add(&setup.host.mass, shared.host.ln_mass / real.host.mass);
        sum.add(&setup.host.r_s, shared.host.ln_r_s / real.host.r_s);
        sum.add(&setup.host.flattening, shared.host.flattening);
        sum.add_vec(&setup.host.axis, shared.host.axis);
        sum.add(&setup.sphere.mass, shared.sphere.ln_mass / real.sphere.mass);
        sum.add(&setup.sphere.r_s, shared.sphere.r_s);
        sum.add(&setup.age_gyr, shared.age_gyr);
        for (node, by) in setup.orbit.nodes.iter().zip(&work.nodes) {
            sum.add_vec(&node.x, by.x);
            sum.add_vec(&node.dx, by.dx);
            sum.add_vec(&node.ddx, by.ddx);
        }
        for (launch, by) in setup.launches.iter().zip(&work.launches) {
            sum.add_vec(&launch.state.x, by.state.x);
            sum.add_vec(&launch.state.v, by.state.v);
            for c in 0..3 {
                sum.add_vec(&launch.position[c], by.position[c]);
                sum.add_vec(&launch.velocity[c], by.velocity[c]);
            }
        }
        sum.0
    }
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
