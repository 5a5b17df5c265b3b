//! Streams in a host whose kind is known only when the program runs: by settings, or one of the user's own.

use super::compiled::CompiledHost;
use super::gradient::{Adjoint, Workspace};
use super::model::Model;
use super::particles::Particles;
use super::progenitor_solution::{ProgenitorSolution, SolutionMemory};
use super::settings::ModelSettings;
use super::system::System;
use super::threads::Threads;
use crate::error::{Error, Rejection, Result as OblateResult};
use crate::params::{DIM, QRange, StreamParams};
use crate::potential::{Galaxy, HaloKind, Nfw, Potential};
use crate::scalar::{Dual, gradient_of, lift};
use std::fmt::Debug;

/// A kind of host as an object: what a likelihood asks of it. Every [`CompiledHost`] has it, so that `&Galaxy` is a
/// `&'static dyn AnyHost`.
pub trait AnyHost: Debug + Send + Sync {
    /// Writes the particles today into `work`.
    ///
    /// # Errors
    /// As of [`Model::progenitor_solution`] and [`Model::integrate`].
    fn particles(
        &self,
        model: &Model,
        input: &StreamInput<'_>,
        memory: &mut Option<SolutionMemory<f64>>,
        work: &mut Workspace,
    ) -> Result<(), Rejection>;

    /// As [`particles`](Self::particles), then calls `of_particles`, which writes the derivatives of a result with respect to the particles
    /// into `work` ([`Model::vjp`]). Returns the gradient of that result with respect to all parameters, as far as it comes from the particles.
    ///
    /// # Errors
    /// As of [`particles`](Self::particles), and those of `of_particles`.
    fn gradient(
        &self,
        model: &Model,
        input: &StreamInput<'_>,
        adjoint: Adjoint,
        work: &mut Workspace,
        of_particles: &mut dyn FnMut(&mut Workspace) -> Result<(), Rejection>,
    ) -> Result<[f64; DIM], Rejection>;

    /// Largest change of the energy along the progenitor's orbit over its largest kinetic energy; none with friction, which takes energy.
    ///
    /// # Errors
    /// As of [`Model::progenitor_solution`].
    fn orbit_energy_error(
        &self,
        model: &Model,
        input: &StreamInput<'_>,
    ) -> Result<Option<f64>, Rejection>;

    /// The potential of the host.
    fn potential(&self, model: &Model, input: &StreamInput<'_>) -> Box<dyn Potential<f64>>;

    /// As [`Host::log10_m200`](crate::potential::Host::log10_m200).
    fn log10_m200(&self, kind: HaloKind, log10_mass: f64, r_s: f64) -> f64;
}

/// A set of parameters, and the threads that may compute its stream.
#[derive(Clone, Copy, Debug)]
pub struct StreamInput<'a> {
    /// The parameters.
    pub params: &'a StreamParams<f64>,
    /// The range of q.
    pub q_range: QRange,
    /// The threads.
    pub threads: Threads,
}

impl StreamInput<'_> {
    /// # Errors
    /// [`Rejection::BadParameter`] if the progenitor is not on the side of the sky from which angles count (docs/physics.md, section 6).
    fn system<H: CompiledHost>(&self, model: &Model) -> Result<System<f64, H>, Rejection> {
        if self.params.x0_kpc < 0.0 {
            return Err(Rejection::BadParameter);
        }
        let (params, q_range) = (self.params, self.q_range);
        Ok(System::with_host(params, q_range, &model.settings))
    }
}

impl<H: CompiledHost> AnyHost for H {
    fn particles(
        &self,
        model: &Model,
        input: &StreamInput<'_>,
        memory: &mut Option<SolutionMemory<f64>>,
        work: &mut Workspace,
    ) -> Result<(), Rejection> {
        let system = input.system::<H>(model)?;
        let solution = model.progenitor_solution_reusing(&system, memory.take())?;
        let integrated = integrate(model, &solution, input.threads, work);
        *memory = Some(solution.into_memory());
        integrated
    }

    fn gradient(
        &self,
        model: &Model,
        input: &StreamInput<'_>,
        adjoint: Adjoint,
        work: &mut Workspace,
        of_particles: &mut dyn FnMut(&mut Workspace) -> Result<(), Rejection>,
    ) -> Result<[f64; DIM], Rejection> {
        let system = input.system::<H>(model)?;
        let solution = model.progenitor_solution(&system)?;
        integrate(model, &solution, input.threads, work)?;
        of_particles(work)?;
        let system_bar = model.vjp(&system, &solution, adjoint, input.threads, work);
        let lifted = StreamParams::from_array(lift(&input.params.to_array()));
        let vector =
            System::<Dual<DIM>, H>::with_host(&lifted, input.q_range, &model.settings).to_vector();
        let mut gradient = [0.0; DIM];
        for (number, number_bar) in vector.iter().zip(system_bar) {
            for (component, derivative) in gradient.iter_mut().zip(gradient_of(number)) {
                *component += number_bar * derivative;
            }
        }
        Ok(gradient)
    }

    fn orbit_energy_error(
        &self,
        model: &Model,
        input: &StreamInput<'_>,
    ) -> Result<Option<f64>, Rejection> {
        let system = input.system::<H>(model)?;
        let solution = model.progenitor_solution(&system)?;
        let error = solution.orbit.energy_error(&solution.host);
        Ok((!model.settings.dynamical_friction).then_some(error))
    }

    fn potential(&self, model: &Model, input: &StreamInput<'_>) -> Box<dyn Potential<f64>> {
        Box::new(System::<f64, H>::with_host(input.params, input.q_range, &model.settings).host)
    }

    fn log10_m200(&self, kind: HaloKind, log10_mass: f64, r_s: f64) -> f64 {
        H::log10_m200(kind, log10_mass, r_s)
    }
}

/// Integrates the particles into `work`, on one thread or on all.
fn integrate<H: CompiledHost>(
    model: &Model,
    solution: &ProgenitorSolution<f64, H>,
    threads: Threads,
    work: &mut Workspace,
) -> Result<(), Rejection> {
    let Workspace {
        schedules,
        particles,
        ..
    } = work;
    match threads {
        Threads::One => model.integrate(solution, schedules, particles),
        Threads::All => model.integrate_in_parallel(solution, particles),
    }
}

/// The kind of host that settings name.
#[must_use]
pub fn host_of(settings: &ModelSettings) -> &'static dyn AnyHost {
    if settings.has_host_of(&ModelSettings::default()) {
        &Nfw
    } else {
        &Galaxy
    }
}

impl Model {
    /// Writes the particles today, in the kind of host of the settings, into `work`.
    ///
    /// # Errors
    /// As of [`AnyHost::particles`].
    pub fn particles(
        &self,
        input: &StreamInput<'_>,
        work: &mut Workspace,
    ) -> Result<(), Rejection> {
        host_of(&self.settings).particles(self, input, &mut None, work)
    }

    /// The particles of a stream today, in the kind of host of the settings, with the default range of q and on the threads of the present
    /// rayon pool.
    ///
    /// # Errors
    /// [`Error::NoTrack`] with the cause if there is no stream.
    pub fn stream(&self, params: &StreamParams<f64>) -> OblateResult<Particles> {
        let input = StreamInput {
            params,
            q_range: QRange::default(),
            threads: Threads::All,
        };
        let mut work = Workspace::default();
        self.particles(&input, &mut work).map_err(Error::NoTrack)?;
        Ok(work.particles)
    }
}
