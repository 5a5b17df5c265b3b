//! The likelihood as a function of the parameters: its value in SIMD lanes, its gradient by reverse mode in lanes and by dual
//! numbers, and its value on any number type as a reference.

use super::observation::Observation;
use super::track::TrackLikelihood;
use crate::error::{Rejection, Tally};
use crate::params::{DIM, QRange, StreamParams};
use crate::potential::Potential;
use crate::scalar::Real;
use crate::stream::{
    Adjoint, AnyHost, CompiledHost, Model, Particles, SolutionMemory, StepSchedules, StreamInput,
    System, Threads, Workspace, host_of,
};
use crate::track::{BinGrid, BinQuantity, PartialSums, Sums, Track, TrackBin};
use rayon::prelude::*;
use std::cell::RefCell;

/// ln L of a parameter set, and the number of approximations made for it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Evaluation {
    /// ln L.
    pub ln_likelihood: f64,
    /// The number of approximations.
    pub tally: Tally,
}

/// Buffers of one thread.
#[derive(Clone, Debug, Default)]
pub struct Buffers {
    memory: Option<SolutionMemory<f64>>,
    work: Workspace,
    sums: Sums<f64>,
    partial_sums: PartialSums,
    sums_bar: Sums<f64>,
}

thread_local! {
    // Buffers of each thread: no allocation after its first call, and no argument for them.
    static BUFFERS: RefCell<Buffers> = RefCell::default();
}

/// Runs `work` with this thread's buffers. A call within a call gets new ones: while a thread waits in rayon it may begin another value.
fn with_buffers<T>(work: impl FnOnce(&mut Buffers) -> T) -> T {
    let mut buffers = BUFFERS.take();
    let result = work(&mut buffers);
    BUFFERS.set(buffers);
    result
}

/// The likelihood of one track as a function of the parameters.
#[derive(Clone, Debug)]
pub struct StreamLikelihood {
    model: Model,
    host: &'static dyn AnyHost,
    track: TrackLikelihood,
    q_range: QRange,
}

impl StreamLikelihood {
    /// From the model of the stream, with the kind of host of its settings, the likelihood of the track and the range of q.
    #[must_use]
    pub fn new(model: Model, track: TrackLikelihood, q_range: QRange) -> Self {
        let host = host_of(model.settings());
        Self::with_host(model, host, track, q_range)
    }

    /// As [`new`](Self::new), in a host that settings cannot name: a halo of your own.
    #[must_use]
    pub fn with_host(
        model: Model,
        host: &'static dyn AnyHost,
        track: TrackLikelihood,
        q_range: QRange,
    ) -> Self {
        Self {
            model,
            host,
            track,
            q_range,
        }
    }

    /// The same likelihood with another model of the stream.
    #[must_use]
    pub fn with_model(&self, model: Model) -> Self {
        let track = self.track.clone();
        Self {
            track: track.with_releases(&model.settings().releases),
            model,
            ..*self
        }
    }

    /// The model of the stream.
    #[must_use]
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// The likelihood of the track.
    #[must_use]
    pub fn track(&self) -> &TrackLikelihood {
        &self.track
    }

    /// The kind of host.
    #[must_use]
    pub fn host(&self) -> &'static dyn AnyHost {
        self.host
    }

    /// The potential of the host.
    #[must_use]
    pub fn potential(&self, params: &StreamParams<f64>) -> Box<dyn Potential<f64>> {
        let input = self.input(params, Threads::One);
        self.host.potential(&self.model, &input)
    }

    /// The range of q.
    #[must_use]
    pub fn q_range(&self) -> QRange {
        self.q_range
    }

    fn input<'a>(&self, params: &'a StreamParams<f64>, threads: Threads) -> StreamInput<'a> {
        StreamInput {
            params,
            q_range: self.q_range,
            threads,
        }
    }

    /// ln L, in lanes, on the caller's thread. `theta` are all parameters in the order and units of
    /// [`PARAMETERS`](crate::params::PARAMETERS); [`without_optional`](crate::params::without_optional) gives them from the thirteen that
    /// every stream has.
    ///
    /// # Errors
    /// [`Rejection::BadParameter`], [`Rejection::BadOrbit`], [`Rejection::UnresolvedOrbit`] or [`Rejection::BadParticle`] where there
    /// is no stream; [`Rejection::Uncovered`] under `coverage = "reject"`; [`Rejection::BadLikelihood`] if ln L is not finite.
    pub fn ln_likelihood(&self, theta: &[f64; DIM]) -> Result<Evaluation, Rejection> {
        with_buffers(|b| self.value(theta, Threads::One, b))
    }

    /// ln L, with the bins' [residuals](TrackLikelihood::residuals) appended to `residuals`.
    ///
    /// # Errors
    /// As [`ln_likelihood`](Self::ln_likelihood).
    pub fn ln_likelihood_and_residuals(
        &self,
        theta: &[f64; DIM],
        residuals: &mut Vec<f64>,
    ) -> Result<Evaluation, Rejection> {
        with_buffers(|b| {
            let evaluation = self.value(theta, Threads::One, b)?;
            let observation = Observation::from(&StreamParams::from_array(*theta));
            self.track.residuals(&b.sums, &observation, residuals)?;
            Ok(evaluation)
        })
    }

    /// The [squares](TrackLikelihood::squares) of the residuals of all data.
    ///
    /// # Errors
    /// As [`ln_likelihood`](Self::ln_likelihood).
    pub fn squares(&self, theta: &[f64; DIM]) -> Result<Vec<f64>, Rejection> {
        with_buffers(|b| {
            self.value(theta, Threads::One, b)?;
            let observation = Observation::from(&StreamParams::from_array(*theta));
            let mut squares = Vec::new();
            self.track.squares(&b.sums, &observation, &mut squares)?;
            Ok(squares)
        })
    }

    /// As [`ln_likelihood`](Self::ln_likelihood), on all threads of the present rayon pool. The result has the same bits.
    ///
    /// # Errors
    /// As [`ln_likelihood`](Self::ln_likelihood).
    pub fn ln_likelihood_in_parallel(&self, theta: &[f64; DIM]) -> Result<Evaluation, Rejection> {
        with_buffers(|b| self.value(theta, Threads::All, b))
    }

    /// ln L of many parameter sets, on all threads of the present rayon pool; each has the same bits as from
    /// [`ln_likelihood`](Self::ln_likelihood).
    #[must_use]
    pub fn ln_likelihoods(&self, points: &[[f64; DIM]]) -> Vec<Result<Evaluation, Rejection>> {
        points
            .par_iter()
            .map(|theta| self.ln_likelihood(theta))
            .collect()
    }

    /// ln L and its gradient with respect to all parameters, per unit of each and in their order: the exact derivative of
    /// the discrete model (docs/physics.md, section 8). On the caller's thread.
    ///
    /// # Errors
    /// As [`ln_likelihood`](Self::ln_likelihood), and [`Rejection::BadLikelihood`] if the gradient is not finite.
    pub fn gradient(&self, theta: &[f64; DIM]) -> Result<(Evaluation, [f64; DIM]), Rejection> {
        with_buffers(|b| self.gradient_of(theta, Adjoint::Exact, Threads::One, b))
    }

    /// As [`gradient`](Self::gradient), on all threads of the present rayon pool. The result has the same bits.
    ///
    /// # Errors
    /// As [`gradient`](Self::gradient).
    pub fn gradient_in_parallel(
        &self,
        theta: &[f64; DIM],
    ) -> Result<(Evaluation, [f64; DIM]), Rejection> {
        with_buffers(|b| self.gradient_of(theta, Adjoint::Exact, Threads::All, b))
    }

    /// As [`gradient`](Self::gradient), without the derivatives of chaotic particles ([`Adjoint::Truncated`]). Where there are such
    /// particles it is not the derivative of ln L; a sampler whose acceptance probability uses ln L itself is exact with any vector field.
    ///
    /// # Errors
    /// As [`gradient`](Self::gradient).
    pub fn truncated_gradient(
        &self,
        theta: &[f64; DIM],
    ) -> Result<(Evaluation, [f64; DIM]), Rejection> {
        with_buffers(|b| self.gradient_of(theta, Adjoint::Truncated, Threads::One, b))
    }

    fn value(
        &self,
        theta: &[f64; DIM],
        threads: Threads,
        b: &mut Buffers,
    ) -> Result<Evaluation, Rejection> {
        let params = StreamParams::from_array(*theta);
        let observation = Observation::from(&params);
        observation.check()?;
        let grid = self.track.grid_from(observation.phi0_deg);
        let input = self.input(&params, threads);
        (self.host).particles(&self.model, &input, &mut b.memory, &mut b.work)?;
        self.sum(&grid, threads, &b.work, &mut b.sums, &mut b.partial_sums);
        let ln_likelihood = self.track.ln_likelihood(&b.sums, &observation)?;
        Ok(Evaluation {
            ln_likelihood,
            tally: b.work.particles.tally,
        })
    }

    fn gradient_of(
        &self,
        theta: &[f64; DIM],
        adjoint: Adjoint,
        threads: Threads,
        b: &mut Buffers,
    ) -> Result<(Evaluation, [f64; DIM]), Rejection> {
        let params = StreamParams::from_array(*theta);
        let observation = Observation::from(&params);
        observation.check()?;
        let grid = self.track.grid_from(observation.phi0_deg);
        let Buffers {
            work,
            sums,
            partial_sums,
            sums_bar,
            ..
        } = b;
        let mut of_track = None;
        let mut of_particles = |work: &mut Workspace| {
            self.sum(&grid, threads, work, sums, partial_sums);
            let (ln_likelihood, observation_bar) = self.track.vjp(sums, &observation, sums_bar)?;
            let Workspace {
                particles,
                x_bar,
                y_bar,
                vz_bar,
                weight_bar,
                mean_square_weight_bar,
                ..
            } = work;
            let columns = [x_bar, y_bar, vz_bar, weight_bar];
            let offset_bar = grid.vjp(particles, sums_bar, columns);
            *mean_square_weight_bar = sums_bar.mean_square_weight;
            of_track = Some((ln_likelihood, observation_bar, offset_bar));
            Ok(())
        };
        let input = self.input(&params, threads);
        let gradient =
            (self.host).gradient(&self.model, &input, adjoint, work, &mut of_particles)?;
        let Some((ln_likelihood, observation_bar, offset_bar)) = of_track else {
            return Err(Rejection::BadLikelihood);
        };
        let tally = work.particles.tally;
        let mut gradient = StreamParams::from_array(gradient);
        gradient.jitter += observation_bar.jitter;
        gradient.distance_factor += observation_bar.distance_factor;
        gradient.v_host_km_s += observation_bar.v_host_km_s;
        gradient.log10_n_stars += observation_bar.log10_n_stars;
        // The bins of the data are at phi - phi0 from the progenitor.
        gradient.phi0_deg -= offset_bar;
        let gradient = gradient.to_array();
        if gradient.iter().all(|g| g.is_finite()) {
            let evaluation = Evaluation {
                ln_likelihood,
                tally,
            };
            Ok((evaluation, gradient))
        } else {
            Err(Rejection::BadLikelihood)
        }
    }

    /// Writes the sums of the particles over the bins of `grid`.
    fn sum(
        &self,
        grid: &BinGrid,
        threads: Threads,
        work: &Workspace,
        sums: &mut Sums<f64>,
        partial_sums: &mut PartialSums,
    ) {
        match threads {
            Threads::One => grid.sum(&work.particles, sums, partial_sums),
            Threads::All => grid.sum_in_parallel(&work.particles, sums),
        }
        if self.track.has(BinQuantity::Velocity) {
            grid.sum_velocities(&work.particles, sums);
        }
    }

    /// ln L on any number type, particle by particle, in the host `H`, which must be the model's: slow. On `f64` it is the reference for [`ln_likelihood`](Self::ln_likelihood), on
    /// [`Dual`](crate::scalar::Dual) numbers for [`gradient`](Self::gradient).
    ///
    /// # Errors
    /// As [`ln_likelihood`](Self::ln_likelihood).
    pub fn ln_likelihood_on<H: CompiledHost, S: Real>(
        &self,
        params: &StreamParams<S>,
    ) -> Result<S, Rejection> {
        let observation = Observation::from(params);
        observation.check()?;
        let settings = self.model.settings();
        // The adaptive steps are those of the computation in lanes.
        let real_parts = params.map(Real::re);
        let mut in_lanes = Particles::default();
        let system = System::<f64, H>::with_host(&real_parts, self.q_range, settings);
        self.model.integrate(
            &self.model.progenitor_solution(&system)?,
            &mut StepSchedules::default(),
            &mut in_lanes,
        )?;
        let system = System::<S, H>::with_host(params, self.q_range, settings);
        let solution = self.model.progenitor_solution(&system)?;
        let particles = self
            .model
            .integrate_one_by_one(&solution, &in_lanes.step_sizes)?;
        let mut sums = Sums::default();
        let neighbourhood = self.model.table().neighbourhood.as_deref();
        let grid = self.track.grid_from(real_parts.phi0_deg);
        let offset_deg = -observation.phi0_deg + self.track.grid().offset_deg;
        let velocities = self.track.has(BinQuantity::Velocity);
        let per_release_time = self.model.table().per_release_time;
        let weights: Vec<S> = (solution.releases)
            .weights_of_particles(per_release_time)
            .collect();
        grid.sum_final_particles(
            &particles,
            &weights,
            neighbourhood,
            offset_deg,
            velocities,
            &mut sums,
        );
        sums.mean_square_weight = solution.releases.mean_square_weight;
        self.track.ln_likelihood(&sums, &observation)
    }

    /// The track of a parameter set as it would be measured, with the data's bins: their width, offset and edges, every bin that is covered,
    /// angles as in the data, and radii by the distance of the data. The particles are those of the model.
    ///
    /// # Errors
    /// [`Rejection::BadParameter`], [`Rejection::BadOrbit`], [`Rejection::UnresolvedOrbit`] or [`Rejection::BadParticle`] where there
    /// is no stream.
    pub fn track_at(&self, params: &StreamParams<f64>) -> Result<(Track, Particles), Rejection> {
        let particles = self.particles_at(params)?;
        let track = self.measured(&particles, params, 0.0);
        Ok((track, particles))
    }

    /// As [`track_at`](Self::track_at), as a curve: bins that move along phi in `per_bin` steps for each bin width, in the order of phi. Every `per_bin`-th point is one of the track.
    ///
    /// # Errors
    /// As of [`track_at`](Self::track_at).
    pub fn curve_at(
        &self,
        params: &StreamParams<f64>,
        per_bin: u32,
    ) -> Result<(Vec<TrackBin>, Particles), Rejection> {
        let particles = self.particles_at(params)?;
        let step_deg = self.track.grid_from(0.0).width_deg / f64::from(per_bin);
        let tracks =
            (0..per_bin).map(|k| self.measured(&particles, params, f64::from(k) * step_deg));
        let mut curve: Vec<TrackBin> = tracks.flat_map(|track| track.bins).collect();
        curve.sort_by(|a, b| a.phi_deg.total_cmp(&b.phi_deg));
        Ok((curve, particles))
    }

    fn particles_at(&self, params: &StreamParams<f64>) -> Result<Particles, Rejection> {
        Observation::from(params).check()?;
        let mut work = Workspace::default();
        let input = self.input(params, Threads::All);
        (self.host).particles(&self.model, &input, &mut None, &mut work)?;
        Ok(work.particles)
    }

    /// The track of particles in the data's bins, moved along phi.
    fn measured(&self, particles: &Particles, params: &StreamParams<f64>, moved_deg: f64) -> Track {
        let grid = self.track.grid_from(params.phi0_deg);
        let track = Track::from_checked(
            particles,
            grid.width_deg,
            grid.offset_deg + moved_deg,
            grid.edges,
            self.track.threshold().max(1.0),
        );
        track.measured_with(params)
    }
}
