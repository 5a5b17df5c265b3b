//! The cold stage of a stream: the progenitor's orbit, and the tidal frame at every release.

use super::{ModelSettings, StepRule};
use crate::error::{Rejection, Tally};
use crate::orbit::{AdaptiveGrid, DenseOrbit, State, crossing};
use crate::params::{QRange, StreamParams};
use crate::potential::{FlattenedNfw, Plummer};
use crate::scalar::{Real, Scalar, Vec3};
use crate::spray::{Recipe, ReleaseTable, Tidal};
use crate::units::KM_S_IN_KPC_PER_GYR;
use std::f64::consts::{LN_10, TAU};

/// What makes a stream: a host, a progenitor, and where it is today.
#[derive(Clone, Copy, Debug)]
pub struct System<S> {
    /// The halo.
    pub host: FlattenedNfw<S>,
    /// The progenitor's own gravity.
    pub progenitor: Plummer<S>,
    /// The progenitor today, kpc and kpc/Gyr.
    pub today: State<S>,
    /// Time since the first release.
    pub age_gyr: S,
}

impl<S: Real> System<S> {
    /// The galaxy of 13 parameters (physics.md 1): masses from their logarithms, the halo's shape from its vector, the
    /// progenitor today at y = 0.
    pub fn from_params(params: &StreamParams<S>, q_range: QRange) -> Self {
        let mass = |log10: S| (log10 * LN_10).exp();
        let shape = q_range.shape(params.dir());
        Self {
            host: FlattenedNfw::new(
                mass(params.log10_m_halo),
                params.r_s_halo_kpc,
                shape.q,
                shape.axis,
            ),
            progenitor: Plummer {
                mass: mass(params.log10_m_prog),
                r_s: params.r_s_prog_kpc,
            },
            today: State {
                x: params.position_kpc(),
                v: params.velocity_km_s() * S::from_f64(KM_S_IN_KPC_PER_GYR),
            },
            age_gyr: params.age_gyr,
        }
    }
}

impl<S: Real> System<S> {
    /// How many numbers a galaxy is.
    pub const LEN: usize = 15;

    /// The numbers: mass, scale radius, flattening 1/q^2 - 1 and axis of the halo, mass and scale radius of the
    /// progenitor, its position and velocity today, the age.
    #[inline(always)]
    pub fn numbers(&self) -> [S; 15] {
        let Self {
            host,
            progenitor,
            today: State { x, v },
            age_gyr,
        } = *self;
        let n = host.axis;
        [
            host.mass,
            host.r_s,
            host.flattening,
            n.x,
            n.y,
            n.z,
            progenitor.mass,
            progenitor.r_s,
            x.x,
            x.y,
            x.z,
            v.x,
            v.y,
            v.z,
            age_gyr,
        ]
    }

    /// The galaxy of its [numbers](Self::numbers).
    #[inline(always)]
    pub fn from_vector(numbers: [S; 15]) -> Self {
        let [
            mass,
            r_s,
            flattening,
            n_x,
            n_y,
            n_z,
            m,
            a,
            x,
            y,
            z,
            v_x,
            v_y,
            v_z,
            age_gyr,
        ] = numbers;
        let axis = Vec3::new(n_x, n_y, n_z);
        Self {
            host: FlattenedNfw::from_flattening(mass, r_s, flattening, axis),
            progenitor: Plummer { mass: m, r_s: a },
            today: State {
                x: Vec3::new(x, y, z),
                v: Vec3::new(v_x, v_y, v_z),
            },
            age_gyr,
        }
    }
}

/// One epoch's release: the progenitor, and the scaled tidal frame that kicks are counted in.
#[derive(Clone, Copy, Debug)]
pub struct ReleaseFrame<S> {
    /// The progenitor's state.
    pub state: State<S>,
    /// Tidal frame times the recipe's length scale, kpc.
    pub position: [Vec3<S>; 3],
    /// Tidal frame times the recipe's velocity scale, kpc/Gyr.
    pub velocity: [Vec3<S>; 3],
    /// The progenitor's winding count.
    pub turns: S,
}

impl<S: Scalar> ReleaseFrame<S> {
    /// The state and the winding count of a particle that leaves with the given kick.
    #[inline(always)]
    pub fn release(&self, position: [S; 3], velocity: [S; 3]) -> (State<S>, S) {
        let x = offset(self.state.x, &self.position, position);
        let v = offset(self.state.v, &self.velocity, velocity);
        (State { x, v }, self.turns + crossing(self.state.x, x))
    }
}

/// A vector plus another one given by its components in a frame.
#[inline(always)]
fn offset<S: Scalar>(from: Vec3<S>, frame: &[Vec3<S>; 3], components: [S; 3]) -> Vec3<S> {
    from.add_scaled(frame[0], components[0])
        .add_scaled(frame[1], components[1])
        .add_scaled(frame[2], components[2])
}

/// Three vectors times a factor.
#[inline(always)]
fn scaled<S: Scalar>(frame: &[Vec3<S>; 3], factor: S) -> [Vec3<S>; 3] {
    [frame[0] * factor, frame[1] * factor, frame[2] * factor]
}

/// The release at the time `tau`, and whether its tidal radius had to be bounded.
#[inline(always)]
pub(super) fn release_frame<S: Real>(
    host: &FlattenedNfw<S>,
    progenitor: &Plummer<S>,
    orbit: &DenseOrbit<S>,
    tau: f64,
    recipe: Recipe,
) -> (ReleaseFrame<S>, bool) {
    let (state, turns) = orbit.at(tau);
    let tidal = Tidal::new(host, progenitor.mass, state);
    let (length, speed) = recipe.scales(&tidal, progenitor.mass);
    let release_frame = ReleaseFrame {
        state,
        position: scaled(&tidal.frame, length),
        velocity: scaled(&tidal.frame, speed),
        turns,
    };
    (release_frame, tidal.bounded)
}

/// Everything that the particles of one parameter set share.
#[derive(Clone, Debug)]
pub struct ProgenitorSolution<S> {
    /// The halo.
    pub host: FlattenedNfw<S>,
    /// The progenitor's own gravity.
    pub progenitor: Plummer<S>,
    /// Age in Gyr.
    pub age_gyr: S,
    /// The progenitor's orbit.
    pub orbit: DenseOrbit<S>,
    /// The phase that steps are even in, if they are not even in time.
    pub grid: Option<AdaptiveGrid<S>>,
    /// One launch per epoch.
    pub release_frames: Vec<ReleaseFrame<S>>,
    /// What had to be bounded.
    pub tally: Tally,
}

impl<S: Real> ProgenitorSolution<S> {
    /// Integrates the orbit and prepares the launches, in the memory of another setup if there is one.
    pub(super) fn new(
        system: &System<S>,
        settings: &ModelSettings,
        table: &ReleaseTable,
        spare: Option<Self>,
    ) -> Result<Self, Rejection> {
        let System {
            host,
            progenitor,
            today,
            age_gyr,
        } = *system;
        let positive = [
            host.mass,
            host.r_s,
            progenitor.mass,
            progenitor.r_s,
            age_gyr,
        ];
        let finite = today.x.norm2() + today.v.norm2() + host.flattening + host.axis.norm2();
        if !finite.re().is_finite()
            || positive
                .iter()
                .any(|p| !(p.re() > 0.0 && p.re().is_finite()))
        {
            return Err(Rejection::BadParameter);
        }
        let (spare_orbit, spare_clock, mut release_frames) = spare
            .map_or((None, None, Vec::new()), |s| {
                (Some(s.orbit), s.grid, s.release_frames)
            });
        let orbit = DenseOrbit::integrate_reusing(
            &host,
            today,
            age_gyr,
            settings.orbit_steps,
            settings.orbit,
            spare_orbit,
        );
        if !orbit.is_finite() {
            return Err(Rejection::BadOrbit);
        }
        let grid = match settings.step_rule {
            StepRule::Uniform => None,
            StepRule::Dynamical => Some(AdaptiveGrid::of(&orbit, spare_clock)),
        };
        if settings.min_steps_per_orbit > 0 {
            let turn = grid.as_ref().map_or_else(
                || orbit.max_orbital_phase(),
                AdaptiveGrid::max_orbital_phase,
            );
            if turn * settings.min_steps_per_orbit as f64 > TAU * settings.steps as f64 {
                return Err(Rejection::UnresolvedOrbit);
            }
        }
        let mut tally = Tally::default();
        release_frames.clear();
        for tau in &table.taus {
            let (release_frame, bounded) =
                release_frame(&host, &progenitor, &orbit, *tau, table.recipe);
            tally.bounded_tidal_radius += u64::from(bounded);
            release_frames.push(release_frame);
        }
        Ok(Self {
            grid,
            host,
            progenitor,
            age_gyr,
            orbit,
            release_frames,
            tally,
        })
    }
}
