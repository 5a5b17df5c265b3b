//! Vector-Jacobian product of the progenitor solution, in forward mode: the solution is computed on dual numbers, whose derivatives are
//! multiplied by those of the result with respect to the solution (docs/physics.md, section 8).

use super::cotangents::{Cotangents, SharedCotangent, WeightCotangents};
use super::friction::WithFriction;
use super::model::Model;
use super::progenitor_solution::{ReleaseAt, friction, release_at, release_law};
use super::release_rate::normalise;
use super::system::{HALO_LEN, SYSTEM_LEN, System};
use crate::orbit::{Conservative, DenseOrbit, NodeTimes};
use crate::potential::{Baryons, Called, Host, HostParts};
use crate::scalar::{Isa, Kernel, LANES, LaneDual, Lanes, Level, Scalar, Vec3, compile_kernel};

/// The vector-Jacobian product of a progenitor solution.
pub struct SolutionVjpKernel<'a, H: Host> {
    pub(super) model: &'a Model,
    pub(super) system: &'a System<f64, H>,
    /// The times of the orbit's nodes.
    pub(super) times: &'a NodeTimes,
    /// Derivatives of the result with respect to the solution.
    pub(super) solution_bar: &'a Cotangents,
    /// Derivatives of the result with respect to the weights of the release times.
    pub(super) weights_bar: &'a WeightCotangents,
}

/// Number of lane arrays that hold the derivatives with respect to the vector of a system without baryons, and of any.
const HALO_VECTORS: usize = HALO_LEN.div_ceil(LANES);
const ALL_VECTORS: usize = SYSTEM_LEN.div_ceil(LANES);

impl<H: Host> Kernel for SolutionVjpKernel<'_, H> {
    type Output = [f64; SYSTEM_LEN];

    #[inline(always)]
    fn run<I: Isa>(self) -> Self::Output {
        if H::IS_GALAXY {
            self.with_vectors::<I, ALL_VECTORS>()
        } else {
            self.with_vectors::<I, HALO_VECTORS>()
        }
    }
}

impl<H: Host> SolutionVjpKernel<'_, H> {
    /// As [`run`](Self::run), with the derivatives in `VECTORS` lane arrays.
    #[inline(always)]
    fn with_vectors<I: Isa, const VECTORS: usize>(self) -> [f64; SYSTEM_LEN] {
        let Self {
            model,
            system,
            times,
            solution_bar,
            weights_bar,
        } = self;
        let mut vector = [LaneDual::<I, VECTORS>::zero(); SYSTEM_LEN];
        for (i, number) in system.to_vector().into_iter().enumerate() {
            if i < VECTORS * LANES {
                vector[i] = LaneDual::variable(number, i);
            }
        }
        let system = system.with_vector(vector);
        // On dual numbers the force is long, and a step of the orbit evaluates it several times.
        let host = Called(&system.host);
        let (today, age_gyr, method) = (system.today, system.age_gyr, model.settings.orbit);
        let orbit = if let Some(friction) = friction(&system, &model.settings) {
            let host = &host;
            let force = WithFriction { host, friction };
            DenseOrbit::integrate_at(&force, today, age_gyr, times, method)
        } else {
            DenseOrbit::integrate_at(&Conservative(&host), today, age_gyr, times, method)
        };
        let law = release_law(&system, &model.settings);
        let mut weights = Vec::new();
        let mut sum = Contraction::<I, VECTORS>(Lanes::zero());
        for (node, node_bar) in orbit.nodes.iter().zip(&solution_bar.nodes) {
            for row in 0..3 {
                sum.add_vec(&node.vector(row), node_bar.vector(row));
            }
        }
        for (k, frame_bar) in solution_bar.release_frames.iter().enumerate() {
            let ReleaseAt {
                frame: release_frame,
                weight,
                ..
            } = release_at(
                &system.host,
                system.progenitor.mass,
                &orbit,
                &law,
                &model.table,
                k,
            );
            if !law.is_even() {
                weights.push(weight);
            }
            sum.add_vec(&release_frame.state.x, frame_bar.state.x);
            sum.add_vec(&release_frame.state.v, frame_bar.state.v);
            for c in 0..3 {
                sum.add_vec(&release_frame.position[c], frame_bar.position[c]);
                sum.add_vec(&release_frame.velocity[c], frame_bar.velocity[c]);
            }
        }
        if !law.is_even() {
            let mean_square = normalise(&mut weights);
            sum.add(&mean_square, weights_bar.mean_square);
            for (weight, weight_bar) in weights.iter().zip(&weights_bar.of_release_times) {
                sum.add(weight, *weight_bar);
            }
        }
        // The particles depend on potentials and age directly too.
        let SharedCotangent {
            host,
            progenitor,
            age_gyr,
        } = solution_bar.shared;
        let HostParts { halo, baryons, .. } = H::parts(&system.host);
        sum.add(&halo.mass, host.halo.ln_mass / halo.mass.re);
        sum.add(&halo.r_s, host.halo.ln_r_s / halo.r_s.re);
        sum.add(&halo.flattening, host.halo.flattening);
        sum.add_vec(&halo.axis, host.halo.axis);
        sum.add(&halo.second.flattening, host.halo.second.flattening);
        sum.add_vec(&halo.second.axis, host.halo.second.axis);
        let Baryons { disc, bulge } = baryons;
        // A part without mass is absent.
        if disc.mass.re > 0.0 {
            let disc_bar = host.baryons.disc;
            sum.add(&disc.mass, disc_bar.ln_mass / disc.mass.re);
            sum.add(&disc.r_s, disc_bar.ln_r_s / disc.r_s.re);
            sum.add_vec(&disc.normal, disc_bar.normal);
        }
        if bulge.mass.re > 0.0 {
            let bulge_bar = host.baryons.bulge;
            sum.add(&bulge.mass, bulge_bar.ln_mass / bulge.mass.re);
            sum.add(&bulge.r_s, bulge_bar.ln_r_s / bulge.r_s.re);
        }
        sum.add(
            &system.progenitor.mass,
            progenitor.ln_mass / system.progenitor.mass.re,
        );
        sum.add(&system.progenitor.r_s, progenitor.r_s);
        sum.add(&system.mass_loss, progenitor.mass_loss);
        sum.add(&system.age_gyr, age_gyr);
        let mut gradient = [0.0; SYSTEM_LEN];
        let lanes = sum.0.store();
        for (number, lane) in gradient.iter_mut().zip(lanes.0.as_flattened()) {
            *number = *lane;
        }
        gradient
    }
}

compile_kernel!(SolutionVjpKernel<H: crate::potential::Host>);

/// Runs the kernel for an instruction set.
pub(super) fn progenitor_solution_vjp<H: Host>(
    kernel: SolutionVjpKernel<'_, H>,
    level: Level,
) -> [f64; SYSTEM_LEN] {
    kernel.dispatch(level)
}

/// The sum over numbers of the derivative of the result with respect to the number times the number's derivatives: the chain rule.
struct Contraction<I: Isa, const VECTORS: usize>(Lanes<I, VECTORS>);

impl<I: Isa, const VECTORS: usize> Contraction<I, VECTORS> {
    #[inline(always)]
    fn add(&mut self, number: &LaneDual<I, VECTORS>, number_bar: f64) {
        self.0 = number.eps.mul_add(Lanes::from_f64(number_bar), self.0);
    }

    #[inline(always)]
    fn add_vec(&mut self, vector: &Vec3<LaneDual<I, VECTORS>>, vector_bar: Vec3<f64>) {
        self.add(&vector.x, vector_bar.x);
        self.add(&vector.y, vector_bar.y);
        self.add(&vector.z, vector_bar.z);
    }
}
