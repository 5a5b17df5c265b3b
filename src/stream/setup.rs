//! The cold stage of a stream: the progenitor's orbit, and the tidal frame at every release.

use super::{ModelSettings, StepRule};
use crate::error::{Rejection, Tally};
use crate::orbit::{Clock, DenseOrbit, Kernel, State, crossing};
use crate::params::{QRange, StreamParams};
use crate::potential::{FlattenedNfw, Plummer};
use crate::scalar::{LaneDual, Real, Scalar, Vec3};
use crate::spray::{ReleaseTable, Tidal};
use crate::units::KPC_PER_GYR_IN_KM_S;
use std::f64::consts::LN_10;

/// What makes a stream: a host, a progenitor, and where it is today.
#[derive(Clone, Copy, Debug)]
pub struct Galaxy<S> {
    /// The halo.
    pub host: FlattenedNfw<S>,
    /// The progenitor's own gravity.
    pub sphere: Plummer<S>,
    /// The progenitor today, kpc and kpc/Gyr.
    pub today: State<S>,
    /// Time since the first release.
    pub age_gyr: S,
}

impl<S: Real> Galaxy<S> {
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
            sphere: Plummer {
                mass: mass(params.log10_m_prog),
                r_s: params.r_s_prog_kpc,
            },
            today: State {
                x: params.position_kpc(),
                v: params.velocity_km_s() * S::from_f64(KPC_PER_GYR_IN_KM_S),
            },
            age_gyr: params.age_gyr,
        }
    }
}

/// One epoch's release: the progenitor, and the scaled tidal frame that kicks are counted in.
#[derive(Clone, Copy, Debug)]
pub struct Launch<S> {
    /// The progenitor's state.
    pub state: State<S>,
    /// Tidal frame times the recipe's length scale, kpc.
    pub position: [Vec3<S>; 3],
    /// Tidal frame times the recipe's velocity scale, kpc/Gyr.
    pub velocity: [Vec3<S>; 3],
    /// The progenitor's winding count.
    pub turns: S,
}

impl<S: Scalar> Launch<S> {
    /// The state and the winding count of a particle that leaves with the given kick.
    #[inline(always)]
    pub fn release(&self, position: [S; 3], velocity: [S; 3]) -> (State<S>, S) {
        let offset = |frame: &[Vec3<S>; 3], c: [S; 3], from: Vec3<S>| {
            from.add_scaled(frame[0], c[0])
                .add_scaled(frame[1], c[1])
                .add_scaled(frame[2], c[2])
        };
        let x = offset(&self.position, position, self.state.x);
        let v = offset(&self.velocity, velocity, self.state.v);
        (State { x, v }, self.turns + crossing(self.state.x, x))
    }

    /// The same constants in another number type.
    #[inline(always)]
    #[must_use]
    pub fn broadcast(launch: &Launch<f64>) -> Self {
        Self {
            state: State::from_f64(launch.state),
            position: launch.position.map(Vec3::from_f64),
            velocity: launch.velocity.map(Vec3::from_f64),
            turns: S::from_f64(launch.turns),
        }
    }
}

/// Everything that the particles of one parameter set share.
#[derive(Clone, Debug)]
pub struct Setup<S> {
    /// The halo.
    pub host: FlattenedNfw<S>,
    /// The progenitor's own gravity.
    pub sphere: Plummer<S>,
    /// Age in Gyr.
    pub age_gyr: S,
    /// The progenitor's orbit.
    pub orbit: DenseOrbit<S>,
    /// The phase that steps are even in, if they are not even in time.
    pub clock: Option<Clock<S>>,
    /// One launch per epoch.
    pub launches: Vec<Launch<S>>,
    /// What had to be bounded.
    pub tally: Tally,
}

impl<S: Real> Setup<S> {
    /// Integrates the orbit and prepares the launches.
    #[inline(always)]
    pub(super) fn new(
        galaxy: &Galaxy<S>,
        settings: &ModelSettings,
        table: &ReleaseTable,
    ) -> Result<Self, Rejection> {
        let Galaxy {
            host,
            sphere,
            today,
            age_gyr,
        } = *galaxy;
        let positive = [host.mass, host.r_s, sphere.mass, sphere.r_s, age_gyr];
        let finite = today.x.norm2() + today.v.norm2() + host.flattening + host.axis.norm2();
        if !finite.re().is_finite()
            || positive
                .iter()
                .any(|p| !(p.re() > 0.0 && p.re().is_finite()))
        {
            return Err(Rejection::BadParameter);
        }
        let orbit =
            DenseOrbit::integrate(&host, today, age_gyr, settings.orbit_steps, settings.orbit);
        if !orbit.is_finite() {
            return Err(Rejection::BadOrbit);
        }
        let mut tally = Tally::default();
        // A loop and not a closure, so that it is inlined into code compiled for any instruction set.
        let mut launches = Vec::with_capacity(table.taus.len());
        for tau in &table.taus {
            let (state, turns) = orbit.at(*tau);
            let tidal = Tidal::new(&host, sphere.mass, state);
            tally.bounded_tidal_radius += u64::from(tidal.bounded);
            let (length, speed) = table.recipe.scales(&tidal, sphere.mass);
            launches.push(Launch {
                state,
                position: tidal.frame.map(|e| e * length),
                velocity: tidal.frame.map(|e| e * speed),
                turns,
            });
        }
        let clock = match settings.step_rule {
            StepRule::Uniform => None,
            StepRule::Dynamical => Some(Clock::of(&orbit)),
        };
        Ok(Self {
            clock,
            host,
            sphere,
            age_gyr,
            orbit,
            launches,
            tally,
        })
    }
}

impl<S: Real> Setup<S> {
    /// The real parts: what the lanes run on.
    #[must_use]
    pub fn real_part(&self) -> Setup<f64> {
        let v = |a: Vec3<S>| a.map(Real::re);
        Setup {
            host: FlattenedNfw::from_flattening(
                self.host.mass.re(),
                self.host.r_s.re(),
                self.host.flattening.re(),
                v(self.host.axis),
            ),
            sphere: Plummer {
                mass: self.sphere.mass.re(),
                r_s: self.sphere.r_s.re(),
            },
            age_gyr: self.age_gyr.re(),
            orbit: self.orbit.real_part(),
            clock: self.clock.as_ref().map(Clock::real_part),
            launches: self
                .launches
                .iter()
                .map(|l| Launch {
                    state: State {
                        x: v(l.state.x),
                        v: v(l.state.v),
                    },
                    position: l.position.map(v),
                    velocity: l.velocity.map(v),
                    turns: l.turns.re(),
                })
                .collect(),
            tally: self.tally,
        }
    }
}

/// The cold stage as a kernel.
pub(super) struct Cold<'a, const N: usize> {
    pub galaxy: &'a Galaxy<LaneDual<N>>,
    pub settings: &'a ModelSettings,
    pub table: &'a ReleaseTable,
}

impl<const N: usize> Kernel for Cold<'_, N> {
    type Output = Result<Setup<LaneDual<N>>, Rejection>;

    #[inline(always)]
    fn run<const FMA: bool>(self) -> Self::Output {
        Setup::new(self.galaxy, self.settings, self.table)
    }
}
