//! The exact derivative of the hot stage: the discrete adjoint of the leapfrog in lanes, joined to the dual numbers of
//! the cold stage.
//!
//! Forward mode is cheap where few numbers depend on many (13 parameters into one orbit), reverse mode where many end
//! in one (all particles into one likelihood): so the setup runs on duals, the particles backwards, and they meet at
//! the launches and the orbit's nodes. Memory: one group's path at a time, O(particles + steps).

use super::{Arrivals, LANES, Launch, Model, Setup};
use crate::orbit::{Kernel, Level, Node, State, advance_recorded, dispatch, reverse};
use crate::potential::{FlattenedNfw, NfwCotangent, Plummer, PlummerCotangent};
use crate::scalar::{Dual, Lanes, Scalar, Vec3};

/// Buffers of one thread, reused from call to call.
#[derive(Clone, Debug, Default)]
pub struct Workspace {
    /// The progenitor during one epoch's flight.
    pub path: Vec<Vec3<f64>>,
    /// The particles today.
    pub arrivals: Arrivals,
    /// Derivative of the result with respect to each particle's sky position.
    pub by_x: Vec<f64>,
    /// The y part.
    pub by_y: Vec<f64>,
    by_path: Vec<Vec3<f64>>,
    nodes: Vec<Node<f64>>,
    launches: Vec<Launch<f64>>,
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
    /// All: the exact derivative of the discrete model.
    All,
    /// Those whose final position moves by at most [`REGULAR`] times their start's. A particle that meets a centre again
    /// and again in steps too long for it is chaotic: it moves a bin's mean by little, but its derivative can exceed all
    /// others together by ten orders of magnitude, and says nothing about any finite step. Without such particles the
    /// derivative is a smooth field that samplers can follow.
    Regular,
}

/// Largest stretch of a regular particle: tides stretch by tens in the age of a stream, eccentric orbits by hundreds.
pub const REGULAR: f64 = 1_000.0;

struct Backward<'a> {
    model: &'a Model,
    setup: &'a Setup<f64>,
    work: &'a mut Workspace,
    counted: Counted,
}

/// Adds `weight * v` to `slot`.
#[inline(always)]
fn add(slot: &mut Vec3<f64>, v: Vec3<f64>, weight: f64) {
    *slot = slot.add_scaled(v, weight);
}

impl Kernel for Backward<'_> {
    type Output = ByShared;

    #[inline(always)]
    fn run<const FMA: bool>(self) -> ByShared {
        let Self {
            model,
            setup,
            work,
            counted,
        } = self;
        let host = FlattenedNfw::<Lanes<LANES, FMA>>::broadcast(&setup.host);
        let sphere = Plummer::<Lanes<LANES, FMA>>::broadcast(&setup.sphere);
        let steps = model.settings.steps;
        let mut by_host = NfwCotangent::<Lanes<LANES, FMA>>::zero();
        let mut by_sphere = PlummerCotangent::<Lanes<LANES, FMA>>::zero();
        let mut by_age = 0.0;
        let mut positions = vec![Vec3::<Lanes<LANES, FMA>>::zero(); steps + 1];
        let mut by_positions = positions.clone();
        let mut epoch = usize::MAX;
        for (i, group) in model.groups.iter().enumerate() {
            if group.epoch != epoch {
                epoch = group.epoch;
                work.path.clear();
                work.path
                    .extend(model.path_of(epoch).iter().map(|p| setup.orbit.position(p)));
                work.by_path.clear();
                work.by_path.resize(steps + 1, Vec3::zero());
            }
            let lane = |column: &[f64]| {
                let mut lanes = [0.0; LANES];
                lanes[..group.len].copy_from_slice(&column[group.first..group.first + group.len]);
                Lanes::<LANES, FMA>(lanes)
            };
            let by_position = Vec3::new(lane(&work.by_x), lane(&work.by_y), Lanes::zero());
            let launch = Launch::broadcast(&setup.launches[epoch]);
            let (start, _) = launch.release(group.position.map(Lanes), group.velocity.map(Lanes));
            let step = Lanes::from_f64(model.step_gyr(epoch, setup.age_gyr));
            let path = &work.path;
            let at = |j: usize| Vec3::from_f64(path[j]);
            advance_recorded(&host, &sphere, at, step, start, &mut positions);
            let (mut host_part, mut sphere_part) = (NfwCotangent::zero(), PlummerCotangent::zero());
            let reversed = reverse(
                &host,
                &sphere,
                at,
                step,
                &positions,
                by_position,
                &mut host_part,
                &mut sphere_part,
                |j, by| by_positions[j] = by,
            );
            let stretch2 = reversed.start.x.norm2();
            let counts = match counted {
                Counted::All => Lanes::<LANES, FMA>::zero().lt(Lanes::one()),
                Counted::Regular => stretch2.lt(by_position.norm2() * (REGULAR * REGULAR)),
            };
            let kept = |l: Lanes<LANES, FMA>| Lanes::select(counts, l, Lanes::zero());
            by_host.ln_mass += kept(host_part.ln_mass);
            by_host.ln_r_s += kept(host_part.ln_r_s);
            by_host.flattening += kept(host_part.flattening);
            by_host.axis += host_part.axis.map(kept);
            by_sphere.ln_mass += kept(sphere_part.ln_mass);
            by_sphere.r_s += kept(sphere_part.r_s);
            for (slot, by) in work.by_path.iter_mut().zip(&by_positions).take(steps) {
                *slot += by.map(|l| kept(l).sum());
            }
            by_age += model.step_gyr(epoch, kept(reversed.step_gyr).sum());
            let by_launch = &mut work.launches[epoch];
            let (x, v) = (reversed.start.x.map(kept), reversed.start.v.map(kept));
            by_launch.state.x += x.map(Lanes::sum);
            by_launch.state.v += v.map(Lanes::sum);
            for c in 0..3 {
                by_launch.position[c] += (x * Lanes(group.position[c])).map(Lanes::sum);
                by_launch.velocity[c] += (v * Lanes(group.velocity[c])).map(Lanes::sum);
            }
            let last_of_epoch = model
                .groups
                .get(i + 1)
                .is_none_or(|next| next.epoch != epoch);
            if last_of_epoch {
                for (place, by) in model.path_of(epoch).iter().zip(&work.by_path) {
                    let w = place.weights;
                    let (earlier, later) = work.nodes.split_at_mut(place.node + 1);
                    let (a, b) = (&mut earlier[place.node], &mut later[0]);
                    add(&mut a.x, *by, w[0]);
                    add(&mut a.dx, *by, w[1]);
                    add(&mut a.ddx, *by, w[2]);
                    add(&mut b.x, *by, w[3]);
                    add(&mut b.dx, *by, w[4]);
                    add(&mut b.ddx, *by, w[5]);
                }
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

impl Model {
    /// The gradient with respect to the `N` variables of the duals in `setup` of a result whose derivatives with respect
    /// to the particles' sky positions stand in `work.by_x` and `work.by_y`. `real` is the real part of `setup`, and the
    /// particles are the ones that [`carry`](Self::carry) made from it.
    pub fn pull_back<const N: usize>(
        &self,
        setup: &Setup<Dual<N>>,
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
        let no_launch = Launch {
            state: State { x: zero, v: zero },
            position: [zero; 3],
            velocity: [zero; 3],
            turns: 0.0,
        };
        work.launches.clear();
        work.launches.resize(setup.launches.len(), no_launch);
        let shared = dispatch(
            Level::best(),
            Backward {
                model: self,
                setup: real,
                work,
                counted,
            },
        );
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
    fn add(&mut self, number: &Dual<N>, by: f64) {
        if let Some(eps) = &number.eps.0 {
            for (slot, e) in self.0.iter_mut().zip(eps.iter()) {
                *slot += by * e;
            }
        }
    }

    fn add_vec(&mut self, vector: &Vec3<Dual<N>>, by: Vec3<f64>) {
        self.add(&vector.x, by.x);
        self.add(&vector.y, by.y);
        self.add(&vector.z, by.z);
    }
}
