//! Vector-Jacobian product of the progenitor solution, in forward mode: the solution is computed on dual numbers, whose derivatives are
//! multiplied by those of the result with respect to the solution (docs/physics.md, section 8).

use super::cotangents::{Cotangents, SharedCotangent};
use super::model::Model;
use super::progenitor_solution::release_frame;
use super::system::{SYSTEM_LEN, System};
use crate::orbit::{DenseOrbit, NodeTimes};
use crate::potential::{Halo, Potential};
use crate::scalar::{Isa, Kernel, LANES, LaneDual, Lanes, Level, Scalar, Vec3, compile_kernel};
use std::marker::PhantomData;

/// The vector-Jacobian product of a progenitor solution.
pub struct SolutionVjpKernel<'a, H: Halo> {
    pub(super) model: &'a Model,
    pub(super) system: &'a System<f64, H>,
    /// The times of the orbit's nodes.
    pub(super) times: &'a NodeTimes,
    /// Derivatives of the result with respect to the solution.
    pub(super) solution_bar: &'a Cotangents,
}

/// Number of lane arrays that hold the derivatives with respect to the vector of a system.
const VECTORS: usize = SYSTEM_LEN.div_ceil(LANES);

impl<H: Halo> Kernel for SolutionVjpKernel<'_, H> {
    type Output = [f64; SYSTEM_LEN];

    #[inline(always)]
    fn run<I: Isa>(self) -> Self::Output {
        let Self {
            model,
            system,
            times,
            solution_bar,
        } = self;
        let mut vector = [LaneDual::<I, VECTORS>::zero(); SYSTEM_LEN];
        for (i, number) in system.to_vector().into_iter().enumerate() {
            vector[i] = LaneDual::variable(number, i);
        }
        let system = System::<_, H>::from_vector(vector);
        let orbit = DenseOrbit::integrate_at(
            &OutOfLine::<I, _>::new(&system.host),
            system.today,
            system.age_gyr,
            times,
            model.settings.orbit,
        );
        let mut sum = Contraction::<I>(Lanes::zero());
        for (node, node_bar) in orbit.nodes.iter().zip(&solution_bar.nodes) {
            for row in 0..3 {
                sum.add_vec(&node.vector(row), node_bar.vector(row));
            }
        }
        for (tau, frame_bar) in model.table.taus.iter().zip(&solution_bar.release_frames) {
            let (release_frame, _) = release_frame(
                &system.host,
                &system.progenitor,
                &orbit,
                *tau,
                model.table.recipe,
            );
            sum.add_vec(&release_frame.state.x, frame_bar.state.x);
            sum.add_vec(&release_frame.state.v, frame_bar.state.v);
            for c in 0..3 {
                sum.add_vec(&release_frame.position[c], frame_bar.position[c]);
                sum.add_vec(&release_frame.velocity[c], frame_bar.velocity[c]);
            }
        }
        // The particles depend on potentials and age directly too.
        let SharedCotangent {
            host,
            progenitor,
            age_gyr,
        } = solution_bar.shared;
        let halo = H::parameters(&system.host);
        sum.add(&halo.mass, host.ln_mass / halo.mass.re);
        sum.add(&halo.r_s, host.ln_r_s / halo.r_s.re);
        sum.add(&halo.flattening, host.flattening);
        sum.add_vec(&halo.axis, host.axis);
        sum.add(
            &system.progenitor.mass,
            progenitor.ln_mass / system.progenitor.mass.re,
        );
        sum.add(&system.progenitor.r_s, progenitor.r_s);
        sum.add(&system.age_gyr, age_gyr);
        let mut gradient = [0.0; SYSTEM_LEN];
        let lanes = sum.0.store();
        gradient.copy_from_slice(&lanes.0.as_flattened()[..SYSTEM_LEN]);
        gradient
    }
}

compile_kernel!(SolutionVjpKernel<H: crate::potential::Halo>);

/// Runs the kernel for an instruction set.
pub(super) fn progenitor_solution_vjp<H: Halo>(
    kernel: SolutionVjpKernel<'_, H>,
    level: Level,
) -> [f64; SYSTEM_LEN] {
    kernel.dispatch(level)
}

/// A potential whose acceleration is called and not inlined: on dual numbers it is long, and a step of the orbit evaluates it several
/// times.
struct OutOfLine<'a, I, P>(&'a P, PhantomData<I>);

impl<'a, I, P> OutOfLine<'a, I, P> {
    fn new(potential: &'a P) -> Self {
        Self(potential, PhantomData)
    }
}

impl<I: Isa, P: Potential<LaneDual<I, VECTORS>>> Potential<LaneDual<I, VECTORS>>
    for OutOfLine<'_, I, P>
{
    #[inline(always)]
    fn value(&self, x: Vec3<LaneDual<I, VECTORS>>) -> LaneDual<I, VECTORS> {
        self.0.value(x)
    }

    #[inline(always)]
    fn acceleration(&self, x: Vec3<LaneDual<I, VECTORS>>) -> Vec3<LaneDual<I, VECTORS>> {
        I::call(Acceleration {
            potential: self.0,
            x,
        })
    }

    #[inline(always)]
    fn hessian_product(
        &self,
        x: Vec3<LaneDual<I, VECTORS>>,
        v: Vec3<LaneDual<I, VECTORS>>,
    ) -> Vec3<LaneDual<I, VECTORS>> {
        self.0.hessian_product(x, v)
    }
}

/// The acceleration as a kernel, for [`Isa::call`].
struct Acceleration<'a, I: Isa, P> {
    potential: &'a P,
    x: Vec3<LaneDual<I, VECTORS>>,
}

impl<I: Isa, P: Potential<LaneDual<I, VECTORS>>> Kernel for Acceleration<'_, I, P> {
    type Output = Vec3<LaneDual<I, VECTORS>>;

    /// `Same` is `I`, the instruction set of the fields.
    #[inline(always)]
    fn run<Same: Isa>(self) -> Self::Output {
        self.potential.acceleration(self.x)
    }
}

/// The sum over numbers of the derivative of the result with respect to the number times the number's derivatives: the chain rule.
struct Contraction<I: Isa>(Lanes<I, VECTORS>);

impl<I: Isa> Contraction<I> {
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
