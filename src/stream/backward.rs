//! The exact derivative of the hot stage: the discrete adjoint of the leapfrog in lanes, joined to the dual numbers of
//! the cold stage.
//!
//! Forward mode is cheap where many numbers depend on few (an orbit on the 15 numbers of a [`Galaxy`]), reverse mode where
//! many end in one (all particles in one likelihood): so the particles run backwards, the setup once more on duals, and they
//! meet at the launches and the orbit's nodes. Paths are run backwards, not remembered: memory is O(particles + steps).

use super::pair::{Flights, IN_FLIGHT, Pair, Planner, Wide};
use super::{Arrivals, Galaxy, Launch, Model, Setup, Threads};
use crate::orbit::{ByStep, Flight, Node, State, add_placed, reverse};
use crate::potential::{FlattenedNfw, NfwCotangent, Plummer, PlummerCotangent};
use crate::scalar::{Eights, Isa, Kernel, LANES, Lanes, Level, Scalar, Vec3, compile_kernel};
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

/// Some epochs on their way back.
#[derive(Clone, Debug, Default)]
struct Part {
    /// Their groups.
    groups: Range<usize>,
    /// Their courses.
    flights: Flights,
    /// Derivatives with respect to the courses in flight.
    sums: [Vec<ByStep<f64>>; IN_FLIGHT],
    /// What comes of it.
    by: Cotangents,
}

/// Derivatives with respect to what the cold stage hands over to the particles of some epochs.
#[derive(Clone, Debug, Default)]
pub(super) struct Cotangents {
    /// The first one.
    first_epoch: usize,
    /// With respect to the launches from the first epoch on.
    pub launches: Vec<Launch<f64>>,
    /// With respect to the nodes of the orbit.
    pub nodes: Vec<Node<f64>>,
    /// With respect to the phases of the clock at the nodes.
    phases: Vec<f64>,
    /// With respect to the times of the course at hand.
    times: Vec<f64>,
    pub shared: ByShared,
}

impl Cotangents {
    /// Forgets what was: zero for these epochs and an orbit of `nodes`.
    fn reset(&mut self, epochs: &Range<usize>, nodes: usize) {
        let zero = Vec3::zero();
        let no_launch = Launch {
            state: State { x: zero, v: zero },
            position: [zero; 3],
            velocity: [zero; 3],
            turns: 0.0,
        };
        self.first_epoch = epochs.start;
        self.launches.clear();
        self.launches.resize(epochs.len(), no_launch);
        self.nodes.clear();
        self.nodes.resize(nodes, Node::zero());
        self.phases.clear();
        self.phases.resize(nodes, 0.0);
        self.shared = ByShared::zero();
    }
}

/// Derivatives with respect to what the cold stage hands over, beside nodes and launches.
#[derive(Clone, Copy, Debug)]
pub(super) struct ByShared {
    pub host: NfwCotangent<f64>,
    pub sphere: PlummerCotangent<f64>,
    pub age_gyr: f64,
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
    /// Those of a pair. A lane without a particle has a state of another, and no derivative.
    #[inline(always)]
    fn of<I: Isa>(&self, pair: &Pair<'_>) -> (State<Wide<I>>, Vec3<Wide<I>>) {
        let Arrivals { x, y, z, v, .. } = self.arrivals;
        let end = State {
            x: Vec3::new(repeated(pair, x), repeated(pair, y), repeated(pair, z)),
            v: Vec3::new(
                repeated(pair, &v[0]),
                repeated(pair, &v[1]),
                repeated(pair, &v[2]),
            ),
        };
        let by_position = Vec3::new(
            padded(pair, self.by_x),
            padded(pair, self.by_y),
            Lanes::zero(),
        );
        (end, by_position)
    }
}

/// A pair's parts of a column; the last number of each again in lanes without a particle.
#[inline(always)]
fn repeated<I: Isa>(pair: &Pair<'_>, column: &[f64]) -> Wide<I> {
    let mut lanes = Eights([[0.0; LANES]; IN_FLIGHT]);
    for (lanes, group) in lanes.0.iter_mut().zip(pair.groups) {
        let (part, rest) = lanes.split_at_mut(group.len);
        part.copy_from_slice(&column[group.first..group.first + group.len]);
        rest.fill(part[group.len - 1]);
    }
    Lanes::load(&lanes)
}

/// A pair's parts of a column; zeros in lanes without a particle.
#[inline(always)]
fn padded<I: Isa>(pair: &Pair<'_>, column: &[f64]) -> Wide<I> {
    let mut lanes = Eights([[0.0; LANES]; IN_FLIGHT]);
    for ((lanes, group), len) in lanes.0.iter_mut().zip(pair.groups).zip(pair.lens) {
        lanes[..len].copy_from_slice(&column[group.first..group.first + len]);
    }
    Lanes::load(&lanes)
}

/// The particles of a part backwards.
struct Backward<'a> {
    model: &'a Model,
    setup: &'a Setup<f64>,
    ends: &'a Ends<'a>,
    /// Square of the largest stretch that counts.
    max_stretch2: f64,
    part: &'a mut Part,
}

impl Kernel for Backward<'_> {
    type Output = ();

    #[inline(always)]
    fn run<I: Isa>(self) {
        let Self {
            model,
            setup,
            ends,
            max_stretch2,
            part,
        } = self;
        let host = FlattenedNfw::<Wide<I>>::broadcast(&setup.host);
        let sphere = Plummer::<Wide<I>>::broadcast(&setup.sphere);
        let mut by_host = NfwCotangent::<Wide<I>>::zero();
        let mut by_sphere = PlummerCotangent::<Wide<I>>::zero();
        let mut by_course = vec![ByStep::<Wide<I>>::zero(); model.settings.steps];
        let Part {
            flights, sums, by, ..
        } = part;
        let mut planner = Planner::new(model, setup, flights);
        let mut pairs = Pair::all(model, &model.groups[part.groups.clone()]).peekable();
        while let Some(pair) = pairs.next() {
            let (end, by_position) = ends.of::<I>(&pair);
            let limit2 = by_position.norm2() * max_stretch2;
            let courses = planner.courses(&pair);
            let by_course = &mut by_course[..model.steps[pair.groups[0].epoch]];
            let by_start = reverse(
                &host,
                &sphere,
                &courses,
                end,
                by_position,
                &mut by_host,
                &mut by_sphere,
                by_course,
                limit2,
            );
            by.add_launches(&pair, &by_start);
            // Pairs of the same epochs are summed together.
            if pairs
                .peek()
                .is_none_or(|next| next.epochs() != pair.epochs())
            {
                sum_lanes(by_course, sums);
                // A half without particles has no derivatives of its own, but may hold those of an earlier pair.
                for ((sums, flight), epoch) in
                    sums.iter().zip([courses.0, courses.1]).zip(pair.epochs())
                {
                    by.add_course(model, setup, epoch, flight, sums);
                }
            }
        }
        by.shared.host = NfwCotangent {
            ln_mass: by_host.ln_mass.sum(),
            ln_r_s: by_host.ln_r_s.sum(),
            flattening: by_host.flattening.sum(),
            axis: sum_vector(by_host.axis),
        };
        by.shared.sphere = PlummerCotangent {
            ln_mass: by_sphere.ln_mass.sum(),
            r_s: by_sphere.r_s.sum(),
        };
    }
}

compile_kernel!(Backward);

/// The sum of all lanes of a vector.
#[inline(always)]
fn sum_vector<I: Isa>(v: Vec3<Wide<I>>) -> Vec3<f64> {
    Vec3::new(v.x.sum(), v.y.sum(), v.z.sum())
}

/// The sums of the lanes of each half of a vector.
#[inline(always)]
fn sums_of_vector<I: Isa>(v: Vec3<Wide<I>>) -> [Vec3<f64>; IN_FLIGHT] {
    let ([x, x_2], [y, y_2], [z, z_2]) = (v.x.sums(), v.y.sums(), v.z.sums());
    [Vec3::new(x, y, z), Vec3::new(x_2, y_2, z_2)]
}

/// Sums the derivatives with respect to courses over the lanes of each half, and forgets them there.
#[inline(always)]
fn sum_lanes<I: Isa>(lanes: &mut [ByStep<Wide<I>>], out: &mut [Vec<ByStep<f64>>; IN_FLIGHT]) {
    out.iter_mut().for_each(Vec::clear);
    for by in lanes {
        let progenitor = sums_of_vector(by.progenitor);
        let (drift, kick) = (by.drift.sums(), by.kick.sums());
        for k in 0..IN_FLIGHT {
            out[k].push(ByStep {
                progenitor: progenitor[k],
                drift: drift[k],
                kick: kick[k],
            });
        }
        *by = ByStep::zero();
    }
}

impl Cotangents {
    /// Adds derivatives with respect to the starts of a pair to those with respect to its launches.
    #[inline(always)]
    fn add_launches<I: Isa>(&mut self, pair: &Pair<'_>, by_start: &State<Wide<I>>) {
        let State { x, v } = *by_start;
        let (position, velocity) = (pair.position::<I>(), pair.velocity::<I>());
        let (by_x, by_v) = (sums_of_vector(x), sums_of_vector(v));
        // A half without particles has no derivatives.
        for k in 0..IN_FLIGHT {
            let launch = &mut self.launches[pair.groups[k].epoch - self.first_epoch];
            launch.state.x += by_x[k];
            launch.state.v += by_v[k];
        }
        for c in 0..3 {
            let by_position = sums_of_vector(x * position[c]);
            let by_velocity = sums_of_vector(v * velocity[c]);
            for k in 0..IN_FLIGHT {
                let launch = &mut self.launches[pair.groups[k].epoch - self.first_epoch];
                launch.position[c] += by_position[k];
                launch.velocity[c] += by_velocity[k];
            }
        }
    }

    /// Adds the derivatives with respect to one epoch's course to those with respect to the orbit's nodes, the age and,
    /// where the course follows a clock, its phases.
    fn add_course(
        &mut self,
        model: &Model,
        setup: &Setup<f64>,
        epoch: usize,
        flight: &Flight<f64>,
        by_course: &[ByStep<f64>],
    ) {
        let places = if setup.clock.is_some() {
            &flight.places
        } else {
            model.path_of(epoch)
        };
        for (place, by) in places.iter().zip(by_course) {
            add_placed(&mut self.nodes, place, by.progenitor);
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
        self.shared.age_gyr += (0..steps)
            .map(|j| by_drift(j) * flight.drift_gyr[j])
            .sum::<f64>()
            / setup.age_gyr;
        if let Some(clock) = &setup.clock {
            let by_times = &mut self.times;
            by_times.clear();
            by_times.resize(steps + 1, 0.0);
            for j in 0..steps {
                let by = by_drift(j) * setup.age_gyr;
                by_times[j + 1] += by;
                by_times[j] += by_course[j]
                    .progenitor
                    .dot(setup.orbit.slope(flight.moments[j]))
                    - by;
            }
            clock.pull_back_times(&flight.moments, by_times, &mut self.phases);
        }
    }

    /// Adds those of the epochs that follow.
    fn append(&mut self, next: &mut Self) {
        self.shared.add(&next.shared);
        for (sum, by) in self.phases.iter_mut().zip(&next.phases) {
            *sum += by;
        }
        for (sum, by) in self.nodes.iter_mut().zip(&next.nodes) {
            for row in 0..3 {
                sum.add(row, by.vector(row));
            }
        }
        self.launches.append(&mut next.launches);
    }
}

impl Model {
    /// The gradient with respect to the [numbers](Galaxy::numbers) of a galaxy of a result whose derivatives with respect to
    /// the particles' sky positions stand in `work.by_x` and `work.by_y`. `setup` was made from this galaxy, and the
    /// particles are the ones that [`carry`](Self::carry) made from it. The same bits for any [`Threads`].
    pub fn pull_back(
        &self,
        galaxy: &Galaxy<f64>,
        setup: &Setup<f64>,
        counted: Counted,
        threads: Threads,
        work: &mut Workspace,
    ) -> [f64; Galaxy::<f64>::NUMBERS] {
        self.prepare(setup, work);
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
        let one = |part: &mut Part| self.pull_back_part(setup, counted, &ends, part);
        match threads {
            Threads::One => parts.iter_mut().for_each(one),
            Threads::All => parts.par_iter_mut().for_each(one),
        }
        let [Part { by: total, .. }, others @ ..] = parts.as_mut_slice() else {
            return [0.0; Galaxy::<f64>::NUMBERS];
        };
        for part in others {
            total.append(&mut part.by);
        }
        if let Some(clock) = &setup.clock {
            clock.pull_back(&setup.orbit, &total.phases, &mut total.nodes);
        }
        self.pull_back_setup(galaxy, total)
    }

    /// Deals the epochs into parts.
    fn prepare(&self, setup: &Setup<f64>, work: &mut Workspace) {
        let epochs = self.table.taus.len();
        let groups_per_epoch = self.groups.len() / epochs;
        let per_part = epochs.div_ceil(PARTS);
        work.parts
            .resize_with(epochs.div_ceil(per_part), Part::default);
        for (k, part) in work.parts.iter_mut().enumerate() {
            let range = k * per_part..epochs.min((k + 1) * per_part);
            part.by.reset(&range, setup.orbit.nodes.len());
            part.groups = range.start * groups_per_epoch..range.end * groups_per_epoch;
        }
    }

    fn pull_back_part(
        &self,
        setup: &Setup<f64>,
        counted: Counted,
        ends: &Ends<'_>,
        part: &mut Part,
    ) {
        let max_stretch2 = match counted {
            Counted::All => f64::INFINITY,
            Counted::Regular => REGULAR * REGULAR,
        };
        let backward = Backward {
            model: self,
            setup,
            ends,
            max_stretch2,
            part,
        };
        backward.dispatch(Level::best());
    }
}
