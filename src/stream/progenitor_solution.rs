//! The progenitor solution: the progenitor's orbit, and the release frame at every release time.

use super::friction::{Friction, WithFriction};
use super::mass_loss::MassOverTime;
use super::release_rate::{ReleaseLaw, ReleaseRate, normalise};
use super::settings::{ModelSettings, StepRule};
use super::system::System;
use crate::error::{Rejection, Tally};
use crate::orbit::{Conservative, DenseOrbit, OrbitForce, Resolution, State, crossing};
use crate::potential::{Baryons, Host, HostParts, MassFraction, Nfw, Plummer, Potential};
use crate::scalar::{Real, Scalar, Vec3};
use crate::spray::{ReleaseTable, Tidal};

/// The progenitor at one release time, and the scaled unit vectors in which release offsets are given (docs/physics.md, section 4).
#[derive(Clone, Copy, Debug)]
pub struct ReleaseFrame<S> {
    /// The progenitor's state, kpc and kpc/Gyr.
    pub state: State<S>,
    /// Unit vectors of [`Tidal::frame`] times the recipe's length scale, kpc.
    pub position: [Vec3<S>; 3],
    /// Unit vectors of [`Tidal::frame`] times the recipe's velocity scale, kpc/Gyr.
    pub velocity: [Vec3<S>; 3],
    /// The progenitor's winding number.
    pub winding_number: S,
}

impl<S: Scalar> ReleaseFrame<S> {
    /// The state and the winding number of a particle with the given release offset.
    #[inline(always)]
    pub fn release(&self, position: [S; 3], velocity: [S; 3]) -> (State<S>, S) {
        let x = offset(self.state.x, &self.position, position);
        let v = offset(self.state.v, &self.velocity, velocity);
        (
            State { x, v },
            self.winding_number + crossing(self.state.x, x),
        )
    }
}

/// A vector plus another that is given by its components in a frame.
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

/// How stars leave the progenitor of a system in hosts of this kind: at an even rate in one that is no galaxy.
pub(super) fn release_law<S: Scalar, H: Host>(
    system: &System<S, H>,
    settings: &ModelSettings,
) -> ReleaseLaw<S> {
    ReleaseLaw {
        rate: if H::IS_GALAXY {
            settings.release_rate
        } else {
            ReleaseRate::Even
        },
        peaking: system.release_peaking,
        mass_loss: settings.mass_over_time::<_, H>(system.mass_loss),
    }
}

/// The friction of the progenitor of a system, in a galaxy and if the settings have it.
pub(super) fn friction<S: Scalar, H: Host>(
    system: &System<S, H>,
    settings: &ModelSettings,
) -> Option<Friction<S>> {
    let HostParts { halo, kind, .. } = H::parts(&system.host);
    (H::IS_GALAXY && settings.dynamical_friction).then_some(Friction {
        kind,
        halo,
        mass: system.progenitor.mass,
        mass_loss: settings.mass_over_time::<_, H>(system.mass_loss),
        coulomb_logarithm: system.coulomb_logarithm,
    })
}

/// One release time of a progenitor.
pub(super) struct ReleaseAt<S> {
    pub frame: ReleaseFrame<S>,
    /// Its weight without the factor that is common to all.
    pub weight: S,
    /// Whether the tidal radius had to be bounded.
    pub bounded: bool,
}

/// Release time number `k` of a table, of a progenitor that has the mass `mass` at the first release.
#[inline(always)]
pub(super) fn release_at<S: Real>(
    host: &impl Potential<S>,
    mass: S,
    orbit: &DenseOrbit<S>,
    law: &ReleaseLaw<S>,
    table: &ReleaseTable,
    k: usize,
) -> ReleaseAt<S> {
    let tau = table.taus[k];
    let mass = mass * law.mass_loss.fraction_at_release(k, table.taus.len(), tau);
    let (state, winding_number) = orbit.at(tau);
    let tidal = Tidal::new(host, mass, state);
    let (length, speed) = table.recipe.scales(&tidal, mass);
    ReleaseAt {
        frame: ReleaseFrame {
            state,
            position: scaled(&tidal.frame, length),
            velocity: scaled(&tidal.frame, speed),
            winding_number,
        },
        weight: law.weight(k, table.taus.len(), tidal.frequency2),
        bounded: tidal.bounded,
    }
}

/// The release frames of a progenitor, and the weights of its release times.
#[derive(Clone, Debug)]
pub struct Releases<S> {
    /// One release frame per release time.
    pub frames: Vec<ReleaseFrame<S>>,
    /// The weights of the release times, which are 1 in the mean; none if all are 1.
    pub weights: Vec<S>,
    /// The mean of the squares of the weights.
    pub mean_square_weight: S,
    /// The number of release times at which the tidal radius had to be bounded.
    pub bounded: u64,
}

impl<S: Scalar> Default for Releases<S> {
    /// Without release times.
    fn default() -> Self {
        Self {
            frames: Vec::new(),
            weights: Vec::new(),
            mean_square_weight: S::one(),
            bounded: 0,
        }
    }
}

impl<S: Scalar> Releases<S> {
    /// The weights of the particles, in the order of the table, which has `per_release_time` of each release time; none if all are 1.
    pub fn weights_of_particles(&self, per_release_time: usize) -> impl Iterator<Item = S> {
        let of_release_time = move |weight: &S| std::iter::repeat_n(*weight, per_release_time);
        self.weights.iter().flat_map(of_release_time)
    }
}

impl<S: Real> Releases<S> {
    /// Computes those of a table in these buffers.
    #[inline(always)]
    pub(super) fn compute(
        &mut self,
        host: &impl Potential<S>,
        progenitor_mass: S,
        orbit: &DenseOrbit<S>,
        law: &ReleaseLaw<S>,
        table: &ReleaseTable,
    ) {
        self.frames.clear();
        self.weights.clear();
        self.bounded = 0;
        for k in 0..table.taus.len() {
            let release = release_at(host, progenitor_mass, orbit, law, table, k);
            self.bounded += u64::from(release.bounded);
            self.frames.push(release.frame);
            if !law.is_even() {
                self.weights.push(release.weight);
            }
        }
        self.mean_square_weight = normalise(&mut self.weights);
    }
}

/// Largest phase of an interval of the orbit over that of a particle's step: the error of the orbit must be smaller, because it is common to
/// all particles.
const ORBIT_PHASE: f64 = 0.75;

/// With adaptive steps an orbit has `orbit_steps` over this number of blocks.
const STEPS_PER_BLOCK: usize = 4;

/// Integrates the progenitor's orbit in the buffers `orbit`; with adaptive steps, in as many intervals as it needs (docs/physics.md,
/// section 3).
///
/// # Errors
/// [`Rejection::BadOrbit`] if it is not finite; [`Rejection::UnresolvedOrbit`] if it needs more intervals than the settings allow.
fn resolved_orbit<S: Real>(
    force: &impl OrbitForce<S>,
    today: State<S>,
    age_gyr: S,
    settings: &ModelSettings,
    orbit: &mut DenseOrbit<S>,
) -> Result<(), Rejection> {
    let resolution = match settings.step_rule {
        StepRule::Uniform => Resolution::uniform(settings.orbit_steps),
        StepRule::Adaptive => Resolution {
            blocks: settings.orbit_steps.div_ceil(STEPS_PER_BLOCK),
            intervals: 1,
            max_phase: ORBIT_PHASE * settings.step_phase,
            // The phase of the age if every one of the particles' shortest steps has the largest phase.
            max_age_phase: settings.step_phase * (settings.steps << settings.max_halvings) as f64,
        },
    };
    if !orbit.integrate_resolved(force, today, age_gyr, resolution, settings.orbit) {
        return Err(Rejection::UnresolvedOrbit);
    }
    if orbit.is_finite() {
        Ok(())
    } else {
        Err(Rejection::BadOrbit)
    }
}

/// What all particles of one parameter set share: potentials, age, orbit and release frames.
#[derive(Clone, Debug)]
pub struct ProgenitorSolution<S: Scalar, H: Host = Nfw> {
    /// The host.
    pub host: H::In<S>,
    /// The progenitor's own gravity at the first release.
    pub progenitor: Plummer<S>,
    /// How it loses mass.
    pub mass_loss: MassOverTime<S>,
    /// Age in Gyr.
    pub age_gyr: S,
    /// The progenitor's orbit.
    pub orbit: DenseOrbit<S>,
    /// Release frames and weights.
    pub releases: Releases<S>,
    /// The approximations made.
    pub tally: Tally,
}

/// The buffers of a [`ProgenitorSolution`], to be used for another one.
#[derive(Clone, Debug)]
pub struct SolutionMemory<S> {
    orbit: DenseOrbit<S>,
    releases: Releases<S>,
}

impl<S: Scalar> Default for SolutionMemory<S> {
    /// Without memory.
    fn default() -> Self {
        Self {
            orbit: DenseOrbit::default(),
            releases: Releases::default(),
        }
    }
}

impl<S: Scalar, H: Host> ProgenitorSolution<S, H> {
    /// The buffers of this solution.
    #[must_use]
    pub fn into_memory(self) -> SolutionMemory<S> {
        SolutionMemory {
            orbit: self.orbit,
            releases: self.releases,
        }
    }
}

impl<S: Real, H: Host> ProgenitorSolution<S, H> {
    /// The fraction of its mass that the progenitor has at the time `tau`.
    #[inline(always)]
    pub(super) fn mass_fraction(&self, tau: f64) -> MassFraction<S> {
        self.mass_loss.fraction(tau)
    }

    /// Integrates the orbit and computes the release frames, in the buffers of another solution if there is one.
    ///
    /// # Errors
    /// As [`Model::progenitor_solution`](super::Model::progenitor_solution).
    pub(super) fn new(
        system: &System<S, H>,
        settings: &ModelSettings,
        table: &ReleaseTable,
        memory: Option<SolutionMemory<S>>,
    ) -> Result<Self, Rejection> {
        let System {
            host,
            progenitor,
            mass_loss,
            release_peaking,
            coulomb_logarithm,
            today,
            age_gyr,
        } = *system;
        let HostParts { halo, baryons, .. } = H::parts(&host);
        let Baryons { disc, bulge } = baryons;
        let positive = [
            halo.mass,
            halo.r_s,
            disc.r_s,
            bulge.r_s,
            progenitor.mass,
            progenitor.r_s,
            mass_loss,
            age_gyr,
        ];
        let finite = today.x.norm2()
            + today.v.norm2()
            + halo.flattening
            + halo.axis.norm2()
            + halo.second.flattening
            + halo.second.axis.norm2()
            + disc.normal.norm2()
            + disc.mass
            + bulge.mass
            + release_peaking
            + coulomb_logarithm;
        if !finite.re().is_finite()
            || mass_loss.re() > 1.0
            || positive
                .iter()
                .any(|p| !(p.re() > 0.0 && p.re().is_finite()))
        {
            return Err(Rejection::BadParameter);
        }
        let SolutionMemory {
            mut orbit,
            mut releases,
        } = memory.unwrap_or_default();
        if let Some(friction) = friction(system, settings) {
            let force = WithFriction {
                host: &host,
                friction,
            };
            resolved_orbit(&force, today, age_gyr, settings, &mut orbit)?;
        } else {
            resolved_orbit(&Conservative(&host), today, age_gyr, settings, &mut orbit)?;
        }
        let law = release_law(system, settings);
        releases.compute(&host, progenitor.mass, &orbit, &law, table);
        let tally = Tally {
            bounded_tidal_radius: releases.bounded,
            ..Tally::default()
        };
        Ok(Self {
            host,
            progenitor,
            mass_loss: law.mass_loss,
            age_gyr,
            orbit,
            releases,
            tally,
        })
    }
}
